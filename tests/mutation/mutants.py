"""Planted bugs: each must make the verdict of `veriray compare` fail against the Embree reference.

    python -m tests.mutation.mutants [NAME ...] [--list] [--case CASE] [--folder DIR] [-o FILE.json]

from the repository root. A mutant is a change of the core's source (or of the scene), made in a
copy outside the tree, rendered at the effort of the reference picture and compared with it; it is
*killed* if the verdict fails. One CPU module holds all mutants, each behind a switch that is read
when the module is loaded. In each case the module first runs with no mutant switched on, and must
pass. Exit status 1 if a mutant survives or the unchanged module is killed. --folder keeps build and
reference pictures for the next run.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.mutation.bugs import CASES, MUTANTS, Mutant
from tests.mutation.level_bugs import MORE
from veriray import device

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "benchmarks" / "results" / "mutants.json"
SHIPPED = ROOT / "scenes" / "cornell" / "refs" / "cornell_box_128.exr"
SWITCH = "VERIRAY_PLANTED_BUG"
_HEADER = f"""#include <cstdlib>
inline const unsigned long planted_bug = [] {{
    const char* number = std::getenv("{SWITCH}");
    return number ? std::strtoul(number, nullptr, 10) : 0ul;
}}();
"""


def span(text: str, old: str) -> tuple[int, int]:
    """Where `old` is in `text`, ignoring blanks; ValueError unless it occurs exactly once."""
    tokens = re.findall(r"\w+|[^\w\s]", old)
    pattern = r"\s*".join(re.escape(token) for token in tokens)
    first, last = (r"\b" if re.match(r"\w", token) else "" for token in (tokens[0], tokens[-1]))
    found = list(re.finditer(first + pattern + last, text))
    if len(found) != 1:
        raise ValueError(f"{old!r} occurs {len(found)} times, expected once")
    return found[0].span()


def planted(text: str, edits: Sequence[tuple[str, str]]) -> str:
    """`text` with every old replaced by its new."""
    for old, new in edits:
        begin, end = span(text, old)
        text = text[:begin] + new + text[end:]
    return text


def _whole(text: str) -> bool:
    """Whether brackets and conditions in C++ text are complete, and no comma is outside them."""
    closes = {")": "(", "]": "[", "}": "{", ":": "?"}
    opened: list[str] = []
    for c in text.replace("::", ""):
        if c in closes.values():
            opened.append(c)
        elif (c in closes and (not opened or opened.pop() != closes[c])) or (
            c == "," and not opened and not text.endswith((";", "}"))
        ):
            return False
    return not opened


#: Statements that declare a variable, or begin within an expression.
_DECLARES = re.compile(
    r"(?!return\b)(?:const )?[A-Za-z_][\w:<>, ]*[*&]* [A-Za-z_]\w*(?: ?=(?!=)|[;(,])|[^\w{*(]"
)


def switched(text: str, edits: Sequence[tuple[int, str, str]]) -> str:
    """C++ `text` in which (number, old, new) replaces `old` while `planted_bug` is `number`.

    Expressions become conditional expressions, statements branches. Edits of one place are told
    apart; ValueError where two places overlap without being one.
    """
    places: dict[tuple[int, int], list[tuple[int, str]]] = {}
    for number, old, new in edits:
        if old.endswith(";") != new.endswith((";", "}")):
            raise ValueError(f"{old!r} and {new!r} must both be statements or expressions")
        for part in (old, new):
            if not _whole(part):
                raise ValueError(f"{part!r} is not a whole expression")
        if old.endswith(";") and _DECLARES.match(old):
            raise ValueError(f"{old!r} declares what would end with its branch")
        if not old.endswith(";") and old[0] in "*/+%<>=|^?.":
            raise ValueError(f"{old!r} begins within an expression")
        places.setdefault(span(text, old), []).append((number, new))
    end_before = len(text)
    for begin, end in sorted(places, reverse=True):
        if end > end_before:
            raise ValueError(f"{text[begin:end]!r} overlaps {text[end_before : end_before + 40]!r}")
        end_before = begin
        result, statement = text[begin:end], text[end - 1] == ";"
        for number, new in places[begin, end]:
            test = f"planted_bug == {number}"
            if statement:
                result = f"if ({test}) {{ {new} }} else {{ {result} }}"
            else:
                result = f"({test} ? ({new}) : ({result}))"
        text = text[:begin] + result + text[end:]
    return text


#: Everything that one build holds; mutant k has the number k + 1.
BUILT = (*MUTANTS, *MORE)


def sources() -> dict[str, str]:
    """Files of cpp/ with all mutants in them."""
    edits: dict[str, list[tuple[int, str, str]]] = {}
    for number, mutant in enumerate(BUILT, 1):
        for file, old, new in mutant.edits:
            edits.setdefault(file, []).append((number, old, new))
    return {
        file: switched((ROOT / "cpp" / file).read_text("utf-8"), e) for file, e in edits.items()
    }


class Workshop:
    """A copy of the sources with all mutants in it, its build, and the references of the cases."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.source = folder, folder / "source"
        chosen, _ = device.select("cpu")
        self.target = chosen.native.__name__.rpartition(".")[2]
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
        self.environment = {**os.environ, "PATH": path, "VERIRAY_CUDA": "0"}
        self._cases: dict[str, tuple[Path, Path]] = {}
        begin = time.perf_counter()
        self.module = self._build()
        self.build_seconds = round(time.perf_counter() - begin, 1)

    def _call(self, *words: object, **environment: str) -> str:
        done = subprocess.run(
            [str(word) for word in words],
            cwd=ROOT, env={**self.environment, **environment}, capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{words[0]} failed:\n{done.stdout[-6000:]}{done.stderr[-3000:]}")
        return done.stdout

    def _build(self) -> Path:
        files = {f"cpp/{file}": text for file, text in sources().items()}
        files["planted_bug.h"] = _HEADER
        copied = ["CMakeLists.txt", "python/veriray/__init__.py"]
        for part in ("cpp", "python/bindings"):
            copied += [str(f.relative_to(ROOT)) for f in (ROOT / part).rglob("*") if f.is_file()]
        for name in copied:
            files.setdefault(name, (ROOT / name).read_text("utf-8"))
        for name, text in files.items():
            file = self.source / name
            file.parent.mkdir(parents=True, exist_ok=True)
            if (
                not file.exists() or file.read_text("utf-8") != text
            ):  # an unchanged file is not compiled
                file.write_text(text)
        build = self.folder / "build"
        self._call("cmake", "-S", self.source, "-B", build, "-G", "Ninja",
                   f"-DCMAKE_CXX_FLAGS=-include {self.source / 'planted_bug.h'}",
                   "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG",
                   f"-DPython_EXECUTABLE={sys.executable}", "-DVERIRAY_CPU=all")  # fmt: skip
        self._call("cmake", "--build", build, "--target", self.target)
        return next(build.glob(f"{self.target}.*"))

    def case(self, name: str) -> tuple[Path, Path]:
        """Scene file, as the mutants render it, and reference picture of a case."""
        if name not in self._cases:
            case = CASES[name]
            scene = ROOT / "scenes" / case.scene
            file = name.replace(" ", "_").replace(",", "")
            if case.edits:
                scene = self._edited(scene, file, case.edits)
            picture = self.folder / f"{file}.exr" if case.options else SHIPPED
            if not picture.exists():
                self._call(sys.executable, "-m", "reference", "render", scene, "-o", picture,
                           "--seed", "1", *case.options)  # fmt: skip
            if case.hidden:
                scene = self._edited(scene, f"{file}_hidden", case.hidden)
            self._cases[name] = scene, picture
        return self._cases[name]

    def _edited(self, scene: Path, name: str, edits: Sequence[tuple[str, str]]) -> Path:
        copy = self.folder / "scenes" / name
        shutil.copytree(
            scene.parent, copy, ignore=shutil.ignore_patterns("refs"), dirs_exist_ok=True
        )
        (copy / scene.name).write_text(planted(scene.read_text("utf-8"), edits))
        return copy / scene.name

    def judge(self, mutant: Mutant | None, case: str, seed: int = 7) -> dict[str, Any]:
        """Verdict on a mutant, or on the unchanged copy."""
        scene, reference = self.case(case)
        begin = time.perf_counter()
        edit = (mutant.shape, mutant.factor) if mutant and mutant.shape else ()
        number = str(BUILT.index(mutant) + 1 if mutant else 0)
        answer: dict[str, Any] = json.loads(
            self._call(sys.executable, "-m", "tests.mutation.judge", self.target, self.module,
                       scene, reference, seed, *edit, **{SWITCH: number})
        )  # fmt: skip
        return {
            "name": mutant.name if mutant else "unchanged",
            "case": case,
            "killed": answer["result"] == "fail",
            **answer,
            "judge_seconds": round(time.perf_counter() - begin, 1),
        }


def main() -> int:
    """Command line."""
    from benchmarks.common import header, write

    p = argparse.ArgumentParser(description="Planted bugs against the verdict")
    p.add_argument("names", nargs="*", help="mutants, default all")
    p.add_argument("--list", action="store_true")
    p.add_argument("--case", choices=CASES, help="the mutants of this case alone")
    p.add_argument("--folder", type=Path, help="keep build and reference pictures here")
    p.add_argument("-o", "--output", type=Path, default=RESULT, help="JSON file")
    args = p.parse_args()
    if args.list:
        print("\n".join(f"{m.name}  ({m.case})" for m in MUTANTS))
        return 0
    unknown = set(args.names) - {m.name for m in MUTANTS}
    if unknown:
        p.error(f"unknown mutants: {', '.join(sorted(unknown))}; --list shows all")
    chosen = [m for m in MUTANTS if not args.names or m.name in args.names]
    chosen = [m for m in chosen if args.case in (None, m.case)]
    with tempfile.TemporaryDirectory() as folder:
        result = {**header("mutants"), **run(Workshop(args.folder or Path(folder)), chosen)}
    write(result, args.output)
    return 0 if result["sound"] and result["killed"] == result["planted"] else 1


def run(shop: Workshop, chosen: Sequence[Mutant]) -> dict[str, Any]:
    """Judges the mutants case by case, the unchanged module first; prints as it goes."""
    print(f"built in {shop.build_seconds} s", flush=True)
    rows: list[dict[str, Any]] = []
    for case in dict.fromkeys(m.case for m in chosen):
        for mutant in (None, *(m for m in chosen if m.case == case)):
            row = shop.judge(mutant, case)
            if mutant and mutant.file:
                row |= {"file": mutant.file, "edits": mutant.edits}
            rows.append(row)
            verdict = "killed" if row["killed"] else "SURVIVED" if mutant else "passes"
            if not mutant and row["result"] != "pass":
                verdict = "FAILS"
            print(f"{case}: {row['name']}: {verdict} {row['failed']} ({row['judge_seconds']} s)",
                  flush=True)  # fmt: skip
    planted_rows = [row for row in rows if row["name"] != "unchanged"]
    killed = sum(row["killed"] for row in planted_rows)
    sound = all(row["result"] == "pass" for row in rows if row["name"] == "unchanged")
    state = "passes" if sound else "FAILS"
    print(f"{killed} of {len(planted_rows)} mutants killed; the unchanged module {state}")
    cases = {
        name: {"scene": c.scene, "options": " ".join(c.options), "edits": c.edits + c.hidden}
        for name, c in CASES.items()
        if name in {m.case for m in chosen}
    }
    return {"cases": cases, "build_seconds": shop.build_seconds, "killed": killed,
            "planted": len(planted_rows), "sound": sound, "rows": rows}  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
