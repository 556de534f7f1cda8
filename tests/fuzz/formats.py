"""The targets by name."""

import importlib
from pathlib import Path

from tests.fuzz.contract import Target

FORMATS = (
    "xml",
    "dictionary",
    "obj",
    "ply",
    "stl",
    "serialized",
    "gltf",
    "exr",
    "image",
    "curve",
    "mtl",
    "vol",
)
CORPUS = Path(__file__).parent / "corpus"


def corpus(name: str) -> Path:
    """The folder of a format's inputs; `render` has those of xml."""
    return CORPUS / ("xml" if name == "render" else name)


def target(name: str) -> Target:
    """The target of a format."""
    found: Target = importlib.import_module(f"tests.fuzz.{name}").TARGET
    return found
