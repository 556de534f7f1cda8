"""Every kind of material is asked what a closure must answer, or it is said why not."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest

import veriray
from veriray.columns import MATERIAL_KINDS
from veriray_validate import references
from veriray_validate.levels import (
    bits,
    sampler_hair,
    sampler_materials,
    sampler_principled,
    sampler_rough,
    sampler_thin,
)
from veriray_validate.run import cases
from veriray_validate.scenes import checks


def principled(side: str) -> str:
    """The kind of a surface, or of one and the side that it is seen from."""
    name = sampler_principled.SIDES[side][0]
    return sampler_principled.grey(sampler_principled.SURFACES[name]).kind


#: Module -> the kind that the name in a case's arguments stands for.
KINDS: Mapping[str, Callable[[str], str]] = {
    "sampler_materials": lambda name: sampler_materials.MATERIALS[name].kind,
    "sampler_rough": lambda name: sampler_rough.ROUGH[name].kind,
    "sampler_principled": principled,
    "sampler_thin": lambda name: sampler_thin.grey(sampler_thin.SHEETS[name]).kind,
    "sampler_hair": lambda name: sampler_hair.grey(sampler_hair.FIBRES[name]).kind,
}
#: Question -> the functions of the levels that ask it.
QUESTIONS: Mapping[str, tuple[str, ...]] = {
    "returns no more than it gets": (
        "sampler_materials.energy", "sampler_rough.rough_energy",
        "sampler_principled.principled_energy", "sampler_thin.thin_energy",
        "sampler_hair.hair_energy",
    ),
    "eval, sample and density agree": (
        "sampler_materials.material_weights", "sampler_rough.rough_weights",
        "sampler_principled.principled_weights", "sampler_thin.thin_weights",
        "sampler_hair.hair_weights",
    ),
    "samples fall as the density says": (
        "sampler_materials.material_directions", "sampler_materials.lobe_choice",
        "sampler_rough.rough_directions", "sampler_rough.weak_white_furnace",
        "sampler_rough.whole_directions",
        "sampler_principled.principled_directions", "sampler_thin.thin_directions",
        "sampler_hair.hair_directions",
    ),
    "is reciprocal": (
        "sampler_materials.reciprocity", "sampler_rough.rough_reciprocity",
        "sampler_rough.rough_reciprocity_of_refraction",
        "sampler_principled.principled_reciprocity", "sampler_thin.thin_reciprocity",
    ),
    "numbers at the end of their range": (
        "sampler_materials.material_corners", "sampler_rough.rough_corners",
        "sampler_principled.principled_corners", "sampler_thin.thin_corners",
    ),
}  # fmt: skip
#: (Question, kind) -> why no case asks it.
_ONE_WAY = "one direction, with one weight: eval is 0"
REASONS = {
    ("samples fall as the density says", "conductor"): _ONE_WAY,
    ("samples fall as the density says", "null"): "nothing is scattered",
    ("is reciprocal", "conductor"): _ONE_WAY,
    ("is reciprocal", "dielectric"): "delta lobes: sampler_materials.reciprocity_of_refraction",
    ("is reciprocal", "thindielectric"): _ONE_WAY,
    ("is reciprocal", "null"): "nothing is scattered",
    ("is reciprocal", "hair"): "absorption and turns follow from wo alone: sampler_hair.hair_pairs",
    ("numbers at the end of their range", "hair"): "a case of other arguments: hair_corners",
}


def asked() -> dict[str, set[str]]:
    """Question -> the kinds that it is asked of."""
    found: dict[str, set[str]] = {question: set() for question in QUESTIONS}
    for case in cases():
        function = case.id.partition("[")[0]
        for question, functions in QUESTIONS.items():
            if function in functions:
                name = case.arguments.get("name") or case.arguments["side"]
                found[question].add(KINDS[function.partition(".")[0]](str(name)))
    return found


def test_functions_exist() -> None:
    known = {case.id.partition("[")[0] for case in cases()}
    assert not {name for names in QUESTIONS.values() for name in names} - known


@pytest.mark.parametrize("kind", MATERIAL_KINDS)
def test_each_kind_is_asked(kind: str) -> None:
    for question, kinds in asked().items():
        assert (kind in kinds) != ((question, kind) in REASONS), f"{kind}: {question}"


def test_reasons_are_of_known_kinds() -> None:
    assert {kind for _, kind in REASONS} <= set(MATERIAL_KINDS)
    assert {question for question, _ in REASONS} <= set(QUESTIONS)


def test_each_kind_is_in_a_check_scene_with_recorded_bits_and_a_reference() -> None:
    recorded = {entry["scene"] for entry in bits.ENTRIES.values()}
    seen: set[str] = set()
    for name, path in checks().items():
        if f"checks/{name}" in recorded and (references.FOLDER / f"{name}.npz").is_file():
            rows = veriray.load_file(path).material_kind
            seen.update(MATERIAL_KINDS[row] for row in rows)
    assert seen == set(MATERIAL_KINDS)
