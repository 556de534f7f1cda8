"""How objects show themselves: short text, and HTML for notebooks that needs no network.

The HTML takes colours and fonts from the page around it, so that it suits light and dark themes.
"""

from __future__ import annotations

import base64
import html
import io
import itertools
import secrets
import zlib
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import visible

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .comparison import Report
    from .picture import Render
    from .scene import Scene

#: Pixels of the longer side of a picture that is embedded in a page.
MOST_PIXELS = 640
_CELL = "border:1px solid color-mix(in srgb, currentColor 30%, transparent);padding:2px 8px"
_numbers = itertools.count()


def counted(number: int, name: str, plural: str = "") -> str:
    """A number with its noun: 1 sphere, 2 spheres."""
    return f"{number:,} {name if number == 1 else plural or name + 's'}"


def scene_text(scene: Scene) -> str:
    """A scene in a line."""
    shapes = [("triangle", scene.triangles), ("sphere", scene.spheres), ("disk", scene.disks)]
    parts = [counted(len(rows), name) for name, rows in shapes if len(rows)]
    parts += [counted(len(scene.material_kind), "material")] if len(scene.material_kind) else []
    media, textures = len(scene.sigma_t), len(scene.texture_kind)
    parts += [counted(media, "medium", "media")] if media else []
    parts += [counted(textures, "texture")] if textures else []
    lamps = len(scene.emissions) + len(scene.light_kind)
    sky = bool(scene.environment.any()) or len(scene.sky_texels) > 0
    parts.append(
        " and ".join([counted(lamps, "lamp")] * bool(lamps) + ["a sky"] * sky) or "no light"
    )
    return f"<Scene {scene.film.width} x {scene.film.height}: {', '.join(parts)}>"


def render_text(render: Render) -> str:
    """A render in a line."""
    stats = render.stats
    error, seconds = stats.get("mean_stderr"), stats.get("seconds")
    parts = [f"{render.width} x {render.height}", f"{render.spp} spp", f"seed {render.seed}"]
    if render.batch_means is not None:
        parts.append(f"{len(render.batch_means)} batches")
    parts += [f"mean stderr {error:.3g}"] if isinstance(error, float) else []
    parts += [f"{seconds:.3g} s"] if seconds else []
    parts += [f"on {stats['device']}"] if stats.get("device") else []
    return f"<Render {', '.join(parts)}>"


def report_text(report: Report) -> str:
    """A comparison in a line."""
    return f"<Report {report.result}: {report.verdict or 'no verdict yet'}>"


# ---- HTML ----


def table(head: Sequence[str], rows: Iterable[Sequence[object]], title: str = "") -> str:
    """A table; every text is escaped."""

    def cells(values: Sequence[object], tag: str) -> str:
        style = f'style="{_CELL};text-align:left;vertical-align:top"'
        return "".join(f"<{tag} {style}>{escaped(value)}</{tag}>" for value in values)

    lines = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    top = f"<tr>{cells(head, 'th')}</tr>" if head else ""
    caption = f'<div style="padding:4px 0">{escaped(title)}</div>' if title else ""
    style = "border-collapse:collapse;color:inherit;background:none"
    body = f'<table style="{style}">{top}{lines}</table>'
    return f'<div style="overflow-x:auto">{caption}{body if lines else ""}</div>'


def escaped(value: object) -> str:
    """Text of a page."""
    return html.escape(visible(str(value)))


def scene_html(scene: Scene) -> str:
    """A table of what a scene holds."""
    camera = scene.camera
    place = ", ".join(f"{x:.5g}" for x in camera.to_world[:3, 3])
    depth = "unlimited" if scene.max_depth < 0 else f"at most {scene.max_depth}"
    view = f"{camera.fov:.4g} degrees along {camera.fov_axis}"
    rows: list[tuple[object, object]] = [
        ("camera", f"{camera.projection} at ({place}), {view}"),
        ("film", f"{scene.film.width} x {scene.film.height}, {scene.film.filter} filter"),
        ("depth", f"{depth}, roulette from {scene.rr_depth}"),
        ("sampler", f"{scene.sampler}, {scene.spp} spp, seed {scene.seed}"),
    ]
    names = list(scene.parameters().items())
    rows += [(name, _short(value)) for name, value in names[:20]]
    rows += [("", f"and {len(names) - 20} more: Scene.parameters()")] if len(names) > 20 else []
    rows += [("note", note) for note in scene.notes[:5]]
    return table((), rows, repr(scene))


def _short(value: float | tuple[float, ...]) -> str:
    """A number or a colour in four digits."""
    if isinstance(value, tuple):
        return f"({', '.join(f'{x:.4g}' for x in value)})"
    return f"{value:.4g}"


def report_html(report: Report) -> str:
    """The verdict and a table of the tests."""
    rows = [
        (t.name, t.result, "" if t.p is None else f"{t.p:.2g}", t.where or t.finds)
        for t in report.tests
    ]
    rows += [(name, "not run", "", why) for name, why in report.not_run]
    rows += [("note", "", "", note) for note in report.notes]
    return table(("test", "result", "p", "where"), rows, report.verdict)


