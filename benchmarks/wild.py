"""Scene files by strangers, read where they lie: whole rooms, and files whose assets are stand-ins.

A folder holds rooms (NAME.tar.xz with NAME/scene.xml and all that it reads) and scenes.tar.xz with
scenes.json (repository, path and version of each file). Nothing of it becomes part of the project.
"""

from __future__ import annotations

import json
import re
import struct
import tarfile
import zlib
from pathlib import Path

import numpy as np
from PIL import Image

from veriray_bench.scenarios import write_ply
from veriray_validate.leaks import displaced_icosphere

_KINDS = "xml|ply|obj|serialized|png|jpg|jpeg|bmp|tga|exr|hdr|spd"
_ASSET = re.compile(rf'(?:value|filename)="([^":,]+\.({_KINDS}))"', re.IGNORECASE)
_DEFAULT = re.compile(r'<default\s+name="([^"]+)"\s+value="([^"]*)"')


def rooms(source: Path, work: Path) -> dict[str, Path]:
    """Name -> scene file of each room, unpacked to `work`."""
    found = {}
    for archive in sorted(source.glob("*.tar.xz")):
        name = archive.name.removesuffix(".tar.xz")
        if name == "scenes":
            continue
        _unpack(archive, work)
        found[name] = work / name / "scene.xml"
    return found


def strangers(source: Path, work: Path) -> dict[str, Path]:
    """Repository/path -> file of each scene of version 2 or 3, with stand-ins for its assets."""
    _unpack(source / "scenes.tar.xz", work)
    found = {}
    for entry in json.loads((source / "scenes.json").read_text("utf-8")):
        path = work / entry["repo"].replace("/", "+") / entry["path"]
        if str(entry["version"])[:1] in ("2", "3") and path.is_file():
            _stand_ins(path, path.parent, work)
            found[f"{entry['repo']}/{entry['path']}"] = path
    return found


def _unpack(archive: Path, work: Path) -> None:
    with tarfile.open(archive) as files:
        files.extractall(work, filter="data")


def _stand_ins(path: Path, folder: Path, work: Path) -> None:
    """Makes what a file and those that it includes name and is not there, inside `work`."""
    text = path.read_text("utf-8", errors="replace")
    defaults = dict(_DEFAULT.findall(text))
    for name, suffix in _ASSET.findall(text):
        full = re.sub(r"\$(\w+)", lambda m: defaults.get(m[1], m[0]), name)
        asset = (folder / full).resolve()
        if "$" in full or not asset.is_relative_to(work.resolve()):
            continue
        if suffix.lower() == "xml" and asset.is_file() and asset != path.resolve():
            _stand_ins(asset, folder, work)
        elif not asset.exists():
            asset.parent.mkdir(parents=True, exist_ok=True)
            _stand_in(asset, suffix.lower())


def _stand_in(path: Path, suffix: str) -> None:
    """A bumpy ball, an image of two colours, or a flat spectrum.

    Balls have sizes and places of their own: what coincides has no one picture.
    """
    v, f = displaced_icosphere(3)
    a, b = np.random.default_rng(zlib.crc32(path.name.encode())).uniform((0.4, -0.5), (1, 0.5))
    v = a * v + b
    texels = np.zeros((8, 16, 3), np.uint8)
    texels[:, :8], texels[:, 8:] = (200, 120, 80), (90, 130, 180)
    if suffix == "ply":
        write_ply(path, v, f, 0.5 + 0.4 * v[:, :2])
    elif suffix == "obj":
        rows = ["v {:.6f} {:.6f} {:.6f}".format(*p) for p in v]
        rows += ["vt {:.6f} {:.6f}".format(*(0.5 + 0.4 * p[:2])) for p in v]
        rows += ["f " + " ".join(f"{k + 1}/{k + 1}" for k in t) for t in f.tolist()]
        path.write_text("\n".join(rows) + "\n")
    elif suffix == "serialized":
        body = struct.pack("<I", 0x1000) + b"m\0" + struct.pack("<QQ", len(v), len(f))
        body += v.astype("<f4").tobytes() + f.astype("<u4").tobytes()
        mesh = struct.pack("<HH", 0x041C, 4) + zlib.compress(body)
        count = 64
        starts = (struct.pack("<Q", k * len(mesh)) for k in range(count))
        path.write_bytes(mesh * count + b"".join(starts) + struct.pack("<I", count))
    elif suffix in ("png", "jpg", "jpeg", "bmp", "tga"):
        Image.fromarray(texels).save(path)
    elif suffix == "exr":
        import OpenEXR

        head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(head, {"RGB": (texels / 160).astype(np.float32)}).write(str(path))
    elif suffix == "hdr":
        shared = np.concatenate([texels, np.full((8, 16, 1), 129, np.uint8)], axis=2)
        path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + shared.tobytes())
    elif suffix == "spd":
        path.write_text("\n".join(f"{w} 0.5" for w in range(360, 840, 20)) + "\n")
