"""What a chunk of paths carries: rays, vertices, and the sums that they leave behind."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from reference.tracer import Start

COLUMNS = (
    "live",
    "escaped",
    "emitter_end",
    "absorbed",
    "rr_killed",
    "depth_cut",
    "invalid",
    "shadow_visible",
    "shadow_occluded",
)
LIVE, ESCAPED, EMITTER, ABSORBED, RR, CUT, INVALID, VISIBLE, OCCLUDED = range(9)


class Columns:
    """Records whose fields are None or arrays of one column for each path: (n,) or (3, n)."""

    def keep(self, index: np.ndarray) -> None:
        """Drop all columns but those of ``index``."""
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None:
                setattr(self, field.name, value.take(index, axis=-1))


@dataclass
class Paths(Columns):
    """Live paths.

    path: number in the chunk; origin, direction: the ray; throughput; pdf: density of the last real
    event's direction, inf if it had none; own, side, near: what the ray starts on (``Start``), None
    at the camera. Only where the scene needs it: depth, real events so far; eta2, the radiance
    scaling that roulette undoes; medium, -1 for vacuum; travelled since the last real event.
    """

    path: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    throughput: np.ndarray
    pdf: np.ndarray
    own: np.ndarray | None = None
    side: np.ndarray | None = None
    near: np.ndarray | None = None
    depth: np.ndarray | None = None
    eta2: np.ndarray | None = None
    medium: np.ndarray | None = None
    travelled: np.ndarray | None = None

    @property
    def start(self) -> Start | None:
        """What the rays start on."""
        return None if self.own is None else Start(self.own, self.side, self.near)


@dataclass
class Vertices(Columns):
    """Where segments end.

    primitive: -1 for none and in media; t: the segment's length; near: close to a triangle's edge;
    scattered: in a medium (None: nowhere); front, normal: ng and ns (3, n), one array if nothing is
    smooth; facing: dot(ng, wo); cosine: dot(ns, wo); lit: on a light's front (None: no lights);
    hidden: a lamp that is not there for the camera (None: no such lamps); material; event; along: u
    grows (None: it does not matter). Where textures turn normals (else None): own, ns without them;
    low, of their shadows, -1 for none.
    """

    primitive: np.ndarray
    t: np.ndarray
    near: np.ndarray
    scattered: np.ndarray | None = None
    front: np.ndarray | None = None
    normal: np.ndarray | None = None
    facing: np.ndarray | None = None
    cosine: np.ndarray | None = None
    lit: np.ndarray | None = None
    hidden: np.ndarray | None = None
    material: np.ndarray | None = None
    event: np.ndarray | None = None
    along: np.ndarray | None = None
    own: np.ndarray | None = None
    low: np.ndarray | None = None

    def keep(self, index: np.ndarray) -> None:
        """As for all columns; ``normal`` stays the same array as ``front`` where it is."""
        if same := self.normal is self.front:
            self.normal = None
        super().keep(index)
        if same:
            self.normal = self.front


class Tally:
    """What a chunk's paths add up to: radiance (3, n), where each ended and why, ray counts."""

    def __init__(self, n: int) -> None:
        self.radiance = np.zeros((3, n))
        self.ended = np.zeros(n, np.int64)
        self.cause = np.zeros(n, np.int64)
        self.counts: list[list[int]] = []  # live, visible, occluded for each segment

    def segment(self, path: np.ndarray) -> None:
        """Begin the next segment of ``path``."""
        self.counts.append([len(path), 0, 0])
        self.ended[path] = len(self.counts) - 1

    def close(self) -> None:
        """Paths with a non-finite or negative sum become ``invalid`` and 0."""
        bad = ~(np.isfinite(self.radiance).all(axis=0) & (self.radiance >= 0).all(axis=0))
        self.radiance[:, bad] = 0
        self.cause[bad] = INVALID

    def rows(self) -> np.ndarray:
        """Ledger rows (D, 9) uint64, after ``close``."""
        rows = np.zeros((len(self.counts), len(COLUMNS)), np.uint64)
        rows[:, [LIVE, VISIBLE, OCCLUDED]] = self.counts
        ends = np.bincount(self.ended * len(COLUMNS) + self.cause, minlength=rows.size)
        rows[:, ESCAPED:VISIBLE] = ends.reshape(rows.shape)[:, ESCAPED:VISIBLE]
        return rows
