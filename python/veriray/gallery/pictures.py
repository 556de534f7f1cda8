"""The pictures of the gallery, and how each one's scene is made."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from ..errors import SceneError
from ..scene import Scene, load_file
from . import maps, meshes, model, spheres
from .own import protect


@dataclass(frozen=True)
class Picture:
    """One picture: figure of the report (0: not in it), file in scenes/ ("" for generated ones),
    values of the file's $names, names of the generated meshes and maps that it reads, batches to
    keep, the relative time of a path, for the estimate of the time left, and the exposure of the
    display copy in stops."""

    name: str
    figure: int
    file: str
    text: str
    values: dict[str, str] = field(default_factory=dict)
    meshes: tuple[str, ...] = ()
    spp: int = 1024
    batches: int = 0
    cost: float = 1.0
    maps: tuple[str, ...] = ()
    exposure: float = 0.0

    @property
    def title(self) -> str:
        """Its name, and its figure if it has one."""
        return f"{self.name} (figure {self.figure})" if self.figure else self.name


def medium(scattering: float, absorption: Sequence[float]) -> dict[str, str]:
    """Values of subsurface.xml from the report's coefficients, per unit of length.

    The report draws the free flight -log(u) / scattering and weights with exp(-absorption * d) per
    channel; the homogeneous medium of the same expectation has sigma_t = scattering + absorption
    and albedo = scattering / sigma_t, with an isotropic phase function.
    """
    total = [scattering + a for a in absorption]
    scale = max(total)
    return {
        "scale": f"{scale:.9g}",
        "sigma_t": ", ".join(f"{t / scale:.9g}" for t in total),
        "albedo": ", ".join(f"{scattering / t:.9g}" for t in total),
    }


_AMBER, _BLUE = (0.15, 0.50, 1.60), (1.20, 0.30, 0.01)


def _subsurface(scattering: float, absorption: Sequence[float], cost: float) -> Picture:
    listed = ", ".join(f"{a:g}" for a in absorption)
    return Picture(
        f"subsurface-{scattering:g}",
        5,
        "gallery/subsurface.xml",
        f"Subsurface scattering in a closed mesh: sigma_s = {scattering:g}, absorption {listed} "
        "(red, green, blue) per unit of length; refractive index 1.3, unlimited depth.",
        medium(scattering, absorption),
        ("mesh", "sweep"),
        cost=cost,
    )


PICTURES = (
    Picture(
        "studio", 1, "gallery/studio.xml",
        "A studio: a hare with subsurface scattering, a knot of gold, clear and tinted glass, "
        "milk, a mirror, plastic and a bubble under three soft boxes; thin lens, 40 bounces.",
        meshes=("hare", "knot", "sweep"), spp=1536, cost=5.0,
    ),
    Picture(
        "spheres", 3, "gallery/spheres.xml",
        "Glass, mirror, gold, copper, plastic and diffuse spheres through a thin lens.",
    ),
    Picture(
        "lens", 4, "gallery/lens.xml",
        "Rows of glossy, mirror and glass spheres at dusk; far lamps become discs of light in a "
        "wide aperture.",
        cost=2.0,
    ),
    _subsurface(64, _AMBER, 14.0),
    _subsurface(16, _AMBER, 9.0),
    _subsurface(4, _AMBER, 4.0),
    _subsurface(1, _BLUE, 2.5),
    Picture(
        "spheres-300", 6, "",
        "300 random spheres from a seed: diffuse colours, one in six a lamp.",
        cost=4.0,
    ),
    Picture(
        "cornell", 7, "cornell/cornell_box.xml",
        "The measured Cornell box.",
        {"width": "128", "height": "128"}, spp=4096, batches=64, cost=0.5, exposure=1.5,
    ),
    Picture(
        "room", 8, "gallery/room.xml",
        "A room by day: window, ceiling light and sphere lamps, a glossy floor, a hare of jade, a "
        "glass knot, a round mirror; thin lens, 40 bounces.",
        meshes=("hare", "knot", "tiles_dark", "tiles_light"), cost=11.0,
    ),
    Picture(
        "daylight", 0, "gallery/daylight.xml",
        "A room by the light of sun and sky through a window: textured boards, plaster, rug, "
        "painting and furniture, rough glass, brushed brass, clay under a clear coat.",
        meshes=("hare", "knot"), spp=4096, cost=4.0,
        maps=("planks.png", "wood.png", "plaster.png", "weave.png", "painting.png", "sky.exr"),
    ),
    Picture(
        "still-life", 0, "gallery/still_life.xml",
        "Rough gold, copper, aluminium and scratched silver, frosted and clear glass, lacquer and "
        "enamel on dark wood; a soft box and a sky, through a thin lens.",
        meshes=("hare", "knot"), spp=2048, cost=3.0, maps=("wood.png", "scratches.png", "sky.exr"),
    ),
    Picture(
        "terrace", 0, "",
        "A glTF model under the sun and sky of Hosek and Wilkie: bronze, lacquer, glass and stone "
        "on textured boards.",
        spp=2048, cost=3.0, exposure=1.0,
    ),
)  # fmt: skip


def names() -> tuple[str, ...]:
    """Names of the pictures, in the order of the report's figures."""
    return tuple(picture.name for picture in PICTURES)


