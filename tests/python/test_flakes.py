"""`sggx`: what is read, what is refused, and what becomes of it."""

from __future__ import annotations

import dataclasses
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from veriray import SceneError
from veriray.columns import PHASE_KINDS

SIX = (0.5, 0.25, 1.0, 0.0, 0.0, 0.0)
VIEW = {"type": "perspective", "fov": 20.0, "film": {"type": "hdrfilm", "width": 4, "height": 4,
        "rfilter": {"type": "box"}}}  # fmt: skip
HAZE = {"type": "hg", "g": 0.5}


def grid(numbers: Any = SIX, **more: Any) -> dict[str, Any]:
    cells = np.broadcast_to(np.array(numbers, np.float32), (2, 2, 2, len(numbers)))
    return {"type": "gridvolume", "grid": cells, **more}


def flakes(numbers: Any = SIX) -> dict[str, Any]:
    return {"type": "sggx", "S": grid(numbers)}


def scene(phase: Any, **more: Any) -> veriray.Scene:
    fog = {"type": "homogeneous", "sigma_t": 3.0, "albedo": 0.5, "phase": phase, **more}
    ball = {"type": "sphere", "center": [0, 0, 4], "bsdf": {"type": "null"}, "interior": fog}
    sky = {"type": "constant", "radiance": 1.0}
    integrator = {"type": "volpath"}
    return veriray.load_dict(
        {"type": "scene", "integrator": integrator, "view": VIEW, "ball": ball, "sky": sky}
    )


def test_the_greatest_area_is_one() -> None:
    found = scene(flakes())
    assert found.lobe_kind.tolist() == [PHASE_KINDS.index("sggx")]
    assert found.lobe_flakes.tolist() == [list(SIX)] and found.sigma_t.tolist() == [[3.0] * 3]
    four = scene(flakes(4 * np.array(SIX)))
    assert four.lobe_flakes.tolist() == [list(SIX)] and four.sigma_t.tolist() == [[6.0] * 3]
    assert scene(flakes(4 * np.array(SIX)), scale=0.5).sha256 == found.sha256
    assert scene(flakes((0.25, 1, 0.5, 0, 0, 0))).sha256 != found.sha256


def test_in_a_blend_the_extinction_is_even() -> None:
    for weight, kinds in ((0.25, ["hg", "sggx"]), (1.0, ["sggx", "hg"])):
        blend = {"type": "blendphase", "weight": weight, "a": HAZE, "b": flakes(4 * np.array(SIX))}
        found = scene(blend)
        assert found.sigma_t.tolist() == [[3.0] * 3]
        assert [PHASE_KINDS[k] for k in found.lobe_kind] == kinds
        assert sum(found.lobe_share) == 1


@pytest.mark.parametrize("blended", [False, True])
def test_light_through_flakes(blended: bool) -> None:
    """Along z they absorb by the root of S_zz, and in a blend as in all directions."""
    phase: Any = flakes((0.5, 1, 0.0625, 0, 0, 0))
    if blended:
        phase = {"type": "blendphase", "weight": 1.0, "a": HAZE, "b": phase}
    found = scene(phase, sigma_t=0.5, albedo=0.0)
    found = dataclasses.replace(found, camera=dataclasses.replace(found.camera, fov=0.5))
    mean = float(veriray.render(found, 4096, device="cpu").image.mean())
    assert abs(mean - np.exp(-2 * 0.5 * (1 if blended else 0.25))) < 0.01


def test_the_older_name_of_scale() -> None:
    fog = {"type": "heterogeneous", "sigma_t": 2.0, "phase": flakes(np.array(SIX) / 4)}
    found = [scene(**{**fog, name: 3.0}) for name in ("scale", "density_scale")]
    assert found[0].sha256 == found[1].sha256
    assert found[0].sigma_t.tolist() == [[3.0] * 3]
    assert scene(**fog).sigma_t.tolist() == [[1.0] * 3]


def test_a_file(tmp_path: Path) -> None:
    cells = np.broadcast_to(np.array(SIX, "<f4"), (2, 3, 2, 6))
    head = struct.pack("<3sB5i6f", b"VOL", 3, 1, 2, 3, 2, 6, 0, 0, 0, 1, 1, 1)
    (tmp_path / "s.vol").write_bytes(head + cells.tobytes())
    path = tmp_path / "a.xml"
    path.write_text(
        '<scene version="3.0.0"><sensor type="perspective"/><shape type="sphere">'
        '<bsdf type="null"/><medium type="homogeneous" name="interior"><phase type="sggx">'
        '<volume name="S" type="gridvolume"><string name="filename" value="s.vol"/></volume>'
        "</phase></medium></shape></scene>"
    )
    assert veriray.load_file(path).lobe_flakes.tolist() == [list(SIX)]


@pytest.mark.parametrize(
    ("phase", "words"),
    [
        ({"type": "sggx"}, '"S" .gridvolume of 6 numbers a cell. is missing'),
        ({"type": "sggx", "S": grid((1, 1, 1))}, "3 numbers a cell; S takes 6"),
        ({"type": "sggx", "T": grid()}, 'a volume of a phase is named "T"; allowed: S'),
        ({"type": "sggx", "S": {"type": "constvolume"}}, 'cannot hold a volume "constvolume"'),
        ({"type": "sggx", "S": 1.0}, 'unknown parameter "S"'),
        (flakes((1, 1, 0, 0, 0, 0)), "eigenvalues from 0 to 1; expected numbers above 0"),
        (flakes((1, 1, 1e-7, 0, 0, 0)), "the least 1e-06 of the greatest or more"),
        (flakes((1, 1, 1, 1.5, 0, 0)), "eigenvalues from -0.5 to 2.5"),
        (flakes((0, 0, 0, 0, 0, 0)), "eigenvalues from 0 to 0"),
    ],
)
def test_what_is_refused(phase: Any, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        scene(phase)


def test_a_grid_that_is_uneven_is_refused() -> None:
    cells = np.broadcast_to(np.array(SIX, np.float32), (2, 2, 2, 6)).copy()
    cells[1, 0, 1, 2] = 0.5
    phase = {"type": "sggx", "S": {"type": "gridvolume", "grid": cells}}
    with pytest.raises(SceneError, match=r"cell \(x 1, y 0, z 1\) is unlike the first; S by place"):
        scene(phase)


def test_arrays_are_checked() -> None:
    found = scene(flakes())
    for wrong in ((1, 1, 1, 1, 0, 0), (0.9, 1, 1, 0.5, 0, 0), (1, 1, 1e-7, 0, 0, 0)):
        with pytest.raises(SceneError, match=r"lobe_flakes\[0\] is of a matrix of eigenvalues"):
            dataclasses.replace(found, lobe_flakes=np.array([wrong], float))
