"""The principled surface against values of Mitsuba (tests/references/record_principled.py)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from veriray import SceneError
from veriray.columns import MATERIAL_KINDS, PRINCIPLED
from veriray_validate.levels.sampler_principled import grey
from veriray_validate.principled import Principled, lobes

RECORD = json.loads(
    (Path(__file__).parents[1] / "references" / "principled.json").read_text("utf-8")
)
WI = np.array(RECORD["wi"])


def rows(own: Any) -> Any:
    """Recorded values with the surface's material, side and directions in its own frame."""
    for row in RECORD["rows"]:
        given = {k: v for k, v in row.items() if k not in ("wo", "f")}
        p = Principled(**{**given, "base": tuple(given["base"])})
        front = row["wo"][2] > 0
        turn = np.array([1, 1, 1 if front else -1])
        wi = WI * turn
        if own(p):
            yield p, front, np.broadcast_to(row["wo"] * turn, wi.shape), wi, np.array(row["f"])


def agree(pairs: list[tuple[Any, Any]], least: int) -> None:
    """Found and told values differ by the rounding of Mitsuba's float32.

    Relative to the value or, below it, to 1e-4 of the largest: 1e-5 but for 1 in 70, which are
    slopes near 0.001 and grazing angles, 3e-3.
    """
    off = [np.abs(a - b) / np.maximum(b, 1e-4 * b.max() + 1e-12) for a, b in pairs]
    flat = np.concatenate([x.ravel() for x in off])
    assert np.quantile(flat, 0.985) < 1e-5 and flat.max() < 3e-3
    assert sum((b > 0).sum() for _, b in pairs) > least


def test_formulas_are_those_of_mitsuba() -> None:
    """All colours."""
    pairs = []
    for p, front, wo, wi, told in rows(lambda p: True):
        found, _ = lobes(p, wo, wi, front, own=True)
        pairs.append((found if p.open else found * (wi[:, 2:] > 0), told))
    agree(pairs, 3000)


def test_the_core_has_mitsubas_values() -> None:
    """Greys, through the code of the vector and the scalar lanes.

    But for F of refraction by the cosine in the thinner medium: beside total reflection the six
    digits of the recorded directions count by the other.
    """
    native = veriray.device.select("cpu")[0].native
    pairs = []
    for p, front, wo, wi, told in rows(lambda p: len(set(p.base)) == 1):
        columns = (*grey(p).columns(front), 0, 0, 1, *wo.T, *wi.T)
        words = np.stack(np.broadcast_arrays(*columns), axis=-1).astype(np.float32)
        other, ours = (lobes(p, wo, wi, front, own=own)[0][:, 0] for own in (True, False))
        pairs.append((native.eval_function("bsdf_eval", words)[:, 0] + other - ours, told[:, 0]))
    agree(pairs, 500)


def made(**given: Any) -> Any:
    """The scene of a ball of a principled bsdf."""
    bsdf = {"type": "principled", **given}
    return veriray.load_dict({
        "type": "scene", "camera": {"type": "perspective", "fov": 40.0},
        "light": {"type": "constant"}, "ball": {"type": "sphere", "bsdf": bsdf},
    })  # fmt: skip


def test_defaults_and_kinds() -> None:
    plain = made()
    assert MATERIAL_KINDS[plain.material_kind[0]] == "principled"
    assert plain.eta[0].tolist() == [1.5] * 3 and plain.roughness[0] == 0.5
    assert made(specular=0.5, metallic=0.0, clearcoat_sampling_rate=0.25).sha256 == plain.sha256
    assert MATERIAL_KINDS[made(spec_trans=0.1).material_kind[0]] == "principled_open"
    assert made(spec_trans=0.1, eta=1.0).eta[0, 0] == np.float32(1.001)  # as Mitsuba
    assert made(specular=0.0).eta[0, 0] == 1
    tint = {"type": "rgb", "value": [1.0, 1.0, 1.0]}
    assert made(spec_tint=tint).spec_tint[0] == 1
    board = {"type": "checkerboard"}
    textured = made(base_color=board, **dict.fromkeys(PRINCIPLED, board))
    given = ("reflectance", *PRINCIPLED)
    assert MATERIAL_KINDS[textured.material_kind[0]] == "principled_open"
    assert all(getattr(textured, f"{name}_texture")[0] >= 0 for name in given)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"eta": 1e300}, '"eta" = 1e+300 is outside'),
        ({"eta": 1.5, "specular": 0.5}, "both eta and specular given"),
        (
            {"eta": {"type": "checkerboard"}},
            "checkerboard is not supported on principled.eta, but on principled.",
        ),
    ],
)
def test_refused(given: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=".*") as error:
        made(**given)
    assert text in str(error.value)


def test_glass_is_not_two_sided() -> None:
    inner = {"type": "principled", "spec_trans": 0.5}
    with pytest.raises(SceneError, match="cannot hold a principled that lets light through"):
        veriray.load_dict({
            "type": "scene", "camera": {"type": "perspective", "fov": 40.0},
            "ball": {"type": "sphere", "bsdf": {"type": "twosided", "bsdf": inner}},
        })  # fmt: skip
