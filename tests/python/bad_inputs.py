"""Writes bad_inputs.md: the command line's answers to bad input, each in a process of its own.

    python -m tests.python.bad_inputs        (from the repository root)

Fails if an answer has a traceback, is not a one-line error with status 2, or leaves a file behind.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.python.test_cli import BAD, RENDER
from veriray.shipped import find_shipped

SCENE_FILES = str(find_shipped("open").parent)
TABLE = Path(__file__).with_name("bad_inputs.md")
SENSOR = (
    '<sensor type="perspective"><float name="fov" value="40"/>'
    '<film type="hdrfilm"><integer name="width" value="8"/>'
    '<integer name="height" value="8"/></film></sensor>'
)
SKY = '<emitter type="constant"/>'
OBJ = '<shape type="obj"><string name="filename" value="{}"/><boolean name="face_normals" value="true"/></shape>'  # noqa: E501
#: Scene file -> its body inside <scene>.
SCENES = {
    "unknown plugin": SENSOR + SKY + '<shape type="spehre"/>',
    "unknown parameter": SENSOR + SKY + '<shape type="cube"><float name="radius" value="1"/></shape>',  # noqa: E501
    "wrong type": SENSOR + SKY + '<integrator type="path"><string name="max_depth" value="8"/></integrator>',  # noqa: E501
    "no sensor": SKY,
    "film without pixels": SENSOR.replace('name="width" value="8"', 'name="width" value="0"') + SKY,
    "field of view": SENSOR.replace('value="40"', 'value="180"') + SKY,
    "number that is none": SENSOR.replace('value="40"', 'value="wide"') + SKY,
    "NaN": SENSOR.replace('value="40"', 'value="nan"') + SKY,
    "reflectance above 1": SENSOR + SKY + '<shape type="cube"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 1.5, 0.5"/></bsdf></shape>',  # noqa: E501
    "plugin of Mitsuba": SENSOR + SKY + '<shape type="cube"><bsdf type="measured"/></shape>',
    "several faults": SKY + SENSOR.replace('value="40"', 'value="180"') + '<shape type="spehre"/><shape type="obj"/>',  # noqa: E501
    "negative scattering": SENSOR + SKY + '<medium type="homogeneous"><float name="sigma_s" value="-1"/><float name="sigma_a" value="1"/></medium>',  # noqa: E501
    "singular transform": SENSOR + SKY + '<shape type="cube"><transform name="to_world"><scale x="0" y="1" z="1"/></transform></shape>',  # noqa: E501
    "missing mesh": SENSOR + SKY + OBJ.format("none.obj"),
    "mesh with NaN vertex": SENSOR + SKY + OBJ.format("nan.obj"),
    "mesh with index out of range": SENSOR + SKY + OBJ.format("range.obj"),
    "metal by name": SENSOR + SKY + '<shape type="cube"><bsdf type="conductor"><string name="material" value="Xx"/></bsdf></shape>',  # noqa: E501
    "index by an unknown name": SENSOR + SKY + '<shape type="cube"><bsdf type="dielectric"><string name="int_ior" value="glass"/></bsdf></shape>',  # noqa: E501
    "medium with two parametrisations": SENSOR + SKY + '<medium type="homogeneous"><float name="sigma_t" value="1"/><float name="sigma_s" value="1"/></medium>',  # noqa: E501
    "asymmetry of 1": SENSOR + SKY + '<medium type="homogeneous"><phase type="hg"><float name="g" value="1"/></phase></medium>',  # noqa: E501
    "light in two places": SENSOR + '<emitter type="point"><point name="position" x="1"/><transform name="to_world"><translate x="1"/></transform></emitter>',  # noqa: E501
    "lens without focus": SENSOR.replace("perspective", "thinlens") + SKY,
    "undefined reference": SENSOR + SKY + '<shape type="cube"><ref id="gold"/></shape>',
    "undefined $name": SENSOR.replace('value="40"', 'value="$fov"') + SKY,
    "broken XML": SENSOR + "<shape",
    "include of itself": SENSOR + '<include filename="include of itself.xml"/>',
    "entity": SENSOR + SKY + "&secret;",
}  # fmt: skip


def prepare(folder: Path) -> None:
    """The files that the rows name."""
    (folder / "folder").mkdir()
    (folder / "folder.exr").mkdir()
    os.mkfifo(folder / "pipe.exr")
    (folder / "loop.exr").symlink_to("loop.exr")
    (folder / "empty.xml").touch()
    (folder / "nan.obj").write_text("v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "range.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    for name, body in SCENES.items():
        doctype = '<!DOCTYPE s [<!ENTITY secret "x">]>' if name == "entity" else ""
        text = f'{doctype}<scene version="3.0.0">\n{body}\n</scene>\n'
        (folder / f"{name}.xml").write_text(text)


def main() -> None:
    """Run every row and write the table."""
    rows = [arguments for arguments, _ in BAD]
    rows += [["render", f"{name}.xml", "-o", "a.exr"] for name in SCENES]
    rows += [[*RENDER, "-o", "/dev/full"], [*RENDER, "-o", "/proc/a.exr"]]
    lines = [
        f"# What the command line answers to bad input ({len(rows)} rows)",
        "",
        "Written by `python -m tests.python.bad_inputs`; each row ended with status 2, one line on",
        "standard error and no file left behind.",
        "",
        "| veriray ... | answer |",
        "|---|---|",
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        before = sorted(os.listdir(folder))
        for arguments in rows:
            done = subprocess.run(
                [sys.executable, "-m", "veriray", *arguments],
                cwd=folder, capture_output=True, text=True, timeout=300,
            )  # fmt: skip
            answer = done.stderr
            ok = done.returncode == 2 and answer.startswith("veriray: error: ")
            ok = ok and answer.count("\n") == 1 and "Traceback" not in answer
            assert ok and sorted(os.listdir(folder)) == before, (arguments, done)
            shown = " ".join(a if len(a) < 60 else a[:20] + "..." for a in arguments)
            cells = [
                c.replace("|", "\\|").replace(name, ".").replace(SCENE_FILES, "veriray/scenes")
                for c in (shown, answer.removeprefix("veriray: error: ").strip())
            ]
            lines.append(f"| `{cells[0]}` | {cells[1]} |")
    TABLE.write_text("\n".join(lines) + "\n")
    print(f"{len(rows)} rows: {TABLE.name}")


if __name__ == "__main__":
    main()
