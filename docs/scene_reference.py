"""The pages that are made from the program: the scene reference with its pictures, and the API.

    python docs/scene_reference.py FOLDER    # writes the pages and pictures, without Sphinx

A picture is a strip: a parameter's values side by side, all else equal. `LOOKS` says which values;
`PLAIN` says why a parameter has no picture. Together they name every parameter (a test checks).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, PngImagePlugin
from scene_looks import LOOKS, PLAIN, Look, scene_of

import veriray as vr
from veriray.formats import plugins
from veriray.formats.plugins import PLUGINS, Plugin
from veriray.image import to_srgb8

#: Categories in the order of the page -> what stands above them.
CATEGORIES = {
    "bsdf": "Materials (bsdfs)",
    "texture": "Textures",
    "shape": "Shapes",
    "emitter": "Lights (emitters)",
    "medium": "Media",
    "phase": "Phase functions",
    "volume": "Volumes",
    "sensor": "Cameras (sensors)",
    "film": "Films",
    "rfilter": "Pixel filters",
    "sampler": "Samplers",
    "integrator": "Integrators",
}
SIZE, SPP, GAP = 84, 32, 4


def draw(look: Look, path: Path) -> None:
    """Save the pictures of a look side by side, unless the file is already that."""
    scenes = [vr.load_dict(scene_of(look.base, change)) for _, change in look.values]
    key = " ".join([vr.__version__, repr(settings(look)), *(s.sha256 for s in scenes)])
    key += repr([(s.camera, s.spp) for s in scenes])
    if path.exists():
        with Image.open(path) as old:
            if old.info.get("veriray") == key:
                return
    info = PngImagePlugin.PngInfo()
    info.add_text("veriray", key)
    Image.fromarray(strip(look, scenes)).save(path, pnginfo=info)


def settings(look: Look) -> dict[str, Any]:
    """How the pictures of a look are rendered."""
    if look.base == "sampler":
        return {"width": SIZE, "height": SIZE, "seed": 1}
    size = (
        {}
        if look.own_size
        else dict(zip(("width", "height"), look.size or (SIZE, SIZE), strict=True))
    )
    return {**size, "spp": look.spp or SPP, "sampler": "sobol", "seed": 1}


def strip(look: Look, scenes: list[vr.Scene]) -> np.ndarray[Any, Any]:
    """Pictures side by side, bytes (H, W, 3)."""
    pictures = []
    for scene in scenes:
        image = np.asarray(vr.render(scene, **settings(look)).image, np.float64)
        if look.own_size:
            image = np.kron(image, np.ones((max(SIZE // image.shape[0], 1),) * 2 + (1,)))
        pictures.append(to_srgb8(image * look.exposure))
    height = max(p.shape[0] for p in pictures)
    parts = []
    for p in pictures:
        padded = np.full((height, p.shape[1] + GAP, 3), 255, np.uint8)
        padded[: p.shape[0], : p.shape[1]] = p
        parts.append(padded)
    return np.concatenate(parts, axis=1)[:, :-GAP]


def pages(folder: Path) -> dict[str, str]:
    """Pages by file name; writes their pictures below `folder`."""
    return {"scene-reference.md": reference(folder)}


def reference(folder: Path) -> str:
    """The scene reference as Markdown."""
    images = folder / "images"
    images.mkdir(parents=True, exist_ok=True)
    text = [
        "# Scene reference\n",
        "Every object and parameter of a scene, with its type, default and range, and what it does "
        "to a picture. [Scene files](../scene-files.md) tells how files are read; XML, "
        "dictionaries and glTF share these names. The pictures were rendered when this page was "
        "built; a strip shows the values that stand below it, all else being equal.\n",
    ]
    for category, title in CATEGORIES.items():
        text.append(f"## {title}\n")
        for name, plugin in PLUGINS.items():
            if plugin.category == category:
                text += section(name, plugin, images)
    text.append("## Names\n")
    text.append(plugins.describe().split("\n\n", 1)[1])
    return "\n".join(text)


def section(name: str, plugin: Plugin, images: Path) -> Iterator[str]:
    """Lines on one object."""
    yield f"### `{name}`\n"
    if plugin.doc:
        yield f"{plugin.doc[0].upper()}{plugin.doc[1:]}.\n"
    if plugin.children:
        yield f"Holds {', '.join(plugin.children)}.\n"
    rows = list(plugins.rows(plugin))
    if rows:
        yield "| parameter | type | default | allowed | meaning |"
        yield "| --- | --- | --- | --- | --- |"
        yield from (f"| {' | '.join(cell.replace('|', ' ') for cell in row)} |" for row in rows)
        yield ""
    for key in ("", *plugin.params):
        look = LOOKS.get((name, key))
        if look is None:
            continue
        file = f"{name}-{key or 'object'}.png"
        draw(look, images / file)
        said = ", ".join(label for label, _ in look.values)
        shown = f"`{key}`: {said}" if key else said
        yield f"![{name} {key}](images/{file})\n\n{shown}\n"


def api_page() -> str:
    """The API from docstrings, as a page that autodoc fills."""
    parts = [
        "# API\n",
        "What `import veriray as vr` offers. Units, shapes and errors are stated.\n",
    ]
    for title, names in (
        ("Functions", ["render", "compare", "load_file", "load_dict", "cornell_box", "dataset",
                       "feature_images", "lint", "trace_path", "devices", "film_hash"]),
        ("Classes", ["Scene", "Camera", "Film", "Render", "FeatureImages", "Accumulation",
                     "Checkpoint", "Report", "Device"]),
        ("Errors and warnings", ["SceneError", "ImageError", "CheckpointError", "DeviceError",
                                 "OutOfMemoryError", "MissingPackageError", "SceneWarning",
                                 "RefusedSamplesWarning", "CheckpointWarning", "DeviceWarning"]),
    ):  # fmt: skip
        parts.append(f"## {title}\n\n```{{eval-rst}}")
        for name in names:
            is_class = isinstance(getattr(vr, name), type)
            kind = "autoclass" if is_class else "autofunction"
            parts.append(f".. {kind}:: veriray.{name}")
            if is_class:
                parts.append("   :members:\n   :member-order: bysource")
            parts.append("")
        parts.append("```\n")
    known = {line.split("veriray.")[1] for part in parts for line in part.split("\n")
             if line.startswith(".. auto")}  # fmt: skip
    left = [n for n in vr.__all__ if n not in known | {"__version__"}]
    parts.append("Constants: " + ", ".join(f"`{n}` = `{getattr(vr, n)!r}`" for n in left) + ".\n")
    return "\n".join(parts)


def undescribed() -> set[tuple[str, str]]:
    """(object, parameter) of which neither a picture nor a reason for none is stated."""
    known = {*LOOKS, *PLAIN}
    return {
        (name, key)
        for name, plugin in PLUGINS.items()
        for key in plugin.params
        if (name, key) not in known and ("", key) not in PLAIN and (name, "*") not in PLAIN
    }


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)
    for page, content in pages(target).items():
        (target / page).write_text(content, "utf-8")
