"""The settings of a render: what states names and defaults again agrees with veriray.settings."""

from __future__ import annotations

import argparse
import ast
import dataclasses
import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from veriray import camera, cli, image, rendering, scene
from veriray.errors import SceneError
from veriray.settings import HEADER, SETTINGS, RenderSettings

ROOT = Path(__file__).resolve().parents[2]
DEFAULTS = {name: setting.default for name, setting in SETTINGS.items()}
#: Arguments of the native calls that are no settings.
RANGE = {"sample_begin": 0, "sample_end": 1, "pixels": None}


def native_defaults(*, path: bool = False) -> dict[str, Any]:
    """By native name: what a render gets that asks for nothing, of a scene that states nothing."""
    of_scene = {name: s.scene for name, s in SETTINGS.items() if s.scene is not None}
    return RenderSettings(**of_scene, scheduler="fused").native(path=path)


def keywords(function: Any, *others: str) -> dict[str, Any]:
    """Names and defaults of a function's arguments but for the others."""
    parameters = inspect.signature(function).parameters
    assert set(others) <= set(parameters)
    return {name: p.default for name, p in parameters.items() if name not in others}


# ---- Python ----


def test_signatures() -> None:
    course = "checkpoint", "every", "time", "on_pass"
    assert keywords(veriray.render, "scene", "progress", "cameras", *course) == DEFAULTS
    path = {name: DEFAULTS[name] for name, s in SETTINGS.items() if s.path}
    assert keywords(veriray.trace_path, "scene", "x", "y", "sample") == path
    few = keywords(rendering.prepare, "scene", "progress")
    assert few == {name: DEFAULTS[name] for name in few}


def test_types() -> None:
    types = {f.name: f.type for f in dataclasses.fields(RenderSettings)}
    stated = dict(veriray.render.__annotations__)
    assert {name: stated[name] for name in types} == types


def test_description() -> None:
    text = inspect.getdoc(veriray.render)
    assert text
    for name, setting in SETTINGS.items():
        found = re.search(rf"^    (?:\w+, )*{name}(?:, \w+)*: .*(?:\n      .*)*", text, re.M)
        assert found, name
        for choice in setting.choices:
            assert f'"{choice}"' in found[0], name
        for limit in (setting.low, setting.high) if name in ("spp", "threads", "batches") else ():
            assert str(limit) in found[0] or f"2^{int(limit or 0).bit_length() - 1}" in found[0]


def test_defaults_of_a_scene() -> None:
    fields = {
        f.name: f.default for of in (scene.Scene, camera.Film) for f in dataclasses.fields(of)
    }
    of_scene = {name: s.scene for name, s in SETTINGS.items() if s.scene is not None}
    assert {name: fields[name] for name in of_scene} == of_scene
    assert fields["seed"] == SETTINGS["seed"].default
    assert set(of_scene) <= set(keywords(scene.Scene.with_, "self"))


def test_header_of_a_file() -> None:
    in_header = {name for name in SETTINGS if f"`veriray.{name}`" in str(image.__doc__)}
    own = {name for name, setting in SETTINGS.items() if setting.kept == HEADER}
    # features: those of the scene; the others: of what the file holds
    others = {"batches", "features", "feature_spp", "light_groups", "motion_to"}
    assert in_header == {*own, *others}


