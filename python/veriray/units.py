"""Units of samples: those of a pixel whose sum is squared for the error (cpp/film/units.h).

With sampler `sobol` the samples of a pixel come in groups of 16, numbered from multiples of 16 on,
within which they are not independent: from `LATE` samples on, units are groups. Before, there are
too few groups, so units are single samples, whose error is an upper estimate. With `independent`
each sample is a unit.
"""

from __future__ import annotations

#: Samples of a group, and of the first pictures whose error follows from groups.
GROUP, LATE = 16, 64


def unit_begin(sample: int) -> int:
    """The first sample of a sample's group."""
    return sample - sample % GROUP


def rounded(spp: int, n: int, left: int) -> int:
    """N of the samples that are left after spp, or a little fewer, such that a group ends with them
    if n is as large as one."""
    return n if n < GROUP or n >= left else whole(spp, n)


def whole(begin: int, n: int) -> int:
    """About n >= 1 samples from a first one on, such that a group ends with them."""
    end = unit_begin(begin + n)
    return (end if end > begin else unit_begin(begin) + GROUP) - begin
