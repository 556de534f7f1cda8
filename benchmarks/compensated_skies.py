"""Skies with and without `mis_compensation`: variance of a sample, and time.

A floor with a ball of one material under three skies (a sun in a clear sky, an overcast sky, a dark
room with two soft boxes). variance: of a sample, relative to the square of the pixel's mean, mean
over the pixels that show no sky; "with" over "without". seconds: processor time of the render, of
both in turn, median of --rounds.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from common import Array, header, parser, write

import veriray

SIZE = 96
HEIGHT, WIDTH = 257, 512


def clear() -> Array:
    """Sun and clear sky, of the model, +y up."""
    sky = {"type": "sunsky", "sun_direction": [0.5, -0.4, 0.6]}
    eye = {"type": "perspective", "film": {"type": "hdrfilm", "width": 1, "height": 1}}
    found = veriray.load_dict({"type": "scene", "sensor": eye, "sky": sky})
    width, height = found.sky_size
    return np.asarray(found.sky_texels).reshape(height, width, 3)


def overcast() -> Array:
    """CIE's overcast sky over a ground of a fifth of its zenith."""
    up = np.cos(np.linspace(0, np.pi, HEIGHT))[:, None, None]
    level = np.where(up >= 0, (1 + 2 * up) / 3, 0.2)
    return np.broadcast_to(level, (HEIGHT, WIDTH, 3)).astype(np.float32)


def studio() -> Array:
    """A room of 0.3 with two soft boxes of 12 and 6."""
    texels = np.full((HEIGHT, WIDTH, 3), 0.3, np.float32)
    texels[60:110, 60:120], texels[80:120, 330:370] = 12, 6
    return texels


SKIES = {"clear sky with a sun": clear, "overcast sky": overcast, "soft boxes": studio}
BALLS: dict[str, dict[str, Any]] = {
    "diffuse": {"type": "diffuse", "reflectance": 0.5},
    "rough plastic 0.1": {"type": "roughplastic", "alpha": 0.1},
    "rough metal 0.05": {"type": "roughconductor", "material": "Au", "alpha": 0.05},
    "rough metal 0.3": {"type": "roughconductor", "material": "Au", "alpha": 0.3},
}


def scene(sky: Array, ball: dict[str, Any], compensated: bool) -> veriray.Scene:
    """The floor, the ball and the sky."""
    place, floor = np.eye(4), np.eye(4)
    back = np.array([0.0, 2.0, 6.0]) / np.hypot(2, 6)
    place[:3, :3] = np.stack([[-1.0, 0, 0], np.cross(-back, [-1.0, 0, 0]), -back], axis=1)
    place[:3, 3] = 6 * back
    floor[:3, :3] = 20 * np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    floor[:3, 3] = [0, -1, 0]
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    return veriray.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 6},
            "sensor": {"type": "perspective", "fov": 24.0, "to_world": place, "film": film},
            "floor": {
                "type": "rectangle",
                "to_world": floor,
                "bsdf": {"type": "diffuse", "reflectance": 0.4},
            },
            "ball": {"type": "sphere", "bsdf": ball},
            "sky": {"type": "envmap", "bitmap": sky, "mis_compensation": compensated},
        }
    )


def main() -> None:
    """Measures and writes."""
    p = parser(__doc__, "compensated_skies.json")
    p.add_argument("--spp", type=int, default=256)
    p.add_argument("--rounds", type=int, default=3)
    arguments = p.parse_args()
    rows = []
    for sky, make in SKIES.items():
        texels = make()
        for ball, bsdf in BALLS.items():
            for sampler in ("independent", "sobol"):
                both = [scene(texels, bsdf, value) for value in (False, True)]
                variance: list[list[float]] = [[], []]
                seconds: list[list[float]] = [[], []]
                for _ in range(arguments.rounds):
                    for k, one in enumerate(both):
                        begin = time.process_time()
                        pictures = [
                            veriray.render(
                                one, arguments.spp // 8, seed=seed, sampler=sampler, device="cpu"
                            ).image
                            for seed in range(8)
                        ]
                        seconds[k].append(time.process_time() - begin)
                        grey = np.array(pictures, np.float64).sum(axis=-1)
                        seen = grey[:, grey.shape[1] // 3 :]  # no sky there
                        mean = seen.mean(axis=0)
                        share = seen.var(axis=0, ddof=1)[mean > 0] / mean[mean > 0] ** 2
                        variance[k].append(float(share.mean() * arguments.spp / 8))
                a, b = (float(np.median(v)) for v in variance)
                s, t = (float(np.median(v)) for v in seconds)
                rows.append({"sky": sky, "ball": ball, "sampler": sampler, "without": a, "with": b,
                             "variance": b / a, "time": t / s})  # fmt: skip
                print(f"{sky}, {ball}, {sampler}: {a:.4g} -> {b:.4g} x {b / a:.3f}, "
                      f"time x {t / s:.3f}", flush=True)  # fmt: skip
    write({**header("compensated_skies"), "rows": rows}, arguments.output)


if __name__ == "__main__":
    main()
