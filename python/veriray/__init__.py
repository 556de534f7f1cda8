"""veriray: a CUDA and CPU path tracer whose every picture can be proved right.

    >>> import veriray as vr
    >>> picture = vr.render(vr.cornell_box(), spp=64)
    >>> picture.save("cornell.exr")
    >>> picture.film_sha256  # the same on every device

Works without a GPU and without a driver: `veriray doctor` says what can be used, and why other
things cannot. Names are imported on first use (PEP 562). No module has one of these names, because
importing `veriray.NAME` would replace the name by the module.
"""

import os
import sys
from importlib import import_module

__version__ = "0.1.0"
TYPE_CHECKING = False  # as type checkers read it; without an import of typing

if TYPE_CHECKING:
    from .accumulation import Accumulation
    from .camera import Camera, Film
    from .checkpoint import Checkpoint
    from .comparison import Report, compare
    from .datasets import dataset
    from .device import Device, devices
    from .errors import (
        CheckpointError,
        CheckpointWarning,
        DeviceError,
        DeviceWarning,
        ImageError,
        MissingPackageError,
        OutOfMemoryError,
        RefusedSamplesWarning,
        SceneError,
        SceneWarning,
    )
    from .feature_rendering import feature_images
    from .features import FeatureImages
    from .linting import lint
    from .picture import Render, film_hash
    from .rendering import render, trace_path
    from .scene import Scene, cornell_box, load_dict, load_file
    from .settings import SAMPLERS
else:
    _HOMES = {
        "accumulation": ("Accumulation",),
        "camera": ("Camera", "Film"),
        "checkpoint": ("Checkpoint",),
        "comparison": ("Report", "compare"),
        "datasets": ("dataset",),
        "device": ("Device", "devices"),
        "errors": (
            "CheckpointError",
            "CheckpointWarning",
            "DeviceError",
            "DeviceWarning",
            "ImageError",
            "MissingPackageError",
            "OutOfMemoryError",
            "RefusedSamplesWarning",
            "SceneError",
            "SceneWarning",
        ),
        "feature_rendering": ("feature_images",),
        "features": ("FeatureImages",),
        "linting": ("lint",),
        "picture": ("Render", "film_hash"),
        "rendering": ("render", "trace_path"),
        "scene": ("Scene", "cornell_box", "load_dict", "load_file"),
        "settings": ("SAMPLERS",),
    }

    def _finish_imports() -> None:
        """Before a fork: waits for modules that other threads import, whose locks nobody would
        release in the child. A module that this thread imports itself is not waited for.
        """
        for name, module in list(sys.modules.items()):
            spec = vars(module).get("__spec__") if hasattr(module, "__dict__") else None
            if getattr(spec, "_initializing", False):
                try:
                    import_module(name)
                except Exception:  # the other thread's to report
                    continue

    _later = [True]  # until names are imported

    def __getattr__(name: str) -> object:
        if _later:
            _later.clear()
            # Hooks run in reverse order: this one before logging takes its lock, which modules use.
            import_module("logging")
            if hasattr(os, "register_at_fork"):
                os.register_at_fork(before=_finish_imports)
        for module, names in _HOMES.items():
            if name in names:
                value = globals()[name] = getattr(import_module(f".{module}", __name__), name)
                return value
        try:
            return import_module(f".{name}", __name__)
        except ModuleNotFoundError as error:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from error


__all__ = [
    "SAMPLERS",
    "Accumulation",
    "Camera",
    "Checkpoint",
    "CheckpointError",
    "CheckpointWarning",
    "Device",
    "DeviceError",
    "DeviceWarning",
    "FeatureImages",
    "Film",
    "ImageError",
    "MissingPackageError",
    "OutOfMemoryError",
    "RefusedSamplesWarning",
    "Render",
    "Report",
    "Scene",
    "SceneError",
    "SceneWarning",
    "__version__",
    "compare",
    "cornell_box",
    "dataset",
    "devices",
    "feature_images",
    "film_hash",
    "lint",
    "load_dict",
    "load_file",
    "render",
    "trace_path",
]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
