"""Level 3: adaptive sampling. The samples that decide are not those that count."""

from __future__ import annotations

import numpy as np
from scipy import stats

from veriray.sampling import PILOT
from veriray.validate.scenes import furnace
from veriray.validate.trial import Trial, case

#: Relative error at which four pixels in five of `furnace(0.5, 0.5)` stop at once.
TARGET = 0.04


@case(3)
def adaptive_means_are_unbiased(t: Trial) -> None:
    """Pictures of one pixel with a target error, in a closed box with the exact answer 1.

    200 pictures; z of their mean. Sees a bias of 1.4 %. The planted estimate, which keeps the
    pilot's samples where they were enough, is rejected (z below -5): dark pilots stop early.
    """
    scene, kept, planted = furnace(0.5, 0.5), [], []
    for _ in range(200 * t.effort):
        seed = t.fresh()
        r = t.render(scene, 256, seed=seed, target_error=TARGET)
        kept.append(float(r.image[0, 0, 0]))
        stopped = r.stats["mean_spp"] == PILOT
        planted.append(
            float(t.render(scene, PILOT, seed=seed).image[0, 0, 0]) if stopped else kept[-1]
        )
    z = [(np.mean(x) - 1) / (np.std(x, ddof=1) / np.sqrt(len(x))) for x in (kept, planted)]
    t.figure("z of the mean; planted", z)
    t.check(z[1] < -5, f"the planted bias is not seen: z = {z[1]:.1f}")
    t.sees((3.29 + 1.28) * float(np.std(kept, ddof=1)) / np.sqrt(len(kept)))
    t.p(2 * float(stats.norm.sf(abs(z[0]))), "mean")
