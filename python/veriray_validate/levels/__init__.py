"""The cases, a module for each group (`veriray_validate.run.cases` imports them all), by levels."""

from __future__ import annotations

from typing import NamedTuple


class Level(NamedTuple):
    """A level's name, and what it shows where it passes."""

    name: str
    shows: str


LEVELS = {
    1: Level(
        "Numbers", "Random numbers, mappings and elementary functions are what they claim to be"
    ),
    2: Level("Samplers", "Every sampler draws from the density that it states, and loses nothing"),
    3: Level("Closed forms", "Scenes with an exact answer give that answer"),
    4: Level(
        "Live rays", "As many rays live and die at each depth as theory and other programs say"
    ),
    5: Level("Stranger", "A renderer that shares no code gives the same pictures within chance"),
    6: Level("Bits", "Schedulers, batches, threads and devices give the same bits"),
    7: Level(
        "Measured box", "The measured Cornell box comes out as its spectra say, as far as RGB can"
    ),
    8: Level("Stress", "Extreme numbers and broken input do what is promised"),
    9: Level("Mutation", "Planted bugs are found"),
}
