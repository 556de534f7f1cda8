"""The stranger: an independent reference renderer for veriray's scene files.

It is written from the specification alone and shares only the scene files with the product: own
XML reading, own sampling, float64 shading in numpy, Embree (robust mode) for visibility, numpy's
Philox for random numbers. It is slow and simple on purpose, and it is the judge: see
``python -m reference render --help``.
"""

__version__ = "1.0.0"

from reference.integrator import COLUMNS, Picture, render
from reference.output import read_exr, write_exr
from reference.scene import Scene, SceneError, load

__all__ = ["COLUMNS", "Picture", "Scene", "SceneError", "load", "read_exr", "render", "write_exr"]
