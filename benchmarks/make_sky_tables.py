"""Makes python/veriray/formats/sky_model.npz: the numbers of Hosek and Wilkie's sky and sun.

    python benchmarks/make_sky_tables.py

reads them from the data of an installed mitsuba, which has them from the model's authors
(https://cgg.mff.cuni.cz/projects/SkylightModelling/, version 1.4a): the RGB sky of 10 turbidities,
2 albedos and 6 elevations, and the sun's spectral radiance and limb darkening. They are under the
3-clause BSD license, Copyright (c) 2012 - 2013, Lukas Hosek and Alexander Wilkie (see LICENSE).
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np

NAMES = {"sky_params_rgb": "sky", "sky_rad_rgb": "level", "sun_rad_spec": "sun",
         "sun_ld_spec": "limb"}  # fmt: skip
HERE = Path(__file__).resolve().parents[1] / "python" / "veriray" / "formats"


def read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a file of Mitsuba's tensors: name, rank, type, place and shape of each."""
    data, at, arrays = path.read_bytes(), 18, {}
    (count,) = struct.unpack_from("<I", data, 14)
    for _ in range(count):
        (length,) = struct.unpack_from("<H", data, at)
        name = data[at + 2 : at + 2 + length].decode()
        at += 2 + length
        rank, kind, first = struct.unpack_from("<HBQ", data, at)
        shape = struct.unpack_from(f"<{rank}Q", data, at + 11)
        at += 11 + 8 * rank
        dtype = {10: "<f4", 11: "<f8"}[kind]
        arrays[name] = np.frombuffer(data, dtype, int(np.prod(shape)), first).reshape(shape)
    return arrays


def main() -> int:
    """Command line."""
    import mitsuba

    found = read(Path(mitsuba.__file__).parent / "data" / "sunsky" / "sunsky_datasets.bin")
    tables = {ours: found[theirs].astype(np.float32) for theirs, ours in NAMES.items()}
    np.savez_compressed(HERE / "sky_model.npz", **tables)
    print({name: table.shape for name, table in tables.items()})
    return 0


if __name__ == "__main__":
    sys.exit(main())
