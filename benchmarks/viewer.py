"""How fast the viewer answers, at 1280 x 720, as a browser on the same machine sees it.

For each scene, through the socket of `veriray view`:
- first picture: from a drag that begins at rest until the first picture that shows it has arrived;
- while moving: 60 drags a second for some seconds; pictures a second that came and that were
  rendered (made), and their resolution;
- back: from the last drag to the first picture in full resolution;
- the steps of the first pictures and of those while moving, in ms, median and most: the render
  thread is free (taken), the scene is on the device, its samples are drawn, the picture is on the
  host, its turn to be sent comes (queue), facts, tones and file are made; wire: the socket, both
  ways. The next picture is drawn meanwhile: from "queue" on other threads work.
The scenes: the Cornell box, bumpy balls of 81,920 and (--large) 1,310,720 triangles under a sky,
the textured room of `veriray gallery`. Targets on a GPU: 100 ms, and 20 pictures a second; on two
CPU cores 5 a second. What the browser takes to show a picture is not in it.

    python benchmarks/viewer.py --device cuda:0 --large -o benchmarks/results/viewer_cuda.json
"""

from __future__ import annotations

import asyncio
import json
import os
import statistics
import struct
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from common import header, parser, write
from websockets.sync.client import connect

import veriray as vr
from veriray.gallery import pictures
from veriray.viewer.controls import View
from veriray.viewer.renderer import Renderer
from veriray.viewer.server import Door, Server
from veriray.viewer.source import Source

WIDTH, HEIGHT = 1280, 720


class Given(Source):
    """A scene that is no file."""

    def __init__(self, scene: vr.Scene) -> None:
        super().__init__("scene.xml")
        self.scene = scene

    def load(self) -> vr.Scene:
        """The scene."""
        return self.scene


