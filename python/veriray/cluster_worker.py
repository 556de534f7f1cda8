"""What runs on the nodes of a cluster: an actor that draws ranges of samples into its own films."""

from __future__ import annotations

import functools
import hashlib
import platform
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import device as device_module
from .crew import Crew, Films
from .plan import settle
from .scene import Scene
from .settings import RenderSettings

if TYPE_CHECKING:
    from ._native import FilmState, Report


@functools.cache
def digests() -> dict[str, str]:
    """SHA-256 of this installation's Python code and of each native module, by name; and the
    version."""
    from . import __version__

    root = Path(__file__).parent
    code = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        code.update(f"{path.relative_to(root).as_posix()}\n{path.stat().st_size}\n".encode())
        code.update(path.read_bytes())
    native = {
        path.name.split(".")[0]: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in root.glob("_c*.so")
    }
    return {"version": __version__, "code": code.hexdigest(), **native}


def differences(own: dict[str, str], other: dict[str, str]) -> str:
    """What is otherwise in another installation; "" if nothing. Native modules that one of them
    lacks, CUDA's for example, do not count."""
    if own["version"] != other["version"]:
        return f"veriray {other['version']}, not {own['version']}"
    names = [name for name in own if name in other and own[name] != other[name]]
    return f"another build of veriray: {', '.join(names)} differ" if names else ""


class Worker:
    """Draws for one node. Films are those of one pass, by its number; a new number begins anew."""

    def __init__(self) -> None:
        self._crew: Crew | None = None
        self._films: Films = ()
        self._number = -1

    def hello(self) -> tuple[str, dict[str, str]]:
        """The machine's name, and `digests`."""
        return platform.node(), digests()

    def prepare(self, shipped: tuple[Scene, dict[str, Any], str], threads: int) -> dict[str, Any]:
        """Makes the scene's form, and says what a picture's statistics need.

        shipped: scene, settings and the scene's SHA-256; threads: that the node has.
        """
        scene, given, sha256 = shipped
        settings = RenderSettings(**given)
        used, settings = settle(scene, settings)
        if used.sha256 != sha256:
            raise RuntimeError(f"the scene has SHA-256 {used.sha256} here, not {sha256}")
        device = settings.device
        if device == "auto":
            gpus = [d.name for d in device_module.devices() if d.backend == "cuda"]
            device = ",".join(gpus) or "cpu"
        settings = settings.with_checked({"device": device, "threads": settings.threads or threads})
        with device_module.native_errors():
            self._crew = Crew(scene, used, settings, None)
        return {"facts": self._crew.facts, "about": self._crew.stats(())}

    def draw(self, number: int, begin: int, end: int, pixels: Any, units: bool) -> Report:
        """Samples of a pass, into this node's films of it."""
        crew = self._crew
        assert crew is not None
        if number != self._number:
            old, self._films, self._number = self._films, (), number
            crew.reuse(old, ())
        try:
            with device_module.native_errors():
                films, report, _, _ = crew.draw(begin, end - begin, pixels, units, None)
                old, self._films = self._films, crew.added(self._films, films)
                crew.reuse(old, self._films)
        except BaseException:
            self._number = -1  # what is in the films is unknown
            raise
        return report

    def state(self, number: int) -> FilmState:
        """The exact sums of a pass; they stay as they are."""
        crew = self._crew
        if crew is None or number != self._number:
            raise RuntimeError(f"no samples of pass {number} here")
        with device_module.native_errors():
            film = crew.merged(self._films)
            assert film is not None
            return film.state()

    def joined(self, first: FilmState, second: FilmState) -> FilmState:
        """The sum of two states."""
        device, _ = device_module.select("cpu", fresh=False)
        height, width = first["planes"][0]["words"].shape[:2]
        with device_module.native_errors():
            film = device.native.Film(width, height, device=device.index)
            film.add_state(first)
            film.add_state(second)
            state: FilmState = film.state()
        return state
