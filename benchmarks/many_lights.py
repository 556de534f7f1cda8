"""Scenes of several lights: wall time, variance and efficiency; with --mitsuba also Mitsuba's.

Scenes are made by rule and given to both renderers as one XML file. wall: seconds of the public
call until the picture is in NumPy, median of --rounds. variance: of a sample, relative to the
square of the pixel's mean, from pictures of different seeds; mean over the pixels in which no light
is seen. efficiency: 1 / (seconds for a sample x variance). With --mitsuba a variant
(llvm_ad_rgb, scalar_rgb, cuda_ad_rgb), in turn with ours; the ratios are ours over theirs.
Only the public interface is used.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from common import Array, header, parser, write

import veriray

Render = Callable[[int, int], Array]
SIZE = 128


def tag(kind: str, name: str, value: Any) -> str:
    """An XML element with a value."""
    if kind in ("rgb",):
        value = ", ".join(f"{v:.9g}" for v in value)
    return f'<{kind} name="{name}" value="{value}"/>'


def lamp_body(radiance: Any) -> str:
    """What makes a shape a black lamp."""
    return (f'<bsdf type="diffuse">{tag("rgb", "reflectance", (0, 0, 0))}</bsdf>'
            f'<emitter type="area">{tag("rgb", "radiance", radiance)}</emitter>')  # fmt: skip


def ball(p: Any, r: float, radiance: Any) -> str:
    """A sphere lamp."""
    x, y, z = p
    return (f'<shape type="sphere"><point name="center" x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>'
            f'{tag("float", "radius", r)}{lamp_body(radiance)}</shape>')  # fmt: skip


def plane(half: float, turn: str = "", body: str = "", up: float = 0.0) -> str:
    """A square of side 2 half in z = up that looks up, or is turned; grey unless body says."""
    body = body or f'<bsdf type="diffuse">{tag("rgb", "reflectance", (0.5, 0.5, 0.5))}</bsdf>'
    return (f'<shape type="rectangle"><transform name="to_world"><scale value="{half}"/>{turn}'
            f'<translate z="{up}"/></transform>{body}</shape>')  # fmt: skip


def point(p: Any, intensity: float) -> str:
    """A point light."""
    x, y, z = p
    return (f'<emitter type="point"><point name="position" x="{x}" y="{y}" z="{z}"/>'
            f'{tag("rgb", "intensity", (intensity,) * 3)}</emitter>')  # fmt: skip


def three_lights(folder: Path) -> tuple[str, str]:
    """A point, a spot and a sun over a wide floor."""
    spot = ('<emitter type="spot"><transform name="to_world"><lookat origin="2, 2, 3" '
            'target="2.5, 2, 0" up="0, 1, 0"/></transform>'
            f'{tag("rgb", "intensity", (20,) * 3)}{tag("float", "cutoff_angle", 25)}'
            "</emitter>")  # fmt: skip
    sun = ('<emitter type="directional"><vector name="direction" x="0.3" y="0.2" z="-1"/>'
           f'{tag("rgb", "irradiance", (1,) * 3)}</emitter>')  # fmt: skip
    return plane(50) + point((-2, -1, 2), 8) + spot + sun, "0, -12, 6"


def lamps(n: int, side: float, seed: int, radius: float) -> str:
    """N sphere lamps of various powers over a square."""
    rng = np.random.default_rng(seed)
    k = int(np.ceil(np.sqrt(n)))
    parts = []
    for i in range(n):
        x, y = ((np.array([i % k, i // k]) + rng.random(2)) / k - 0.5) * 2 * side
        parts.append(ball((x, y, rng.uniform(0.3, 1.5)), radius,
                          rng.uniform(0.2, 1, 3) * 10 ** rng.uniform(0, 1.5)))  # fmt: skip
    return "".join(parts)


def hundred_lamps(folder: Path) -> tuple[str, str]:
    """100 small spheres over a floor, with some blockers."""
    return plane(10) + lamps(100, 8, 1, 0.05) + plane(1, '<rotate x="1" angle="60"/>', up=0.5), \
        "0, -14, 8"  # fmt: skip


def field(folder: Path) -> tuple[str, str]:
    """10,000 small spheres over a field."""
    return plane(110) + lamps(10_000, 100, 2, 0.05), "0, -60, 30"


def emissive_mesh(folder: Path) -> tuple[str, str]:
    """A lamp of 5,120 triangles, a bumpy ball, above a floor and beside a wall."""
    u, v = np.meshgrid(np.arange(80), np.arange(33))
    phi, theta = 2 * np.pi * u / 80, np.pi * (0.01 + 0.98 * v / 32)
    r = 0.8 * (1 + 0.2 * np.sin(5 * phi) * np.sin(4 * theta))
    at = r[..., None] * np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi),
                                  np.cos(theta)], axis=-1)  # fmt: skip
    lines = [f"v {x:.6f} {y:.6f} {z + 1.2:.6f}" for x, y, z in at.reshape(-1, 3)]
    for j in range(32):
        for i in range(80):
            a, b = 80 * j + i + 1, 80 * j + (i + 1) % 80 + 1
            lines += [f"f {a} {a + 80} {b + 80}", f"f {a} {b + 80} {b}"]
    path = folder / "lamp.obj"
    path.write_text("\n".join(lines) + "\n")
    mesh = (f'<shape type="obj">{tag("string", "filename", path)}'
            f'{tag("boolean", "face_normals", "true")}{lamp_body((3, 3, 3))}</shape>')  # fmt: skip
    wall = plane(6, '<rotate x="1" angle="90"/><translate y="2"/>')
    return plane(6) + wall + mesh, "0, -7, 3"


def room(folder: Path) -> tuple[str, str]:
    """A closed room with 12 panels below its ceiling and a lamp on the floor."""
    walls = plane(4) + plane(4, '<rotate x="1" angle="180"/>', up=4)
    for turn in ('<rotate x="1" angle="90"/><translate y="4"/>',
                 '<rotate x="1" angle="-90"/><translate y="-4"/>',
                 '<rotate y="1" angle="90"/><translate x="-4"/>',
                 '<rotate y="1" angle="-90"/><translate x="4"/>'):  # fmt: skip
        walls += plane(4, turn)
    for k in range(12):
        walls += plane(0.2, f'<rotate x="1" angle="180"/><translate x="{k % 4 * 2 - 3}" '
                       f'y="{k // 4 * 2 - 2}"/>', lamp_body((4 + k,) * 3), 3.95)  # fmt: skip
    return walls + ball((2, 1, 0.4), 0.2, (5, 4, 3)), "0, -3.8, 2"


SCENES = {"three_lights": three_lights, "hundred_lamps": hundred_lamps, "field": field,
          "emissive_mesh": emissive_mesh, "room": room}  # fmt: skip


def scene_file(name: str, folder: Path) -> Path:
    """The scene as XML, with what it refers to."""
    body, origin = SCENES[name](folder)
    path = folder / f"{name}.xml"
    path.write_text(
        '<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="3"/>'
        '</integrator><sensor type="perspective"><float name="fov" value="50"/>'
        f'<transform name="to_world"><lookat origin="{origin}" target="0, 0, 0.5" up="0, 0, 1"/>'
        f'</transform><film type="hdrfilm"><integer name="width" value="{SIZE}"/>'
        f'<integer name="height" value="{SIZE}"/><rfilter type="box"/></film>'
        f'<sampler type="independent"/></sensor>{body}</scene>'
    )
    return path


def measure(renders: list[Render], used: Array, spp: int, rounds: int) -> list[dict[str, float]]:
    """Of each renderer, over the pixels `used`: wall, variance, efficiency, mean."""
    times: list[list[float]] = [[] for _ in renders]
    pictures: list[list[Array]] = [[] for _ in renders]
    for render in renders:
        render(1, 0)
    for k in range(rounds):
        for i, render in enumerate(renders):
            begin = time.perf_counter()
            image = render(spp, 1 + k)
            times[i].append(time.perf_counter() - begin)
            pictures[i].append(image.astype(np.float64)[used].mean(axis=-1))
    level = np.mean([np.mean(p, axis=0) for p in pictures], axis=0)
    lit = level > 0
    out = []
    for own, seconds in zip(pictures, times, strict=True):
        squares = np.var(np.stack(own), axis=0, ddof=1)
        variance = float((squares[lit] / level[lit] ** 2).mean()) * spp
        wall = float(np.median(seconds))
        out.append({"wall": wall, "variance": variance, "efficiency": spp / (wall * variance),
                    "mean": float(np.mean(own))})  # fmt: skip
    return out


def _ours(path: Path, device: str) -> Any:
    scene = veriray.load_file(path)

    def render(spp: int, seed: int, **more: Any) -> Array:
        return veriray.render(scene, spp=spp, seed=seed, device=device, **more).image

    return render


def _theirs(mi: Any, path: Path) -> Render:
    scene = mi.load_file(str(path))

    def render(spp: int, seed: int) -> Array:
        return np.array(mi.render(scene, spp=spp, seed=seed))[..., :3]

    return render


def main() -> None:
    """Prints lines by scene and writes JSON."""
    p = parser(__doc__, "many_lights.json")
    p.add_argument("--device", default="auto")
    p.add_argument("--scenes", nargs="*", default=list(SCENES), choices=SCENES)
    p.add_argument("--spp", type=int, default=64)
    p.add_argument("--rounds", type=int, default=4)
    p.add_argument("--mitsuba", help="variant")
    args = p.parse_args()
    mi: Any = None
    if args.mitsuba:
        from mitsuba_peer import start

        mi = start(args.mitsuba)
    result = header("many_lights")
    result["scenes"] = {}
    for name in args.scenes:
        with tempfile.TemporaryDirectory() as folder:
            path = scene_file(name, Path(folder))
            seen = _ours(path, args.device)(256, 0, max_depth=1)
            renders: list[Render] = [_ours(path, args.device)]
            if mi:
                renders.append(_theirs(mi, path))
            rows = measure(renders, ~seen.any(axis=-1), args.spp, args.rounds)
        result["scenes"][name] = rows
        for who, row in zip(("veriray", "mitsuba"), rows, strict=False):
            print(f"{name:14} {who:8} wall {row['wall']:8.3f} s  variance {row['variance']:9.4g}  "
                  f"efficiency {row['efficiency']:9.4g}  mean {row['mean']:.6g}",
                  flush=True)  # fmt: skip
        if mi:
            print(f"{name:14} ratio    variance {rows[0]['variance'] / rows[1]['variance']:.3f}  "
                  f"efficiency {rows[0]['efficiency'] / rows[1]['efficiency']:.3f}",
                  flush=True)  # fmt: skip
    write(result, args.output)


if __name__ == "__main__":
    main()
