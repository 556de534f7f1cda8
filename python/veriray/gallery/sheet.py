"""The gallery's display copies, contact sheet and page.

A PNG of the gallery holds the facts of its render as JSON in the text entry "veriray", so sheet and
page can be made without the EXR files.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..errors import printable
from ..files import open_regular, replacing
from ..html import tint
from ..image import to_srgb8
from .own import MARK
from .pictures import PICTURES, Picture

if TYPE_CHECKING:
    from PIL.Image import Image

    from ..picture import Render

Array = npt.NDArray[Any]

SHEET_WIDTH = 960
ROW_HEIGHT = 276  # of a row at most
PAGE_WIDTH = 1024  # of a picture on the page at most
_MARGIN, _CAPTION = 10, 40
_KEYS = (
    "width height spp seed max_depth rr_depth seconds samples_per_second device device_name "
    "scheduler scene_sha256 version mean_stderr nonfinite_samples compare"
).split()


def facts(render: Render) -> dict[str, Any]:
    """The facts about a render that the captions and the page state."""
    known = {**render.stats, "width": render.width, "height": render.height}
    known |= {"spp": render.spp, "seed": render.seed}
    return {key: known[key] for key in _KEYS if key in known} | {"film_sha256": render.film_sha256}


def speed(fact: dict[str, Any]) -> str:
    """Time, speed and device as one line."""
    rate = fact.get("samples_per_second") or 0.0
    return f"{fact['seconds']:.3g} s, {rate / 1e6:.3g} Mpaths/s, {fact.get('device_name') or '?'}"


def size(fact: dict[str, Any]) -> str:
    """Size and samples as one line."""
    return f"{fact['width']} x {fact['height']}, {fact['spp']:,} spp"


def save_png(path: Path, pixels: Array, render: Render) -> None:
    """Write sRGB bytes (H, W, 3) with the render's facts; whole or not at all."""
    from PIL import Image, PngImagePlugin

    note = PngImagePlugin.PngInfo()
    note.add_text("Comment", MARK)
    note.add_text("veriray", json.dumps(facts(render)))
    with replacing(path) as file:
        Image.fromarray(pixels).save(file, format="png", pnginfo=note, optimize=True)


def outputs(folder: Path, docs: Path, names: Collection[str] = ()) -> list[Path]:
    """The files that `make` writes once these pictures are in `folder`: page, sheet, copies."""
    images = docs / "images"
    shown = [p for p in PICTURES if p.name in names or (folder / f"{p.name}.png").exists()]
    copies = [images / f"{picture.name}.jpg" for picture in shown]
    return [docs / "gallery.md", images / "gallery.png", *copies]


def side_by_side(ours: Render, theirs: Render, exposure: float, zoom: int = 4) -> Array:
    """Our picture, theirs and their difference in standard errors: (H zoom, 3 W zoom, 3) bytes.

    The difference is the mean over the channels of (ours - theirs) / standard error: white is 0,
    red ours brighter, blue ours darker, full colour 4. Pixels are repeated, not interpolated.
    exposure: of the first two, in stops.
    """
    error = np.sqrt(np.square(ours.stderr, dtype=np.float64) + np.square(theirs.stderr))
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.nan_to_num((ours.image - theirs.image.astype(np.float64)) / error).mean(axis=-1)
    panels = [to_srgb8(ours.image, exposure), to_srgb8(theirs.image, exposure), tint(z)]
    row: Array = np.concatenate(panels, axis=1)
    return row.repeat(zoom, axis=0).repeat(zoom, axis=1)


def make(folder: Path, docs: Path) -> list[Path]:
    """Contact sheet, page and its pictures from the files in `folder`; returns the files written.

    Writes docs/gallery.md, docs/images/gallery.png and docs/images/NAME.jpg; nothing if `folder`
    holds no picture. Raises OSError.
    """
    from PIL import PngImagePlugin

    shown = [(p, *found) for p in PICTURES if (found := _read(folder, p)) is not None]
    if not shown:
        return []
    images = docs / "images"
    images.mkdir(parents=True, exist_ok=True)
    written = []
    for picture, image, _ in shown:
        path = images / f"{picture.name}.jpg"
        small = image.copy()
        small.thumbnail((PAGE_WIDTH, PAGE_WIDTH))
        with replacing(path) as file:
            small.save(
                file, format="jpeg", quality=85, optimize=True, subsampling=0, comment=MARK.encode()
            )
        written.append(path)
    path = images / "gallery.png"
    note = PngImagePlugin.PngInfo()
    note.add_text("Comment", MARK)
    with replacing(path) as file:
        contact_sheet(shown).save(file, format="png", pnginfo=note, optimize=True)
    written.append(path)
    path = docs / "gallery.md"
    with replacing(path) as file:
        file.write(page([(p, fact) for p, _, fact in shown], docs).encode())
    return [*written, path]


def _read(folder: Path, picture: Picture) -> tuple[Image, dict[str, Any]] | None:
    """A picture's PNG and its facts; None without a PNG that holds them."""
    from PIL import Image, UnidentifiedImageError

    path = folder / f"{picture.name}.png"
    try:
        with open_regular(path) as file, Image.open(file) as opened:
            text = opened.info.get("veriray")
            if not text:
                return None
            known = json.loads(text)
            return opened.convert("RGB"), {
                key: printable(value) if isinstance(value, str) else value
                for key, value in known.items()
            }
    except (FileNotFoundError, UnidentifiedImageError, ValueError):
        return None


