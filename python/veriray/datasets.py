"""Folders of many pictures of one scene, with their cameras: `dataset`."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .camera import Camera
from .errors import ImageError, SceneError, printable
from .files import check_writable, open_regular, replacing
from .first_surface import pixel_rows
from .formats.cameras import View, load, parsed, transforms
from .light_groups import layers
from .numeric import number, path_text, shown, switch
from .picture import Render
from .rendering import render_with, settle
from .saving import save_png
from .settings import MAX_STOPS, SETTINGS, RenderSettings

if TYPE_CHECKING:
    from .scene import Scene

#: Settings that decide a picture, beside the scene's hash; others decide its time alone.
DECIDING = ("spp", "seed", "sampler", "max_depth", "rr_depth", "target_error", "version")
#: Stands in the PNG files and the transforms.json of data sets.
MARK = "made by veriray dataset"


def dataset(
    scene: Scene,
    folder: str | os.PathLike[str],
    cameras: str | os.PathLike[str] | Sequence[Camera] | None = None,
    *,
    png: bool = False,
    exposure: float = 0.0,
    again: bool = False,
    progress: Callable[[float], object] | None = None,
    **settings: Any,
) -> list[Path]:
    """Renders views of a scene to a folder: NAME.exr for each, and transforms.json.

    What is there already, whole and with the same scene and settings, is kept, so that a run that
    was stopped goes on. Display copies follow their EXR file and the exposure. View k has the seed
    `seed` + k, so that no two pictures share their noise. The feature "motion" is to the next view,
    unless `motion_to` says to which camera: the last view then has none.

    Args:
        scene: seen by all cameras, each with the near and far plane, aperture, focus and medium of
            the scene's own.
        folder: is made if it is missing.
        cameras: a file or folder (see `veriray.formats.cameras`), a list of cameras, or None for
            all of the scene's sensors.
        png: also writes display copies, with this exposure in stops.
        again: replaces files of other settings, and those that no data set made, which otherwise
            are an error; never the file of cameras.
        progress: called with the fraction of all views that are not there yet.
        settings: as `render` takes them, but for width and height where the cameras state them.

    Returns:
        The files, transforms.json last.

    Raises:
        SceneError, ValueError: bad cameras or settings. ImageError: a file in the way that is
        damaged, of other settings or of another origin. OSError: a file that cannot be written.
    """
    png, again = (switch(name, x, error=ValueError) for name, x in (("png", png), ("again", again)))
    exposure = number("exposure", exposure, -MAX_STOPS, MAX_STOPS, error=ValueError)
    if progress is not None and not callable(progress):
        raise ValueError(f"progress = {shown(progress)} is not callable")
    own = RenderSettings(**settings)
    to_next = "motion" in own.features and own.motion_to is None
    used, _ = settle(scene, own.with_checked({"motion_to": scene.camera}) if to_next else own)
    views = _views(used, cameras)
    described = {"comment": MARK, **transforms(views)}  # refuses what it cannot hold
    each = [
        dataclasses.replace(own, seed=(own.seed + k) % 2**64, width=None, height=None)
        for k in range(len(views))
    ]
    if to_next:
        each = _moving(each, views)
    root = Path(path_text("folder", folder))
    files = [root / f"{view.name}.exr" for view in views]
    listed = root / "transforms.json"
    _check_origin(listed, described, cameras, again)
    missing, stale = [], []
    for k, file in enumerate(files):
        old = _kept(file, used, views[k], each[k], again)
        copy = _beginning(file.with_suffix(".png")) if png else None
        if copy is not None and MARK.encode() not in copy and not again:
            raise _foreign(file.with_suffix(".png"))
        if old is None:
            missing.append(k)
        elif png and (copy is None or _note(old, exposure).encode() not in copy):
            stale.append(k)
    root.mkdir(parents=True, exist_ok=True)
    check_writable(listed)
    for k in (*missing, *stale):
        files[k].parent.mkdir(parents=True, exist_ok=True)
        check_writable(files[k])
    for k in stale:
        _save_copy(Render.load(files[k]), files[k], exposure)
    for done, k in enumerate(missing):

        def part(fraction: float, done: int = done) -> None:
            if progress is not None:
                progress((done + fraction) / len(missing))

        render = render_with(_seen(used, views[k]), each[k], part)
        if png:
            _save_copy(render, files[k], exposure)
        render.save(files[k])  # last: it says that all files of the view are there
    with replacing(listed) as out:
        out.write((json.dumps(described, indent=1) + "\n").encode())
    return [*files, listed]


def _check_origin(listed: Path, described: dict[str, Any], cameras: Any, again: bool) -> None:
    """Raises ImageError where transforms.json holds what no data set wrote, or the cameras."""
    if not listed.exists():
        return
    if isinstance(cameras, (str, os.PathLike)) and os.path.samefile(cameras, listed):
        raise ImageError(f"{listed} would replace the list of cameras: choose another folder (-o)")
    if again:
        return
    try:
        old = parsed(os.fspath(listed))
    except SceneError:
        old = {}
    if old.keys() != described.keys() or old["comment"] != MARK:
        raise _foreign(listed)


def _foreign(file: Path) -> ImageError:
    return ImageError(
        f"{file} is in the way: veriray dataset did not write it, or it was changed since "
        "(again replaces it)"
    )


def _beginning(file: Path) -> bytes | None:
    """The bytes of a file among which its comment stands; None if there is no file."""
    try:
        with open_regular(file) as there:
            return there.read(4096)
    except FileNotFoundError:
        return None


def _note(render: Render, exposure: float) -> str:
    """What the comment of a display copy says."""
    return f"{MARK} of film {render.film_sha256} at exposure {exposure!r}."


def _save_copy(render: Render, file: Path, exposure: float) -> None:
    save_png(
        render.image, file.with_suffix(".png"), exposure=exposure, note=_note(render, exposure)
    )


def _moving(each: list[RenderSettings], views: list[View]) -> list[RenderSettings]:
    """The settings of each view with its motion to the next one; the last view has none."""
    if len(views) < 2:
        raise ValueError('feature "motion" is to the next view, and there is one: set motion_to')
    for one, other in itertools.pairwise(views):
        if (one.width, one.height) != (other.width, other.height):
            text = (
                f"{one.name} has {one.width} x {one.height} pixels and the next view, {other.name}"
            )
            raise ValueError(printable(f'feature "motion": {text}, {other.width} x {other.height}'))
    still = tuple(name for name in each[-1].features if name != "motion")
    moving = [dataclasses.replace(settings, motion_to=view.camera)
              for settings, view in zip(each, views[1:], strict=False)]  # fmt: skip
    return [*moving, dataclasses.replace(each[-1], features=still)]


def _seen(scene: Scene, view: View) -> Scene:
    """The scene from a view; geometry and tree are shared."""
    return scene.with_(camera=view.camera, width=view.width, height=view.height)


def _views(scene: Scene, cameras: Any) -> list[View]:
    if cameras is None:
        cameras = scene.cameras
    if isinstance(cameras, (str, os.PathLike)):
        names = ("near_clip", "far_clip", "aperture_radius", "focus_distance", "medium")
        lens = {name: getattr(scene.camera, name) for name in names}
        return load(cameras, scene.film.width, scene.film.height, **lens)
    if not isinstance(cameras, (list, tuple)) or not all(isinstance(c, Camera) for c in cameras):
        raise TypeError(f"cameras = {shown(cameras)}; expected a path, or a list of Camera")
    if not cameras:
        raise ValueError("cameras is an empty list")
    size = scene.film.width, scene.film.height
    return [View(f"{k:04d}", camera, *size) for k, camera in enumerate(cameras)]


def _kept(
    file: Path, scene: Scene, view: View, settings: RenderSettings, again: bool
) -> Render | None:
    """This view of a file, if it is there. Raises ImageError where another one is in the way."""
    if not file.exists():
        return None
    used, settled = settle(_seen(scene, view), settings)
    try:
        old = Render.load(file)
        found, missing = old.stats, {*settled.features} - {*old.features}
        batches = 0 if old.batch_means is None else len(old.batch_means)
        if batches != settled.batches:
            raise ImageError(
                f"{file} is in the way: batches is {batches}, not {settled.batches} "
                "(again replaces it)"
            )
        if settled.feature_spp not in (None, old.features.spp) and {*settled.features}:
            raise ImageError(
                f"{file} is in the way: feature_spp is {old.features.spp}, not "
                f"{settled.feature_spp} (again replaces it)"
            )
        if missing:
            raise ImageError(
                f"{file} is in the way: it lacks {', '.join(sorted(missing))} (again replaces it)"
            )
        if settled.motion_to is not None:
            rows = pixel_rows(settled.motion_to, view.width, view.height)
            if not np.array_equal(np.asarray(old.features.motion_to), rows):
                raise ImageError(
                    f"{file} is in the way: its motion is to another camera (again replaces it)"
                )
        if settled.light_groups and old.features.lamps != layers(used, [*settled.light_groups]):
            raise ImageError(f"{file} is in the way: it has other light groups (again replaces it)")
        wanted = {"scene_sha256": used.sha256, **_deciding(settled)}
        for name, value in wanted.items():
            if (found.get(name) or None) != (value or None):
                raise ImageError(
                    f"{file} is in the way: {name} is {shown(found.get(name))}, not {shown(value)} "
                    "(again replaces it)"
                )
    except ImageError:
        if again:
            return None
        raise
    return old


def _deciding(settings: RenderSettings) -> dict[str, Any]:
    from . import __version__

    values: dict[str, Any] = {
        name: getattr(settings, name) for name in DECIDING if name in SETTINGS
    }
    return values | {"version": __version__}
