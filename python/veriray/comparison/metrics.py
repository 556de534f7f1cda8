"""Error measures of a picture I against a reference R: figures, never a verdict.

By all of them, a picture that is 2 % wrong scores better than a right one with more noise.
Definitions (means run over pixels and channels):

- mse      mean (I - R)^2
- relmse   mean (I - R)^2 / (R^2 + 0.01), after both are scaled so that mean R = 1
- relmse_trimmed  the same without the worst 0.1 % of pixels
- smape    mean 2 |I - R| / (|I| + |R| + 1e-6)
- psnr     dB, of the display copies (below), peak 1
- ssim     structural similarity of the display copies (Wang et al. 2004; scikit-image, 7x7 window)
- flip     mean HDR-FLIP (Andersson et al. 2021; flip-evaluator, 67 pixels per degree), after both
           are scaled as for the display copy, without its clipping
- mean_ratio_r, _g, _b   mean I / mean R

Display copy: both pictures over the 95th percentile of R's luminance, clipped to [0, 1], sRGB.
A measure that cannot be computed (NaN in a picture, sides under 7 pixels, black reference) is None.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_LUMINANCE = (0.2126, 0.7152, 0.0722)


def display_scale(reference: NDArray[Any]) -> float:
    """1 / 95th percentile of the luminance (Rec. 709) of a (H, W, 3) picture; 1 if it is black."""
    luminance = np.nan_to_num(np.asarray(reference, np.float64), posinf=0, neginf=0) @ _LUMINANCE
    white = float(np.percentile(luminance, 95)) or float(luminance.max())
    return 1.0 / white if white > 0 else 1.0


def figures(image: NDArray[Any], reference: NDArray[Any]) -> dict[str, float | None]:
    """All measures of this module for two (H, W, 3) pictures of linear radiance."""
    names = ("mse", "relmse", "relmse_trimmed", "smape", "psnr", "ssim", "flip",
             "mean_ratio_r", "mean_ratio_g", "mean_ratio_b")  # fmt: skip
    out: dict[str, float | None] = dict.fromkeys(names)
    i, r = np.asarray(image, np.float64), np.asarray(reference, np.float64)
    if not (np.isfinite(i).all() and np.isfinite(r).all()):
        return out
    out["mse"] = float(np.mean((i - r) ** 2))
    out["smape"] = float(np.mean(2 * np.abs(i - r) / (np.abs(i) + np.abs(r) + 1e-6)))
    mean = float(r.mean())
    if mean > 0:
        error = (i - r) ** 2 / (r**2 + 0.01 * mean**2)
        out["relmse"] = float(error.mean())
        worst = np.sort(error.mean(axis=-1), axis=None)
        out["relmse_trimmed"] = float(worst[: math.ceil(worst.size * 0.999)].mean())
    for c, letter in enumerate("rgb"):
        if r[..., c].mean() > 0:
            out[f"mean_ratio_{letter}"] = float(i[..., c].mean() / r[..., c].mean())
    scale = display_scale(r)
    a, b = (_display(x * scale) for x in (i, r))
    if (square := float(np.mean((a - b) ** 2))) > 0:
        out["psnr"] = -10 * math.log10(square)
    if min(i.shape[:2]) >= 7:
        from skimage.metrics import structural_similarity

        out["ssim"] = float(structural_similarity(a, b, channel_axis=2, data_range=1.0))
        if mean > 0:
            out["flip"] = _flip(i * scale, r * scale)
    return out


def _display(x: NDArray[np.float64]) -> NDArray[np.float64]:
    x = np.clip(x, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def _flip(image: NDArray[np.float64], reference: NDArray[np.float64]) -> float | None:
    """Mean HDR-FLIP at exposures from log2(x / max) to log2(x / median), as FLIP chooses them.

    x is where its ACES curve saturates. The exposures are passed explicitly because the package
    ends the process if its own choice fails (very dark pictures).
    """
    import flip_evaluator

    luminance = reference @ _LUMINANCE
    start = 1.0832973 - math.log2(luminance.max())
    stop = 1.0832973 - math.log2(max(float(np.median(luminance)), 2.0**-23))
    count = max(2, math.ceil(stop - start))
    _, mean, _ = flip_evaluator.evaluate(
        np.maximum(reference, 0).astype(np.float32),
        np.clip(image, 0, 1e30).astype(np.float32),
        "HDR",
        applyMagma=False,
        parameters={"startExposure": start, "stopExposure": stop, "numExposures": count},
    )
    return float(mean) if math.isfinite(mean) else None
