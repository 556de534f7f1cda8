"""Level 6: files hold what the film holds, as read without the code that wrote them."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import veriray
from veriray.image import load_with_regions
from veriray.picture import Render, film_hash
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]

SPP = 16


def rendered(t: Trial, what: str) -> Render:
    """A picture with batches, or one whose tiles have different numbers of samples."""
    scene = veriray.cornell_box().with_(width=40, height=24)
    more = {"batches": 4} if what == "batches" else {"target_error": 0.05}
    r = t.render(scene, SPP if what == "batches" else 64 * SPP, **more)
    t.check((r.image[..., 0] != r.image[..., 2]).mean() > 0.9, "red and blue are alike")
    return r


@case(6, each={"what": ("batches", "samples")})
def pictures_of_record(t: Trial, what: str) -> None:
    """An EXR file's channels, read by the standard library for it, are the film's numbers.

    Equal by channel: R, G, B and their standard errors bit for bit, means of batches rounded once
    to float32, samples of each pixel, regions. The hash of the data read is the one in the header,
    and `load` returns the same render.
    """
    import OpenEXR

    r = rendered(t, what)
    regions = np.arange(r.width * r.height, dtype=np.uint32).reshape(r.height, r.width)
    pictures = {"": r.image, "stderr.": r.stderr}
    if r.batch_means is not None:
        pictures |= {f"batch.{k:03d}.": m.astype(np.float32) for k, m in enumerate(r.batch_means)}
    wanted: dict[str, Array] = {
        f"{group}{letter}": picture[..., c]
        for group, picture in pictures.items() for c, letter in enumerate("RGB")
    } | {"region": regions}  # fmt: skip
    if r.samples is not None:
        t.check(len(np.unique(r.samples)) > 1, "all tiles have as many samples")
        wanted["samples"] = r.samples
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.exr"
        r.save(path, regions=regions)
        file = OpenEXR.File(str(path), separate_channels=True)
        header, found = file.header(), {k: c.pixels for k, c in file.channels().items()}
        again, masks, _ = load_with_regions(path)
    t.check(found.keys() == wanted.keys(), f"channels {', '.join(found.keys() ^ wanted.keys())}")
    for name, values in wanted.items():
        t.check(found[name].dtype == values.dtype, f"channel {name}: {found[name].dtype}")
        t.check(found[name] == values, f"channel {name}")
    image, error = (np.stack([found[x + c] for c in "RGB"], -1) for x in ("", "stderr."))
    hashed = film_hash(image, error, int(header["veriray.spp"]), found.get("samples"))
    t.check(header["veriray.film_sha256"] == hashed == r.film_sha256, "another hash")
    t.check(int(header["veriray.seed"]) == again.seed == r.seed, "another seed")
    t.check(again.stats["ledger"] == r.stats["ledger"], "another ledger")
    pairs = [(again.image, r.image), (again.stderr, r.stderr), (masks, regions)]
    if r.batch_means is not None:
        pairs.append((again.batch_means, r.batch_means.astype(np.float32)))
    if r.samples is not None:
        pairs.append((again.samples, r.samples))
    t.check(all(np.array_equal(a, b) for a, b in pairs), "load gives another render")


@case(6)
def display_copies(t: Trial) -> None:
    """A PNG file's bytes, decoded by IEC 61966-2-1, are the picture clipped to [0, 1].

    Each of R, G, B within half a step of its byte; an exposure of -1 stop halves it.
    """
    from PIL import Image

    r = rendered(t, "batches")
    for exposure in (0, -1):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "picture.png"
            r.save(path, exposure=exposure)
            with Image.open(path) as picture:
                t.check(picture.mode == "RGB", f"mode {picture.mode}")
                steps = np.asarray(picture, np.float64)
        light = np.clip(r.image.astype(np.float64) * 2.0**exposure, 0, 1)
        low, high = (_linear((steps + half) / 255) for half in (-0.5, 0.5))
        t.check((low <= light) & (light <= high), f"another value with exposure {exposure}")


def _linear(v: Array) -> Array:
    """Radiance of sRGB values."""
    return np.where(v <= 0.04045, v / 12.92, (np.maximum(v, 0.04045) + 0.055) ** 2.4 / 1.055**2.4)
