"""Values of Mitsuba's principledthin bsdf, for tests/python/test_principled_thin.py.

    python tests/references/record_principled_thin.py

writes principled_thin.json next to it, with mitsuba (scalar_rgb): parameters, wo, wi and f cos.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import mitsuba as mi
import numpy as np
from flat_surface import interaction, unit, values

SHARES = ("roughness", "spec_trans", "spec_tint", "sheen", "sheen_tint", "flatness", "diff_trans",
          "anisotropic")  # fmt: skip
CORNERS = (
    {}, *({name: 1.0} for name in SHARES), {"diff_trans": 2.0}, {"roughness": 0.0},
    {"sheen": 0.7, "sheen_tint": 1.0, "diff_trans": 0.6}, {"spec_trans": 1.0, "spec_tint": 1.0},
    {"spec_trans": 1.0, "roughness": 0.9}, {"spec_trans": 0.4, "diff_trans": 1.6},
    {"spec_trans": 1.0, "roughness": 0.8, "anisotropic": 0.7}, dict.fromkeys(SHARES, 0.5),
    {"flatness": 1.0, "roughness": 1.0}, {"spec_trans": 0.7, "spec_tint": 0.6, "roughness": 0.8},
)  # fmt: skip
COLOURS = ((0.8, 0.3, 0.1), (0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
INDICES = (1.5, 2.4, 0.8, 1.0)
ANGLES = (5.0, 40.0, 75.0)


def directions() -> list[list[float]]:
    """A few of both hemispheres."""
    v = np.random.default_rng(7).normal(size=(10, 3))
    return unit(v)


def main() -> None:
    """Writes the file."""
    rows, si = [], interaction()
    for number, (given, colour, eta) in enumerate(itertools.product(CORNERS, COLOURS, INDICES)):
        if (colour != COLOURS[0] or eta != INDICES[0]) and number % 5:
            continue
        plugin = {"type": "principledthin", "eta": eta, **given}
        plugin["base_color"] = {"type": "rgb", "value": list(colour)}
        bsdf = mi.load_dict(plugin)
        for angle, side in itertools.product(ANGLES, (1, -1)):
            turn = np.radians(angle)
            wo = [float(round(x, 6)) for x in (np.sin(turn), 0.0, side * np.cos(turn))]
            si.wi = mi.Vector3f(*wo)
            found = values(bsdf, si, directions())
            rows.append({"base": colour, "eta": eta, **given, "wo": wo, "f": found})
    record = {"mitsuba": mi.__version__, "wi": directions(), "rows": rows}
    text = json.dumps(record).replace('{"base"', '\n{"base"') + "\n"
    Path(__file__).with_name("principled_thin.json").write_text(text, "utf-8")


if __name__ == "__main__":
    main()
