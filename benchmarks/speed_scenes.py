"""Speed on meshes and a medium against Mitsuba 3: the same files and settings, alternating.

Two displaced icospheres (81,920 and 1,310,720 triangles, face normals, albedo 0.8, max_depth 8,
rr_depth 5) and a sphere of glass (index 1.3) around a scattering medium (sigma_t 16, albedo 0.9,
max_depth 128, rr_depth 64), each under a constant sky; box filter, independent sampler. Both read
the same XML and PLY, made in a temporary folder. Against cuda_ad_rgb on a GPU, llvm_ad_rgb on the
CPU. Per round and contestant: seconds until the film is complete in device memory (`seconds`), of
the whole call to a picture in NumPy with all that belongs to it (`wall`), own CPU time (`cpu`).
Medians, spread (largest less smallest over the median) and the median of the rounds' ratios, after
a warm-up. A row whose pictures differ in the mean by more than chance and 1e-4 (Mitsuba leaves
surfaces by a fixed share of the coordinates) is void: no medians, no ratios, exit status 1.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import mitsuba_peer
import numpy as np
from common import (
    Mitsuba,
    Ours,
    cpu_count,
    header,
    means_agree,
    median,
    parser,
    spread,
    wait_quiet,
    write,
    write_ply,
)

import veriray
from veriray.validate.leaks import displaced_icosphere

SCENE = """<scene version="3.0.0">
    <default name="width" value="512"/>
    <default name="height" value="512"/>
    <integrator type="{integrator}">
        <integer name="max_depth" value="{max_depth}"/>
        <integer name="rr_depth" value="{rr_depth}"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world">
            <lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <rfilter type="box"/>
        </film>
        <sampler type="independent"/>
    </sensor>
    <emitter type="constant">
        <rgb name="radiance" value="1, 1, 1"/>
    </emitter>
    {shape}
</scene>
"""
MESH = """<shape type="ply">
        <string name="filename" value="{name}.ply"/>
        <boolean name="face_normals" value="true"/>
        <bsdf type="diffuse">
            <rgb name="reflectance" value="0.8, 0.8, 0.8"/>
        </bsdf>
    </shape>"""
GLASS = """<shape type="sphere">
        <bsdf type="dielectric">
            <float name="int_ior" value="1.3"/>
            <float name="ext_ior" value="1"/>
        </bsdf>
        <medium type="homogeneous" name="interior">
            <float name="sigma_t" value="16"/>
            <rgb name="albedo" value="0.9, 0.9, 0.9"/>
            <phase type="isotropic"/>
        </medium>
    </shape>"""
MARGIN = 1e-4
LEVELS = {"icosphere_82k": 6, "icosphere_1.3M": 8}
SCENES = (*LEVELS, "glass_medium")


def settings(name: str) -> dict[str, Any]:
    """Integrator and depths of a scene."""
    if name in LEVELS:
        return {"integrator": "path", "max_depth": 8, "rr_depth": 5}
    return {"integrator": "volpath", "max_depth": 128, "rr_depth": 64}


def make(name: str, folder: Path) -> Path:
    """The scene's file, its mesh beside it."""
    shape = GLASS
    if name in LEVELS:
        write_ply(folder / f"{name}.ply", *displaced_icosphere(LEVELS[name]))
        shape = MESH.format(name=name)
    path = folder / f"{name}.xml"
    path.write_text(SCENE.format(shape=shape, **settings(name)))
    return path


def race(
    contestants: dict[str, Any], spp: int, rounds: int, quiet: float, faster: str
) -> dict[str, Any]:
    """Alternating rounds of "ours" and, if there is one, "mitsuba". faster: the ratio to print."""
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in contestants}
    images: dict[str, list[np.ndarray]] = {name: [] for name in contestants}
    for seed in range(rounds + 1):
        for name, contestant in contestants.items():
            if seed and quiet:
                wait_quiet(quiet)
            row, image = contestant.run(spp, seed)
            if seed:
                rows[name].append({"seed": seed, **row})
                images[name].append(image)
    last = contestants["ours"].last
    paths = last.stats["paths"]
    out: dict[str, Any] = {"void": False}
    if "mitsuba" in rows:
        out["agreement"] = means_agree(images["ours"], images["mitsuba"], last.stderr, MARGIN)
        out["void"] = not out["agreement"]["agree"]
        if out["void"]:
            return {**out, "rounds": rows}
        out["times_faster"] = {}
        for key in ("seconds", "wall", "cpu"):
            each = [t[key] / o[key] for o, t in zip(rows["ours"], rows["mitsuba"], strict=True)]
            out["times_faster"][key] = {
                "median": float(np.median(each)), "spread": spread(each), "rounds": each,
            }  # fmt: skip
    for name, r in rows.items():
        out[name] = {
            **{key: median(r, key) for key in ("seconds", "wall", "cpu")},
            "spread": {key: spread(row[key] for row in r) for key in ("seconds", "wall")},
            "mpaths_per_second": paths / median(r, faster) / 1e6,
            "rounds": r,
        }
    rays = last.stats["rays"] / paths
    out["ours"] |= {
        "mrays_per_second": rays * out["ours"]["mpaths_per_second"],
        "rays_per_path": rays,
        "film_sha256": last.film_sha256,
        "film_seed": rounds,
        **{key: last.stats[key] for key in ("scheduler", "threads", "variant", "path_bytes",
                                            "primitives", "tree")},
    }  # fmt: skip
    return out


