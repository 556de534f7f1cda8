"""Every public function and class with absurd arguments raises documented errors.

The table lists callables and the arguments of each that are tried one at a time; the message of an
error names the argument (or the file).
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray import image
from veriray.errors import printable
from veriray.rendering import prepare, settle
from veriray.settings import RenderSettings


class Rude:
    """Raises whatever is done with it."""

    def __getattribute__(self, name: str) -> Any:
        if name == "__class__":
            return Rude
        raise RuntimeError("rude")

    def __repr__(self) -> str:
        raise RuntimeError("rude")

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("rude")

    def __float__(self) -> float:
        raise RuntimeError("rude")

    def __bool__(self) -> bool:
        raise RuntimeError("rude")

    def __eq__(self, other: object) -> bool:
        raise RuntimeError("rude")

    __hash__ = object.__hash__


HOSTILE: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "text": lambda: "three",
    "empty": lambda: "",
    "null": lambda: "a\0b",
    "surrogate": lambda: "\udc80",
    "number text": lambda: "1",
    "bytes": lambda: b"\xff",
    "True": lambda: True,
    "-1": lambda: -1,
    "0": lambda: 0,
    "2^70": lambda: 2**70,
    "10^400": lambda: 10**400,
    "-10^400": lambda: -(10**400),
    "10^5000": lambda: 10**5000,
    "nan": lambda: float("nan"),
    "inf": lambda: float("inf"),
    "1e300": lambda: 1e300,
    "float": lambda: 1.5,
    "sNaN": lambda: Decimal("sNaN"),
    "decimal": lambda: Decimal("1e999999"),
    "fraction": lambda: Fraction(10**400, 3),
    "complex": lambda: 1j,
    "list": lambda: [],
    "ragged": lambda: [[1, 2], [3]],
    "huge inside": lambda: [10**400, 1, 2],
    "texts": lambda: ["a", "b", "c"],
    "sNaNs": lambda: [Decimal("sNaN")] * 3,
    "dictionary": lambda: {},
    "keys": lambda: {1: 2},
    "set": lambda: {1},
    "generator": lambda: (k for k in range(3)),
    "function": lambda: len,
    "type": lambda: int,
    "object": lambda: object(),
    "rude": lambda: Rude(),
    "numpy nan": lambda: np.float32("nan"),
    "numpy bool": lambda: np.bool_(True),
    "numpy text": lambda: np.str_("x"),
    "numpy array": lambda: np.zeros((2, 2)),
    "numpy complex": lambda: np.zeros(3, complex),
    "numpy objects": lambda: np.array([object(), None, 10**400], object),
    "numpy long": lambda: np.ones(3, np.longdouble) * np.longdouble("1e400"),
    "numpy empty": lambda: np.zeros((0, 3, 3)),
    "numpy date": lambda: np.datetime64("NaT"),
}
ALLOWED = (ValueError, TypeError, OSError, vr.DeviceError)


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Good values of the arguments."""
    scene = vr.cornell_box().with_(width=4, height=4, spp=2, max_depth=2)
    picture = vr.render(scene, device="cpu", threads=1)
    path = tmp_path_factory.mktemp("hostile") / "a.exr"
    picture.save(path)
    work = vr.Accumulation(scene, device="cpu", threads=1)
    work.add(2)
    work.checkpoint().save(path.with_name("a.film"))
    return {"checkpoint": work.checkpoint(),
            "scene": scene, "picture": picture, "path": path, "film": scene.film,
            "features": vr.feature_images(scene, "depth", device="cpu", threads=1),
            "camera": scene.camera, "report": vr.compare(picture, picture),
            "device": vr.devices()[0]}  # fmt: skip


def _fields(value: Any) -> dict[str, Any]:
    """Fields of a dataclass that its constructor takes."""
    return {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.init}


def _used(good: vr.Render) -> Callable[..., Any]:
    """Makes a Render, and does with it what a user does."""

    def call(**fields: Any) -> None:
        made = vr.Render(**fields)
        made.save("made.exr")
        made.save("made.png")
        made._repr_png_()
        vr.compare(made, good)

    return call


def _row(call: Callable[..., Any], names: str, **good: Any) -> tuple[Any, list[str], Any]:
    return call, names.split(), good


