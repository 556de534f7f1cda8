"""Packages that rendering and reading scenes do without: what needs which, and what brings them.

`EXTRAS` states the extras of pyproject.toml whose features ask for them; a test compares the two.
"""

from __future__ import annotations

import sys

from .errors import MissingPackageError

_COMPARE = ("scipy", "skimage", "flip_evaluator", "jinja2", "matplotlib")
_PROOF = (*_COMPARE, "trimesh", "colour", "mpmath")
#: Extra -> the modules that its packages bring.
EXTRAS = {
    "formats": ("trimesh", "skimage"),
    "compare": _COMPARE,
    "proof": _PROOF,
    "bench": _PROOF,
    "view": ("websockets",),
    "denoise": ("pyoidn",),
    "cluster": ("ray",),
}
#: Module -> its package, where the names differ.
PACKAGES = {
    "colour": "colour-science",
    "flip_evaluator": "flip-evaluator",
    "skimage": "scikit-image",
}


def need(feature: str, extra: str, *modules: str) -> None:
    """Raises MissingPackageError where a module is not installed; nothing is imported.

    feature: what needs them, for the message; modules: of those of the extra, all if none is named.
    """
    absent = [name for name in modules or EXTRAS[extra] if not _installed(name)]
    if absent:
        *others, last = [PACKAGES.get(name, name) for name in absent]
        names, verb = (f"{', '.join(others)} and {last}", "are") if others else (last, "is")
        raise MissingPackageError(
            f"{feature} needs {names}, which {verb} not installed: pip install 'veriray[{extra}]'"
        )


def has_bars() -> bool:
    """Whether progress can be drawn: standard error is a terminal, and rich is installed."""
    return sys.stderr is not None and sys.stderr.isatty() and _installed("rich")


def _installed(module: str) -> bool:
    if module in sys.modules:
        return sys.modules[module] is not None
    from importlib.util import find_spec

    try:
        spec = find_spec(module)
        return spec is not None and spec.origin is not None  # else a folder of that name
    except ImportError:
        return False
