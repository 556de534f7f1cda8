"""The quick run of `veriray validate`, one test per case: `pytest -k` takes the names of cases."""

from __future__ import annotations

import os

import pytest

from veriray_validate.run import cases, fast_devices
from veriray_validate.trial import Case, judge

DEVICES = fast_devices()
JOBS = [(c, d) for c in cases() for d in (DEVICES[:1] if c.once else DEVICES)]
THREADS = 1 if "PYTEST_XDIST_WORKER" in os.environ else None


@pytest.mark.parametrize(("case", "device"), JOBS, ids=[f"{c.id}-{d}" for c, d in JOBS])
def test_case(case: Case, device: str) -> None:
    outcome = judge(case, device, threads=THREADS)
    if outcome.verdict == "skip":
        pytest.skip(outcome.message)
    assert outcome.verdict == "pass", f"{outcome.verdict}: {case.title}\n{outcome.message}"
