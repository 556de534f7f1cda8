"""Coverage-guided fuzzing of everything that parses (atheris, libFuzzer).

    python -m tests.fuzz FORMAT... | all [--seconds N] [--jobs J] [--keep] [-o FILE.json]

from the repository root; `pip install atheris` first. All formats run at once, each in J processes
for N seconds, from the inputs in tests/fuzz/corpus. Prints, and writes as JSON, executions,
coverage and findings of each format; exit status 1 if there is a finding. --keep: adds to
tests/fuzz/corpus the smallest inputs that, with the existing ones, reach all code that was reached;
--folder: keeps all.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tests.fuzz.contract import MAX_INPUT
from tests.fuzz.formats import FORMATS, corpus, target

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "benchmarks" / "results" / "fuzz.json"
CORPUS_BYTES = 45_000  # of a format
HANG = 60  # seconds of one input
_PROGRESS = re.compile(r"cov: (\d+) ft: (\d+) corp: (\d+)")
_EXECUTIONS = re.compile(r"stat::number_of_executed_units: (\d+)")


def escaped(word: str) -> str:
    """A line of libFuzzer's dictionary."""
    plain = (c for c in word.encode())
    return '"' + "".join(chr(c) if 32 <= c < 127 and c not in b'\\"' else f"\\x{c:02x}"
                         for c in plain) + '"'  # fmt: skip


def cpu_seconds(pid: int) -> float:
    """Processor time of a running process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()  # proc(5), from 3 on
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Run:
    """The processes of one format."""

    def __init__(self, name: str, folder: Path, jobs: int, seconds: int, seed: int) -> None:
        self.name, self.jobs, self.end, self.seed = name, jobs, time.monotonic() + seconds, seed
        self.begin = time.monotonic()
        self.work, self.findings, self.logs = (
            folder / name / place for place in ("work", "findings", "logs")
        )
        for place in (self.work, self.findings, self.logs, corpus(name)):
            place.mkdir(parents=True, exist_ok=True)
        self.words = folder / name / "words"
        self.words.write_text("\n".join(map(escaped, filter(None, target(name).words))) + "\n")
        self.starts = 0
        self.cpu: dict[int, float] = {}  # seconds of processor time by process
        self.processes = [self.start() for _ in range(jobs)]

    def start(self) -> subprocess.Popen[bytes]:
        """One more process, until the end of the run."""
        self.starts += 1
        left = max(1, int(self.end - time.monotonic()))
        arguments = [
            f"-max_total_time={left}", f"-max_len={MAX_INPUT}", f"-timeout={HANG}",
            "-rss_limit_mb=4096", "-print_final_stats=1", "-reload=5", "-len_control=0",
            f"-seed={self.seed * 1000 + self.starts}", f"-dict={self.words}",
            f"-artifact_prefix={self.findings}/", str(self.work), str(corpus(self.name)),
        ]  # fmt: skip
        threads = {f"{x}_NUM_THREADS": "1" for x in ("OPENBLAS", "OMP", "MKL")}
        with open(self.logs / str(self.starts), "wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "tests.fuzz.worker", self.name, self.findings, *arguments],
                cwd=ROOT, env={**os.environ, **threads}, stderr=log, stdout=log,
            )  # fmt: skip

    def alive(self) -> bool:
        """Restarts what crashed; returns whether anything is left to wait for."""
        for process in self.processes:
            if process.poll() is None:
                self.cpu[process.pid] = cpu_seconds(process.pid)
        for k, process in enumerate(self.processes):
            if process.poll() == 1:  # not libFuzzer's: an exception outside the target
                texts = [log.read_text(errors="replace")[-1500:] for log in self.logs.iterdir()]
                raise RuntimeError(f"{self.name}: the fuzzer failed:\n{''.join(texts)}")
            if process.poll() not in (None, 0) and time.monotonic() < self.end - 5:
                if self.starts < 20 * self.jobs:
                    self.processes[k] = self.start()
        return any(process.poll() is None for process in self.processes)

    def result(self) -> dict[str, Any]:
        """Executions, coverage and findings."""
        texts = [log.read_text(errors="replace") for log in sorted(self.logs.iterdir())]
        executions, edges, features = 0, 0, 0
        for text in texts:
            done = _EXECUTIONS.findall(text) or re.findall(r"^#(\d+)", text, re.MULTILINE)
            executions += int(done[-1]) if done else 0
            for cov, ft, _ in _PROGRESS.findall(text):
                edges, features = max(edges, int(cov)), max(features, int(ft))
        found = []
        for file in sorted(self.findings.iterdir()):
            if file.suffix == ".json":
                data = file.with_suffix(".bin").read_bytes()
                found.append({**json.loads(file.read_text("utf-8")), "input": packed(data)})
            elif file.suffix != ".bin":
                kind, data = file.name.split("-")[0], file.read_bytes()
                if again := replayed(self.name, file):  # else the machine paused, not the parser
                    found.append({"key": kind, "text": f"the process ended ({kind}); {again}",
                                  "bytes": len(data), "input": packed(data)})  # fmt: skip
        if not executions:
            raise RuntimeError(f"{self.name}: nothing ran:\n{texts[0][-2000:]}")
        return {
            "executions": executions, "seconds": round(time.monotonic() - self.begin),
            "cpu_seconds": round(sum(self.cpu.values())),
            "processes": self.jobs, "restarts": self.starts - self.jobs, "edges": edges,
            "features": features, "findings": found,
        }  # fmt: skip


def packed(data: bytes) -> str:
    """An input for the result file: base64 of its first 3000 bytes."""
    return base64.b64encode(data[:3000]).decode()


def replayed(name: str, file: Path) -> str:
    """The fault of an input in a process of its own; "" if there is none."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (HANG, HANG + 1))

    done = subprocess.run([sys.executable, "-m", "tests.fuzz.replay", name, file], cwd=ROOT,
                          capture_output=True, text=True, preexec_fn=limit)  # fmt: skip
    return "" if done.returncode == 0 else f"again: {done.returncode} {done.stderr[-300:]}"


