"""Planted bugs: each must make the verdict of `veriray compare` fail against the Embree reference.

    python -m tests.mutation.mutants [NAME ...] [--list] [-o FILE.json]

from the repository root. A mutant is a change of the core's source (or of the scene), made in a
copy outside the tree, built as a CPU module of its own, rendered at the effort of the reference
picture and compared with it; it is *killed* if the verdict fails. The unchanged copy goes first in
each case and must pass. Exit status 1 if a mutant survives or the unchanged copy is killed.
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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from veriray import device

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "benchmarks" / "results" / "mutants.json"
CORNELL = ROOT / "scenes" / "cornell"


@dataclass(frozen=True)
class Case:
    """Scene and reference: the shipped picture, or one that `reference/` makes for the occasion.

    options: of `python -m reference render`; edit: (old, new) in the scene file, in a copy.
    """

    options: tuple[str, ...] = ()
    edit: tuple[str, str] | None = None


_QUICK = ("--width", "48", "--height", "48", "--spp", "1024")
CASES = {
    "shipped": Case(),
    "quick": Case(_QUICK),
    "depth 3": Case((*_QUICK, "--max-depth", "3")),
    # In the box as measured no path can meet the back of the lamp.
    "lowered lamp": Case(_QUICK, ("0 -65 0 278 0 0 -1 548.8", "0 -65 0 278 0 0 -1 400")),
}


@dataclass(frozen=True)
class Mutant:
    """A planted bug: `old` becomes `new` in cpp/`file`, or `shape` reflects `factor` times."""

    name: str
    file: str = ""
    old: str = ""
    new: str = ""
    case: str = "shipped"
    shape: str = ""
    factor: float = 1.0


_PATH, _LIGHT, _DIFFUSE = "integrators/path.h", "lights/light.h", "materials/diffuse.h"
_EVAL = "return {albedo * pdf, pdf};"
_PDF = "s.pdf_sa = column(kLightPdfArea) * d2 / cos_light;"
_Q = "const F q = min(F(1.f), "
_DIVIDE = "path.throughput * (F(1.f) / q)"
_SURVIVE = "active & (uniform(u) < q)"
_RR = "if (depth + 1 < s.rr_depth) return active;"
_CUT = "if (depth + 1 >= s.max_depth)"
_HIT = "emitted * mis_weight(path.pdf_sa, pdf_light)"
_NEE = "(F(1.f) / (light.pdf_sa + bsdf.pdf_sa))"
_LIT = "const M lit = hit_emitter(scene, path, hit, at, valid);"
_T_MAX = "shadow.t_max = light.distance;"
_MATERIAL = "fn(Diffuse<F>{albedo});"
_SCATTER = "return {wi, albedo, cosine_hemisphere_pdf_sa(wi.z)};"
_SAMPLE = "const float radiance[3] = {r[0][k], r[1][k], r[2][k]};"
_JITTER_X = "const F dx = F(0.5f) + filter_offset<L>(scene.filter, uniform(r.x));"
_LIGHT_UV = "const F u = uniform(scatter.x), v = uniform(scatter.y);"


def _wall(shape: str, percent: float) -> Mutant:
    return Mutant(f"reflectance of {shape} +{percent} %", shape=shape, factor=1 + percent / 100)


#: The bugs that the verdict against the shipped reference must find, in this order.
MUTANTS = (
    *(_wall(shape, 0.5) for shape in ("floor", "back_wall", "right_wall", "left_wall")),
    Mutant("MIS weight missing on hit", _PATH, _HIT, "emitted"),
    Mutant("MIS weight missing on light sample", _PATH, _NEE, "(F(1.f) / light.pdf_sa)"),
    Mutant("cosine missing in eval", _DIFFUSE, _EVAL, "return {albedo * F(kInvPi), pdf};"),
    Mutant("cosine squared in eval", _DIFFUSE, _EVAL, "return {albedo * (pdf * cos_i), pdf};"),
    Mutant("roulette not divided out", _PATH, _DIVIDE, "path.throughput"),
    Mutant("roulette divided by q squared", _PATH, _DIVIDE,
           "path.throughput * (F(1.f) / (q * q))"),
    Mutant("roulette survives 2 % too rarely", _PATH, _SURVIVE,
           "active & (uniform(u) < q * F(.98f))"),
    Mutant("light cosine missing", _LIGHT, _PDF, "s.pdf_sa = column(kLightPdfArea) * d2;"),
    Mutant("1/r for 1/r^2", _LIGHT, _PDF,
           "s.pdf_sa = column(kLightPdfArea) * distance / cos_light;"),
    Mutant("light pdf doubled", _LIGHT, _PDF,
           "s.pdf_sa = F(2.f) * column(kLightPdfArea) * d2 / cos_light;"),
    Mutant("emission doubled at depth 1", _PATH, _LIT,
           _LIT + " if (depth == 1) hit_emitter(scene, path, hit, at, valid);"),
    Mutant("samples clamped at 10", "schedulers/tile.h", _SAMPLE,
           "const float radiance[3] = {__builtin_fminf(r[0][k], 10.f), "
           "__builtin_fminf(r[1][k], 10.f), __builtin_fminf(r[2][k], 10.f)};"),
    Mutant("half-pixel shift", _PATH, _JITTER_X, _JITTER_X.replace("0.5f", "1.0f")),
    Mutant("albedo +1 %", "materials/material.h", _MATERIAL, "fn(Diffuse<F>{albedo * F(1.01f)});"),
    Mutant("albedo +0.2 %", "materials/material.h", _MATERIAL,
           "fn(Diffuse<F>{albedo * F(1.002f)});"),
    Mutant("albedo +1 % in the weight only", _DIFFUSE, _SCATTER,
           "return {wi, albedo * F(1.01f), cosine_hemisphere_pdf_sa(wi.z)};"),
    Mutant("one segment more", _PATH, _CUT, "if (depth >= s.max_depth)", "depth 3"),
    Mutant("one segment less", _PATH, _CUT, "if (depth + 2 >= s.max_depth)", "depth 3"),
    Mutant("no light sample at the last vertex", _PATH, _T_MAX,
           _T_MAX + " if (depth + 2 >= s.max_depth) shadow.wanted = active & !active;", "depth 3"),
    Mutant("back of the lamp emits when hit", _PATH,
           "lit = valid & at.front & (pdf_area > F(0.f)); if (any(lit)) {"
           "const F cos_light = -dot(at.n, path.ray.d);",
           "lit = valid & (pdf_area > F(0.f)); if (any(lit)) {"
           "const F cos_light = abs(dot(at.n, path.ray.d));", "lowered lamp"),
    # The ray is shortened, or the lamp would shadow its own back.
    Mutant("back of the lamp emits when sampled", _LIGHT, "const F cos_light = -dot(n, s.wi);",
           "const F cos_light = abs(dot(n, s.wi));"
           "s.distance = s.distance * select(dot(n, s.wi) > F(0.f), F(.99f), F(1.f));",
           "lowered lamp"),
    Mutant("no 1/pi", _DIFFUSE, _EVAL, "return {albedo * cos_i, pdf};", "quick"),
    Mutant("albedo squared", "materials/material.h", _MATERIAL,
           "fn(Diffuse<F>{albedo * albedo});", "quick"),
    Mutant("hemisphere of half the azimuth", "core/mapping.h",
           "sincos_2pi(v, s, c); const F r = sqrt(u); return {r * c, r * s, sqrt(F(1.f) - u)};",
           "sincos_2pi(v * F(.5f), s, c); const F r = sqrt(u); "
           "return {r * c, r * s, sqrt(F(1.f) - u)};", "quick"),
    Mutant("u = v on the lamp", _PATH, _LIGHT_UV,
           "const F u = uniform(scatter.x), v = uniform(scatter.x);", "quick"),
    Mutant("roulette and direction share a number", _PATH, "dimension_block(depth, kDecide)).y;",
           "dimension_block(depth, kScatter)).z;", "quick"),
    Mutant("shadow rays meet nothing", _PATH, _T_MAX, "shadow.t_max = F(0.f);", "quick"),
    Mutant("shadow rays half as long", _PATH, _T_MAX, "shadow.t_max = light.distance * F(.5f);",
           "quick"),
    Mutant("roulette one vertex early", _PATH, _RR,
           "if (depth + 2 < s.rr_depth) return active;", "quick"),
    Mutant("roulette capped at 0.5", _PATH, _Q, "const F q = min(F(.5f), ", "quick"),
    Mutant("picture mirrored", _PATH,
           "camera_direction<L>(scene.camera, to_float(x), to_float(y), dx, dy)",
           "camera_direction<L>(scene.camera, F(float(width)) - F(1.f) - to_float(x), "
           "to_float(y), dx, dy)", "quick"),
)  # fmt: skip


def planted(text: str, old: str, new: str) -> str:
    """`text` with `old` replaced, blanks aside; ValueError unless it occurs exactly once."""
    tokens = re.findall(r"\w+|[^\w\s]", old)
    pattern = re.compile(r"\s*".join(re.escape(token) for token in tokens))
    found = pattern.findall(text)
    if len(found) != 1:
        raise ValueError(f"{old!r} occurs {len(found)} times, expected once")
    return pattern.sub(lambda _: new, text)


class Workshop:
    """A copy of the sources in a folder of its own, its build, and the references of the cases."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.source = folder, folder / "source"
        chosen, _ = device.select("cpu")
        self.target = chosen.native.__name__.rpartition(".")[2]
        for part in ("cpp", "python/bindings"):
            shutil.copytree(ROOT / part, self.source / part)
        (self.source / "python" / "veriray").mkdir()
        for part in ("CMakeLists.txt", "python/veriray/__init__.py"):
            shutil.copy(ROOT / part, self.source / part)
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
        self.environment = {**os.environ, "PATH": path, "VERIRAY_CUDA": "0"}
        self._call("cmake", "-S", self.source, "-B", folder / "build", "-G", "Ninja",
                   "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG",
                   f"-DPython_EXECUTABLE={sys.executable}")  # fmt: skip
        self._references: dict[str, tuple[Path, Path]] = {}

    def _call(self, *words: object) -> str:
        done = subprocess.run(
            [str(word) for word in words],
            cwd=ROOT, env=self.environment, capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{words[0]} failed:\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
        return done.stdout

    def build(self, mutant: Mutant | None) -> Path:
        """The module with the bug in it; the copy of the sources is sound again afterwards."""
        file = self.source / "cpp" / mutant.file if mutant and mutant.file else None
        sound = file.read_text() if file else ""
        if file and mutant:
            file.write_text(planted(sound, mutant.old, mutant.new))
        try:
            self._call("cmake", "--build", self.folder / "build", "--target", self.target)
        finally:
            if file:
                file.write_text(sound)
        return next((self.folder / "build").glob(f"{self.target}.*"))

    def case(self, name: str) -> tuple[Path, Path]:
        """Scene file and reference picture of a case."""
        if name not in self._references:
            case, scene = CASES[name], CORNELL / "cornell_box.xml"
            if case.edit:
                copy = self.folder / name.replace(" ", "_")
                shutil.copytree(CORNELL, copy, ignore=shutil.ignore_patterns("refs"))
                scene = copy / scene.name
                scene.write_text(planted(scene.read_text(), *case.edit))
            picture = CORNELL / "refs" / "cornell_box_128.exr"
            if case.options:
                picture = self.folder / f"{name.replace(' ', '_')}.exr"
                self._call(sys.executable, "-m", "reference", "render", scene, "-o", picture,
                           "--seed", "1", *case.options)  # fmt: skip
            self._references[name] = scene, picture
        return self._references[name]

    def judge(self, mutant: Mutant | None, case: str, seed: int = 7) -> dict[str, Any]:
        """Verdict on a mutant, or on the unchanged copy."""
        scene, reference = self.case(case)
        begin = time.perf_counter()
        module = self.build(mutant)
        built = time.perf_counter() - begin
        edit = (mutant.shape, mutant.factor) if mutant and mutant.shape else ()
        answer: dict[str, Any] = json.loads(
            self._call(
                sys.executable,
                "-m",
                "tests.mutation.judge",
                self.target,
                module,
                scene,
                reference,
                seed,
                *edit,
            )  # fmt: skip
        )
        return {
            "name": mutant.name if mutant else "unchanged",
            "case": case,
            "killed": answer["result"] == "fail",
            **answer,
            "build_seconds": round(built, 1),
            "judge_seconds": round(time.perf_counter() - begin - built, 1),
        }


def main() -> int:
    """Command line."""
    from benchmarks.common import header, write

    p = argparse.ArgumentParser(description="Planted bugs against the verdict")
    p.add_argument("names", nargs="*", help="mutants, default all")
    p.add_argument("--list", action="store_true")
    p.add_argument("-o", "--output", type=Path, default=RESULT, help="JSON file")
    args = p.parse_args()
    if args.list:
        print("\n".join(f"{m.name}  ({m.case})" for m in MUTANTS))
        return 0
    unknown = set(args.names) - {m.name for m in MUTANTS}
    if unknown:
        p.error(f"unknown mutants: {', '.join(sorted(unknown))}; --list shows all")
    chosen = [m for m in MUTANTS if not args.names or m.name in args.names]
    result = header("mutants")
    result["cases"] = {
        name: {"options": " ".join(CASES[name].options), "edit": CASES[name].edit}
        for name in sorted({m.case for m in chosen})
    }
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        shop = Workshop(Path(folder))
        for case in dict.fromkeys(m.case for m in chosen):
            for mutant in (None, *(m for m in chosen if m.case == case)):
                row = shop.judge(mutant, case)
                if mutant and mutant.file:
                    row |= {"file": mutant.file, "old": mutant.old, "new": mutant.new}
                rows.append(row)
                verdict = "killed" if row["killed"] else "SURVIVED" if mutant else "passes"
                seconds = f"{row['build_seconds']} s + {row['judge_seconds']} s"
                print(f"{case}: {row['name']}: {verdict} {row['failed']} ({seconds})", flush=True)
    planted_rows = [row for row in rows if row["name"] != "unchanged"]
    killed = sum(row["killed"] for row in planted_rows)
    sound = all(row["result"] == "pass" for row in rows if row["name"] == "unchanged")
    state = "passes" if sound else "FAILS"
    print(f"{killed} of {len(planted_rows)} mutants killed; the unchanged copy {state}")
    write({**result, "killed": killed, "planted": len(planted_rows), "rows": rows}, args.output)
    return 0 if sound and killed == len(planted_rows) else 1


if __name__ == "__main__":
    sys.exit(main())
