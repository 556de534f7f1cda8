"""Shared by all tests. They run against the installed package, not against python/."""

from __future__ import annotations

from pathlib import Path

import pytest

import veriray
from veriray.device import survey

ROOT = Path(__file__).resolve().parents[1]
USABLE, REASONS = survey()
CPU_DEVICES = [device.name for device in USABLE if device.backend == "cpu"]
CUDA_DEVICES = [device.name for device in USABLE if device.backend == "cuda"]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the tests marked slow too")


def pytest_report_header() -> list[str]:
    lines = [f"veriray {veriray.__version__} from {Path(veriray.__file__).parent}"]
    lines.append("devices: " + ", ".join(f"{d.name} ({d.description})" for d in USABLE))
    return lines + [f"not usable: {name}: {reason}" for name, reason in REASONS.items()]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if item.get_closest_marker("gpu") and not CUDA_DEVICES:
            item.add_marker(pytest.mark.skip(reason=f"no GPU: {REASONS.get('cuda', 'none')}"))
        if item.get_closest_marker("slow") and not config.getoption("--slow"):
            item.add_marker(pytest.mark.skip(reason="slow: run with --slow"))


@pytest.fixture(scope="session")
def root() -> Path:
    """The source checkout."""
    return ROOT


@pytest.fixture(scope="session")
def cornell() -> veriray.Scene:
    """The measured Cornell box, 32 x 32."""
    return veriray.cornell_box().with_(width=32, height=32)


@pytest.fixture(params=CPU_DEVICES)
def cpu(request: pytest.FixtureRequest) -> str:
    """Each CPU device of this machine in turn."""
    name: str = request.param
    return name


@pytest.fixture(params=CPU_DEVICES + CUDA_DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    """Each device of this machine in turn."""
    name: str = request.param
    return name