def minimised(name: str, to: Path, *sources: Path) -> dict[str, Any]:
    """`tests.fuzz.minimise` in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.minimise", name, str(CORPUS_BYTES), to, *sources],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    if done.returncode:
        return {"error": f"exit status {done.returncode}: {done.stderr[-500:]}"}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def main() -> int:
    """Command line."""
    p = argparse.ArgumentParser(description="Coverage-guided fuzzing of everything that parses")
    p.add_argument("formats", nargs="+", choices=(*FORMATS, "render", "all"))
    p.add_argument("--seconds", type=int, default=60, help="of each format, default 60")
    p.add_argument("--jobs", type=int, default=1, help="processes of each format")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--keep", action="store_true", help="update tests/fuzz/corpus")
    p.add_argument("--folder", type=Path, help="keep logs, findings and all inputs here")
    p.add_argument("-o", "--output", type=Path, help="JSON file")
    args = p.parse_args()
    names = FORMATS if "all" in args.formats else tuple(dict.fromkeys(args.formats))
    folder = args.folder or Path(tempfile.mkdtemp())
    runs = [Run(n, folder, args.jobs, args.seconds, args.seed) for n in names]
    while any([run.alive() for run in runs]):
        time.sleep(1)
    from benchmarks.common import header, write

    result = {**header("fuzz", "atheris", "lxml", "OpenEXR", "trimesh"), "max_input": MAX_INPUT,
              "formats": {run.name: run.result() for run in runs}}  # fmt: skip
    for name, row in result["formats"].items():
        small = folder / name / "corpus"
        row["corpus"] = minimised(name, small, corpus(name), folder / name / "work")
        if args.keep and name != "render" and "error" not in row["corpus"]:
            shutil.copytree(small, corpus(name), dirs_exist_ok=True)
            for old in corpus(name).iterdir():
                if not (small / old.name).exists():
                    old.unlink()
        kept = row["corpus"]
        print(f"{name}: {row['executions']} executions in {row['cpu_seconds']} CPU seconds, "
              f"{row['edges']} edges; {kept.get('lines_run')} of {kept.get('lines')} lines by "
              f"{kept.get('inputs')} inputs ({kept.get('bytes')} bytes); "
              f"{len(row['findings'])} findings")  # fmt: skip
        for finding in row["findings"]:
            print(f"  {finding['key']}: {finding['text']}")
    if args.output:
        write(result, args.output)
    if not args.folder:
        shutil.rmtree(folder, ignore_errors=True)
    return 1 if any(row["findings"] for row in result["formats"].values()) else 0


if __name__ == "__main__":
    sys.exit(main())
