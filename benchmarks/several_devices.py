"""How much faster several devices are together than the first of them alone.

Rounds of `veriray.render` in alternation: each device alone, then all. `ratio` is the time of
the first alone over that of all, `of_sum` the rate of all over the sum of the rates of each alone.
The film's SHA-256 must be the same every time:

python benchmarks/several_devices.py --devices cuda:0,cuda:1
"""

from __future__ import annotations

import time

import numpy as np
from common import ROOT, header, parser, write
from moves import mesh_scene

import veriray as vr


def wall(scene: vr.Scene, spp: int, device: str) -> tuple[float, str]:
    """Seconds until the picture is in NumPy, and the film's SHA-256."""
    start = time.perf_counter()
    made = vr.render(scene, spp, device=device)
    np.asarray(made)
    return time.perf_counter() - start, made.film_sha256


def race(scene: vr.Scene, devices: list[str], seconds: float, rounds: int) -> dict[str, object]:
    """Median seconds of each alone and of all, and the ratios."""
    entries = [*devices, ",".join(devices)]
    for entry in entries:  # trees, kernels and memory
        wall(scene, 8, entry)
    trial = 64
    spp = max(1, round(trial * seconds / wall(scene, trial, devices[0])[0]))
    times: dict[str, list[float]] = {entry: [] for entry in entries}
    films = set()
    for _ in range(rounds):
        for entry in entries:
            t, film = wall(scene, spp, entry)
            times[entry].append(t)
            films.add(film)
    median = {entry: float(np.median(t)) for entry, t in times.items()}
    together = median[entries[-1]]
    alone = [median[device] for device in devices]
    return {
        "spp": spp, "seconds": times, "film_sha256": sorted(films),
        "same_film": len(films) == 1, "ratio": alone[0] / together,
        "of_sum": 1 / together / sum(1 / t for t in alone),
    }  # fmt: skip


def main() -> None:
    """Races every scene and writes the result."""
    p = parser(__doc__, "several_devices.json")
    p.add_argument("--devices", default="cuda:0,cuda:1")
    p.add_argument("--seconds", type=float, default=4.0, help="of a render on the first device")
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--fine", type=int, default=7, help="the mesh has 8 * 4^FINE triangles")
    given = p.parse_args()
    devices = given.devices.split(",")
    scenes = {
        "cornell-box": vr.load_file("cornell-box-mitsuba").with_(width=1024, height=1024),
        "mesh": mesh_scene(given.fine).with_(width=1024, height=1024),
        "medium": vr.load_file(ROOT / "scenes/checks/medium_in_glass.xml").with_(
            width=1024, height=1024
        ),
    }
    result = header("several_devices")
    result["devices"] = {d.name: d.description for d in vr.devices()}
    result["settings"] = {k: v for k, v in vars(given).items() if k != "output"}
    result["scenes"] = {}
    for name, scene in scenes.items():
        row = result["scenes"][name] = race(scene, devices, given.seconds, given.rounds)
        print(f"{name}: {row['ratio']:.3f}, {row['of_sum']:.3f} of the sum; "
              f"{'one film' if row['same_film'] else 'FILMS DIFFER'}")  # fmt: skip
    write(result, given.output)


if __name__ == "__main__":
    main()
