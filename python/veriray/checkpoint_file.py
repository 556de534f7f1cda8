r"""Files of checkpoints (`veriray.checkpoint`).

Layout of a file, format 2; all numbers are little-endian
---------------------------------------------------------
- the bytes "veriray checkpoint 2\n"
- the length of the header in bytes, uint64; at most 2^20
- the header, a JSON object: `render`, `first`, `spp`, `paths`, `beyond` and `machine` as in
  `Checkpoint`; `units`: those of the samples in each of the films `film`, `groups` and `tail` that
  are there; `planes`: name, kind, channels, negative and scale of each plane of these films;
  `report`: what the native renders said in words and numbers; `arrays`: a list of [name, dtype,
  shape]
- the arrays in that order, in C order, without gaps: `FILM NAME` of each film and plane (exact
  sums: see `PlaneState` in `_native.pyi`), `tiles` and `means` where they are, and the arrays of
  the report
- the SHA-256 of all bytes before it

Nothing in a file is trusted: all sizes follow from the header and must give the size of the file
before anything is allocated, and no code is read from it.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import struct
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from .errors import CheckpointError
from .files import open_regular, replacing
from .numeric import shown
from .sampling import PILOTS, TILE
from .units import GROUP, LATE

Array = npt.NDArray[Any]

_MAGIC, _FORMAT = b"veriray checkpoint ", b"2\n"
_MAX_HEADER = 1 << 20
_MAX_SIDE, _MAX_COUNT, _MAX_DEPTHS = 2**31 - 1, 2**64 - 1, 1 << 20
#: Arrays and numbers of a `Report`.
_ROWS = {"ledger": "<u8", "blocks": "<u8", "depth_seconds": "<f8", "compaction_seconds": "<f8"}
_SCALARS: dict[str, type] = {
    "seconds": float, "nonfinite_samples": int, "launches": int, "device": str, "scheduler": str,
    "features": list, "threads": int, "path_bytes": int, "kernel": dict,
}  # fmt: skip
_NUMBERS = ("first", "spp", "paths", "beyond")
FILMS = ("film", "groups", "tail")
#: Kinds of planes and the words of a number.
_KINDS = {"sums and squares": 4, "sums": 2, "integers": 2}


def write(path: str, fields: dict[str, Any]) -> None:
    """Writes the fields of a `Checkpoint`, whole or not at all. Raises OSError naming the path."""
    arrays = _arrays(fields)
    films, report = _films(fields), fields["report"]
    planes = next(iter(films.values()))["planes"] if films else []
    header = {
        **{name: fields[name] for name in ("render", *_NUMBERS, "machine")},
        "units": {name: film["units"] for name, film in films.items()},
        "planes": [{k: v for k, v in plane.items() if k != "words"} for plane in planes],
        "report": {name: report[name] for name in _SCALARS},
        "arrays": [[name, a.dtype.str, a.shape] for name, a in arrays.items()],
    }
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    digest = hashlib.sha256()
    with replacing(path) as file:
        head = _MAGIC + _FORMAT + struct.pack("<Q", len(text)) + text
        for part in (head, *(_bytes(a) for a in arrays.values())):
            digest.update(part)
            file.write(part)
        file.write(digest.digest())


def _films(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: fields[name] for name in FILMS if fields[name] is not None}


def _arrays(fields: dict[str, Any]) -> dict[str, Array]:
    found: dict[str, Array] = {}
    report = fields["report"]
    for name, film in _films(fields).items():
        for plane in film["planes"]:
            found[f"{name} {plane['name']}"] = plane["words"].astype("<u8", copy=False)
    for name, dtype in (("tiles", "<i8"), ("means", "<f8")):
        if fields[name] is not None:
            found[name] = fields[name].astype(dtype, copy=False)
    for name, dtype in _ROWS.items():
        found[name] = report[name].astype(dtype, copy=False)
    found["ledger"] = found["ledger"].reshape(-1, 9)
    listed = report["nonfinite"]
    found["nonfinite_at"] = np.array([e[:3] for e in listed], "<u8").reshape(-1, 3)
    found["nonfinite_radiance"] = np.array([e[3:] for e in listed], "<f4").reshape(-1, 3)
    return {name: np.ascontiguousarray(a) for name, a in found.items()}


def read(path: str, max_bytes: int) -> dict[str, Any]:
    """The fields of a `Checkpoint`. Raises CheckpointError for a file that is none, is damaged or
    larger than max_bytes; OSError if it cannot be read."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            if size > max_bytes:
                raise _BadError(f"{size} bytes; the limit is {max_bytes} (max_bytes)")
            return _read(file, size)
        except _BadError as bad:
            raise CheckpointError(f"{path}: {bad}") from None


class _BadError(Exception):
    """What is wrong with a file."""


