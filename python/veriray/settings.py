"""The settings of a render, once: defaults, what is allowed, meanings.

Checks, options of the command line, the header of an EXR file and the call of the native modules
follow from `SETTINGS`; tests/python/test_settings.py compares it with what states names and
defaults again for readers: `veriray.render`, `Scene`, `_native.pyi`, cpp/api/renderer.h and the
bindings. To add a setting, add a field of `RenderSettings`, and there. Loads no NumPy, as the
command line is read without.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .errors import SceneError

if TYPE_CHECKING:
    from .camera import Camera

#: Ways in which scheduler `thrust` closes the gaps of ended paths; the 2016 report's is remove_if.
COMPACTIONS = {
    "none": "thrust-none",
    "remove_if": "thrust",
    "partition": "thrust-partition",
    "copy_if": "thrust-copy",
    "append": "thrust-append",
}
#: One scheduler of each method.
METHODS = ("fused", "thrust", "wavefront")
SCHEDULERS = ("auto", "fused", *sorted(COMPACTIONS.values()), "wavefront", "wavefront-unsorted")
#: How a tree is built: binned SAH with spatial splits on the host, or clustering (PLOC) on the
#: device. The films are the same.
BUILDERS = ("auto", "sah", "ploc")
SAMPLERS = ("independent", "sobol")
#: Feature images; `veriray.features` says what they are.
FEATURES = (
    "depth", "depth_axis", "position", "normal", "geo_normal", "albedo", "uv", "motion", "alpha",
    "object", "material", "primitive", "direct", "indirect",
)  # fmt: skip
DEVICES = "auto, cuda, cuda:N, cpu, cpu:avx512, cpu:avx2, cpu:portable"
#: Segments of a path at most; -1 in a scene stands for this.
MAX_PATH_DEPTH = 262143
MAX_SPP = 2**40
#: Of an exposure, both ways.
MAX_STOPS = 1000
MAX_BATCHES = 1000
#: Columns of the ray ledger, in the native modules' order.
LEDGER_COLUMNS = (
    "live", "escaped", "emitter_end", "absorbed", "rr_killed", "depth_cut", "invalid",
    "shadow_visible", "shadow_occluded",
)  # fmt: skip
#: How files keep a setting: an EXR header as an attribute of its own, or within `veriray.stats`.
HEADER, STATS = "header", "stats"


@dataclass(frozen=True)
class Setting:
    """What there is to know of a setting.

    doc: for the command line. low, high: of an integer, inclusive, or of a float, exclusive.
    choices: of a text. several: of a tuple of texts, or one with commas between them. scene: what a
    scene has if it states nothing, for settings that None takes from the scene; none: what None
    stands for otherwise. native: its name in the native modules, "" if they do not take it. path:
    paths depend on it. kept: HEADER, STATS, or "" where no file has it. joined: a list of texts is
    one text with commas. groups: texts of `veriray.light_groups.entries`. camera: a Camera, which
    the command line reads from a text.
    """

    default: Any
    doc: str
    low: float | None = None
    high: float = 0
    choices: tuple[str, ...] = ()
    several: tuple[str, ...] = ()
    scene: Any = None
    none: str = ""
    native: str = ""
    path: bool = False
    kept: str = ""
    joined: bool = False
    groups: bool = False
    camera: bool = False

    @property
    def is_text(self) -> bool:
        """Whether its values are texts."""
        named = self.choices or self.several or self.groups or self.camera
        return bool(named) or isinstance(self.default, str)

    @property
    def help(self) -> str:
        """Meaning, what is allowed, and the default."""
        text, default = self.doc, self.default
        if self.choices or self.several:
            text += f": {', '.join(self.choices or self.several)}"
        elif isinstance(self.low, float):
            text += f", in ({self.low:g}, {self.high:g})"
        elif self.low is not None:
            text += f", {_power(self.low)} to {_power(int(self.high))}"
        if default is None:
            default = self.none if self.scene is None else "the scene's"
        unsaid = default in ("", ()) or default is False
        return text if unsaid else f"{text} (default: {default})"

    def checked(self, name: str, value: Any, error: type[ValueError]) -> Any:
        """`value` as a plain one. Raises `error` if it is not allowed."""
        from .numeric import choice, number, shown, switch, texts, whole

        if self.groups:
            from .light_groups import entries

            return entries(name, value, error)
        if self.camera:
            return _camera(name, value, error)
        if self.several:
            names = tuple(value.split(",")) if isinstance(value, str) else texts(name, value, error)
            each = [choice(name, one.strip(), self.several, error=error) for one in names]
            return tuple(dict.fromkeys(each))
        if self.choices:
            return choice(name, value, self.choices, error=error)
        if isinstance(self.low, float):
            return number(name, value, self.low, self.high, open_=True, error=error)
        if self.low is not None:
            return whole(name, value, int(self.low), int(self.high), error=error)
        if self.joined and isinstance(value, (list, tuple)):
            return ",".join(texts(name, value, error))
        if self.default == "" and not self.joined and not isinstance(value, str):
            raise error(f"{name} = {shown(value)} is not text")
        return switch(name, value, error=error) if self.default is False else value


def _camera(name: str, value: Any, error: type[ValueError]) -> Camera:
    from .camera import Camera
    from .numeric import shown

    if not isinstance(value, Camera):
        raise error(f"{name} = {shown(value)} is not a Camera")
    return value


def _power(number: int) -> str:
    """A number as text; one at a large power of two as that."""
    for off in (0, 1):
        exponent = (number + off).bit_length() - 1
        if exponent >= 20 and number + off == 2**exponent:
            return f"2^{exponent}{' - 1' * off}"
    return str(number)


def _setting(default: Any, doc: str, low: float | None = None, high: float = 0,
             **known: Any) -> Any:  # fmt: skip
    return field(default=default, metadata={"setting": Setting(default, doc, low, high, **known)})


@dataclass(frozen=True, kw_only=True)
class RenderSettings:
    """What `veriray.render` is asked for, which describes the settings; checked, one by one.

    Names of devices are checked by `veriray.device.select`, the size by `veriray.Film`. Raises
    ValueError, SceneError for what belongs to the scene.
    """

    spp: int | None = _setting(None, "samples per pixel", 1, MAX_SPP, scene=4, kept=HEADER)
    seed: int = _setting(
        0, "of the random numbers", 0, 2**64 - 1, native="seed", path=True, kept=HEADER
    )
    device: str | Sequence[str] = _setting(
        "auto", f"{DEVICES}, or several with commas between them", joined=True, kept=HEADER
    )
    scheduler: str = _setting(
        "auto", "who runs the paths", choices=SCHEDULERS, native="scheduler", kept=HEADER
    )
    max_depth: int | None = _setting(
        None, "segments of the longest path (1 emission, -1 no limit)", -1, MAX_PATH_DEPTH,
        scene=-1, native="max_depth", path=True, kept=HEADER,
    )  # fmt: skip
    rr_depth: int | None = _setting(
        None, "first depth of Russian roulette", 1, 2**31 - 1, scene=5, native="rr_depth",
        path=True, kept=HEADER,
    )  # fmt: skip
    sampler: str | None = _setting(
        None, "where random numbers come from", choices=SAMPLERS, scene="sobol",
        native="sampler", path=True, kept=HEADER,
    )  # fmt: skip
    width: int | None = _setting(None, "film width in pixels", scene=768, path=True, kept=STATS)
    height: int | None = _setting(None, "film height in pixels", scene=576, path=True, kept=STATS)
    threads: int | None = _setting(None, "CPU threads", 1, 1024, none="all", native="threads")
    batches: int = _setting(0, "batch means to keep, not 1", 0, MAX_BATCHES, kept=STATS)
    batch_size: int = _setting(
        0, "paths in flight, 0 for as many as fit", 0, 2**26, native="batch", kept=STATS
    )
    all_features: bool = _setting(False, "run the all-features variant", native="all_features")
    target_error: float | None = _setting(
        None, "relative standard error at which tiles stop (--spp is the most)", 0.0, 1.0
    )
    builder: str = _setting("auto", "who builds the tree", choices=BUILDERS)
    features: str | tuple[str, ...] = _setting(
        (),
        "feature images beside the picture, with commas between them; motion with --motion-to",
        several=FEATURES,
    )
    feature_spp: int | None = _setting(
        None, "their samples per pixel", 1, MAX_SPP, none="8, or as many as the picture has"
    )
    light_groups: str | Sequence[str] | Mapping[str, Any] = _setting(
        (), "pictures by the light of some lamps each, as GROUP=LAMP with commas between them, or "
        '"*" for one of each lamp', groups=True,
    )  # fmt: skip
    motion_to: Camera | None = _setting(
        None, "second camera of the image motion: the number of another sensor, or FILE[:NAME] "
        "with a camera of a list as `dataset` takes it", camera=True,
    )  # fmt: skip
    cluster: str = _setting(
        "", "address of a Ray cluster that renders: auto, local, HOST:PORT or ray://HOST:PORT"
    )

    def __post_init__(self) -> None:
        for name, setting in SETTINGS.items():
            value = getattr(self, name)
            if value is not setting.default:
                error = ValueError if setting.scene is None else SceneError
                object.__setattr__(self, name, setting.checked(name, value, error))

    def with_checked(self, values: dict[str, Any]) -> RenderSettings:
        """A copy with other values, which are known to be allowed."""
        copy = object.__new__(RenderSettings)
        copy.__dict__.update(self.__dict__, **values)
        return copy

    def of_scene(self) -> dict[str, Any]:
        """Those that None takes from the scene, as `Scene.with_` takes them."""
        return {name: getattr(self, name) for name, setting in SETTINGS.items()
                if setting.scene is not None}  # fmt: skip

    def kept(self) -> dict[str, Any]:
        """Those that files have, by name."""
        return {name: getattr(self, name) for name, setting in SETTINGS.items() if setting.kept}

    def native(self, *, path: bool = False) -> dict[str, Any]:
        """Those that the native modules take, by their names there; path: of one path alone."""
        chosen = {s.native: getattr(self, name) for name, s in SETTINGS.items()
                  if s.native and (s.path or not path)}  # fmt: skip
        return {name: 0 if value is None else value for name, value in chosen.items()}


SETTINGS: dict[str, Setting] = {
    f.name: f.metadata["setting"] for f in dataclasses.fields(RenderSettings)
}
