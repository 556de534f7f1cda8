"""veriray: a CUDA and CPU path tracer whose every picture can be proved right.

    >>> import veriray as vr
    >>> picture = vr.render(vr.cornell_box(), spp=64)
    >>> picture.save("cornell.exr")
    >>> picture.film_sha256  # the same on every device

Works without a GPU and without a driver: `veriray doctor` says what can be used, and why not.
"""

__version__ = "0.1.0"

from .camera import Camera, Film
from .comparison import Report, compare
from .device import Device, devices
from .errors import DeviceError, OutOfMemoryError, SceneError, SceneWarning
from .image import ImageError
from .rendering import Render, film_hash, render, trace_path
from .scene import SAMPLERS, Scene, cornell_box, load_dict, load_file

__all__ = [
    "SAMPLERS",
    "Camera",
    "Device",
    "DeviceError",
    "Film",
    "ImageError",
    "OutOfMemoryError",
    "Render",
    "Report",
    "Scene",
    "SceneError",
    "SceneWarning",
    "__version__",
    "compare",
    "cornell_box",
    "devices",
    "film_hash",
    "load_dict",
    "load_file",
    "render",
    "trace_path",
]
