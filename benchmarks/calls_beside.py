"""Wall time of public calls, until the picture is in NumPy, with Mitsuba beside it.

    python benchmarks/calls_beside.py --device cuda:0 --peer cuda_ad_rgb
    python benchmarks/calls_beside.py --device cpu --peer llvm_ad_rgb --triangles 81920 --rounds 3

The Cornell box at 1 sample (256 x 256, 1024 x 1024, 1920 x 1080) and 64 samples (1024 x 1024); a
mesh under an even sky, 512 x 512 and 1 sample, with the same camera, a camera that moves each
time, and a colour that changes each time; scenes of the gallery, 256 x 256 and 64 samples. Both
renderers read the same files and take turns in one process; medians of --rounds rounds after two to
warm up.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from common import MITSUBA_BOX, header, parser, write
from loading import WRITERS, mesh

import veriray as vr
from veriray.gallery import pictures
from veriray_bench.mitsuba import start

BOX = ((256, 256, 1), (1024, 1024, 1), (1920, 1080, 1), (1024, 1024, 64))
GALLERY = ("room", "studio", "subsurface-16")
Call = Callable[[int], Any]  # a picture of round k
#: A mesh under an even sky.
MESH = """<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="6"/></integrator>
<sensor type="perspective" id="view">
  <float name="fov" value="40"/>
  <transform name="to_world"><lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
  <sampler type="independent"><integer name="sample_count" value="1"/></sampler>
  <film type="hdrfilm">
    <integer name="width" value="512"/><integer name="height" value="512"/><rfilter type="box"/>
  </film>
</sensor>
<emitter type="constant"/>
<shape type="ply" id="ball">
  <string name="filename" value="ball.ply"/><boolean name="face_normals" value="true"/>
  <bsdf type="diffuse" id="paint"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf>
</shape>
</scene>
"""


def place(k: int) -> list[float]:
    """Where the camera is in round k: on a circle about the mesh."""
    return [4 * math.sin(0.01 * k), 1, 4 * math.cos(0.01 * k)]


class Pair:
    """The calls of both renderers for one scene file."""

    def __init__(self, mi: Any, device: str, path: Path, spp: int, **names: str) -> None:
        self.mi, self.device, self.spp = mi, device, spp
        self.ours = vr.load_file(path, parameters=names)
        self.theirs = mi.load_file(str(path), **names)
        self.handles = mi.traverse(self.theirs)
        self.paint = next((n for n in self.ours.parameters() if n.endswith("reflectance")), "")
        self.their_paint = next(
            (str(k) for k in self.handles.keys() if str(k).endswith("reflectance.value")), ""
        )

    def same(self) -> tuple[Call, Call]:
        """The same scene each time."""
        return self._ours, self._theirs

    def moved(self) -> tuple[Call, Call]:
        """Another camera each time."""

        def ours(k: int) -> Any:
            camera = vr.Camera.look_at(place(k), [0, 0, 0], fov=40)
            return self._render(self.ours.with_(camera=camera), k)

        def theirs(k: int) -> Any:
            to_world = self.mi.ScalarTransform4f().look_at(place(k), [0, 0, 0], [0, 1, 0])
            self.handles["view.to_world"] = to_world
            self.handles.update()
            return self._theirs(k)

        return ours, theirs

    def coloured(self) -> tuple[Call, Call]:
        """Another reflectance each time."""

        def ours(k: int) -> Any:
            return self._render(self.ours.with_({self.paint: 0.3 + 0.001 * k}), k)

        def theirs(k: int) -> Any:
            self.handles[self.their_paint] = self.mi.Color3f(0.3 + 0.001 * k)
            self.handles.update()
            return self._theirs(k)

        return ours, theirs

    def _render(self, scene: vr.Scene, k: int) -> Any:
        return np.asarray(vr.render(scene, device=self.device, spp=self.spp, seed=k).image)

    def _ours(self, k: int) -> Any:
        return self._render(self.ours, k)

    def _theirs(self, k: int) -> Any:
        return np.array(self.mi.render(self.theirs, spp=self.spp, seed=k))


def measured(name: str, calls: tuple[Call, Call], rounds: int) -> dict[str, Any]:
    """Milliseconds of both, and the means of the pictures of the last round."""
    times: tuple[list[float], list[float]] = [], []
    means = [0.0, 0.0]
    for k in range(rounds + 2):
        for one, call in enumerate(calls):
            begin = time.perf_counter()
            picture = call(k)
            seconds = time.perf_counter() - begin
            means[one] = float(np.mean(picture[..., :3]))
            if k >= 2:
                times[one].append(1e3 * seconds)
    ours, theirs = map(median, times)
    print(f"{name:32s} {ours:9.2f} ms {theirs:9.2f} ms {theirs / ours:7.2f} x", flush=True)
    return {
        "what": name, "veriray_ms": ours, "mitsuba_ms": theirs, "ratio": theirs / ours,
        "means": means, "rounds_ms": times,
    }  # fmt: skip


def main() -> None:
    """Measures all rows and writes them."""
    p = parser(__doc__, "calls_beside.json")
    p.add_argument("--device", default="cuda:0")
    p.add_argument("--peer", default="cuda_ad_rgb", help="variant of Mitsuba")
    p.add_argument("--triangles", type=int, default=1_300_000)
    p.add_argument("--rounds", type=int, default=9)
    given = p.parse_args()
    mi = start(given.peer)
    rows = []
    print(f"{'':32s} {'veriray':>12s} {'Mitsuba':>12s}")
    for width, height, spp in BOX:
        pair = Pair(mi, given.device, MITSUBA_BOX, spp, width=str(width), height=str(height))
        name = f"Cornell box {width} x {height}, {spp} spp"
        rows.append(measured(name, pair.same(), given.rounds))
    with tempfile.TemporaryDirectory() as folder:
        WRITERS["ply"](Path(folder) / "ball.ply", *mesh(given.triangles))
        path = Path(folder) / "ball.xml"
        path.write_text(MESH)
        pair = Pair(mi, given.device, path, 1)
        for what, calls in (("same camera", pair.same()), ("camera moved", pair.moved()),
                            ("colour changed", pair.coloured())):  # fmt: skip
            name = f"{given.triangles} triangles, {what}"
            rows.append(measured(name, calls, given.rounds))
        for picture in pictures.select(GALLERY):
            pictures.load(picture.name, Path(folder))  # writes meshes and maps
            values = picture.values | {m: f"{folder}/{m}.ply" for m in picture.meshes}
            found = pictures.find(picture.file)
            assert found is not None
            pair = Pair(mi, given.device, found, 64, width="256", height="256", **values)
            rows.append(measured(f"gallery {picture.name}, 64 spp", pair.same(), given.rounds))
    result = {
        **header("calls beside Mitsuba", "mitsuba", "drjit"), "device": given.device,
        "peer": given.peer, "rows": rows,
    }  # fmt: skip
    write(result, given.output)


if __name__ == "__main__":
    main()