def _read(file: IO[bytes], size: int) -> dict[str, Any]:
    head = file.read(len(_MAGIC) + len(_FORMAT) + 8)
    if not head.startswith(_MAGIC):
        raise _BadError("not a veriray checkpoint")
    number = head[len(_MAGIC) : len(_MAGIC) + len(_FORMAT)]
    if number != _FORMAT[: len(number)]:
        text = number.split(b"\n")[0].decode("ascii", "backslashreplace")
        raise _BadError(f"a checkpoint of format {text}; this veriray reads format 2")
    if len(head) < len(_MAGIC) + len(_FORMAT) + 8:
        raise _BadError("damaged: it ends early")
    (length,) = struct.unpack("<Q", head[-8:])
    if length > _MAX_HEADER:
        raise _BadError(f"damaged: a header of {length} bytes; at most {_MAX_HEADER}")
    content = file.read(length)
    digest = hashlib.sha256(head + content)
    try:
        header = json.loads(content, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise _BadError("damaged: its header is not JSON") from None
    fields = _Fields(header)
    layout = fields.layout()
    need = len(head) + length + 32 + sum(count * step for _, _, _, count, step in layout)
    if need != size:
        raise _BadError(f"damaged: {size} bytes, where its header says {need}")
    arrays: dict[str, Array] = {}
    for name, dtype, shape, count, step in layout:
        values = np.empty(count, dtype)
        view = _bytes(values)
        if file.readinto(view) != count * step:  # type: ignore[attr-defined]
            raise _BadError("damaged: it ends early")
        digest.update(view)
        arrays[name] = values.astype(values.dtype.newbyteorder("="), copy=False).reshape(shape)
    if file.read(33) != digest.digest():
        raise _BadError("damaged: the SHA-256 at its end is not that of its content")
    return fields.of(arrays)


def _bytes(values: Array) -> Any:
    """The memory of an array in C order."""
    return memoryview(values.reshape(-1).view(np.uint8))  # type: ignore[arg-type]


def _no_number(text: str) -> None:
    raise ValueError(text)


class _Fields:
    """The header of a file, checked. Raises _BadError."""

    def __init__(self, header: Any) -> None:
        self.header = self._typed("header", header, dict)
        render = self._typed("render", header.get("render"), dict)
        kinds = {"version": str, "scene_sha256": str, "sampler": str}
        limits = {
            "seed": (0, _MAX_COUNT), "width": (1, _MAX_SIDE), "height": (1, _MAX_SIDE),
            "max_depth": (-1, _MAX_SIDE), "rr_depth": (1, _MAX_SIDE), "batches": (0, 1000),
        }  # fmt: skip
        names = {*kinds, *limits, "target_error", "spp"}
        if set(render) != names:
            raise _BadError(f"damaged: render has not the keys {', '.join(sorted(names))}")
        for name, kind in kinds.items():
            self._typed(name, render[name], kind)
        for name, (low, high) in limits.items():
            self._whole(name, render[name], low, high)
        target = render["target_error"]
        if target is not None and not (type(target) is float and 0 < target < 1):
            raise _BadError(f"damaged: target_error is {shown(target)}")
        bound = render["batches"] or target is not None
        if bound:
            self._whole("spp", render["spp"], 1, 2**40)
        elif render["spp"] is not None:
            raise _BadError(f"damaged: spp is {shown(render['spp'])}")
        self.render: dict[str, Any] = render
        self.numbers = {
            name: self._whole(name, header.get(name), 0, _MAX_COUNT) for name in _NUMBERS
        }
        spp, batches = self.numbers["spp"], render["batches"]
        if self.numbers["first"] + spp > 2**41 or (bound and spp > render["spp"]):
            raise _BadError(f"damaged: spp is {spp}")
        if batches and spp % max(render["spp"] // batches, 1):
            raise _BadError(f"damaged: {spp} samples are no batches")
        self.adaptive = target is not None

    @staticmethod
    def _typed(name: str, value: Any, kind: type) -> Any:
        if type(value) is not kind:
            raise _BadError(f"damaged: {name} is {shown(value)}, expected {kind.__name__}")
        return value

    @staticmethod
    def _whole(name: str, value: Any, low: int, high: int) -> int:
        if type(value) is not int or not low <= value <= high:
            raise _BadError(f"damaged: {name} is {shown(value)}, outside [{low}, {high}]")
        return value

    def layout(self) -> list[tuple[str, str, tuple[int, ...], int, int]]:
        """Name, dtype, shape, numbers and bytes of a number of each array."""
        width, height = self.render["width"], self.render["height"]
        wanted: dict[str, tuple[str, tuple[int | None, ...]]] = {}
        self.units = self._typed("units", self.header.get("units"), dict)
        for film, units in self.units.items():
            if film not in FILMS:
                raise _BadError(f"damaged: units of {shown(film)}")
            self._whole(f"units of {film}", units, 0, self.numbers["spp"])
        self.planes = [
            self._plane(p) for p in self._typed("planes", self.header.get("planes"), list)
        ]
        for plane in self.planes:
            shape = height, width, plane["channels"], _KINDS[plane["kind"]]
            wanted |= {f"{film} {plane['name']}": ("<u8", shape) for film in self.units}
        if len(wanted) != len(self.planes) * len(self.units):
            raise _BadError("damaged: two planes of one name")
        listed = self._typed("arrays", self.header.get("arrays"), list)
        names = [entry[0] for entry in listed if type(entry) is list and entry]
        if self.adaptive and "tiles" in names:
            wanted["tiles"] = "<i8", (-(-height // TILE), -(-width // TILE))
        if self.render["batches"]:
            batch = self.render["spp"] // self.render["batches"]
            wanted["means"] = "<f8", (self.numbers["spp"] // max(batch, 1), height, width, 3)
        wanted |= {"ledger": ("<u8", (None, 9)), "nonfinite_at": ("<u8", (None, 3)),
                   "nonfinite_radiance": ("<f4", (None, 3))}  # fmt: skip
        wanted |= {name: (dtype, (None,)) for name, dtype in _ROWS.items() if name != "ledger"}
        result = []
        for entry in listed:
            if type(entry) is not list or len(entry) != 3 or type(entry[0]) is not str:
                raise _BadError(f"damaged: an array is {shown(entry)}")
            name, dtype, shape = entry
            if name not in wanted:
                raise _BadError(f"damaged: an array {shown(name)}")
            expected, form = wanted.pop(name)
            if (
                dtype != expected
                or type(shape) is not list
                or len(shape) != len(form)
                or any(type(n) is not int or n < 0 for n in shape)
                or any(n != m if m is not None else n > _MAX_DEPTHS
                       for n, m in zip(shape, form, strict=True))
            ):  # fmt: skip
                raise _BadError(f"damaged: array {name} is {shown([dtype, shape])}")
            result.append((name, dtype, tuple(shape), math.prod(shape), np.dtype(dtype).itemsize))
        if wanted:
            raise _BadError(f"damaged: no array {next(iter(wanted))}")
        return result

    def _plane(self, plane: Any) -> dict[str, Any]:
        kinds = {"name": str, "kind": str, "channels": int, "negative": bool, "scale": float}
        if type(plane) is not dict or {k: type(v) for k, v in plane.items()} != kinds:
            raise _BadError(f"damaged: a plane is {shown(plane)}")
        self._whole("channels", plane["channels"], 1, 64)
        if plane["kind"] not in _KINDS:
            raise _BadError(f"damaged: a plane of {shown(plane['kind'])}")
        return plane

    def of(self, arrays: dict[str, Array]) -> dict[str, Any]:
        """The fields with these arrays."""
        header, spp, tiles = self.header, self.numbers["spp"], arrays.get("tiles")
        if tiles is not None and not (
            min(PILOTS.values()) <= int(tiles.min()) <= int(tiles.max()) <= self.render["spp"]
        ):
            raise _BadError(f"damaged: tiles of {tiles.min()} to {tiles.max()} samples")
        if not (bool(self.planes) == bool(spp) == bool(self.units)) or not (
            spp or tiles is not None
        ):
            raise _BadError(f"damaged: {spp} samples, and {len(self.planes)} planes")
        films: dict[str, dict[str, Any] | None] = dict.fromkeys(FILMS)
        for film, samples in self._samples(tiles is not None).items():
            words = [{**p, "words": arrays[f"{film} {p['name']}"]} for p in self.planes]
            films[film] = {"samples": samples, "units": self.units[film], "planes": words}
            if self.units[film] > samples:
                raise _BadError(f"damaged: {self.units[film]} units of {samples} samples")
        machine = self._typed("machine", header.get("machine"), dict)
        for name, value in machine.items():
            self._typed(f"machine: {name}", value, str)
        return {
            "render": self.render,
            **self.numbers,
            "report": self._report(arrays),
            **films,
            "tiles": tiles,
            "means": arrays.get("means"),
            "machine": machine,
        }

    def _samples(self, listed: bool) -> dict[str, int]:
        """Samples of every pixel in each film."""
        spp = self.numbers["spp"]
        cut = spp % GROUP if "tail" in self.units else 0
        late = spp >= LATE or self.adaptive
        samples = {"film": spp - cut if late else spp, "groups": spp - cut, "tail": cut}
        return {film: 0 if listed else samples[film] for film in self.units}

    def _report(self, arrays: dict[str, Array]) -> dict[str, Any]:
        given = self._typed("report", self.header.get("report"), dict)
        for name, kind in _SCALARS.items():
            value = self._typed(name, given.get(name), kind)
            if kind is int:
                self._whole(name, value, 0, _MAX_COUNT)
        if not 0 <= given["seconds"] < math.inf:
            raise _BadError(f"damaged: seconds is {given['seconds']}")
        for name in given["features"]:
            self._typed("a feature", name, str)
        for name, value in given["kernel"].items():
            self._whole(f"kernel: {name}", value, 0, _MAX_COUNT)
        at, radiance = arrays["nonfinite_at"], arrays["nonfinite_radiance"]
        if len(at) != len(radiance):
            raise _BadError(f"damaged: {len(at)} places of {len(radiance)} refused samples")
        return {
            **{name: given[name] for name in _SCALARS},
            **{name: arrays[name] for name in _ROWS},
            "nonfinite": [(*a, *b) for a, b in zip(at.tolist(), radiance.tolist(), strict=True)],
        }
