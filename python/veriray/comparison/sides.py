"""One side of a comparison: a render, its file, another program's picture, or many of these.

Recognised layouts of EXR files, by the names of channels and the header
-----------------------------------------------------------------------
- ours (`veriray.image`), also as other programs write it: R G B with `stderr.R` ...
- Cycles: `LAYER.Combined.R`; samples from the header `cycles.LAYER.samples`.
- pbrt-v4: R G B, and of a gbuffer film `Variance.R`: the variance of one sample, which with the
  number of samples gives the standard error.
- Mitsuba 3: R G B. The moments of its `moment` integrator are of X, Y, Z and not used.
- LuxCore and others: R G B, or `Y` alone; any one layer that has R, G and B.

Several parts are read as one. N pictures of one scene with N seeds are N batches: they need no
statement of samples. A picture of luminance stands for R, G and B alike, and makes that of the
other side. Half floats are rounded by up to 2^-11, which the tests then leave alone.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from veriray.errors import ImageError
from veriray.image import load_with_regions
from veriray.loading import MAX_BYTES, read_exr, read_header
from veriray.numeric import path_text, whole
from veriray.picture import Render
from veriray.settings import MAX_BATCHES, MAX_SPP
from veriray.units import GROUP

Array = NDArray[Any]
Path = str | os.PathLike[str]
Source = Render | Path | Sequence[Render | Path]
Masks = tuple[Array | None, list[str]]

#: Weights of R, G and B in the luminance of Rec. 709, which EXR files mean by Y.
LUMINANCE = (0.2126, 0.7152, 0.0722)
#: How to get independent pictures out of a program.
SEEDS = {
    "Mitsuba": "mi.render(scene, seed=k)",
    "Cycles": "scene.cycles.seed = k",
    "pbrt": '--seed k (or Film "gbuffer", whose Variance channels give errors)',
    "LuxCore": "renderengine.seed = k",
    "veriray": "--seed k, or one picture with --batches 32",
}


class CompareError(ValueError):
    """Two pictures, or settings, that cannot be compared."""


@dataclass(frozen=True)
class Foreign:
    """A picture from a file.

    image: (H, W, 3) float64. stderr: likewise or None. spp: samples per pixel or None. seed: or
    None. luminance: only Y was there. half: numbers are rounded to half floats.
    """

    image: Array
    stderr: Array | None
    spp: int | None
    renderer: str
    half: bool
    luminance: bool


def opened(
    source: Source, letter: str, channels: str | None = None, spp: int | None = None
) -> tuple[Render, str, Masks]:
    """The render of one side, its name, and the masks of its file.

    letter: "A" or "B". channels: the layer to read ("Combined", "ViewLayer.Combined"), three
    channels "X,Y,Z" or one; None finds it. spp: samples per pixel of each picture where the file
    does not say. Raises as `veriray.compare`.
    """
    if spp is not None:
        spp = whole(f"spp of {letter}", spp, 1, MAX_SPP, error=CompareError)
    if isinstance(source, (Render, str, os.PathLike)):
        render, name, masks = _one(source, letter, channels, spp)
        render = _of_whole_groups(render)
        if render.batch_means is not None and len(render.batch_means) < 2:
            render = replace(render, batch_means=None)
        return render, name, masks
    if isinstance(source, Sequence) and not source:
        raise TypeError(
            f"{letter} is an empty list; expected a Render or a path, or a list of these"
        )
    if not isinstance(source, Sequence):
        kind = type(source).__name__
        raise TypeError(f"{letter} is {kind}; expected a Render or a path, or a list of these")
    if len(source) == 1:
        return opened(source[0], letter, channels, spp)
    if len(source) > MAX_BATCHES:
        raise CompareError(f"{letter}: {len(source)} pictures; expected at most {MAX_BATCHES}")
    return _many(source, letter, channels, spp)


def _of_whole_groups(render: Render) -> Render:
    """The render with batches that are independent of each other: of whole groups of samples.

    Means of batches that cut the groups of `veriray.units` spread more than that of all does, so
    that tests would find less than they state. The batches that fill groups together become one;
    all go where they do not come out even.
    """
    means = render.batch_means
    if means is None or render.stats.get("sampler") != "sobol":
        return render
    each = render.spp // len(means)
    joined = GROUP // math.gcd(each, GROUP)
    if joined == 1:
        return render
    kept, left = divmod(len(means), joined)
    told = f"{joined} are tested as one" if not left else "none is tested"
    note = f"batches of {each} samples cut the groups of {GROUP} that sobol draws: {told}"
    batches = None if left else means.reshape(kept, joined, *means.shape[1:]).mean(axis=1)
    return replace(render, batch_means=batches, stats={**render.stats, "batches_cut": note})


def _one(
    source: Any, letter: str, channels: str | None, spp: int | None
) -> tuple[Render, str, Masks]:
    name = letter
    masks: Masks = (None, [])
    if isinstance(source, Render):
        render = source
    elif isinstance(source, (str, os.PathLike)):
        name = path_text(letter, source, CompareError)
        header, names = read_header(source)
        if channels is None and _is_ours(header, names):
            render, mask, labels = load_with_regions(source)
            masks = mask, labels
        else:
            render = _rendered(read(source, channels, spp))
        render = replace(render, stats={**render.stats, "window": _window(header)})
    else:
        raise TypeError(f"{letter} is {type(source).__name__}; expected a Render or a path")
    if render.stats.get("denoiser"):
        raise CompareError(
            f"{name} is denoised by {render.stats['denoiser']}: its error is unknown; compare what "
            "was rendered"
        )
    return render, name, masks


def _rendered(found: Foreign) -> Render:
    """A picture without batches as a Render."""
    image = found.image.astype(np.float32)
    error = np.full_like(image, np.nan) if found.stderr is None else found.stderr
    height, width, _ = image.shape
    stats = {
        "renderer": found.renderer, "half": found.half, "luminance": found.luminance,
        "filter": None,
    }  # fmt: skip
    spp = found.spp or 0
    return Render(image, error.astype(np.float32), None, "", stats, width, height, spp, 0)


def _many(
    sources: Sequence[Render | Path], letter: str, channels: str | None, spp: int | None
) -> tuple[Render, str, Masks]:
    """Pictures of one scene with their own seeds as the batches of one."""
    renders: list[Render] = []
    names: list[str] = []
    seen: dict[bytes, int] = {}
    masks: Masks = (None, [])
    for k, source in enumerate(sources):
        render, name, found = _one(source, f"{letter}[{k}]", channels, spp)
        masks = found if masks[0] is None else masks
        if renders and render.image.shape != renders[0].image.shape:
            sizes = " and ".join(f"{x.width} x {x.height}" for x in (renders[0], render))
            raise CompareError(f"different sizes in {letter}: {sizes} ({names[0]}, {name})")
        bits = np.ascontiguousarray(render.image).tobytes()
        if (twin := seen.setdefault(bits, k)) != k and np.any(render.image):
            raise CompareError(
                f"{names[twin]} and {name} hold the same picture: each needs its own seed"
                f"{_seeds(_program(render))}"
            )
        renders.append(render)
        names.append(name)
    check_windows([*zip(renders, names, strict=True)])
    counts = {render.spp for render in renders}
    hashes = {str(render.stats.get("scene_sha256") or "") for render in renders}
    for what, values in (("samples per pixel", counts), ("scenes", hashes)):
        if len(values) > 1:
            listed = ", ".join(sorted(map(str, values))[:3])
            raise CompareError(f"{letter} holds pictures of different {what}: {listed}")
    means = np.stack([render.image.astype(np.float64) for render in renders])
    with np.errstate(invalid="ignore"):  # infinite values: S0 finds them
        error = means.std(axis=0, ddof=1) / math.sqrt(len(means))
    first, (each,) = renders[0], counts
    kept = (
        "renderer", "half", "luminance", "scene_sha256", "max_depth", "rr_depth", "features",
        "filter", "filter_parameter", "window",
    )  # fmt: skip
    stats = {name: first.stats[name] for name in kept if name in first.stats}
    stats |= {"pictures": len(means), "spp_unknown": not each}
    made = Render(
        means.mean(axis=0).astype(np.float32), error.astype(np.float32), means, "", stats,
        first.width, first.height, len(means) * (each or 1), first.seed,
    )  # fmt: skip
    return made, f"{names[0]} and {len(names) - 1} more", masks


def alike(a: Render, b: Render) -> tuple[Render, Render]:
    """Both sides, as luminance if one of them is nothing else."""
    grey = [bool(x.stats.get("luminance")) for x in (a, b)]
    if grey[0] == grey[1]:
        return a, b
    made = [x if is_grey else _luminance(x) for x, is_grey in zip((a, b), grey, strict=True)]
    return made[0], made[1]


def _luminance(x: Render) -> Render:
    """A picture in R, G and B as that of its luminance, three times."""

    def of(values: Array) -> Array:
        y = (values.astype(np.float64) * LUMINANCE).sum(axis=-1, keepdims=True)
        return np.repeat(y, 3, axis=-1)

    means = None if x.batch_means is None else of(x.batch_means)
    if means is not None:
        error = means.std(axis=0, ddof=1) / math.sqrt(len(means))
    else:  # the channels go together at most
        error = of(x.stderr)
    return replace(x, image=of(x.image).astype(np.float32), stderr=error.astype(np.float32),
                   batch_means=means, film_sha256="")  # fmt: skip


def advice(x: Render, letter: str) -> str:
    """What to render for a verdict, where a side has no errors; "" if it has."""
    if x.batch_means is not None or np.isfinite(x.stderr).any():
        return ""
    program = _program(x)
    return (
        f"{letter} carries no error: render it 16 times or more, each time with another seed"
        f"{_seeds(program)}, and give all files (--{letter.lower()} FILE FILE ...)"
    )


def _program(x: Render) -> str:
    return str(x.stats.get("renderer") or "")


def _seeds(program: str) -> str:
    how = next((text for name, text in SEEDS.items() if name in program), "")
    return f" ({program}: {how})" if how else ""


# ---- files ----


def _is_ours(header: dict[str, Any], names: list[str]) -> bool:
    """Whether a file has our layout."""
    return "veriray.format" in header or "stderr.R" in names


def _window(header: dict[str, Any]) -> tuple[int, ...]:
    """Where the first pixel lies in the whole picture, and the size of that."""
    low, high = (np.asarray(corner, np.int64) for corner in header["displayWindow"])
    first = np.asarray(header["dataWindow"][0], np.int64)
    return *map(int, first - low), *map(int, high - low + 1)


def check_windows(sides: Sequence[tuple[Render, str]]) -> None:
    """Raises CompareError for two parts of a picture, of one size, that lie apart.

    sides: renders with their names. Whole pictures of different sizes say nothing of where the one
    lies in the other: a cut-out that is a picture of its own may be compared with a part.
    """
    seen: dict[tuple[int, ...], tuple[tuple[int, ...], str]] = {}
    for render, name in sides:
        x, y, *whole = render.stats.get("window") or (0, 0)
        if not whole:
            continue
        (other_x, other_y), other = seen.setdefault((*whole,), ((x, y), name))
        if (x, y) != (other_x, other_y):
            raise CompareError(
                f"different parts of a picture of {whole[0]} x {whole[1]}: {other} begins at pixel "
                f"({other_x}, {other_y}), {name} at ({x}, {y})"
            )


def read(path: Path, channels: str | None = None, spp: int | None = None) -> Foreign:
    """The picture in a file of whatever program.

    Raises ImageError if no picture is found, or several are and `channels` does not choose.
    """
    where = os.fspath(path)
    header, layers = read_exr(path, MAX_BYTES, every_part=True)
    renderer = _renderer(header, layers)
    names = _chosen(layers, channels, str(where), str(header.get("name", "")))
    pixels = [layers[name] for name in names]
    if len({values.shape for values in pixels}) > 1:
        raise ImageError(f"{where}: {', '.join(names)} have different sizes")
    image = np.stack([values.astype(np.float64) for values in pixels], axis=-1)
    luminance = len(names) == 1
    image = np.repeat(image, 3, axis=-1) if luminance else image
    spp = spp or _samples(header, names[0])
    stderr = None
    variance = [f"Variance.{letter}" for letter in "RGB"]
    if names == ["R", "G", "B"] and spp and all(name in layers for name in variance):
        each = np.stack([layers[name].astype(np.float64) for name in variance], axis=-1)
        stderr = np.sqrt(np.maximum(each, 0.0) / spp)
    half = any(values.dtype == np.float16 for values in pixels)
    return Foreign(image, stderr, spp, renderer, half, luminance)


def _chosen(layers: dict[str, Array], channels: str | None, where: str, part: str) -> list[str]:
    """The names of the three channels, or of the one, that hold the picture.

    part: the name of the first part, whose channels do not bear it.
    """
    wholes = [name[:-1] for name in layers if name.endswith("R")
              and (name == "R" or name.endswith(".R"))
              and all(name[:-1] + letter in layers for letter in "GB")]  # fmt: skip
    if channels is not None:
        if not isinstance(channels, str) or not channels:
            raise CompareError(f"channels = {channels!r}; expected the name of a layer or channels")
        names = channels.split(",")
        if len(names) in (1, 3) and all(name in layers for name in names):
            return names
        ends = [x for x in wholes if x == f"{channels}." or x.endswith(f".{channels}.")]
        if len(ends) == 1:
            return [ends[0] + letter for letter in "RGB"]
        if channels == part and "" in wholes:
            return ["R", "G", "B"]
        several = f" (several: {', '.join(x.rstrip('.') for x in ends)})" if ends else ""
        raise ImageError(f"{where}: no layer or channels {channels!r}{several}; {_listed(layers)}")
    if "" in wholes:
        return ["R", "G", "B"]
    if combined := [x for x in wholes if x.endswith("Combined.")]:
        wholes = combined
    wholes = [x for x in wholes if not re.match(r"(stderr|batch\.\d+|Variance)\.", x)]
    if len(wholes) == 1:
        return [wholes[0] + letter for letter in "RGB"]
    if {"RY", "BY"} & {*layers}:
        raise ImageError(f"{where}: luminance and chroma; convert it to R, G and B")
    if not wholes and "Y" in layers:
        return ["Y"]
    which = ", ".join(x.rstrip(".") for x in wholes)
    raise ImageError(
        f"{where}: several layers, {which}: choose one by channels"
        if wholes
        else f"{where}: no channels R, G, B; {_listed(layers)}"
    )


def _listed(layers: dict[str, Array]) -> str:
    return f"found {', '.join(sorted(layers)[:9])}{' ...' * (len(layers) > 9)}"


def _renderer(header: dict[str, Any], layers: dict[str, Array]) -> str:
    """The program that wrote a file, as far as it can be told."""
    if "veriray.format" in header:
        return str(header.get("veriray.renderer", "veriray"))
    if any(key.startswith("cycles.") for key in header):
        return "Cycles"
    made = str(header.get("generatedBy", ""))
    if "Mitsuba" in made:
        return made.replace(" version", "")
    if "RelativeVariance.R" in layers or "samplesPerPixel" in header:
        return "pbrt"
    if any(name.endswith(".Combined.R") for name in layers):
        return "Blender"
    named = f"{made} {header.get('Software', '')} {header.get('software', '')}"
    return "LuxCore" if "lux" in named.lower() else ""


def _samples(header: dict[str, Any], name: str) -> int | None:
    """Samples per pixel as the header has them."""
    layer = name.rsplit(".Combined", 1)[0]
    for key in ("veriray.spp", "samplesPerPixel", f"cycles.{layer}.samples"):
        try:
            value = int(header[key])
        except (KeyError, TypeError, ValueError):
            continue
        if 1 <= value <= MAX_SPP:
            return value
    return None
