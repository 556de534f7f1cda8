"""The pieces of which the matrix's scene files are made: text that veriray and Mitsuba 3 read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from veriray_validate.leaks import icosphere

from .scenarios import write_ply

Three = tuple[float, float, float]


def text(*values: float) -> str:
    """Numbers with commas between."""
    return ", ".join(f"{float(v):.7g}" for v in values)


def rgb(name: str, *value: float) -> str:
    """A colour of one or three numbers."""
    return f'<rgb name="{name}" value="{text(*value)}"/>'


def number(name: str, value: float) -> str:
    """A float."""
    return f'<float name="{name}" value="{float(value):.7g}"/>'


def flag(name: str, value: bool = True) -> str:
    """A boolean."""
    return f'<boolean name="{name}" value="{str(value).lower()}"/>'


def string(name: str, value: str) -> str:
    """A string."""
    return f'<string name="{name}" value="{value}"/>'


def point(name: str, at: Three) -> str:
    """A point."""
    return f'<point name="{name}" value="{text(*at)}"/>'


def plugin(tag: str, kind: str, *inside: str, name: str = "") -> str:
    """An element such as <bsdf type="...">."""
    named = f' name="{name}"' if name else ""
    return f'<{tag} type="{kind}"{named}>' + "".join(inside) + f"</{tag}>"


def to_world(*steps: str) -> str:
    """A transform of steps, the first applied first."""
    return '<transform name="to_world">' + "".join(steps) + "</transform>"


def scale(*by: float) -> str:
    """By one factor, or by three."""
    return f'<scale value="{text(*by)}"/>'


def turn(axis: str, degrees: float) -> str:
    """Around an axis."""
    return f'<rotate {axis}="1" angle="{float(degrees):.7g}"/>'


def move(*by: float) -> str:
    """By a vector."""
    return f'<translate value="{text(*by)}"/>'


def look(origin: Three, target: Three) -> str:
    """From a place to another, y upwards."""
    return f'<lookat origin="{text(*origin)}" target="{text(*target)}" up="0, 1, 0"/>'


def camera(origin: Three, target: Three, fov: float, *more: str, kind: str = "perspective") -> str:
    """A sensor whose film has the parameters width and height."""
    film = plugin(
        "film", "hdrfilm", '<integer name="width" value="$width"/>',
        '<integer name="height" value="$height"/>', '<rfilter type="box"/>',
    )  # fmt: skip
    return plugin(
        "sensor", kind, number("fov", fov), *more, to_world(look(origin, target)), film,
        '<sampler type="independent"/>',
    )  # fmt: skip


def scene(body: str, integrator: str) -> str:
    """A whole file with the parameters width, height, max_depth and rr_depth."""
    defaults = {"width": 128, "height": 128, "max_depth": 8, "rr_depth": 5}
    depths = ('<integer name="max_depth" value="$max_depth"/>',
              '<integer name="rr_depth" value="$rr_depth"/>')  # fmt: skip
    return "\n".join((
        '<scene version="3.0.0">',
        *(f'<default name="{k}" value="{v}"/>' for k, v in defaults.items()),
        plugin("integrator", integrator, *depths),
        body.replace("><shape", ">\n<shape").replace("><emitter", ">\n<emitter"),
        "</scene>\n",
    ))  # fmt: skip


# ---- shapes and lights ----


def diffuse(colour: Three) -> str:
    """A matt surface."""
    return plugin("bsdf", "diffuse", rgb("reflectance", *colour))


def rectangle(size: tuple[float, float], steps: tuple[str, ...], *inside: str) -> str:
    """A rectangle of half sizes that faces +z before the steps."""
    return plugin("shape", "rectangle", to_world(scale(*size, 1), *steps), *inside)


def floor(half: float, *inside: str, y: float = 0) -> str:
    """A square that faces upwards."""
    return rectangle((half, half), (turn("x", -90), move(0, y, 0)), *inside)


def lamp(size: tuple[float, float], at: Three, radiance: Three) -> str:
    """A black rectangle that shines downwards."""
    shine = plugin("emitter", "area", rgb("radiance", *radiance))
    return rectangle(size, (turn("x", 90), move(*at)), diffuse((0, 0, 0)), shine)


def ball(at: Three, radius: float, *inside: str) -> str:
    """A sphere."""
    return plugin("shape", "sphere", point("center", at), number("radius", radius), *inside)


def bulb(at: Three, radius: float, radiance: Three) -> str:
    """A black sphere that shines."""
    shine = plugin("emitter", "area", rgb("radiance", *radiance))
    return ball(at, radius, diffuse((0, 0, 0)), shine)


def box(half: Three, degrees: float, at: Three, *inside: str) -> str:
    """A box of half sizes, turned around y."""
    return plugin("shape", "cube", to_world(scale(*half), turn("y", degrees), move(*at)), *inside)


def sky(radiance: Three) -> str:
    """The same light from everywhere."""
    return plugin("emitter", "constant", rgb("radiance", *radiance))


def image_sky(file: str) -> str:
    """Light by an image."""
    return plugin("emitter", "envmap", string("filename", file))


def board(name: str, a: Three, b: Three, times: float) -> str:
    """A checkerboard in place of a colour."""
    to_uv = f'<transform name="to_uv">{scale(times, times, 1)}</transform>'
    colours = rgb("color0", *a) + rgb("color1", *b)
    return f'<texture type="checkerboard" name="{name}">{colours}{to_uv}</texture>'


def bitmap(name: str, file: str) -> str:
    """An image in place of a colour."""
    return f'<texture type="bitmap" name="{name}">{string("filename", file)}</texture>'


def mesh(file: str, smooth: bool, *inside: str) -> str:
    """A PLY file."""
    return plugin(
        "shape", "ply", string("filename", file), flag("face_normals", not smooth), *inside
    )


# ---- files ----


def write_blob(path: Path, rng: np.random.Generator, level: int, bumps: float, uv: bool) -> None:
    """A closed mesh of 20 * 4^level triangles around the origin: a sphere of radius 1 with waves
    along its radius, of amplitude `bumps` at most. uv: texture coordinates by x and y.
    """
    v, f = icosphere(level)
    k = rng.normal(0, 3.0, (6, 3))
    phase, size = rng.uniform(0, 2 * np.pi, 6), rng.uniform(0.5, 1, 6)
    waves = np.sin(v @ k.T + phase) @ (size / size.sum())
    v = v * (1 + bumps * waves)[:, None]
    write_ply(path, v, f, 0.5 + 0.4 * v[:, :2] if uv else None)


def write_noise(path: Path, rng: np.random.Generator, size: int) -> None:
    """A PNG file of size x size texels: coarse random colours with fine stripes."""
    from PIL import Image

    coarse = rng.uniform(0.15, 0.85, (8, 8, 3)).repeat(size // 8, 0).repeat(size // 8, 1)
    stripes = 0.1 * np.sin(np.arange(size) * rng.uniform(0.2, 0.6))
    texels = np.clip(255 * (coarse + stripes[:, None, None]), 0, 255).astype(np.uint8)
    with open(path, "wb") as file:
        Image.fromarray(texels).save(file, format="png")


def write_sky(path: Path, rng: np.random.Generator, width: int) -> None:
    """A PFM file of width x width / 2 texels: a gradient, clouds and a small bright sun."""
    height = width // 2
    u = (np.arange(width) + 0.5) / width
    v = (np.arange(height) + 0.5) / height  # rows of a PFM file go upwards
    texels = np.empty((height, width, 3), np.float32)
    shade = (0.2 + 0.6 * v)[:, None]
    for _ in range(3):
        a, b = rng.integers(1, 6, 2)
        phase = rng.uniform(0, 2 * np.pi, 2)
        shade = shade * (1 + 0.3 * np.outer(np.sin(2 * np.pi * b * v + phase[0]),
                                           np.sin(2 * np.pi * a * u + phase[1])))  # fmt: skip
    texels[...] = shade[..., None] * rng.uniform((0.5, 0.6, 0.8), (0.8, 0.9, 1.0))
    x, y = rng.uniform(0.2, 0.8), rng.uniform(0.65, 0.85)
    sun = ((u - x) ** 2)[None, :] * 4 + ((v - y) ** 2)[:, None] < 0.012**2
    texels[sun] += np.asarray((900, 850, 750), np.float32)
    head = f"PF\n{width} {height}\n-1.0\n".encode()
    path.write_bytes(head + texels.astype("<f4").tobytes())
