"""The table of stress cases, from a validation's JSON."""

from __future__ import annotations

from veriray_validate.tables import stress_table


def row(name: str, device: str, verdict: str, title: str = "A scene.", level: int = 8):
    return {"id": name, "device": device, "verdict": verdict, "title": title, "level": level}


def test_one_row_a_line() -> None:
    name = "stress_geometry.grazing_view_of_a_floor"
    table = stress_table({
        "facts": {"commit": "0123456789"},
        "full": True, "veriray": "1", "devices": {"cpu:avx2": "a CPU", "cuda:0": "a GPU"},
        "cases": [
            row(f"{name}[0.001]", "cpu:avx2", "pass"), row(f"{name}[0.0001]", "cpu:avx2", "fail"),
            row(f"{name}[0.001]", "cuda:0", "pass"),
            row("another.level", "cuda:0", "fail", level=7),
            row("stress_x.y", "cuda:0", "skip", "No | number"),
        ],
    })  # fmt: skip
    lines = [line for line in table.splitlines() if line.startswith("| ")]
    assert len(lines) == 3
    assert lines[1].startswith(f"| `{name}` | A diffuse floor under a sky of 1 at cosines ")
    assert "Its albedo" in lines[1] and lines[1].endswith("| fail (1 of 2) | pass |")
    assert lines[2] == "| `stress_x.y` | No \\| number |  | - | skip |"
    assert "2 lines, 4 outcomes: 1 fail, 2 pass, 1 skip." in table
    assert "- cuda:0: a GPU, commit 0123456\n" in table
    assert " cases are not in these runs: `" in table and table.count(f"`{name}`") == 1
