"""Values of Mitsuba's sunsky emitter, for tests/python/test_sunsky.py.

    python tests/references/record_sunsky.py

writes sunsky.json next to it, with mitsuba (scalar_rgb): radiances of the sky by direction and of
the sun, and where the sun stands by place and time.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

SKIES = ((3.0, 0.3, 45.0), (3.5, 0.0, 20.0), (1.2, 1.0, 5.0), (10.0, 0.5, 80.0), (1.0, 0.2, 89.9))
TIMES: tuple[dict[str, float], ...] = (
    {}, {"hour": 9.0}, {"year": 2024, "month": 1, "day": 3, "hour": 11.0, "minute": 20.0,
    "latitude": -33.9, "longitude": 18.4, "timezone": 2.0},
    {"latitude": 60.0, "longitude": 10.0, "timezone": 2.0, "month": 6, "day": 21, "hour": 20.0},
)  # fmt: skip


def seen(directions: list[list[float]], **given: Any) -> list[list[float]]:
    """Radiances by direction."""
    light, si = mi.load_dict({"type": "sunsky", **given}), mi.SurfaceInteraction3f()
    found = []
    for direction in directions:
        si.wi = mi.Vector3f(*(-x for x in direction))
        found.append([float(f"{x:.7g}") for x in light.eval(si)])
    return found


def main() -> None:
    """Writes the file."""
    mi.set_variant("scalar_rgb")
    v = np.random.default_rng(7).normal(size=(20, 3))
    v[:, 2] = np.abs(v[:, 2])
    directions = (v / np.linalg.norm(v, axis=1)[:, None]).round(6).tolist()
    skies, times = [], []
    for turbidity, albedo, elevation in SKIES:
        turn = np.radians(elevation)
        sun = [float(x) for x in np.array([np.cos(turn), 0, np.sin(turn)]).round(9)]
        given = {"turbidity": turbidity, "albedo": albedo, "sun_direction": sun}
        shown = seen([sun], **given, sky_scale=0.0)[0]
        skies.append({**given, "sky": seen(directions, **given, sun_scale=0.0), "sun": shown})
    for time in TIMES:
        parameters = mi.traverse(mi.load_dict({"type": "sunsky", **time}))
        found = np.array(list(parameters["sun_direction"])).ravel()
        times.append({"given": time, "sun": [round(float(x), 6) for x in found]})
    record = {"mitsuba": mi.__version__, "directions": directions, "skies": skies, "times": times}
    text = json.dumps(record).replace('{"turbidity"', '\n{"turbidity"') + "\n"
    Path(__file__).with_name("sunsky.json").write_text(text, "utf-8")


if __name__ == "__main__":
    main()
