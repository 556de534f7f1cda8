"""The stranger: an independent reference renderer for veriray's scene files.

It is written from the specification alone and shares only the scene files with the product: own
XML reading, own sampling, float64 shading in numpy, Embree (robust mode) for visibility of
triangles, spheres and disks in float64, numpy's Philox for random numbers. It is slow and simple on
purpose, and it is the judge: see ``python -m reference render --help``.
"""

__version__ = "2.0.0"

from reference.output import read_exr, write_exr
from reference.paths import COLUMNS
from reference.plugins import load
from reference.render import Picture, render
from reference.scene import Scene, SceneError, with_settings

__all__ = [
    "COLUMNS",
    "Picture",
    "Scene",
    "SceneError",
    "load",
    "read_exr",
    "render",
    "with_settings",
    "write_exr",
]
