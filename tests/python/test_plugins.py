"""What becomes of every parameter of every plugin of Mitsuba 3.9.1: docs/what-is-read.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.plugins import page, scenes
from tests.plugins.table import TABLE
from veriray.formats.known import MITSUBA

CASES = list(scenes.cases())
#: What Mitsuba's scalar_rgb variant does not load, as it needs another variant, a file of
#: measurements, or another parameter beside.
_NOT_THERE = (
    "measured", "measured_polarized", "specfilm", "stokes", "prb",
    "prb_basic", "prb_projective", "prbvolpath", "direct_projective", "volprim_rf_basic",
)  # fmt: skip
_NOT_LOADED = re.compile(
    rf"\w+\.({'|'.join(_NOT_THERE)})(\.|$)|sensor\.\w+\.srf|.*timed_sunsky\.(end_year|window_end_time)"
)


@pytest.fixture(scope="module", name="folder")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plugins")
    scenes.files(folder)
    return folder


def test_the_table_names_every_plugin() -> None:
    """All that the reader knows by name as Mitsuba's; `blender` is of its add-on alone."""
    rows = [tuple(line.split()[:2]) for line in TABLE.splitlines() if line]
    assert len(rows) == len(set(rows))
    known = {(category, name) for category, names in MITSUBA.items() for name in names}
    assert known - set(rows) == {("shape", "blender")}
    assert set(rows) - known == {("spectrum", "rawconstant")}


def test_the_page_is_true_and_dictionaries_are_read_as_files(folder: Path) -> None:
    files = page.outcomes(folder)
    shown = page.page(page.judged(files))
    assert shown == page.PAGE.read_text("utf-8"), "python -m tests.plugins.page"
    for case, found in files.items():
        if "sunsky" not in case.plugin:  # whose images take time
            other = scenes.outcome(scenes.dictionary(scenes.scene(case), folder), folder)
            assert (other.hash, bool(other.fault)) == (found.hash, bool(found.fault)), case
        if found.fault:  # names the object, or the texture in it, with file and line
            assert re.match(rf'\w+ "{case.plugin}" of Mitsuba is not|{case.plugin}: |texture ',
                            found.fault)  # fmt: skip
            assert found.where == f"{folder}/scene.xml:2"


def test_mitsuba_reads_the_same_scenes(folder: Path) -> None:
    """So the table has Mitsuba's names and kinds of values."""
    mi = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mi.set_variant("scalar_rgb")
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    faults = []
    try:
        for case in CASES:
            if not _NOT_LOADED.match(str(case)):
                (folder / "theirs.xml").write_text(scenes.scene(case), "utf-8")
                try:
                    mi.load_file(str(folder / "theirs.xml"))
                except RuntimeError as error:
                    faults.append(f"{case}: {str(error).splitlines()[0]}")
    finally:
        mi.set_log_level(level)
    assert not faults
