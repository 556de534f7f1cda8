"""Rooms and floors of plastic: variance of a sample, for builds that choose lobes otherwise.

    python benchmarks/plastics.py -o before.json                    # one build
    python benchmarks/plastics.py --before before.json              # another; writes both

A closed room with a ball, or a floor with a ball under an even sky, all of one plastic. variance:
of a sample, mean over pixels and channels; seconds: processor time of a picture. Medians of
--rounds.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import header, parser, write

import veriray

SIZE = 128
WALLS = (  # rotation and place of a square of half size 1
    ([[1, 0, 0], [0, 0, 1], [0, -1, 0]], [0, -1, 0]),
    ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 1, 0]),
    ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, -1]),
    ([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [-1, 0, 0]),
    ([[0, 0, -1], [0, 1, 0], [1, 0, 0]], [1, 0, 0]),
)
#: Half size of the lamp and its radiance; none: a sky of 1.
LIGHTS = {"a lamp": (0.25, 18.0), "a small lamp": (0.05, 400.0), "an even sky": None}
COLOURS = {"0.05": 0.05, "0.2": 0.2, "0.5": 0.5, "0.8": 0.8, "0.8, 0.2, 0.1": [0.8, 0.2, 0.1]}


def square(wall: int, size: float = 1.0, shift: float = 0.0, **more: Any) -> dict[str, Any]:
    """One of WALLS, of a half size, moved inwards."""
    turn, place = (np.asarray(a, float) for a in WALLS[wall])
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = turn * size, place + shift * turn[:, 2]
    return {"type": "rectangle", "to_world": to_world, **more}


def scene(kind: str, colour: Any, light: tuple[float, float] | None) -> veriray.Scene:
    """The room or the floor."""
    bsdf = {"type": kind, "diffuse_reflectance": {"type": "rgb", "value": colour}}
    view = np.diag([-1.0, 1, -1, 1])
    view[2, 3] = 3.9
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    parts: dict[str, Any] = {"sky": {"type": "constant"}, "floor": square(0, 4.0, bsdf=bsdf)}
    if light:
        size, radiance = light
        parts = {f"wall_{k}": square(k, bsdf=bsdf) for k in range(len(WALLS))}
        parts["lamp"] = square(1, size, 0.02, emitter={"type": "area", "radiance": radiance})
    ball = {"type": "sphere", "center": [0.3, -0.6, 0.2], "radius": 0.4, "bsdf": bsdf}
    eye = {"type": "perspective", "fov": 39.3, "to_world": view, "film": film}
    depth = {"type": "path", "max_depth": 12}
    return veriray.load_dict(
        {"type": "scene", "integrator": depth, "eye": eye, "ball": ball, **parts}
    )


def main() -> None:
    """Measures and writes."""
    p = parser(__doc__, "plastics.json")
    p.add_argument("--spp", type=int, default=256)
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--before", type=Path, help="of another build: adds the ratios to it")
    arguments = p.parse_args()
    before = json.loads(arguments.before.read_text()) if arguments.before else None
    rows = []
    for kind in ("plastic", "roughplastic"):
        for name, light in LIGHTS.items():
            for colour, value in COLOURS.items():
                made = scene(kind, value, light)
                variance, seconds = [], []
                for seed in range(arguments.rounds):
                    begin = time.process_time()
                    r = veriray.render(made, arguments.spp, seed=seed, device="cpu")
                    seconds.append(time.process_time() - begin)
                    variance.append(float((r.stderr.astype(float) ** 2).mean() * arguments.spp))
                row = {"material": kind, "colour": colour, "light": name,
                       "variance": float(np.median(variance)),
                       "seconds": float(np.median(seconds))}  # fmt: skip
                text = f"{kind} {colour} under {name}: {row['variance']:.4g}"
                if before:
                    old = before["rows"][len(rows)]
                    row["variance_ratio"] = row["variance"] / old["variance"]
                    row["time_ratio"] = row["seconds"] / old["seconds"]
                    text += f" x {row['variance_ratio']:.3f}, time x {row['time_ratio']:.2f}"
                rows.append(row)
                print(text, flush=True)
    more = {"before": before} if before else {}
    write({**header("plastics"), "rows": rows, **more}, arguments.output)


if __name__ == "__main__":
    main()