@pytest.mark.parametrize(
    "given, message",
    [
        ({"spp": 0}, "spp = 0 is outside [1, 1099511627776]"),
        ({"seed": 2**64}, "seed = 18446744073709551616 is outside [0, 18446744073709551615]"),
        ({"scheduler": "best"}, "scheduler = 'best' is unknown; allowed: auto, fused, thrust, "
         "thrust-append, thrust-copy, thrust-none, thrust-partition, wavefront, "
         "wavefront-unsorted"),
        ({"sampler": "halton"}, "sampler = 'halton' is unknown; allowed: independent, sobol"),
        ({"max_depth": -2}, "max_depth = -2 is outside [-1, 262143]"),
        ({"rr_depth": 1.5}, "rr_depth = 1.5 is not an integer"),
        ({"threads": 1025}, "threads = 1025 is outside [1, 1024]"),
        ({"batches": -1}, "batches = -1 is outside [0, 1000]"),
        ({"batch_size": 2**26 + 1}, "batch_size = 67108865 is outside [0, 67108864]"),
        ({"all_features": "yes"}, "all_features = 'yes' is not a bool"),
        ({"target_error": 1}, "target_error = 1 is outside (0, 1)"),
        ({"builder": "kd"}, "builder = 'kd' is unknown; allowed: auto, sah, ploc"),
        ({"features": np.array(3)}, "features = array(3) is not a list of strings"),
        ({"light_groups": np.array(3)}, "light_groups = array(3) is not a list of strings"),
        ({"cluster": 3}, "cluster = 3 is not text"),
    ],
)  # fmt: skip
def test_what_is_not_allowed(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        RenderSettings(**given)
    assert str(caught.value) == message
    assert isinstance(caught.value, SceneError) == (SETTINGS[next(iter(given))].scene is not None)


# ---- the command line ----


def test_options() -> None:
    parser = cli._parser()
    arguments = parser.parse_args(["render", "open"])
    assert {name: getattr(arguments, name) for name in SETTINGS} == DEFAULTS
    commands = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    options = {action.dest: action for action in commands.choices["render"]._actions}
    for name, setting in SETTINGS.items():
        assert options[name].option_strings == [f"--{name.replace('_', '-')}"]
        assert options[name].help == setting.help
    given = "--spp 3 --target-error 0.5 --all-features --builder sah --max-depth -1".split()
    arguments = parser.parse_args(["render", "open", *given])
    assert (arguments.spp, arguments.target_error, arguments.all_features) == (3, 0.5, True)
    assert (arguments.builder, arguments.max_depth) == ("sah", -1)


# ---- the native modules ----


def stub(name: str) -> set[str]:
    """Keywords of a function in `_native.pyi`."""
    tree = ast.parse((ROOT / "python" / "veriray" / "_native.pyi").read_text("utf-8"))
    found = next(n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == name)
    return {argument.arg for argument in found.args.kwonlyargs}


def literal(text: str) -> Any:
    """A value of C++ as Python has it."""
    text = re.sub(r"Sampler::k(\w+)", lambda m: f'"{m[1].lower()}"', text.strip())
    words = {"true": True, "false": False, "py::none()": None}
    return words[text] if text in words else ast.literal_eval(text)


def bound(name: str) -> dict[str, Any]:
    """Names and defaults of the keywords of a function in the bindings."""
    sources = sorted((ROOT / "python" / "bindings").glob("*.cpp"))
    text = "\n".join(path.read_text("utf-8") for path in sources)
    start = re.search(rf'm\.def\(\s*"{name}"', text)
    assert start
    arguments = text[text.index("py::kw_only()", start.start()) :]
    arguments = arguments[: arguments.index(");\n")]
    return {
        n: literal(v) for n, v in re.findall(r'"(\w+)"_a = ("\w+"|[\w:-]+(?:\(\))?)', arguments)
    }


def test_stub_and_bindings() -> None:
    assert stub("render") == {*native_defaults(), *RANGE, "units", "poll"}
    assert bound("render") == {**native_defaults(), **RANGE, "units": False, "poll": None}
    place = {"x": 0, "y": 0, "sample": 0}
    assert stub("trace_path") == {*native_defaults(path=True), *place}
    assert bound("trace_path") == {**native_defaults(path=True), **place}


def test_struct() -> None:
    text = (ROOT / "cpp" / "api" / "renderer.h").read_text("utf-8")
    body = re.search(r"struct RenderSettings \{(.*?)\};", text, re.S)
    assert body
    found: dict[str, Any] = {}
    for line in re.sub(r"//.*", "", body[1]).split(";")[:-1]:
        _, declared = line.strip().split(" ", 1)
        for part in declared.split(","):
            name, _, value = part.partition("=")
            found[name.strip()] = literal(value) if value else None
    assert found == {**native_defaults(), **RANGE, "units": False}


def test_native_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is asked for reaches the native module under its name there."""
    asked: list[dict[str, Any]] = []
    chosen, _ = rendering.device_module.select("cpu")

    def render(*_: object, **given: Any) -> Any:
        asked.append(given)
        raise ValueError("enough")

    monkeypatch.setattr(chosen.native, "render", render)
    given: dict[str, Any] = {
        "seed": 7, "scheduler": "thrust-copy", "max_depth": 3, "rr_depth": 2, "sampler": "sobol",
        "threads": 2, "batch_size": 99, "all_features": True,
    }  # fmt: skip
    with pytest.raises(ValueError, match="enough"):
        veriray.render(veriray.cornell_box(), 2, device="cpu", width=4, height=4, **given)
    assert {name: asked[0][SETTINGS[name].native] for name in given} == given
    assert set(asked[0]) == stub("render")