def render_html(render: Render) -> str:
    """The picture with a slider for the exposure, and a table of facts below it.

    The radiance itself is embedded (at most MOST_PIXELS a side, in 8 bits a channel and a common
    exponent), so that the slider brings back what is too bright or too dark. Where scripts do not
    run, a display copy stays.
    """
    image = smaller(np.asarray(render), MOST_PIXELS)
    height, width = image.shape[:2]
    data = base64.b64encode(zlib.compress(shared_exponent(image).tobytes(), 6)).decode()
    small = _png(smaller(image, MOST_PIXELS // 2))
    stats, error = render.stats, render.stats.get("mean_stderr")
    rate = stats.get("samples_per_second")
    facts = [
        ("device", f"{stats.get('device', '')} {stats.get('device_name', '')}".strip()),
        ("samples", f"{rate:,.0f} per second" if isinstance(rate, (int, float)) else ""),
        ("mean stderr", f"{error:.4g}" if isinstance(error, float) else ""),
        ("SHA-256", render.film_sha256),
    ]
    name = f"veriray-{next(_numbers)}-{secrets.token_hex(6)}"
    script = _SCRIPT.replace("NAME", name).replace("WIDTH", str(width))
    return (
        f'<div id="{name}" style="max-width:100%">'
        f'<img alt="the picture" style="max-width:100%" src="data:image/png;base64,{small}">'
        f'<div style="padding:4px 0"><label>exposure <input type="range" min="-8" max="8" '
        'step="0.1" value="0" style="vertical-align:middle;width:16em"> <output>0.0</output> stops'
        f'</label></div><script type="application/octet-stream">{data}</script></div>'
        f"{table((), [f for f in facts if f[1]], render_text(render))}"
        f"<script>{script.replace('HEIGHT', str(height))}</script>"
    )


_SCRIPT = """
(async () => {
  const box = document.getElementById("NAME"), image = box.querySelector("img");
  const slider = box.querySelector("input"), out = box.querySelector("output");
  const text = box.querySelector("script").textContent;
  const packed = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const rgbe = new Uint8Array(await new Response(stream).arrayBuffer());
  const canvas = document.createElement("canvas");
  canvas.width = WIDTH; canvas.height = HEIGHT; canvas.style.maxWidth = "100%";
  const pen = canvas.getContext("2d"), pixels = pen.createImageData(WIDTH, HEIGHT);
  const curve = x => x <= 0.0031308 ? 12.92 * x : 1.055 * Math.pow(x, 1 / 2.4) - 0.055;
  const steps = Array.from({length: 4097}, (_, k) => Math.round(255 * curve(k / 4096)));
  const draw = () => {
    const stops = Number(slider.value);
    out.textContent = stops.toFixed(1);
    for (let i = 0; i < rgbe.length; i += 4) {
      const scale = Math.pow(2, rgbe[i + 3] - 136 + stops), lost = rgbe[i + 3] === 255;
      for (let c = 0; c < 3; ++c)
        pixels.data[i + c] = lost ? (c === 1 ? 0 : 255)
          : steps[Math.round(4096 * Math.min(1, rgbe[i + c] * scale))];
      pixels.data[i + 3] = 255;
    }
    pen.putImageData(pixels, 0, 0);
  };
  slider.addEventListener("input", draw);
  draw();
  image.replaceWith(canvas);
})();
"""


def smaller(image: NDArray[Any], most: int) -> NDArray[Any]:
    """A picture (H, W, 3) of at most `most` pixels a side: means of blocks of equal size."""
    step = -(-max(image.shape[:2]) // most)
    if step == 1:
        return image
    height, width = (max(n // step, 1) for n in image.shape[:2])
    tall, wide = (min(step, n) for n in image.shape[:2])
    cut = image[: height * tall, : width * wide].reshape(height, tall, width, wide, 3)
    means: NDArray[Any] = cut.mean(axis=(1, 3))
    return means


def shared_exponent(image: NDArray[Any]) -> NDArray[np.uint8]:
    """(H, W, 4) bytes r, g, b, e: values r 2^(e - 136) and so on. e = 255: not finite.

    Negative values become 0; so does what is below 2^-128, and what is above 2^118 is cut.
    """
    finite = np.isfinite(image).all(axis=-1)
    values = np.where(finite[..., None], np.clip(image, 0.0, 2.0**118), 0.0).astype(np.float64)
    _, exponent = np.frexp(values.max(axis=-1))
    # the largest channel is below 2^exponent and at least half of it: its byte is 128 to 255
    exponent = np.clip(exponent, -127, 118)
    scaled = np.minimum(np.rint(np.ldexp(values, (8 - exponent)[..., None])), 255)
    out = np.concatenate([scaled, (exponent + 128)[..., None]], axis=-1).astype(np.uint8)
    out[~finite] = (0, 0, 0, 255)
    return out


def _png(image: NDArray[Any]) -> str:
    from PIL import Image

    from .saving import to_srgb8

    file = io.BytesIO()
    Image.fromarray(to_srgb8(image)).save(file, format="png")
    return base64.b64encode(file.getvalue()).decode()
