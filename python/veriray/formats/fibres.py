"""The row of `hair` from its parameters, which are Mitsuba's.

M. J.-Y. Chiang, B. Bitterli, C. Tappan, B. Burley, "A Practical and Controllable Hair and Fur Model
for Production Path Tracing", Computer Graphics Forum 35(2), 2016: the variance and the scale that
belong to a roughness. Absorption by pigment: E. d'Eon et al., "An Energy-Conserving Hair
Reflectance Model", EGSR 2011.
"""

from __future__ import annotations

from typing import Any

from ..columns import MATERIAL_KINDS
from ..errors import SceneError
from ..numeric import sin_cos_degrees
from .materials import BLACK, Row
from .node import Node

_EUMELANIN = (0.419, 0.697, 1.37)
_PHEOMELANIN = (0.187, 0.4, 1.05)
_PIGMENTS = {"eumelanin": 1.3, "pheomelanin": 0.2}
_ROOT_PI_OVER_8 = 0.6266570686577501
#: What a fibre shows from within: light that went in has left at once.
INSIDE: Row = {**BLACK, "material_kind": MATERIAL_KINDS.index("null")}


def along(roughness: float) -> float:
    """Variance of the light that a fibre's surface reflects, along it; roughness in [0, 1]."""
    root = 0.726 * roughness + 0.812 * roughness * roughness + 3.7 * _power(roughness, 20)
    return root * root


def around(roughness: float) -> float:
    """Scale in radians of the logistic by which light spreads around a fibre."""
    spread = 0.265 * roughness + 1.194 * roughness * roughness + 5.372 * _power(roughness, 22)
    return _ROOT_PI_OVER_8 * spread


def _power(x: float, n: int) -> float:
    result = 1.0
    for _ in range(n):
        result *= x
    return result


def row(node: Node, values: dict[str, Any]) -> Row:
    """The columns of a hair; values: its checked parameters."""
    pigments = [name for name in _PIGMENTS if values[name] is not None]
    absorption = values["sigma_a"]
    if absorption is not None and pigments:
        text = f"sigma_a and {' and '.join(pigments)} given; expected one of the two"
        raise SceneError(f"{node}: {text}", node.values[pigments[0]].where)
    if absorption is None:
        dark, red = (
            default if values[name] is None else values[name] for name, default in _PIGMENTS.items()
        )
        absorption = tuple(
            dark * a + red * b for a, b in zip(_EUMELANIN, _PHEOMELANIN, strict=True)
        )
    else:
        absorption = tuple(values["scale"] * x for x in absorption)
    index = values["int_ior"] / values["ext_ior"]
    if index < 1:
        text = f"int_ior over ext_ior is {index:g}; hair is denser than what is around it"
        raise SceneError(f"{node}: {text}", node.where)
    return {
        **BLACK,
        "material_kind": MATERIAL_KINDS.index("hair"),
        "eta": (index,) * 3,
        "k": absorption,
        "hair_along": along(values["longitudinal_roughness"]),
        "hair_around": around(values["azimuthal_roughness"]),
        "hair_tilt": sin_cos_degrees(values["scale_tilt"])[0],
    }
