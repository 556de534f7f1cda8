"""Writes what follows from the schema of a scene's arrays (python/veriray/columns.py).

    python cpp/schema/generate.py [--check]

from the repository root. --check writes nothing: exit status 1 if a file is not current.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
import textwrap
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "python"))

from veriray.columns import COLUMNS, KINDS, REQUIRED, TABLES, TEXTURABLE, Column  # noqa: E402

C_TYPES = {np.float64: "double", np.float32: "float", np.uint32: "uint32_t", np.int32: "int32_t",
           np.bool_: "uint8_t"}  # fmt: skip
SOURCE = "Made by cpp/schema/generate.py from python/veriray/columns.py."
DEF = """\
// The arrays of a scene. {source}
//   VR_TABLE(table, the column that says how many rows it has)
//   VR_COLUMN(table, name, type, low, high, ends excluded, numbers of a row...)
//   VR_INDEX(table, name, type, least, table whose rows it names, numbers of a row...)
//   VR_KIND(table, name, type, how many there are, numbers of a row...)
// The table `scene` has one row.
#ifndef VR_TABLE
#define VR_TABLE(...)
#endif
#ifndef VR_COLUMN
#define VR_COLUMN(...)
#endif
#ifndef VR_INDEX
#define VR_INDEX(...)
#endif
#ifndef VR_KIND
#define VR_KIND(...)
#endif

{rows}

#undef VR_TABLE
#undef VR_COLUMN
#undef VR_INDEX
#undef VR_KIND
"""
MATERIALS = """\
// What closures know of a material: its numbers. {source}
//   VR_PARAMETER(name, numbers)
//   VR_TEXTURABLE(name): a texture can give it
#ifndef VR_PARAMETER
#define VR_PARAMETER(...)
#endif
#ifndef VR_TEXTURABLE
#define VR_TEXTURABLE(...)
#endif

{rows}

#undef VR_PARAMETER
#undef VR_TEXTURABLE
"""
FIELDS = '''\
"""The array fields of a scene. {source}"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

Array = npt.NDArray[Any]
_NONE: Any = None  # until the scene is made


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneArrays:
    """The arrays of a scene, read-only; None when given stands for an empty table or the default.

{doc}
    """

