"""Values of Mitsuba's hair bsdf, for tests/python/test_hair.py.

    python tests/references/record_hair.py

writes hair.json next to it, with mitsuba (scalar_rgb): parameters, wo, wi and f cos.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from flat_surface import interaction, unit, values

CORNERS: tuple[dict[str, Any], ...] = (
    {}, {"eumelanin": 0.2}, {"pheomelanin": 1.0}, {"eumelanin": 0.0, "pheomelanin": 0.4},
    {"sigma_a": [0.1, 0.5, 1.0]}, {"sigma_a": [0.1, 0.5, 1.0], "scale": 0.5, "int_ior": 1.8},
    {"sigma_a": [0.0, 0.0, 0.0]}, {"longitudinal_roughness": 0.7, "scale_tilt": -5.0},
    {"azimuthal_roughness": 0.8}, {"longitudinal_roughness": 1.0, "azimuthal_roughness": 1.0},
    {"int_ior": 1.3, "ext_ior": 1.1}, {"scale_tilt": 0.0, "longitudinal_roughness": 0.2},
)  # fmt: skip


def directions(count: int, seed: int) -> list[list[float]]:
    """A few."""
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return unit(v)


def main() -> None:
    """Writes the file."""
    rows, si = [], interaction()
    wi = directions(12, 7)
    for given in CORNERS:
        plugin = {"type": "hair", **given}
        if "sigma_a" in given:
            plugin["sigma_a"] = {"type": "rgb", "value": given["sigma_a"]}
        bsdf = mi.load_dict(plugin)
        for x, y, z in directions(4, 8):
            si.wi = mi.Vector3f(x, y, abs(z))
            found = values(bsdf, si, wi)
            rows.append({"given": given, "wo": [x, y, abs(z)], "f": found})
    record = {"mitsuba": mi.__version__, "wi": wi, "rows": rows}
    text = json.dumps(record).replace('{"given"', '\n{"given"') + "\n"
    Path(__file__).with_name("hair.json").write_text(text, "utf-8")


if __name__ == "__main__":
    main()