def run(name: str, path: Path, mi: Any, args: Any, faster: str) -> dict[str, Any]:
    """One row: both contestants on the file at `path`."""
    size = args.size or (512 if name not in LEVELS or faster == "wall" else 1024)
    film = {"width": size, "height": size}
    begin = time.perf_counter()
    scene = veriray.load_file(path, film)
    veriray.render(scene, spp=1, device=args.device, threads=args.threads)
    loaded = {"ours": time.perf_counter() - begin}
    contestants: dict[str, Any] = {
        "ours": Ours(scene, args.device, scheduler=args.scheduler, threads=args.threads)
    }
    if mi is not None:
        begin = time.perf_counter()
        contestants["mitsuba"] = Mitsuba(mi, path, **film)
        contestants["mitsuba"].run(1, 0)
        loaded["mitsuba"] = time.perf_counter() - begin
    row = race(contestants, args.spp, args.rounds, args.quiet, faster)
    return {**film, "spp": args.spp, **settings(name), "seconds_to_first_sample": loaded, **row}


def report(name: str, row: dict[str, Any], faster: str) -> None:
    """One line for people."""
    if row["void"]:
        print(f"{name}: THE MEANS DIFFER, the row is void: {row['agreement']}", flush=True)
        return
    text = f"{name}, {row['width']} x {row['height']}, {row['spp']} spp:"
    for who in ("ours", "mitsuba"):
        if who in row:
            text += (f" {who} {row[who]['mpaths_per_second']:.2f} Mpaths/s "
                     f"(spread {row[who]['spread'][faster]:.1%})")  # fmt: skip
    if "times_faster" in row:
        ratio = row["times_faster"]
        text += f", {ratio[faster]['median']:.2f} x by {faster}"
        if faster == "wall":
            text += f", {ratio['cpu']['median']:.2f} x by CPU time"
        z = max(abs(z) for z in row["agreement"]["z"])
        text += f", means agree (|z| {z:.1f})"
    print(text, flush=True)


def main() -> int:
    """Command line."""
    p = parser(__doc__, "speed_scenes_DEVICE.json")
    p.add_argument("scenes", nargs="*", help=f"of {', '.join(SCENES)}; default: all")
    p.add_argument("--device", default="cuda")
    p.add_argument("--size", type=int, help="width and height; default 1024; medium and CPU 512")
    p.add_argument("--spp", type=int, default=64)
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument("--scheduler", default="fused")
    p.add_argument("--threads", type=int, default=None)
    p.add_argument("--quiet", type=float, default=0, help="seconds to wait for an idle machine")
    p.add_argument("--peer", help="variant of Mitsuba, or 'none'; default: the device's")
    args = p.parse_args()
    unknown = set(args.scenes) - set(SCENES)
    if unknown:
        p.error(f"unknown scenes: {', '.join(unknown)}")
    chosen, _ = veriray.device.select(args.device)
    variant = args.peer or ("cuda_ad_rgb" if chosen.backend == "cuda" else "llvm_ad_rgb")
    faster = "seconds" if chosen.backend == "cuda" else "wall"
    mi, why = None, "not asked for"
    if variant != "none":
        try:
            mi, why = mitsuba_peer.start(variant), ""
        except (ImportError, RuntimeError) as error:
            why = str(error)
            print(f"no peer: {why}")
    result = header("speed_scenes", "mitsuba", "drjit")
    if mi is not None:
        result["versions"]["mitsuba"] = mi.__version__
    result["device"] = {"name": chosen.name, "description": chosen.description, **chosen.details}
    result["build"] = chosen.native.build_info()
    result["settings"] = {
        "filter": "box", "sampler": "independent", "rounds": args.rounds, "spp": args.spp,
        "scheduler": args.scheduler, "threads": args.threads or cpu_count(),
        "ratio_by": faster, "peer": variant if mi else None, "no_peer": why or None,
    }  # fmt: skip
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in args.scenes or SCENES:
            rows[name] = run(name, make(name, Path(folder)), mi, args, faster)
            report(name, rows[name], faster)
    name = args.output.name.replace("DEVICE", chosen.backend)
    write({**result, "rows": rows}, args.output.with_name(name))
    return 1 if any(row["void"] for row in rows.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
