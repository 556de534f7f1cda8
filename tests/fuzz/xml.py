"""Scene files."""

from __future__ import annotations

import random
from pathlib import Path

from lxml import etree

from tests.fuzz.contract import Target
from tests.fuzz.scenes import ATTRIBUTES, BESIDE, NAMES, NUMBERS, problem
from veriray.errors import SceneError
from veriray.scene import load_file


def _load(path: Path) -> object:
    return load_file(path)


def mutate(data: bytes, rng: random.Random) -> bytes | None:
    """Changes one element of a well-formed file."""
    try:
        root = etree.fromstring(data, etree.XMLParser(resolve_entities=False, huge_tree=False))
    except (etree.XMLSyntaxError, ValueError):
        return None
    elements = [e for e in root.iter() if isinstance(e.tag, str)]
    e, other = rng.choice(elements), rng.choice(elements)
    parent = e.getparent()
    choice = rng.randrange(8)
    try:
        if choice == 0 and parent is not None:
            parent.remove(e)
        elif choice == 1 and len(elements) < 200:
            e.append(etree.fromstring(etree.tostring(other, with_tail=False)))
        elif choice == 2 and parent is not None:
            parent.append(etree.fromstring(etree.tostring(e, with_tail=False)))
        elif choice == 3:
            e.tag = rng.choice(NAMES)
        elif choice == 4:
            e.set(rng.choice(ATTRIBUTES), rng.choice(NAMES + NUMBERS))
        elif e.attrib:
            key = rng.choice(list(e.attrib))
            if choice == 5:
                e.set(key, rng.choice(NUMBERS))
            elif choice == 6 and other.attrib:
                e.set(key, other.get(rng.choice(list(other.attrib))) or "")
            else:
                e.set(key, rng.choice(NAMES))
        return etree.tostring(root)
    except ValueError:
        return None


TARGET = Target(
    ".xml", _load, problem, (SceneError,),
    ("formats/mitsuba_xml.py", "formats/node.py", "formats/build.py", "formats/values.py",
     "formats/spectra.py", "formats/metals.py", "formats/upgrade.py",
     "formats/shapes.py", "formats/materials.py", "formats/known.py",
     "formats/report.py", "transform.py", "numeric.py", "columns.py", "camera.py"),
    (*NAMES, *NUMBERS, *(f'{a}="' for a in ATTRIBUTES)), mutate, BESIDE,
)  # fmt: skip
