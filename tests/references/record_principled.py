"""Values of Mitsuba's principled bsdf, for tests/python/test_principled.py.

    python tests/references/record_principled.py

writes principled.json next to it, with mitsuba (scalar_rgb): parameters, wo, wi and f cos.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import mitsuba as mi
import numpy as np
from flat_surface import interaction, unit, values

SHARES = ("roughness", "metallic", "spec_trans", "spec_tint", "sheen", "sheen_tint", "flatness",
          "clearcoat", "clearcoat_gloss")  # fmt: skip
CORNERS = (
    {}, *({name: 1.0} for name in SHARES), {"roughness": 0.1}, {"roughness": 0.0},
    {"sheen": 0.7, "sheen_tint": 1.0}, {"sheen": 1.0, "metallic": 0.5},
    {"metallic": 0.5, "spec_tint": 0.6}, {"clearcoat": 0.5, "clearcoat_gloss": 0.6},
    {"spec_trans": 0.6, "metallic": 0.3}, {"spec_trans": 1.0, "roughness": 0.9},
    dict.fromkeys(SHARES, 0.5),
    {"anisotropic": 1.0}, {"anisotropic": 0.6, "metallic": 1.0, "roughness": 0.8},
    {"anisotropic": 0.8, "spec_trans": 0.7, "roughness": 0.6},
)  # fmt: skip
COLOURS = ((0.8, 0.3, 0.1), (0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
INDICES = (1.5, 0.8, 1.0)
ANGLES = (5.0, 40.0, 75.0)


def directions() -> list[list[float]]:
    """A few of both hemispheres."""
    rng = np.random.default_rng(7)
    v = rng.normal(size=(10, 3))
    v[:7, 2] = np.abs(v[:7, 2])
    return unit(v)


def main() -> None:
    """Writes the file."""
    rows, si = [], interaction()
    for number, (given, colour, eta) in enumerate(itertools.product(CORNERS, COLOURS, INDICES)):
        if (colour != COLOURS[0] or eta != INDICES[0]) and number % 3:
            continue
        if given.get("spec_trans") and eta == 1:  # 1.001 to Mitsuba, whose float32 is rough there
            continue
        plugin = {"type": "principled", "eta": eta, **given}
        plugin["base_color"] = {"type": "rgb", "value": list(colour)}
        bsdf = mi.load_dict(plugin)
        for angle, side in itertools.product(ANGLES, (1, -1)):
            if side < 0 and "spec_trans" not in given:
                continue
            turn = np.radians(angle)
            wo = [float(round(x, 6)) for x in (np.sin(turn), 0.0, side * np.cos(turn))]
            si.wi = mi.Vector3f(*wo)
            found = values(bsdf, si, directions())
            rows.append({"base": colour, "eta": eta, **given, "wo": wo, "f": found})
    record = {"mitsuba": mi.__version__, "wi": directions(), "rows": rows}
    text = json.dumps(record).replace('{"base"', '\n{"base"') + "\n"
    Path(__file__).with_name("principled.json").write_text(text, "utf-8")


if __name__ == "__main__":
    main()