{fields}
'''
PAGE = """\
# The arrays of a scene

{source}

`veriray.Scene` takes and holds these NumPy arrays. A row that is not given holds the default;
`None` stands for an empty table or for a column of defaults. Numbers are finite. An array that is
wrong raises `SceneError`, which names array, index, value and what is allowed. Arrays are read-only
and C-contiguous; but one of 4,096 rows and more whose numbers are all alike may take the memory of
one number, with strides of 0.

Numbers of rows: {letters}.

{tables}
"""


def number(x: float) -> str:
    """A number for C++."""
    return "INFINITY" if x == math.inf else "-INFINITY" if x == -math.inf else f"{x:g}"


def shape(column: Column) -> str:
    """As in "(M, 3)"."""
    axes = [TABLES[column.table]] if column.table else []
    axes += [str(n) for n in column.width]
    return f"({', '.join(axes)}{',' if len(axes) == 1 else ''})"


def dtype(column: Column) -> str:
    """As NumPy calls it."""
    return str(np.dtype(column.dtype))


def c_row(name: str, column: Column) -> str:
    """A column for the preprocessor."""
    kind = C_TYPES[column.dtype]
    head = f"{column.table or 'scene'}, {name}, {kind}"
    width = "".join(f", {n}" for n in column.width)
    if column.indexes in KINDS:
        return f"VR_KIND({head}, {KINDS[column.indexes]}{width})"
    if column.indexes:
        return f"VR_INDEX({head}, {0 if kind == 'uint32_t' else -1}, {column.indexes}{width})"
    low, high = (0, 1) if kind == "uint8_t" else (column.low, column.high)
    ends = "true" if column.open else "false"
    return f"VR_COLUMN({head}, {number(low)}, {number(high)}, {ends}{width})"


def meaning(column: Column) -> str:
    """Range, default and meaning in words."""
    words = []
    if column.indexes and column.indexes not in KINDS:
        words.append(f"index of {column.indexes}")
    if (column.low, column.high) != (-math.inf, math.inf) and abs(column.low) < 1e100:
        top = "infinity" if column.high == math.inf else f"{column.high:g}"
        start, end = "()" if column.open else "[)" if column.high == math.inf else "[]"
        words.append(f"in {start}{column.low:g}, {top}{end}")
    if column.default is not REQUIRED:
        words.append(f"default {column.default}")
    return f"{column.doc} ({', '.join(words)})" if words else column.doc


def first_columns() -> dict[str, str]:
    """By table: the column that says how many rows there are."""
    found: dict[str, str] = {}
    for name, column in COLUMNS.items():
        if column.table:
            found.setdefault(column.table, name)
    return found


def definitions() -> str:
    """columns.def."""
    rows = [f"VR_TABLE({table}, {name})" for table, name in first_columns().items()]
    rows += [c_row(name, column) for name, column in COLUMNS.items()]
    return DEF.format(source=SOURCE, rows="\n".join(rows))


def parameters() -> str:
    """materials.def."""
    rows = [f"VR_PARAMETER({name}, {math.prod(column.width)})" for name, column in COLUMNS.items()
            if column.table == "materials"
            and (column.dtype is np.float32 or name == "distribution")]  # fmt: skip
    rows += [f"VR_TEXTURABLE({name})" for name in TEXTURABLE]
    return MATERIALS.format(source=SOURCE, rows="\n".join(rows))


def fields() -> str:
    """scene_arrays.py."""
    doc = []
    for name, column in COLUMNS.items():
        text = f"{name} {shape(column)} {dtype(column)}: {meaning(column)}"
        doc += textwrap.wrap(text, 100, initial_indent="    ", subsequent_indent="        ")
    given = [f"    {name}: Array = _NONE" for name in COLUMNS]
    return FIELDS.format(source=SOURCE, doc="\n".join(doc), fields="\n".join(given))


def page() -> str:
    """docs/scene-arrays.md."""
    parts = []
    for table in ("", *TABLES):
        title = f"{table.capitalize()} ({TABLES[table]})" if table else "The scene itself"
        rows = [f"| `{name}` | {shape(c)} {dtype(c)} | {meaning(c)} |"
                for name, c in COLUMNS.items() if c.table == table]  # fmt: skip
        parts.append(
            "\n".join([f"## {title}", "", "| array | rows | meaning |", "|---|---|---|", *rows])
        )
    letters = ", ".join(f"{letter} {table}" for table, letter in TABLES.items())
    return PAGE.format(source=SOURCE, letters=letters, tables="\n\n".join(parts))


def stub(text: str) -> str:
    """_native.pyi with the types of the arrays."""
    letters = ", ".join(f"{letter} {table}" for table, letter in TABLES.items())
    doc = textwrap.fill(
        f'"""{letters}; see veriray.Scene. uint8 columns hold 0 or 1. {SOURCE}"""',
        96, initial_indent="    ", subsequent_indent="    ",
    )  # fmt: skip
    rows = []
    for name, column in COLUMNS.items():
        kind = "uint8" if column.dtype is np.bool_ else dtype(column)
        rows.append(f"    {name}: npt.NDArray[np.{kind}]  # {shape(column)}")
    block = "\n".join(["class SceneArrays(TypedDict):", doc, "", *rows, "", ""])
    return re.sub(
        r"class SceneArrays\(TypedDict\):\n.*?\n(?=class )", lambda _: block, text, flags=re.S
    )


def main() -> int:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--check", action="store_true")
    args = p.parse_args()
    native = ROOT / "python" / "veriray" / "_native.pyi"
    wanted = {
        ROOT / "cpp" / "schema" / "columns.def": definitions(),
        ROOT / "cpp" / "schema" / "materials.def": parameters(),
        ROOT / "python" / "veriray" / "scene_arrays.py": fields(),
        ROOT / "docs" / "scene-arrays.md": page(),
        native: stub(native.read_text("utf-8")),
    }
    stale = []
    for path, text in wanted.items():
        if not path.is_file() or path.read_text("utf-8") != text:
            stale.append(path.relative_to(ROOT))
            if not args.check:
                path.write_text(text, "utf-8")
    for path in stale:
        print(f"{path}: {'not current; run make schema' if args.check else 'written'}")
    return 1 if stale and args.check else 0


if __name__ == "__main__":
    sys.exit(main())
