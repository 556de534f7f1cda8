"""The thin principled sheet: values of Mitsuba (tests/references/record_principled_thin.py)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from veriray import SceneError
from veriray.columns import MATERIAL_KINDS
from veriray_validate.levels.sampler_thin import grey
from veriray_validate.principled_thin import Sheet, lobes

RECORD = json.loads(
    (Path(__file__).parents[1] / "references" / "principled_thin.json").read_text("utf-8")
)
WI = np.array(RECORD["wi"])
SHARES = ("roughness", "spec_trans", "spec_tint", "sheen", "sheen_tint", "flatness", "anisotropic",
          "diff_trans")  # fmt: skip


def rows(own: Any) -> Any:
    """Recorded values with the sheet, the side and the directions in the viewer's own frame."""
    for row in RECORD["rows"]:
        given = {k: v for k, v in row.items() if k not in ("wo", "f")}
        p = Sheet(**{**given, "base": tuple(given["base"])})
        front = row["wo"][2] > 0
        turn = np.array([1, 1, 1 if front else -1])
        if own(p):
            yield (
                p,
                front,
                np.broadcast_to(row["wo"] * turn, WI.shape),
                WI * turn,
                np.array(row["f"]),
            )


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
    """All colours, both sides."""
    agree([(lobes(p, wo, wi)[0], told) for p, _, wo, wi, told in rows(lambda p: True)], 3000)


def test_the_core_has_mitsubas_values() -> None:
    """Greys, through the code of the vector and the scalar lanes."""
    native = veriray.device.select("cpu")[0].native
    pairs = []
    for p, front, wo, wi, told in rows(lambda p: len(set(p.base)) == 1):
        columns = (*grey(p).columns(front), 0, 0, 1, *wo.T, *wi.T)
        words = np.stack(np.broadcast_arrays(*columns), axis=-1).astype(np.float32)
        pairs.append((native.eval_function("bsdf_eval", words)[:, 0], told[:, 0]))
    agree(pairs, 300)


def made(**given: Any) -> Any:
    """The scene of a ball of a thin principled sheet."""
    bsdf = {"type": "principledthin", **given}
    return veriray.load_dict({
        "type": "scene", "camera": {"type": "perspective", "fov": 40.0},
        "light": {"type": "constant"}, "ball": {"type": "sphere", "bsdf": bsdf},
    })  # fmt: skip


def test_defaults_and_textures() -> None:
    plain = made()
    assert MATERIAL_KINDS[plain.material_kind[0]] == "principledthin"
    assert plain.eta[0].tolist() == [1.5] * 3 and plain.roughness[0] == 0.5
    assert plain.diff_trans[0] == 0 and made(diff_trans=2.0).diff_trans[0] == 2
    assert made(eta=1.5, specular_transmittance_sampling_rate=0.25).sha256 == plain.sha256
    board = {"type": "checkerboard"}
    textured = made(base_color=board, **dict.fromkeys(SHARES, board))
    assert all(getattr(textured, f"{name}_texture")[0] >= 0 for name in ("reflectance", *SHARES))


@pytest.mark.parametrize("name", ["reflectance", *SHARES])
def test_textures_give_the_number(name: str) -> None:
    """A texture of one number is that number: the same picture, bit for bit."""
    key = "base_color" if name == "reflectance" else name
    rest = {"spec_trans": 0.5, "spec_tint": 0.5, "sheen": 0.5, "diff_trans": 0.5, "base_color": 0.5}
    field = {"type": "rgb", "value": [0.25] * 3}
    board = {"type": "checkerboard", "color0": field, "color1": field}
    pictures = [
        veriray.render(made(**{**rest, key: value}), width=8, height=8, spp=4, device="cpu")
        for value in (0.25, board)
    ]
    assert pictures[0].film_sha256 == pictures[1].film_sha256


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"diff_trans": 2.5}, '"diff_trans" = 2.5 is outside [0, 2]'),
        ({"metallic": 0.5}, 'unknown parameter "metallic"'),
        ({"eta": {"type": "checkerboard"}}, "checkerboard is not supported on principledthin.eta"),
    ],
)
def test_refused(given: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=".*") as error:
        made(**given)
    assert text in str(error.value)


def test_it_is_not_two_sided() -> None:
    """It has two sides of its own."""
    with pytest.raises(SceneError, match="twosided cannot hold"):
        veriray.load_dict({
            "type": "scene", "camera": {"type": "perspective", "fov": 40.0},
            "ball": {"type": "sphere",
                     "bsdf": {"type": "twosided", "bsdf": {"type": "principledthin"}}},
        })  # fmt: skip
