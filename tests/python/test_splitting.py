"""Ranges of samples for workers of different speed: each sample once, and all end together."""

from __future__ import annotations

import heapq
import random

import pytest

from veriray.splitting import LEAST, Split


def simulated(
    n: int, rates: dict[int, float], seed: int = 0, deaths: int = 0
) -> tuple[Split, dict[int, float], dict[int, set[int]]]:
    """Workers with these samples a second draw n samples; `deaths` times a
    worker dies after a range (another one comes, without what it drew). When each ended its last
    range, and the samples that it holds."""
    rng, split = random.Random(seed), Split(5, 5 + n, dict.fromkeys(rates, 0.0))
    now, ended = 0.0, dict.fromkeys(rates, 0.0)
    events: list[tuple[float, int, float]] = []
    held: dict[int, set[int]] = {worker: set() for worker in rates}
    ranges: dict[int, tuple[int, int]] = {}
    while not split.done:
        for worker in rates:
            if worker not in ranges and (piece := split.take(worker)) is not None:
                ranges[worker] = piece
                seconds = (piece[1] - piece[0]) / rates[worker]
                heapq.heappush(events, (now + seconds, worker, seconds))
        assert events, "all wait for one another"
        now, worker, seconds = heapq.heappop(events)
        piece = ranges.pop(worker)
        if deaths and rng.random() < 0.3:
            deaths -= 1
            split.lost(worker, leaves=False)
            held[worker] = set()
            continue
        split.finished(worker, seconds)
        ended[worker] = now
        assert not held[worker] & {*range(*piece)}
        held[worker] |= {*range(*piece)}
    return split, ended, held


@pytest.mark.parametrize("deaths", [0, 12])
@pytest.mark.parametrize("seed", range(20))
def test_each_sample_once(seed: int, deaths: int) -> None:
    rng = random.Random(seed)
    rates = {k: 10 ** rng.uniform(0, 4) for k in range(rng.randint(1, 9))}
    n = rng.randint(1, 3000)
    split, _, held = simulated(n, rates, seed, deaths)
    everything = [x for samples in held.values() for x in samples]
    assert sorted(everything) == [*range(5, 5 + n)]
    assert {k: split.drawn(k) for k in rates} == {k: len(held[k]) for k in rates}


@pytest.mark.parametrize("seed", range(20))
def test_all_end_together(seed: int) -> None:
    """No one waits longer than the slowest that took part needs for one sample, or LEAST (twice:
    the last range of a worker may begin just before those of others)."""
    rng = random.Random(seed)
    rates = {k: 10 ** rng.uniform(1, 4) for k in range(rng.randint(2, 6))}
    _, ended, held = simulated(20000, rates)
    slowest = max(1 / rates[k] for k in rates if held[k])
    assert max(ended.values()) - min(ended.values()) <= 2 * max(slowest, LEAST)
    ideal = 20000 / sum(rates.values())
    assert max(ended.values()) <= ideal + 2 * max(slowest, LEAST)


def test_slow_workers_wait_for_fast_ones() -> None:
    """A sample by the slow worker would last longer than all that is left by the fast one."""
    split = Split(0, 100, {"fast": 1000.0, "slow": 0.5})
    assert split.take("slow") is None and split.take("fast") == (0, 49)
    split.lost("fast")
    assert split.take("slow") == (0, 49)  # nobody else is there


def test_a_first_range_may_be_slow() -> None:
    """A device that starts takes long for its first sample; it is tried again."""
    split = Split(0, 100, {"fast": 1000.0, "new": 0.0})
    assert split.take("new") == (0, 1)
    split.finished("new", 2.0)
    assert split.take("new") == (1, 2), "not by the first range alone"
    split.finished("new", 2.0)
    assert split.take("new") is None


def test_closed_early() -> None:
    split = Split(0, 1000, {"a": 10.0, "b": 10.0})
    first, second = split.take("a"), split.take("b")
    assert first == (0, 250) and second == (250, 437)
    split.close()
    assert (split.end, split.left, split.done) == (437, 0, False)
    split.finished("b", 1.0)
    split.lost("a")  # what was given out is drawn all the same
    assert split.take("b") == (0, 125) and not split.done
    split.finished("b", 1.0)
    assert split.take("b") == (125, 187)


@pytest.mark.parametrize("seed", range(6))
def test_groups_are_whole(seed: int) -> None:
    """Ranges end with groups of 16 samples, or with the pass."""
    rng = random.Random(seed)
    split = Split(64, 64 + 1007, {k: 10 ** rng.uniform(1, 4) for k in range(4)}, groups=True)
    ranges = []
    while not split.done:
        for worker in range(4):
            if (piece := split.take(worker)) is not None:
                ranges.append(piece)
                split.finished(worker, rng.random())
    ends = sorted(ranges)
    assert [begin for begin, _ in ends[1:]] == [end for _, end in ends[:-1]]
    assert all(begin % 16 == 0 for begin, _ in ends) and ends[-1][1] == 1071