def contact_sheet(shown: list[tuple[Picture, Image, dict[str, Any]]]) -> Image:
    """All pictures in rows of one height, each with name, size, samples, time, speed, device."""
    from PIL import Image, ImageDraw, ImageFont

    rows = _rows(shown)
    inner = SHEET_WIDTH - _MARGIN
    heights = [
        min(ROW_HEIGHT, round((inner - _MARGIN * len(row)) / sum(_aspect(i) for _, i, _ in row)))
        for row in rows
    ]
    total = sum(height + _CAPTION + _MARGIN for height in heights) + _MARGIN
    sheet = Image.new("RGB", (SHEET_WIDTH, total), (24, 24, 26))
    draw = ImageDraw.Draw(sheet)
    y = _MARGIN
    for row, height in zip(rows, heights, strict=True):
        x = _MARGIN
        for picture, image, fact in row:
            width = round(height * _aspect(image))
            sheet.paste(image.resize((width, height), Image.Resampling.LANCZOS), (x, y))
            title = f"{picture.title}: {size(fact)}"
            for k, (line, shade) in enumerate(((title, 235), (speed(fact), 165))):
                font = _fitting(ImageFont, line, width)
                draw.text((x, y + height + 4 + 17 * k), line, (shade,) * 3, font=font)
            x += width + _MARGIN
        y += height + _CAPTION + _MARGIN
    return sheet


def _fitting(fonts: Any, line: str, width: int) -> Any:
    """The largest font, from 14 to 8 points, in which a line is no wider than its picture."""
    for points in range(14, 7, -1):
        font = fonts.load_default(points)
        if font.getlength(line) <= width:
            break
    return font


def _aspect(image: Image) -> float:
    return image.width / image.height


def _rows(shown: list[Any]) -> list[list[Any]]:
    """Pictures in order, as few to a row as keep it at most ROW_HEIGHT high."""
    rows: list[list[Any]] = [[]]
    for entry in shown:
        wide = sum(_aspect(image) for _, image, _ in rows[-1])
        if wide and SHEET_WIDTH / wide <= ROW_HEIGHT:
            rows.append([])
        rows[-1].append(entry)
    return rows


def page(shown: list[tuple[Picture, dict[str, Any]]], docs: Path) -> str:
    """The page in Markdown; includes the picture of figure 2 if `docs` has it."""
    lines = [
        f"<!-- {MARK} -->",
        "",
        "# Gallery",
        "",
        'Every figure of the report "Parallel Path Tracing in CUDA" (H. Dahlberg, KTH, 2016), made',
        "again by `veriray gallery`, and pictures of what the report had not. It also made this",
        "page and the contact sheet, from the facts in the pictures' files. The pictures shown are",
        "display copies: sRGB, clipped at 1. The films are those of the version that made them,",
        "and the same, bit for bit, on every device.",
        "",
        "![contact sheet](images/gallery.png)",
        "",
        "| figure | picture | size | spp | depth | seconds | Mpaths/s | device | mean standard "
        "error | film SHA-256 |",
        "|" + " --- |" * 10,
    ]
    for picture, fact in shown:
        depth = fact.get("max_depth")
        error = fact.get("mean_stderr")
        cells = (
            picture.figure or "",
            f"[{picture.name}](#{picture.name})",
            f"{fact['width']} x {fact['height']}",
            f"{fact['spp']:,}",
            "unlimited" if depth == -1 else depth,
            f"{fact['seconds']:.3g}",
            f"{(fact.get('samples_per_second') or 0.0) / 1e6:.3g}",
            fact.get("device_name") or "",
            "" if error is None else f"{error:.2g}",
            f"`{fact['film_sha256'][:16]}`",
        )
        lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    for picture, fact in shown:
        if picture.figure != 1 and "## correlated-seeds" not in lines:
            lines += _figure_2(docs)
        lines += ["", f"## {picture.name}", "", picture.text]
        if picture.figure:
            lines[-1] = f"Figure {picture.figure}. {picture.text}"
        if picture.exposure:
            stops = f"{picture.exposure:g} stop{'s' * (picture.exposure != 1)}"
            lines[-1] += f" Shown {stops} brighter than it is."
        if fact.get("compare"):
            lines += ["", "Our render on the left, the independent reference in the middle, their "]
            lines[-1] += "difference in standard errors on the right (blue -4, red +4). "
            lines[-1] += fact["compare"]
        lines += ["", f"![{picture.name}](images/{picture.name}.jpg)"]
    return "\n".join(lines) + "\n"


def _figure_2(docs: Path) -> list[str]:
    lines = [
        "",
        "## correlated-seeds",
        "",
        "Figure 2. The seeding of 2016, reproduced: each bounce seeds a linear generator with a",
        "hash of pixel, pass, clock and depth, so a pixel's numbers in consecutive bounces differ",
        "by a constant. `python benchmarks/correlated_seeds.py` compares bias and correlation with",
        "ours.",
    ]
    if (docs / "images" / "correlated_seeds.png").is_file():
        lines += ["", "![correlated seeds](images/correlated_seeds.png)"]
    return lines
