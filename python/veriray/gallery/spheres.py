"""The scene of 300 random spheres (figure 6 of the report), as a Mitsuba file, from a seed."""

from __future__ import annotations

import random
from pathlib import Path

from ..files import replacing
from .own import MARK

COUNT = 300
_WIDE, _DEEP, _HIGH = 7.0, 5.5, 4.2  # half width, half depth, height
_HUES = (  # reflectances, linear RGB
    (0.70, 0.10, 0.07), (0.78, 0.34, 0.05), (0.76, 0.58, 0.10), (0.22, 0.48, 0.12),
    (0.05, 0.40, 0.38), (0.07, 0.22, 0.60), (0.34, 0.14, 0.55), (0.72, 0.70, 0.66),
)  # fmt: skip
_LIGHTS = ((1.0, 0.48, 0.13), (0.25, 0.52, 1.0), (1.0, 0.16, 0.30), (0.30, 0.90, 0.35))

_HEAD = """<?xml version="1.0" encoding="utf-8"?>
<!-- {count} random spheres that do not touch, diffuse, one in six a lamp; seed {seed};
     {mark}. -->
<scene version="3.0.0">
    <default name="spp" value="1024"/>
    <default name="width" value="1280"/>
    <default name="height" value="720"/>
    <default name="max_depth" value="40"/>
    <default name="rr_depth" value="8"/>

    <integrator type="path">
        <integer name="max_depth" value="$max_depth"/>
        <integer name="rr_depth" value="$rr_depth"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="42"/>
        <transform name="to_world">
            <lookat origin="0, 4.6, -15" target="0, 1.75, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <rfilter type="gaussian"/>
        </film>
        <sampler type="independent">
            <integer name="sample_count" value="$spp"/>
        </sampler>
    </sensor>

    <emitter type="constant">
        <rgb name="radiance" value="0.30, 0.33, 0.40"/>
    </emitter>
    <shape type="rectangle" id="floor">
        <transform name="to_world">
            <scale value="200"/>
            <rotate x="1" angle="-90"/>
        </transform>
        <bsdf type="diffuse">
            <rgb name="reflectance" value="0.42, 0.42, 0.44"/>
        </bsdf>
    </shape>
"""
_SPHERE = """
    <shape type="sphere" id="sphere_{k}">
        <point name="center" x="{x:.4f}" y="{y:.4f}" z="{z:.4f}"/>
        <float name="radius" value="{r:.4f}"/>
        <bsdf type="diffuse">
            <rgb name="reflectance" value="{colour}"/>
        </bsdf>{emitter}
    </shape>
"""
_EMITTER = """
        <emitter type="area">
            <rgb name="radiance" value="{}"/>
        </emitter>"""


def place(count: int, seed: int) -> list[tuple[float, float, float, float]]:
    """(x, y, z, radius) of `count` spheres above y = 0, at least 0.02 apart and off the floor.

    Large ones come first; a quarter of all lie on the floor. The same on every machine.
    """
    draw = random.Random(seed).random
    found: list[tuple[float, float, float, float]] = []
    while len(found) < count:
        left = 1 - len(found) / count
        r = 0.16 + 0.5 * left * left * left * (0.6 + 0.4 * draw())
        x, z = (2 * draw() - 1) * _WIDE, (2 * draw() - 1) * _DEEP
        y = r + 0.01 if draw() < 0.25 else r + 0.02 + draw() * draw() * _HIGH
        here = (x, y, z, r)
        if all(_gap_squared(here, there) > 0 for there in found):
            found.append(here)
    return found


def _gap_squared(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Positive if two spheres are more than 0.02 apart."""
    x, y, z, reach = a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] + b[3] + 0.02
    return x * x + y * y + z * z - reach * reach


def scene_text(count: int = COUNT, seed: int = 2016) -> str:
    """The scene file: `count` diffuse spheres, every sixth with an emission, over a grey floor."""
    draw = random.Random(seed + 1).random
    parts = [_HEAD.format(count=count, seed=seed, mark=MARK)]
    for k, (x, y, z, r) in enumerate(place(count, seed)):
        colour = _HUES[int(draw() * len(_HUES))]
        tint, power = _LIGHTS[int(draw() * len(_LIGHTS))], 1.2 + 1.2 * draw()
        lit = k % 6 == 5
        if lit:
            colour = (0.1, 0.1, 0.1)
        emitter = ", ".join(f"{power * c:.3f}" for c in tint)
        parts.append(
            _SPHERE.format(
                k=k, x=x, y=y, z=z, r=r, colour=", ".join(f"{c:g}" for c in colour),
                emitter=_EMITTER.format(emitter) if lit else "",
            )
        )  # fmt: skip
    return "".join([*parts, "</scene>\n"])


def write(path: Path, count: int = COUNT, seed: int = 2016) -> None:
    """Writes the scene file; it appears whole or not at all."""
    with replacing(path) as file:
        file.write(scene_text(count, seed).encode())
