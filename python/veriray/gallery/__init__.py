"""The gallery: every figure of the report "Parallel Path Tracing in CUDA" (H. Dahlberg, 2016), and
pictures of what the report had not.

`run` renders the pictures into a folder, each as NAME.exr and NAME.png, and makes a contact sheet
and a page of them. Figure 2 is an experiment: benchmarks/correlated_seeds.py.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .own import MARK, is_foreign, protect
from .pictures import Picture, find, load, names, select

if TYPE_CHECKING:
    from ..picture import Render
    from ..scene import Scene

__all__ = ["load", "names", "run"]

REFERENCE = "cornell/refs/cornell_box_128.exr"
Show = Callable[[str], AbstractContextManager[Callable[[float], Any] | None]]


def run(
    names: Sequence[str] = (),
    output: str | os.PathLike[str] = "gallery",
    *,
    mesh: str | os.PathLike[str] | None = None,
    spp: int | None = None,
    seed: int = 0,
    width: int | None = None,
    scale: float = 1.0,
    device: str = "auto",
    threads: int | None = None,
    force: bool = False,
    sheet_only: bool = False,
    docs: str | os.PathLike[str] | None = None,
    show: Show | None = None,
    say: Callable[[str], object] | None = None,
) -> list[Path]:
    """Render pictures of the gallery, then make its contact sheet and page.

    A picture is skipped if its EXR exists with the same scene, samples and seed, so a stopped run
    continues where it was. Files appear whole or not at all.

    Args:
        names: pictures, or "fig5" for all of a figure; () for all.
        output: folder, created if missing; generated scenes, meshes and maps go there too.
        mesh: closed mesh for figure 5 (y up, facing +z); None takes the generated hare.
        spp: samples per pixel; None takes each picture's own.
        seed: of all pictures.
        width: in pixels, of all pictures; the height follows. None takes `scale` times their own.
        scale: of width and height, 0 to 16.
        device, threads: as for `render`.
        force: also render existing pictures, and replace files that the gallery did not make.
        sheet_only: render nothing.
        docs: folder of gallery.md and images/; None takes `output`.
        show: maps a title to a context that gives a progress callback or None.
        say: called with one line for each step.

    Returns:
        The files written.

    Raises:
        ValueError: an unknown name or a setting out of range; also as `render` and `load` do.
        OSError: a file that cannot be written; before anything is rendered, FileExistsError for a
            file in the way that the gallery did not make.
    """
    from . import sheet

    say = say or (lambda line: None)
    folder = Path(output)
    if not 0 < scale <= 16:
        raise ValueError(f"scale = {scale!r} is outside (0, 16]")
    if width is not None and not 1 <= width <= 65536:
        raise ValueError(f"width = {width!r} is outside [1, 65536]")
    chosen = select(names)
    written: list[Path] = []
    place = folder if docs is None else Path(docs)
    protect(sheet.outputs(folder, place, () if sheet_only else [p.name for p in chosen]), force)
    if not sheet_only:
        folder.mkdir(parents=True, exist_ok=True)
        jobs = []
        for picture in chosen:
            loaded = load(picture.name, folder, Path(mesh) if mesh else None, force)
            scene = _sized(loaded, width, scale)
            jobs.append((picture, scene, picture.spp if spp is None else spp))
            ours = [folder / f"{picture.name}{end}" for end in (".exr", ".png", "-report.html")]
            if any(map(is_foreign, ours)) and not (
                ours[1].is_file() and _finished(ours[0], *jobs[-1][1:], seed)
            ):
                protect(ours, force)
        settings = {"seed": seed, "device": device, "threads": threads}
        written += _render_all(jobs, folder, settings, force, show or _quietly, say)
    made = sheet.make(folder, place)
    for path in made:
        say(f"written    {path}")
    if not made:
        say(f"no pictures in {folder}: no contact sheet")
    return written + made


@contextlib.contextmanager
def _quietly(title: str) -> Iterator[None]:
    yield None


def _sized(scene: Scene, width: int | None, scale: float) -> Scene:
    """The scene with a film `width` pixels wide, or `scale` times its own, of the same aspect."""
    film = scene.film
    factor = scale if width is None else width / film.width
    width, height = (max(round(pixels * factor), 1) for pixels in (film.width, film.height))
    return scene.with_(width=width, height=height)


def _render_all(
    jobs: list[tuple[Picture, Scene, int]],
    folder: Path,
    settings: dict[str, Any],
    force: bool,
    show: Show,
    say: Callable[[str], object],
) -> list[Path]:
    """Render what is missing; returns the files written."""
    from ..rendering import render, settle
    from ..settings import RenderSettings
    from . import sheet

    work = [p.cost * s.film.width * s.film.height * spp for p, s, spp in jobs]
    written: list[Path] = []
    done, rendered, start = 0.0, 0.0, time.perf_counter()
    for k, (picture, scene, spp) in enumerate(jobs):
        batches = picture.batches if picture.batches and spp % picture.batches == 0 else 0
        settle(scene, RenderSettings(spp=spp, **settings))
        exr, png = folder / f"{picture.name}.exr", folder / f"{picture.name}.png"
        result = None if force else _finished(exr, scene, spp, settings["seed"])
        head = f"picture {k + 1} of {len(jobs)}"
        if result is not None:
            say(f"{head}: {picture.name} exists")
        else:
            film, rate = scene.film, rendered / max(time.perf_counter() - start, 1e-9)
            left = f", about {(sum(work) - done) / rate:.0f} s left" if rate > 0 else ""
            title = (
                f"{head} ({100 * done / sum(work):.0f} %{left}): {picture.name}, "
                f"{film.width} x {film.height}, {spp} spp"
            )
            with show(title) as progress:
                result = render(scene, spp, progress=progress, batches=batches, **settings)
            result.stats["origin"] = MARK
            result.save(exr)
            written.append(exr)
            rendered += work[k]
            say(f"{head}: {picture.name}, {sheet.speed(sheet.facts(result))}")
        done += work[k]
        if exr in written or not png.is_file():
            sheet.save_png(png, _display(picture, result, folder, say), result)
            written.append(png)
    return written


def _finished(path: Path, scene: Scene, spp: int, seed: int) -> Render | None:
    """The render in `path` if it is complete and of this scene, with these samples and seed."""
    from .. import image

    try:
        found = image.load(path)
    except (OSError, ValueError):
        return None
    same = (found.stats.get("scene_sha256"), found.spp, found.seed) == (scene.sha256, spp, seed)
    return found if same else None


def _display(picture: Picture, result: Render, folder: Path, say: Callable[[str], object]) -> Any:
    """The picture to show, (H, W, 3) sRGB bytes; for figure 7 beside the reference, compared."""
    from .. import image
    from . import sheet

    if picture.figure != 7:
        return image.to_srgb8(result.image, picture.exposure)
    reference = find(REFERENCE)
    theirs = image.load(reference) if reference else None
    if theirs is None or result.image.shape != theirs.image.shape:
        say(f"compare    not made: it needs 128 x 128 pixels and scenes/{REFERENCE} of a checkout")
        return image.to_srgb8(result.image, picture.exposure)
    from .. import compare

    report = compare(result, theirs)
    report.notes.append(f"{MARK}, for the picture {picture.name}")
    report.save(folder / f"{picture.name}-report.html")
    say(f"compare    {report.verdict}")
    result.stats["compare"] = report.verdict
    return sheet.side_by_side(result, theirs, picture.exposure)
