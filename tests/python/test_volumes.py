"""Grids of numbers in space: files, arrays, media that read them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from veriray import SceneError
from veriray.formats import volume_grid


def vol(cells: np.ndarray, box=(0, 0, 0, 1, 1, 1), version=3, encoding=1) -> bytes:
    z, y, x, channels = cells.shape
    head = struct.pack("<3sB5i6f", b"VOL", version, encoding, x, y, z, channels, *box)
    return head + cells.astype("<f4").tobytes()


CELLS = np.arange(2 * 3 * 4 * 3, dtype=np.float32).reshape(2, 3, 4, 3) / 72


def test_file_gives_cells_and_box(tmp_path: Path):
    path = tmp_path / "a.vol"
    path.write_bytes(vol(CELLS, (-1, -2, -3, 4, 5, 6)) + b"more")
    cells, box = volume_grid.read_vol(path)
    assert cells.dtype == np.float32 and (cells == CELLS).all()
    assert box.tolist() == [[-1, -2, -3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"VOL\x03", "no header"),
        (b"X" * 60, "no header"),
        (vol(CELLS, version=2), "version 2 and encoding 1; expected 3 and 1"),
        (vol(CELLS, encoding=3), "version 3 and encoding 3; expected 3 and 1"),
        (vol(CELLS)[:-1], "holds 335 bytes; 4 x 3 x 2 cells of 3 numbers take 336"),
        (vol(CELLS * np.nan), r"number 0 of cell \(x 0, y 0, z 0\) is nan"),
        (vol(CELLS, (0, 0, 0, np.inf, 1, 1)), "must be finite"),
        (vol(CELLS[:, :, :0]), "0 x 3 x 2 cells of 3 numbers"),
        (struct.pack("<3sB5i6f", b"VOL", 3, 1, *[2**15] * 3, 1, *[0] * 6), "numbers at most"),
        (struct.pack("<3sB5i6f", b"VOL", 3, 1, -1, 1, 1, 1, *[0] * 6), "-1 x 1 x 1 cells"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, data: bytes, message: str):
    path = tmp_path / "a.vol"
    path.write_bytes(data)
    with pytest.raises(SceneError, match=message):
        volume_grid.read_vol(path, "s.xml:7")


def test_missing_file_is_named(tmp_path: Path):
    with pytest.raises(SceneError, match="cannot read .*none.vol.: No such file"):
        volume_grid.read_vol(tmp_path / "none.vol")
