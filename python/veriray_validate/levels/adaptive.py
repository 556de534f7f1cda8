"""Level 3: adaptive sampling. The samples that decide do not count in the picture."""

from __future__ import annotations

import numpy as np
from scipy import stats

from veriray.comparison.statistics import MARGIN
from veriray.rendering import render
from veriray.sampling import PILOTS, TILE
from veriray_validate.scenes import camera, furnace, make, sphere
from veriray_validate.statistics import max_z
from veriray_validate.trial import Trial, case

#: Relative error at which four of five pixels of `furnace(0.5, 0.5)` stop at once.
TARGET = 0.04


@case(3)
def adaptive_means_are_unbiased(t: Trial) -> None:
    """Pictures of one pixel with a target error, in a closed box with the exact answer 1.

    Independent samples, which are the noisier. 300 pictures; z of their mean. Sees a bias of 1.2 %.
    The planted estimate, which keeps the pilot's samples where they were enough, is rejected at
    -3.3, because dark pilots stop early. Its z is about -9, so a sound run misses it less than once
    in 10^8.
    """
    scene, kept, planted = furnace(0.5, 0.5, sampler="independent"), [], []
    pilot = PILOTS["independent"]
    for _ in range(300 * t.effort):
        seed = t.fresh()
        r = t.render(scene, 256, seed=seed, target_error=TARGET)
        kept.append(float(r.image[0, 0, 0]))
        if r.stats["mean_spp"] == pilot:
            r = render(scene, pilot, seed=seed, device=t.device, threads=t.threads)
        planted.append(float(r.image[0, 0, 0]))
    z = [(np.mean(x) - 1) / (np.std(x, ddof=1) / np.sqrt(len(x))) for x in (kept, planted)]
    t.figure("z of the mean; planted", z)
    t.check(z[1] < -3.3, f"the planted bias is not seen: z = {z[1]:.1f}")
    t.sees((3.29 + 1.28) * float(np.std(kept, ddof=1)) / np.sqrt(len(kept)))
    t.p(2 * float(stats.norm.sf(abs(z[0]))), "mean")


@case(3)
def adaptive_tiles_agree(t: Trial) -> None:
    """A ball that reflects and emits 1/2 is invisible under a sky of 1; it gets most samples.

    Its noise comes from roulette. z of the means of 9 tiles, which get from 64 to some hundred
    samples per pixel. Sees 1 % in each.
    """
    view = camera([0, 0, 4], [0.5, 0.4, 0], 40)
    scene = make([sphere([0, 0, 0], 1, 0.5, 0.5)], view, 1.0, 48, 48, rr_depth=1)
    r = t.render(scene, 2048, target_error=0.003)
    t.check(r.samples is not None and len(np.unique(r.samples)) > 2, "all tiles get as many")
    starts = np.arange(0, 48, TILE)
    off, square = (
        np.add.reduceat(np.add.reduceat(x[..., 0].astype(np.float64), starts, 0), starts, 1)
        for x in (r.image - 1, r.stderr**2)
    )
    error = np.sqrt(square)
    t.check(np.abs(off[error == 0]) < 256 * MARGIN, "a tile without noise")
    t.sees((3.89 + 1.28) * float(error.max()) / TILE**2)
    t.p(max_z(off[error > 0] / error[error > 0]), "tiles")