Vector = (0.0, 0.0, 1.0)
TABLE: dict[str, Callable[[dict[str, Any]], tuple[Any, list[str], Any]]] = {
    "Accumulation": lambda g: _row(
        vr.Accumulation,
        "scene spp seed device scheduler max_depth rr_depth sampler width height threads "
        "batches batch_size progress target_error builder all_features first",
        scene=g["scene"],
        device="cpu",
        threads=1,
    ),
    "Accumulation.resume": lambda g: _row(
        lambda checkpoint: vr.Accumulation(g["scene"], device="cpu", threads=1).resume(checkpoint),
        "checkpoint",
    ),
    "Checkpoint": lambda g: _row(
        vr.Checkpoint, " ".join(_fields(g["checkpoint"])), **_fields(g["checkpoint"])
    ),
    "Checkpoint.save": lambda g: _row(g["checkpoint"].save, "path"),
    "Checkpoint.load": lambda g: _row(
        vr.Checkpoint.load, "path max_bytes", path=g["path"].with_name("a.film")
    ),
    "Checkpoint.merged": lambda g: _row(vr.Checkpoint.merged, "parts"),
    "Checkpoint.picture": lambda g: _row(g["checkpoint"].picture, "device"),
    "CheckpointError": lambda g: _row(vr.CheckpointError, "message"),
    "Accumulation.add": lambda g: _row(
        lambda n, progress=None: vr.Accumulation(g["scene"], device="cpu", threads=1).add(
            n, progress
        ),
        "n progress",
        n=1,
    ),
    "Accumulation.paths_of": lambda g: _row(
        vr.Accumulation(g["scene"], device="cpu", threads=1).paths_of, "n", n=1
    ),
    "render": lambda g: _row(
        vr.render,
        "scene spp seed device scheduler max_depth rr_depth sampler width height threads "
        "batches batch_size progress target_error builder all_features features feature_spp "
        "motion_to cameras checkpoint every time on_pass",
        scene=g["scene"],
        device="cpu",
        threads=1,
    ),
    "prepare": lambda g: _row(
        prepare, "scene device width height progress builder spp", scene=g["scene"], device="cpu"
    ),
    "settle": lambda g: _row(
        lambda scene, **given: settle(scene, RenderSettings(**given)),
        "scene spp seed max_depth rr_depth sampler scheduler threads batches batch_size "
        "all_features target_error builder features feature_spp motion_to",
        scene=g["scene"],
    ),
    "trace_path": lambda g: _row(
        vr.trace_path,
        "scene x y sample seed max_depth rr_depth sampler width height",
        scene=g["scene"],
        x=0,
        y=0,
        sample=0,
    ),
    "feature_images": lambda g: _row(
        vr.feature_images,
        "scene names spp seed device sampler width height threads motion_to progress",
        scene=g["scene"],
        device="cpu",
        threads=1,
    ),
    "FeatureImages": lambda g: _row(vr.FeatureImages, "images stderr spp motion_to"),
    "FeatureImages.save": lambda g: _row(g["features"].save, "path"),
    "lint": lambda g: _row(vr.lint, "scene", scene=g["scene"]),
    "dataset": lambda g: _row(
        vr.dataset,
        "scene folder cameras png exposure again progress spp seed",
        scene=g["scene"],
        folder=g["path"].with_name("views"),
        device="cpu",
        again=True,
    ),
    "Render.load": lambda g: _row(vr.Render.load, "path check", path=g["path"]),
    "film_hash": lambda g: _row(
        vr.film_hash,
        "image stderr spp samples",
        image=g["picture"].image,
        stderr=g["picture"].stderr,
        spp=2,
    ),
    "load_file": lambda g: _row(vr.load_file, "scene parameters", scene="open"),
    "load_dict": lambda g: _row(vr.load_dict, "scene"),
    "compare": lambda g: _row(
        vr.compare,
        "a b alpha seed regions region_names same_estimator target channels spp",
        a=g["picture"],
        b=g["picture"],
    ),
    "compare masks": lambda g: _row(
        vr.compare,
        "region_names",
        a=g["picture"],
        b=g["picture"],
        regions=np.zeros((4, 4), int),
    ),
    "Film": lambda g: _row(vr.Film, "width height filter filter_parameter"),
    "Film mitchell": lambda g: _row(vr.Film, "filter_parameter", filter="mitchell"),
    "Camera": lambda g: _row(
        vr.Camera,
        " ".join(f.name for f in dataclasses.fields(vr.Camera)),
        to_world=np.eye(4),
        fov=40.0,
    ),
    "look_at": lambda g: _row(
        vr.Camera.look_at, "origin target up fov", origin=(0, 0, 0), target=Vector
    ),
    "orthographic": lambda g: _row(
        vr.Camera.orthographic, "to_world near_clip far_clip medium", to_world=np.eye(4)
    ),
    "from_opengl": lambda g: _row(vr.Camera.from_opengl, "matrix fov", matrix=np.eye(4), fov=40),
    "from_opencv": lambda g: _row(
        vr.Camera.from_opencv,
        "K R t width height",
        K=[[9, 0, 4], [0, 9, 4], [0, 0, 1]],
        R=np.eye(3),
        t=(0, 0, 0),
        width=8,
        height=8,
    ),
    "from_opencv matrix": lambda g: _row(
        vr.Camera.from_opencv,
        "matrix",
        K=[[9, 0, 4], [0, 9, 4], [0, 0, 1]],
        width=8,
        height=8,
    ),
    "looking_at": lambda g: _row(g["camera"].looking_at, "target origin up", target=(278, 273, 0)),
    "orbit": lambda g: _row(g["camera"].orbit, "azimuth elevation centre up", azimuth=1.0),
    "dolly": lambda g: _row(g["camera"].dolly, "distance"),
    "tan_half_x": lambda g: _row(g["camera"].tan_half_x, "width height", width=4, height=4),
    "tan_half_y": lambda g: _row(g["camera"].tan_half_y, "width height", width=4, height=4),
    "Scene": lambda g: _row(
        vr.Scene,
        " ".join(f.name for f in dataclasses.fields(vr.Scene)),
        **{f.name: getattr(g["scene"], f.name) for f in dataclasses.fields(vr.Scene)},
    ),
    "with_": lambda g: _row(
        g["scene"].with_, " ".join(list(inspect.signature(vr.Scene.with_).parameters)[1:])
    ),
    "scaled": lambda g: _row(g["scene"].scaled, "factor"),
    "with_emission_scaled": lambda g: _row(g["scene"].with_emission_scaled, "factor"),
    "save": lambda g: _row(
        image.save,
        "render path exposure regions region_names",
        render=g["picture"],
        path=g["path"].with_name("b.exr"),
        regions=np.zeros((4, 4), int),
    ),
    "save png": lambda g: _row(
        image.save, "exposure", render=g["picture"], path=g["path"].with_name("b.png")
    ),
    "Render.save": lambda g: _row(g["picture"].save, "path"),
    "save_png": lambda g: _row(
        image.save_png,
        "image path exposure",
        image=g["picture"].image,
        path=g["path"].with_name("b.png"),
    ),
    "to_srgb8": lambda g: _row(image.to_srgb8, "image exposure", image=g["picture"].image),
    "load": lambda g: _row(image.load, "path max_bytes", path=g["path"]),
    "Render": lambda g: _row(
        _used(g["picture"]), " ".join(_fields(g["picture"])), **_fields(g["picture"])
    ),
    "Report": lambda g: _row(vr.Report, " ".join(_fields(g["report"])), **_fields(g["report"])),
    "Report.save": lambda g: _row(g["report"].save, "path"),
    "Device": lambda g: _row(vr.Device, " ".join(_fields(g["device"])), **_fields(g["device"])),
    "place": lambda g: _row(g["scene"].place, "message"),
    "SceneError": lambda g: _row(vr.SceneError, "message where", message="bad"),
    "SceneWarning": lambda g: _row(vr.SceneWarning, "message"),
    "ImageError": lambda g: _row(vr.ImageError, "message"),
    **{
        kind.__name__: lambda g, kind=kind: _row(lambda message: kind(message), "message")
        for kind in (
            vr.DeviceError,
            vr.MissingPackageError,
            vr.OutOfMemoryError,
            vr.RefusedSamplesWarning,
            vr.CheckpointWarning,
            vr.DeviceWarning,
        )
    },
}
#: What `compare` alone calls; and what needs a package (see test_denoising).
OWN = {"add_power", "add_means", "decide", "denoised"}


