"""Models how a render on a cluster (`veriray render --cluster`) scales, from measured parts.

    python benchmarks/cluster_model.py [--width 1920] [--height 1080] [-o FILE.json]

Measured on this machine, as medians: the bytes of a film's sums, the time to take them out of a
film, to add them to one, to join two states into one as a node does, and, if Ray is installed, the
time of a call of an actor. Modelled: a pass of `veriray.cluster.PASS` seconds, its last range, and
the joining of the films of N nodes, one by one on one machine ("flat") or in a tree of nodes
("tree", which is what `veriray.cluster` does), over a network of a stated speed for each node.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import veriray as vr
from veriray.cluster import LONGEST, PASS
from veriray.cluster_worker import Worker
from veriray.splitting import LEAST

NODES = (1, 2, 4, 8, 16, 32, 64)
NETWORKS = (1, 10, 25)  # Gbit/s


def seconds(call: Callable[[], object], times: int = 7) -> float:
    """The median time of a call."""
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        taken.append(time.perf_counter() - start)
    return statistics.median(taken)


def measured(width: int, height: int) -> dict[str, Any]:
    """The parts."""
    scene = vr.cornell_box()
    work = vr.Accumulation(scene, width=width, height=height, device="cpu", spp=2)
    work.add(1)
    film = work._crew.merged(work._kept.films)
    assert film is not None
    state = film.state()
    other = work.device.native.Film(width, height, device=0)
    other.add_state(state)
    node = Worker()
    parts = {
        "bytes": sum(plane["words"].nbytes for plane in state["planes"]),
        "out": seconds(film.state),
        "in": seconds(lambda: other.add_state(state)),
        "join": seconds(lambda: node.joined(state, state)),
    }
    return parts | {"call": call_seconds()}


def call_seconds() -> float | None:
    """The time of a call of an actor; None without Ray."""
    try:
        import ray
    except ModuleNotFoundError:
        return None

    class Echo:
        def say(self) -> int:
            return 1

    ray.init("local", num_cpus=1, include_dashboard=False, log_to_driver=False,
             object_store_memory=80 << 20, logging_level="error")  # fmt: skip
    actor = ray.remote(Echo).remote()
    ray.get(actor.say.remote())
    return seconds(lambda: ray.get(actor.say.remote()), 200)


def joining(parts: dict[str, Any], nodes: int, gbit: float, tree: bool) -> float:
    """Seconds from the last sample to one film on the machine that asked."""
    send = parts["bytes"] / (gbit * 1e9 / 8)
    if tree:
        levels = math.ceil(math.log2(nodes))
        return float(parts["out"] + levels * (send + parts["join"]) + send + parts["in"])
    return float(parts["out"] + nodes * (send + parts["in"]))


def share(parts: dict[str, Any], nodes: int, gbit: float, tree: bool) -> float:
    """Of the nodes' time, that in which all of them draw: a pass ends with a wait for the last
    range, of LEAST seconds, and each range waits for a call."""
    calls = (parts["call"] or 0.0) * PASS / LONGEST
    idle = LEAST + calls + joining(parts, nodes, gbit, tree)
    return PASS / (PASS + idle)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--width", type=int, default=1920)
    parser.add_argument("--height", type=int, default=1080)
    parser.add_argument("-o", "--output")
    arguments = parser.parse_args()
    parts = measured(arguments.width, arguments.height)
    call = "not measured" if parts["call"] is None else f"{parts['call'] * 1e3:.2f} ms"
    print(f"film of {arguments.width} x {arguments.height}: {parts['bytes'] / 1e6:.0f} MB of sums;")
    print(f"out {parts['out'] * 1e3:.0f} ms, in {parts['in'] * 1e3:.0f} ms, "
          f"join {parts['join'] * 1e3:.0f} ms; a call {call}\n")  # fmt: skip
    heads = [f"{kind}, {g} Gbit/s" for g in NETWORKS for kind in ("flat", "tree")]
    print(f"| nodes | {' | '.join(heads)} |\n| --: |{' --: |' * len(heads)}")
    rows = []
    for n in NODES:
        row = {"nodes": n}
        cells = []
        for gbit in NETWORKS:
            for tree in (False, True):
                speed = n * share(parts, n, gbit, tree)
                row[f"{'tree' if tree else 'flat'}_{gbit}"] = speed
                cells.append(f"{speed:.3g} ({joining(parts, n, gbit, tree):.2g} s)")
        rows.append(row)
        print(f"| {n} | {' | '.join(cells)} |")
    if arguments.output:
        with open(arguments.output, "w") as file:
            json.dump({"version": vr.__version__, "pass": PASS, "least": LEAST, "longest": LONGEST,
                       "width": arguments.width, "height": arguments.height, "parts": parts,
                       "speedups": rows}, file, indent=1)  # fmt: skip
            file.write("\n")


if __name__ == "__main__":
    main()
