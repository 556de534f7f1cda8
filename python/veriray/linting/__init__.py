"""`lint`: what in a scene is probably not meant: black surfaces, lamps that light nothing, ...

A scene that loads can be rendered; this looks for what renders and is wrong. Each rule is a
function of a `Look` in `surfaces`, `bodies`, `lights` or `sizes`, named in RULES.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any, overload

import numpy as np

from .. import limits
from ..scene import Scene
from . import bodies, lights, sizes, surfaces
from .look import Finding, Look

__all__ = ["RULES", "Finding", "Findings", "lint"]

#: Rules by name, and what each looks for.
RULES = {
    "changed": "what the reader rendered with other numbers than the file has",
    "black-surface": "materials that reflect and transmit nothing",
    "black-back": "backs of one-sided surfaces in view of the camera",
    "albedo": "materials and media that lose no light",
    "energy": "materials that give back more light than they get",
    "clipped-texture": "bitmaps of which a tenth and more is at the end of its range",
    "open-body": "glass and media in surfaces that are not closed",
    "media": "media that do not agree along a ray",
    "flipped": "bodies whose fronts are inside, or look both ways",
    "duplicate": "the same primitive twice",
    "touching": "opaque faces in one plane, one over the other",
    "degenerate": "triangles without area",
    "covered-lamp": "lamps under something opaque, closer than shadow rays resolve",
    "dark-light": "lamps that give nothing to the picture",
    "no-light": "scenes without light",
    "view": "cameras that see nothing",
    "clip": "near and far planes that cut off what is in view",
    "lens": "lenses through which nothing is sharp",
    "size": "a scene or a medium of another size than its surroundings: units?",
    "precision": "details too fine for float32 (see `veriray.limits`)",
}


class Findings(Sequence[Finding]):
    """What `lint` found, in the order of RULES; empty if all is well.

    skipped: what was not examined, and why, as lines of text.
    """

    def __init__(self, found: Sequence[Finding], skipped: Sequence[str] = ()) -> None:
        self._found = tuple(found)
        self.skipped = tuple(skipped)

    @overload
    def __getitem__(self, index: int) -> Finding: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Finding, ...]: ...
    def __getitem__(self, index: int | slice) -> Finding | tuple[Finding, ...]:
        return self._found[index]

    def __len__(self) -> int:
        return len(self._found)

    def __iter__(self) -> Iterator[Finding]:
        return iter(self._found)

    def __str__(self) -> str:
        count = len(self)
        last = f"{count or 'no'} finding{'s' * (count != 1)}"
        return "\n".join([*map(str, self), *(f"skipped: {text}" for text in self.skipped), last])

    def __repr__(self) -> str:
        rules = ", ".join(dict.fromkeys(finding.rule for finding in self))
        return f"<Findings: {len(self)}{f' ({rules})' if rules else ''}>"

    def without(self, rules: Sequence[str]) -> Findings:
        """Those of other rules."""
        return Findings([f for f in self if f.rule not in rules], self.skipped)

    def to_dict(self) -> dict[str, Any]:
        """What `veriray lint --json` prints: findings, a list of dictionaries, and skipped."""
        return {"findings": [vars(f) for f in self], "skipped": list(self.skipped)}

    def to_json(self) -> str:
        """The same as text."""
        return json.dumps(self.to_dict(), indent=2)

    def _repr_html_(self) -> str:
        """A table, for notebooks."""
        from ..showing import table

        rows = [(f.rule, f.key, f.where, f.text, f.reason) for f in self]
        return table(("rule", "what", "where", "found", "why it matters"), rows, repr(self))


def lint(scene: Scene) -> Findings:
    """What in a scene is probably not meant, each with its place and the physical reason.

    Nothing is changed, and no finding is an error: a black surface may be meant. The rules are
    those of RULES. Some render small pictures on the CPU, with fixed seeds: the same scene gives
    the same findings. Raises TypeError for what is no Scene, and as `veriray.render`.
    """
    if not isinstance(scene, Scene):
        raise TypeError(
            f"scene is {type(scene).__name__}, expected a Scene: use veriray.load_file(path) or "
            "veriray.load_dict(dict)"
        )
    look = Look(scene)
    found: list[Finding] = []
    with np.errstate(all="ignore"):
        found += surfaces.changed(look)
        for rules in (surfaces, bodies, lights, sizes):
            for rule in rules.CHECKS:
                found += rule(look)
        reason = "positions are float32, rounded to 6e-8 of their distance from the origin"
        for text in limits.warnings(scene, look.origin.tolist()):
            found.append(Finding("precision", "", scene.place(""), text, reason))
    order = list(RULES)
    found.sort(key=lambda finding: order.index(finding.rule))
    return Findings(found, look.skipped)
