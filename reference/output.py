"""EXR output of a reference picture.

One part, ZIP, FLOAT channels R, G, B, stderr.R/G/B and batch.NNN.R/G/B; header strings
``veriray.*``: the layout that veriray's own files have, written by code of its own. Two strings
differ in meaning: ``veriray.film_sha256`` is the hash of the batch means (float64, little-endian,
batch by batch, row by row), and ``veriray.scene_sha256`` is left out, since that hash is of
veriray's scene object; the hash of the scene's files is in ``veriray.stats``.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from reference import __version__
from reference.paths import COLUMNS
from reference.render import Picture
from reference.tracer import embree_version


def summary(picture: Picture) -> dict[str, Any]:
    """What was rendered and how, as JSON types; mean and mean standard error per channel."""
    scene = picture.scene
    return {
        "device": f"reference: {embree_version()}",
        "scene_files_sha256": scene.digest,
        "width": scene.film.width,
        "height": scene.film.height,
        "filter": scene.film.filter,
        "spp": picture.spp,
        "seed": picture.seed,
        "batches": len(picture.batch_means),
        "max_depth": scene.max_depth,
        "rr_depth": scene.rr_depth,
        "seconds": picture.seconds,
        "rays": int(picture.ledger[:, [0, -2, -1]].sum()),
        "mean": picture.mean.mean(axis=(0, 1)).tolist(),
        "mean_stderr": picture.stderr.mean(axis=(0, 1)).tolist(),
        "ledger": {name: picture.ledger[:, i].tolist() for i, name in enumerate(COLUMNS)},
    }


def write_exr(picture: Picture, path: str | Path) -> None:
    """Write to a temporary file beside ``path`` and rename. OSError names the path."""
    path = Path(path)
    stats = summary(picture)
    film = hashlib.sha256(np.ascontiguousarray(picture.batch_means, "<f8").tobytes()).hexdigest()
    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "veriray.format": "1",
        "veriray.renderer": "reference",
        "veriray.version": __version__,
        "veriray.scheduler": "batches",
        "veriray.features": "[]",
        "veriray.film_sha256": film,
        "veriray.ledger": json.dumps(stats.pop("ledger")),
        "veriray.stats": json.dumps(stats),
    }
    for key in ("device", "seed", "spp", "batches", "max_depth", "rr_depth", "seconds"):
        header[f"veriray.{key}"] = str(stats[key])
    images = {"": picture.mean, "stderr.": picture.stderr}
    images |= {f"batch.{k:03d}.": mean for k, mean in enumerate(picture.batch_means)}
    channels = {
        prefix + "RGB"[c]: np.ascontiguousarray(image[..., c], np.float32)
        for prefix, image in images.items()
        for c in range(3)
    }
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        os.close(handle)
        OpenEXR.File(header, channels).write(temporary)
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:
        raise OSError(f"{path}: cannot write: {error}") from error
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)


def read_exr(path: str | Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Channels (H, W) float32 by name, and the ``veriray.*`` strings without their prefix."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels.copy() for name, channel in file.channels().items()}
        strings = {k[8:]: v for k, v in file.header().items() if k.startswith("veriray.")}
    return channels, strings
