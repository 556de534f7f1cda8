"""Ranges of samples for workers of different speed: devices of one machine, or nodes of a cluster.

A worker that is free takes the next range. Its size is half of the worker's share of what is left,
by the speeds measured so far (guided self-scheduling: C. Polychronopoulos and D. Kuck, "Guided
Self-Scheduling", 1987), so that all end at about the same time. Films are exact sums, so who draws
which range leaves no trace in a picture.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field

from .units import whole

Range = tuple[int, int]

#: Ranges grow by this factor at most while a worker's speed is learnt; the first has 1 sample.
GROWTH = 8
#: Seconds that a range takes at least, where there are so many samples: less costs more than the
#: wait for the last range that it saves.
LEAST = 0.03


@dataclass
class _Worker:
    """rate: samples a second, 0 where unknown. size: samples of its last range. busy: the range
    that it draws. drawn: those that it has drawn and holds. trials: ranges by which its rate is
    known; the first may be slow for other reasons."""

    rate: float
    size: float
    busy: Range | None = None
    drawn: list[Range] = field(default_factory=list)
    trials: int = 0


class Split:
    """The samples [begin, end), each given to one worker.

    rates: the workers, and what is known of their samples a second (0: nothing). longest: seconds
    that a range takes at most, as far as its worker's rate tells. groups: ranges end with groups
    (`veriray.units`). Not for several threads at once.
    """

    def __init__(
        self, begin: int, end: int, rates: dict[Hashable, float], longest: float = math.inf,
        groups: bool = False,
    ) -> None:  # fmt: skip
        self.end, self._groups = end, groups
        self._next, self._again, self._longest = begin, list[Range](), longest
        self._workers: dict[Hashable, _Worker] = {}
        for worker, rate in rates.items():
            self.join(worker, rate)

    def join(self, worker: Hashable, rate: float = 0.0) -> None:
        """A worker more."""
        self._workers[worker] = _Worker(rate, math.inf if rate else 0, trials=2 if rate else 0)

    @property
    def left(self) -> int:
        """Samples that no worker has."""
        return self.end - self._next + _count(self._again)

    @property
    def done(self) -> bool:
        """Whether all samples are drawn and held."""
        return not self.left and not any(w.busy for w in self._workers.values())

    def drawn(self, worker: Hashable) -> int:
        """Samples that a worker has drawn and holds."""
        return _count(self._workers[worker].drawn)

    def trials(self, worker: Hashable) -> int:
        """Ranges by which its rate is known; 2 of a rate that was given."""
        return self._workers[worker].trials

    def rate(self, worker: Hashable) -> float:
        """Its samples a second in its last range, 0 where unknown."""
        return self._workers[worker].rate

    def take(self, worker: Hashable) -> Range | None:
        """The next range of a worker. None: it must wait, as nothing is left now, or as the faster
        ones will have drawn what is left before it draws one sample."""
        own, left = self._workers[worker], self.left
        if not left:
            return None
        size = 1.0
        if own.rate:
            faster = [w for w in self._workers.values() if w.rate > own.rate]
            ahead = left + _count(w.busy for w in faster if w.busy)
            if faster and own.trials > 1 and ahead * own.rate < sum(w.rate for w in faster):
                return None
            share = left * own.rate / sum(w.rate for w in self._workers.values())
            size = max(share / 2, own.rate * LEAST)
            size = min(size, GROWTH * own.size, own.rate * self._longest)
        own.busy = self._cut(max(1, math.floor(min(size, left))))
        return own.busy

    def _cut(self, size: int) -> Range:
        begin, end = self._again.pop(0) if self._again else (self._next, self.end)
        cut = min(begin + (whole(begin, size) if self._groups else size), end)
        if begin == self._next:
            self._next = cut
        elif cut < end:
            self._again.insert(0, (cut, end))
        return begin, cut

    def finished(self, worker: Hashable, seconds: float) -> None:
        """The worker holds the range that it took; seconds: that it needed."""
        own = self._workers[worker]
        assert own.busy is not None
        own.size = own.busy[1] - own.busy[0]
        own.rate = own.size / max(seconds, 1e-6)
        own.trials += 1
        own.drawn.append(own.busy)
        own.busy = None

    def lost(self, worker: Hashable, leaves: bool = True) -> None:
        """What the worker drew and draws is lost; it is drawn again. leaves: not by this one."""
        own = self._workers.pop(worker)
        again = [*self._again, *own.drawn, *([own.busy] if own.busy else [])]
        self._again = _joined(again)
        if not leaves:
            self.join(worker)

    def close(self) -> None:
        """Gives out no samples behind those that were given out: `end` moves there."""
        self.end = self._next


def _count(ranges: Iterable[Range]) -> int:
    return sum(end - begin for begin, end in ranges)


def _joined(ranges: Iterable[Range]) -> list[Range]:
    """The same samples in as few ranges as there can be, in order."""
    joined: list[Range] = []
    for begin, end in sorted(ranges):
        if joined and joined[-1][1] == begin:
            begin = joined.pop()[0]
        joined.append((begin, end))
    return joined