def test_the_table_is_complete() -> None:
    for name in vr.__all__:
        value = getattr(vr, name)
        if inspect.isclass(value):
            assert name in TABLE
            for method, function in inspect.getmembers(value, inspect.isroutine):
                if not method.startswith("_") and value.__module__ in str(
                    getattr(function, "__module__", "")
                ):
                    takes = set(inspect.signature(function).parameters) - {"self"}
                    known = {method, f"{name}.{method}"} & set(TABLE)
                    assert known or not takes or method in OWN, (name, method)
        elif inspect.isfunction(value) and inspect.signature(value).parameters:
            assert name in TABLE


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", TABLE)
def test_hostile_arguments(
    name: str, given: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(given["path"].parent)  # a hostile path may be a good one
    call, arguments, good = TABLE[name](given)
    problems = []
    for argument in arguments:
        # a scene's arrays may be wrong together
        words = arguments if name == "Scene" else [argument]
        names = re.compile(rf"\b({'|'.join(words)})\b", re.I)
        for kind, make in HOSTILE.items():
            what = f"{name}({argument} = {kind})"
            bad = make()
            if argument in ("progress", "on_pass") and kind in ("function", "type"):
                continue  # what a callback raises is its own
            try:
                call(**{**good, argument: bad})
            except ALLOWED as error:
                text = str(error)
                path = argument in ("path", "a", "b", "scene", "cameras") and isinstance(bad, str)
                file = path and printable(bad) in text
                if not isinstance(error, OSError) and not names.search(text) and not file:
                    problems.append(f"{what}: {type(error).__name__} without name: {text[:90]}")
                elif len(text) > 3000:
                    problems.append(f"{what}: a message of {len(text)} characters")
            except MemoryError as error:
                problems.append(f"{what}: {error!r}"[:200])
            except Exception as error:
                problems.append(f"{what}: {error!r}"[:200])
    assert not problems, "\n" + "\n".join(problems)


def test_compare_needs_a_seed(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="^seed = None is not an integer"):
        vr.compare(given["picture"], given["picture"], seed=None)  # type: ignore[arg-type]
