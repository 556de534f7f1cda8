"""The scripts for the queue of a farm in docs/clusters.md, with a queue of our own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import veriray as vr

PAGE = Path(__file__).resolve().parents[2] / "docs/clusters.md"

#: Runs the tasks of an array, those in $AGAIN once more; a job without array runs after them.
SBATCH = """#!/bin/sh
set -eu
for script; do :; done
bounds=$(sed -n 's/^#SBATCH --array=0-//p' "$script")
if [ -n "$bounds" ]; then
  export SLURM_ARRAY_TASK_COUNT=$((bounds + 1))
  for k in $(seq "$bounds" -1 0) $AGAIN; do SLURM_ARRAY_TASK_ID=$k sh "$script" >&2; done
else
  sh "$script" >&2
fi
echo 17
"""


def test_slurm_scripts(tmp_path: Path) -> None:
    """Odd sizes of ranges, tasks in any order, one of them queued again."""
    text = PAGE.read_text("utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```", text[text.index("Plain commands") :], re.M | re.S)
    render, merge, submit = blocks
    tools = tmp_path / "bin"
    tools.mkdir()
    for name, content in (
        ("sbatch", SBATCH),
        ("veriray", f'#!/bin/sh\nexec "{sys.executable}" -m veriray "$@"\n'),
    ):
        (tools / name).write_text(content)
        (tools / name).chmod(0o755)
    size = "--width 24 --height 18 --device cpu"
    (tmp_path / "render.sh").write_text(
        render.replace("--quiet", f"--quiet {size}").replace("0-7", "0-3")
    )
    (tmp_path / "merge.sh").write_text(merge)
    assert "SPP=8192" in submit and "--array=0-7" in render
    (tmp_path / "submit.sh").write_text(
        submit.replace("SPP=8192", "SPP=120").replace("scene.xml", "cornell-box")
    )
    environment = {**os.environ, "PATH": f"{tools}:{os.environ['PATH']}", "AGAIN": "2"}
    subprocess.run(["sh", "-eu", "submit.sh"], cwd=tmp_path, env=environment, check=True)
    assert len([*tmp_path.glob("part-*.film")]) == 4
    right = vr.render(vr.cornell_box(), 120, width=24, height=18, device="cpu").film_sha256
    assert vr.Render.load(tmp_path / "out.exr").film_sha256 == right