def ball(fine: int) -> vr.Scene:
    """A ball of 20 * 4^fine triangles with bumps, on a floor under a sky."""
    mesh = trimesh.creation.icosphere(subdivisions=fine)
    mesh.vertices *= 1 + 0.03 * np.sin(9 * mesh.vertices).prod(axis=1, keepdims=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "ball.ply"
        mesh.export(file)
        look = vr.Camera.look_at([0, 1.2, -4], [0, 0, 0], fov=40).to_world
        return vr.load_dict({
            "type": "scene", "sky": {"type": "constant"},
            "sensor": {"type": "perspective", "fov": 40.0, "to_world": look},
            "ball": {"type": "ply", "filename": str(file), "bsdf": {"type": "diffuse"}},
            "floor": {"type": "sphere", "center": [0.0, -101.0, 0.0], "radius": 100.0},
        })  # fmt: skip


def scenes(large: bool) -> Iterator[tuple[str, Callable[[], vr.Scene]]]:
    """Names and what makes them."""
    yield "cornell-box", vr.cornell_box
    yield "mesh, 82k triangles", lambda: ball(6)
    if large:
        yield "mesh, 1.3M triangles", lambda: ball(8)

    def room() -> vr.Scene:
        with tempfile.TemporaryDirectory() as folder:
            return pictures.load("daylight", Path(folder))

    yield "textured room", room


@contextmanager
def serving(renderer: Renderer) -> Iterator[int]:
    """A server on a free port, with its loop on a thread."""
    server, loop = Server(renderer, Door(), "scene.xml"), asyncio.new_event_loop()
    stop, ready, ports = asyncio.Event(), threading.Event(), []

    async def serve() -> None:
        async with server.listening("127.0.0.1", 0) as port:
            ports.append(port)
            ready.set()
            await stop.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    ready.wait()
    try:
        yield ports[0]
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join()


class Browser:
    """Takes pictures on a thread, as a browser does, and notes when they came."""

    def __init__(self, port: int) -> None:
        self.socket = connect(
            f"ws://127.0.0.1:{port}/ws", max_size=None, max_queue=None, compression=None
        )
        self.pictures: list[tuple[float, dict[str, Any], int]] = []
        self.sent = [time.perf_counter()]  # when each change was
        self.closing = False
        threading.Thread(target=self._take, daemon=True).start()

    def _take(self) -> None:
        for message in self.socket:
            if isinstance(message, bytes) and not self.closing:
                at = time.perf_counter()
                (length,) = struct.unpack("<I", message[:4])
                self.pictures.append((at, json.loads(message[4 : 4 + length]), len(message)))
                self.socket.send('{"do":"ack"}')

    def orbit(self, x: float) -> None:
        """Sends a drag."""
        self.sent.append(time.perf_counter())
        self.socket.send(json.dumps({"do": "orbit", "x": x, "y": 0.0}))

    def steps(self, picture: tuple[float, dict[str, Any], int]) -> dict[str, float]:
        """Seconds of each step from the last drag that a picture shows until it came."""
        at, facts, _ = picture
        total = at - self.sent[facts["change"]]
        return facts["steps"] | {"wire": total - facts["age"], "total": total}

    def first(self, change: int, coarse: int = 99, spp: int = 1) -> Any:
        """The first picture that shows so many changes, at most so coarse, with so many samples."""
        place = 0
        while True:
            while place < len(self.pictures):
                facts = self.pictures[place][1]
                if facts["change"] >= change and facts["coarse"] <= coarse and facts["spp"] >= spp:
                    return self.pictures[place]
                place += 1
            time.sleep(0.0005)


def measured(scene: vr.Scene, device: str, rounds: int, seconds: float) -> dict[str, Any]:
    """Times in ms, and pictures a second."""
    view = View(width=WIDTH, height=HEIGHT, spp=1 << 20)
    renderer = Renderer(Given(scene), device, view=view)
    renderer.start()
    try:
        with serving(renderer) as port:
            browser = Browser(port)
            browser.first(0, 1, 2)
            firsts = []
            for k in range(rounds):
                time.sleep(0.7)
                browser.orbit(0.01 * (-1) ** k)
                firsts.append(browser.steps(browser.first(k + 1)))
            before, start, sent = len(browser.pictures), time.perf_counter(), 0
            while time.perf_counter() < start + seconds:
                browser.orbit(0.004 if sent % 120 < 60 else -0.004)
                sent += 1
                time.sleep(max(0.0, start + sent / 60 - time.perf_counter()))
            moving = browser.pictures[before:]
            back = browser.first(rounds + sent, 1)[0] - browser.sent[-1]
            browser.closing = True
            browser.socket.close()
    finally:
        renderer.stop()
    steps = [browser.steps(picture) for picture in moving]
    numbers = [facts["number"] for _, facts, _ in moving]
    return {
        "triangles": len(scene.triangles),
        "first_ms_median": in_ms(firsts)["total"][0],
        "first_ms_most": in_ms(firsts)["total"][1],
        "first_steps_ms": in_ms(firsts),
        "moving_per_second": len(moving) / seconds,
        "moving_made_per_second": (numbers[-1] - numbers[0]) / (moving[-1][0] - moving[0][0]),
        "moving_widths": sorted({facts["width"] for _, facts, _ in moving}),
        "moving_width_median": statistics.median(facts["width"] for _, facts, _ in moving),
        "moving_steps_ms": in_ms(steps),
        "moving_bytes_median": statistics.median(size for _, _, size in moving),
        "back_ms": 1e3 * back,
        "load_average": os.getloadavg()[0],
        "rounds": rounds,
        "seconds": seconds,
    }


def in_ms(pictures: list[dict[str, float]]) -> dict[str, tuple[float, float]]:
    """Median and most of each step."""
    times = {name: [1e3 * steps[name] for steps in pictures] for name in pictures[0]}
    return {name: (statistics.median(ms), max(ms)) for name, ms in times.items()}


def main() -> None:
    """Writes and prints the result."""
    p = parser(__doc__, "viewer.json")
    p.add_argument("--device", default="auto")
    p.add_argument("--large", action="store_true", help="the mesh of 1.3M triangles too")
    p.add_argument("--rounds", type=int, default=12)
    p.add_argument("--seconds", type=float, default=5.0)
    given = p.parse_args()
    result = header("viewer", "websockets", "pillow") | {"device": given.device, "scenes": {}}
    for name, make in scenes(given.large):
        row = measured(make(), given.device, given.rounds, given.seconds)
        result["scenes"][name] = row
        print(
            f"{name:22} first {row['first_ms_median']:6.0f} ms (most {row['first_ms_most']:.0f})  "
            f"moving {row['moving_per_second']:5.1f}/s of {row['moving_made_per_second']:.1f} made "
            f"at {row['moving_width_median']:.0f} wide  back {row['back_ms']:.0f} ms"
        )
        for part in ("first", "moving"):
            steps = row[f"{part}_steps_ms"].items()
            print(f"  {part:6}", *(f"{step} {ms:.0f} ({most:.0f})" for step, (ms, most) in steps))
    write(result, given.output)


if __name__ == "__main__":
    main()
