"""`veriray validate`: evidence that the renderer on this machine is right, and its building blocks.

    >>> from veriray_validate import validate
    >>> run = validate(["cpu"], levels=[1, 3])
    >>> run.passed, run.false_alarm, run.levels()
    >>> print(run)
    >>> run.save("report.html")

`validate` runs the suite in worker processes, so a script calls it under
`if __name__ == "__main__":`, or with workers=0. `Trial`, `case` and `judge` are the parts of a
case, for your own scenes too (docs/how-we-know.md has an example). `statistics` has the tests of
counts and means, `scenes` small scenes with known answers, and `report` the verdict in words, the
page and the JSON.
"""

from veriray.extras import need

need("veriray validate", "proof")

from veriray_validate.levels import LEVELS
from veriray_validate.run import Stopped, Validation, cases, validate
from veriray_validate.scenes import furnace
from veriray_validate.statistics import (
    binomial,
    chi_square,
    grids,
    homogeneous,
    max_z,
    pooled,
    sidak,
    smallest_bias,
    welch,
)
from veriray_validate.trial import (
    CASES,
    Case,
    Failed,
    Inconclusive,
    Outcome,
    Skipped,
    Trial,
    case,
    judge,
)

__all__ = [
    "CASES", "LEVELS", "Case", "Failed", "Inconclusive", "Outcome", "Skipped", "Stopped",
    "Trial", "Validation", "binomial", "case", "cases", "chi_square", "furnace", "grids",
    "homogeneous", "judge", "max_z", "pooled", "sidak", "smallest_bias", "validate", "welch",
]  # fmt: skip