def select(wanted: Sequence[str]) -> list[Picture]:
    """The pictures of these names, () for all; "fig5" stands for all of figure 5.

    Raises ValueError for an unknown name.
    """
    chosen = []
    for name in wanted:
        match = re.fullmatch(r"fig(?:ure)?[-_ ]?([1-9])", name)
        found = [p for p in PICTURES if p.name == name or (match and p.figure == int(match[1]))]
        if not found:
            known = ", ".join(p.name + (f" (fig{p.figure})" if p.figure else "") for p in PICTURES)
            raise ValueError(f"gallery has no picture {name!r}; it has {known}")
        chosen += found
    return [p for p in PICTURES if not wanted or p in chosen]


def find(file: str) -> Path | None:
    """A file of scenes/: in the installed package, in the source checkout, or in a checkout that is
    the working directory; else None."""
    package = Path(__file__).resolve().parents[1]
    for root in (package / "scenes", package.parents[1] / "scenes", Path("scenes")):
        if (root / file).is_file():
            return root / file
    return None


@cache
def _made(name: str) -> meshes.Mesh:
    return meshes.MAKERS[name]()


@cache
def _map(name: str) -> maps.Array:
    return maps.MAKERS[name]()


def load(name: str, folder: Path, mesh: Path | None = None, force: bool = False) -> Scene:
    """The scene of a picture. Generated meshes, maps and scene files are written to `folder`.

    mesh: a closed mesh, y up and facing +z, for figure 5 in place of the hare.
    force: also replace files of these names that the gallery did not make.
    Raises ValueError for an unknown name, SceneError as `load_file` does or for a mesh that is not
    closed, OSError if the folder cannot be written or holds such files.
    """
    (picture,) = [p for p in PICTURES if p.name == name] or select([name])[:1]
    folder.mkdir(parents=True, exist_ok=True)
    if name == "terrace":
        protect([folder / f"{name}.glb"], force)
        model.write(folder / f"{name}.glb")
        return model.load(folder / f"{name}.glb")
    if not picture.file:
        protect([folder / f"{name}.xml"], force)
        spheres.write(folder / f"{name}.xml")
        return load_file(folder / f"{name}.xml")
    path = find(picture.file)
    if path is None:
        raise SceneError(f"scenes/{picture.file} is not installed")
    values: dict[str, object] = dict(picture.values)
    for wanted in picture.meshes:
        file = folder / f"{wanted}.ply"
        protect([file], force)
        if wanted == "mesh" and mesh is not None:
            meshes.write_ply(file, meshes.standing(mesh))
        else:
            meshes.write_ply(file, _made("hare" if wanted == "mesh" else wanted))
        values[wanted] = str(file.resolve())
    for wanted in picture.maps:
        file = folder / wanted
        protect([file], force)
        maps.write(file, _map(wanted))
        values[file.stem] = str(file.resolve())
    return load_file(path, values)
