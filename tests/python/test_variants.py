"""The compiled variants: which one a scene takes, and what its paths store."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from veriray.device import select
from veriray.info import FEATURES
from veriray.rendering import METHODS, prepare
from veriray.shipped import SHIPPED, find_shipped
from veriray_bench import SCENARIOS
from veriray_bench.scenarios import scene_file
from veriray_validate.scenes import Part, camera, make, quad

#: Bytes that a path stores for a feature, in addition to those of every path.
NEEDS = {"refraction": 4, "pass": 12, "media": 8, "many_lights": 4}
SCENES = [*SHIPPED, *sorted((find_shipped("open").parent / "checks").glob("*.xml"))]


def smallest(needed: list[str], variants: list[list[str]]) -> list[str]:
    """The first variant that covers what is needed; the list starts with the smallest."""
    return next(v for v in variants if set(needed) <= set(v))


def test_the_list_has_the_smallest_first(device: str) -> None:
    native = select(device)[0].native
    variants = native.variants()
    assert set(variants[-1]) == set(FEATURES)
    for earlier, later in itertools.combinations(variants, 2):
        assert not set(later) <= set(earlier)
        assert native.path_bytes(earlier) <= native.path_bytes(later)


def test_a_path_stores_what_its_features_need(device: str) -> None:
    native = select(device)[0].native
    base = native.path_bytes([])
    assert base == 4 * (3 + 3 + 3 + 3 + 1 + 2)  # ray, throughput, radiance, pdf; pixel, sample
    for name in FEATURES:
        assert native.path_bytes([name]) == base + NEEDS.get(name, 0), name
    for names in [*itertools.product(*([n, ""] for n in NEEDS)), *native.variants()]:
        used = [name for name in names if name]
        assert native.path_bytes(used) == base + sum(NEEDS.get(name, 0) for name in used)
    with pytest.raises(ValueError, match="feature 'fur' is unknown"):
        native.path_bytes(["quads", "fur"])


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: Path(s).stem)
def test_a_scene_takes_the_smallest_variant_that_covers_it(scene: Any, cpu: str) -> None:
    native = select(cpu)[0].native
    facts = prepare(veriray.load_file(scene), cpu, width=8, height=8)
    assert facts["features"] and set(facts["features"]) <= set(facts["variant"])
    assert facts["variant"] == smallest(facts["features"], native.variants())
    assert facts["path_bytes"] == native.path_bytes(facts["variant"])
    wider = [v for v in native.variants() if set(facts["features"]) <= set(v)]
    assert facts["path_bytes"] == min(map(native.path_bytes, wider))


def test_the_scenarios_reach_every_variant(tmp_path: Path, cpu: str) -> None:
    used = [s.settings("cpu", True)["scene"] for s in SCENARIOS if s.kind == "variants"]
    found = [prepare(veriray.load_file(scene_file(name, tmp_path)), cpu) for name in used]
    *others, _ = select(cpu)[0].native.variants()
    assert {tuple(f["variant"]) for f in found} == set(map(tuple, others))


def test_what_ran_is_reported(
    cornell: veriray.Scene, device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VERIRAY_KERNELS", "off")
    native = select(device)[0].native
    for scheduler, everything in itertools.product(METHODS, (False, True)):
        stats = veriray.render(cornell, 1, device=device, scheduler=scheduler,
                               all_features=everything).stats  # fmt: skip
        variants = native.variants()
        few = [variants[0], *variants[-2:]]  # compiled of schedulers that are not the default one
        own = variants if scheduler == "fused" else few
        expected = variants[-1] if everything else smallest(stats["features"], own)
        if stats["variant"] == stats["features"] and device.startswith("cuda") and not everything:
            expected = stats["variant"]  # by kernels that an earlier test had made for just these
        assert stats["variant"] == expected
        assert stats["path_bytes"] == native.path_bytes(expected)
        # one launch, or one to begin and one a bounce: no stage has a launch of its own but in a
        # wave, of which several steps are launched at once
        launches = {"fused": 1, "thrust": 1 + len(stats["live_rays"])}
        if scheduler in launches:
            assert stats["launches"] == launches[scheduler]
        else:
            assert 1 <= stats["launches"] <= 2 + len(stats["live_rays"])
        if device.startswith("cpu"):
            assert stats["kernel"] == {}
            continue
        assert set(stats["kernel"]) == {"registers", "local_bytes", "resident_threads"}
        assert 16 <= stats["kernel"]["registers"] <= 255 and stats["kernel"]["local_bytes"] >= 0
        assert stats["kernel"]["resident_threads"] % 128 == 0 < stats["kernel"]["resident_threads"]


#: Corners of a lamp of two triangles, in its edges; height; whether it is a rectangle that is
#: sampled by solid angle, None where it is one in a tree alone.
LAMPS = {
    "rectangle": ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], 0.3, True),
    "far": ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], 0.6, None),
    "kite": ([(0, 0, 0), (1, 0, 0), (0.9, 0.9, 0), (0, 1, 0)], 0.3, False),
    "lifted corner": ([(0, 0, 0), (1, 0, 0), (1, 1, 0.2), (0, 1, 0)], 0.3, False),
    # flat, and a rectangle, to the rounding of the larger scene with a tree
    "bent": ([(0, 0, 0), (1, 0, 0), (1, 1, 1e-5), (0, 1, 0)], 0.3, None),
    "sheared": ([(0, 0, 0), (1, 0, 0), (1.2, 1, 0), (0.2, 1, 0)], 0.3, False),
}


@pytest.mark.parametrize(("tree", "size"), [(False, 1.0), (True, 1.0), (True, 1e-4)])
@pytest.mark.parametrize("name", LAMPS)
def test_rectangles_to_sample_by_solid_angle_are_found(
    name: str, tree: bool, size: float, cpu: str
) -> None:
    corners, height, near = LAMPS[name]
    lamp = size * np.array(corners, float)
    faces = [[0, 2, 1], [0, 3, 2]]  # shines down
    parts = [Part(lamp, faces, 0.1, 1.0), quad([-2, -2, -height * size], [4, 0, 0], [0, 4, 0])]
    if tree:  # far away and too small for a scene without
        parts.append(quad([100, 0, -1], [1e-4, 0, 0], [0, 1e-4, 0]))
    scene = make(parts, camera([0, 0, -0.1 * size], [0, 0, 1], 40), 0, 8, 8)
    features = prepare(scene, cpu)["features"]
    assert ("bvh" in features) is tree and ("rectangle_lights" in features) is (
        tree if near is None else near
    )
