"""Pictures on disk: EXR, the file of record, and PNG, a display copy.

Layout of an EXR file, version 1 (any program that writes it can be compared by `veriray.compare`)
--------------------------------------------------------------------------------------------------
One part, scan lines, not compressed (of a render's noise RLE saves 5 % and ZIP 8 %, in 1.6 and 4.5
times the time), dataWindow = displayWindow = (0, 0)-(W-1, H-1), row 0 = top.
All lengths below: H rows, W columns. "required" is all that `load` insists on.

Channels, FLOAT (32 bits) unless said otherwise, linear scene-referred radiance:
- `R` `G` `B`                        required; mean over all samples of the pixel.
- `stderr.R` `stderr.G` `stderr.B`   standard error of that mean: sqrt(s^2 / spp), s^2 with spp - 1.
- `batch.000.R` ... `batch.NNN.B`    batch means; batch k of B is the mean of the samples
  [k spp/B, (k+1) spp/B) of the pixel. Three digits, B <= 1000, B divides spp, no gaps. The means
  are float64 in memory and float32 here: the loss is the rounding, 6e-8 of a batch mean, far below
  its own standard error and below the margin (1e-5) of every test in `veriray.compare`.
- `samples`                          UINT (32 bits), optional: samples of each pixel, where they
  differ.
- `region`                           UINT (32 bits), optional: what the ray through the pixel's
  centre hits first, k + 1 for shape k of the scene file in its order, 0 for nothing.

Header attributes, all of them strings, each optional (a missing one reads as empty or 0):
- `veriray.format` "1"; `veriray.renderer` program that made it: "veriray", "reference", ...
- `veriray.version`, `veriray.device`, `veriray.scheduler`, `veriray.sampler`: free text
- `veriray.scene_sha256`, `veriray.film_sha256`: 64 hexadecimal digits
- `veriray.denoiser`: program that guessed the picture behind the noise; only in such files, which
  have no `film_sha256`, and which `veriray.compare` refuses
- `veriray.seed`, `veriray.spp`, `veriray.max_depth`, `veriray.rr_depth`: decimal integers
- `veriray.batches`: B as a decimal integer, "0" for none; `veriray.seconds`: decimal number
- `veriray.features`: JSON list of strings
- `veriray.ledger`: JSON object, column name -> list of integers, one per depth; the columns are
  live, escaped, emitter_end, absorbed, rr_killed, depth_cut, invalid, shadow_visible,
  shadow_occluded; lists of one length, trailing all-zero depths left out
- `veriray.feature_spp`: decimal integer, samples of the feature images' means; then channels
  `LAYER.X` and `stderr.LAYER.X` (`veriray.features.LAYERS`): FLOAT, but UINT for numbers
- `veriray.light_groups`: JSON object, layer `light.NAME` -> list of the names of its lamps
- `veriray.motion_to`: JSON list of 3 lists of 4 numbers: `FeatureImages.motion_to`
- `veriray.regions`: JSON list of names; entry k names the value k + 1 of channel `region`
- `veriray.stats`: JSON object, whatever else `Render.stats` holds
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import ImageError as ImageError
from .loading import MAX_BYTES, read
from .loading import read_exr as read_exr
from .picture import Render
from .saving import save_png as save_png
from .saving import to_srgb8 as to_srgb8


def save(render: Render, path: str | os.PathLike[str], **options: Any) -> None:
    """Write a render to `path`: `render.save`. Raises TypeError for what is no Render."""
    if not isinstance(render, Render):
        raise TypeError(f"render is {type(render).__name__}, expected a Render")
    render.save(path, **options)


def load(path: str | os.PathLike[str], *, max_bytes: int = MAX_BYTES) -> Render:
    """Read a render from an EXR file (layout at the top of this module).

    Nothing in the file is trusted: sizes are checked before pixels are read, and text is parsed
    as JSON or a number. A render without standard errors gets NaN there. Pixels that are not
    finite are kept and counted in `stats["nonfinite_pixels"]`.

    Args:
        path: the file.
        max_bytes: largest size of all decoded channels together.

    Raises:
        ImageError: not such a file, damaged, or beyond the limits; the message names the file.
        OSError: the file cannot be opened or read.
    """
    return load_with_regions(path, max_bytes=max_bytes)[0]


def load_with_regions(
    path: str | os.PathLike[str], *, max_bytes: int = MAX_BYTES
) -> tuple[Render, NDArray[np.uint32] | None, list[str]]:
    """As `load`, with the object masks: (H, W) uint32 (0 = nothing) or None, and their names."""
    fields, regions, names = read(path, max_bytes)
    return Render(**fields), regions, names
