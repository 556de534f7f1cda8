"""Scenes as dictionaries; the input is JSON, which holds all that a dictionary may."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

from tests.fuzz.contract import Target
from tests.fuzz.scenes import BESIDE, NAMES, NUMBERS, problem
from veriray.errors import SceneError
from veriray.scene import Scene, load_dict


def _load(path: Path) -> object:
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        raise SceneError("not JSON") from None
    return load_dict(_here(content, path.parent))


def _here(content: Any, folder: Path) -> Any:
    """File names made relative to the input's folder."""
    if isinstance(content, dict):
        return {k: str(folder / v[:200]) if k == "filename" and isinstance(v, str) else
                _here(v, folder) for k, v in content.items()}  # fmt: skip
    return content


def _valid(scene: Scene) -> str:
    return problem(scene)


def mutate(data: bytes, rng: random.Random) -> bytes | None:
    """Changes one value of a JSON text."""
    try:
        root = json.loads(data)
    except (ValueError, RecursionError):
        return None
    slots: list[tuple[Any, Any]] = []

    def walk(node: Any) -> None:
        if isinstance(node, (dict, list)):
            for key in node if isinstance(node, dict) else range(len(node)):
                slots.append((node, key))
                walk(node[key])

    walk(root)
    if not slots:
        return None
    (node, key), (other, other_key) = rng.choice(slots), rng.choice(slots)
    choice = rng.randrange(6)
    if choice == 0:
        del node[key]
    elif choice == 1:
        node[key] = json.loads(json.dumps(other[other_key]))
    elif choice == 2 and isinstance(node, dict):
        node[rng.choice(NAMES)] = node.pop(key)
    elif choice == 3:
        node[key] = rng.choice(NAMES)
    elif choice == 4:
        node[key] = rng.choice([0, 1, -1, 0.5, 1e300, float("nan"), True, None, 2**64, 10**40])
    else:
        node[key] = [rng.choice([0, 1, 1e30, -2.5]) for _ in range(rng.choice([1, 2, 3, 4]))]
    return json.dumps(root).encode()


TARGET = Target(
    ".json", _load, _valid, (SceneError,),
    ("formats/mitsuba_dict.py", "formats/node.py", "formats/build.py", "formats/values.py",
     "formats/spectra.py", "formats/metals.py",
     "formats/shapes.py", "formats/materials.py", "numeric.py", "columns.py", "camera.py"),
    (*(f'"{n}"' for n in NAMES), *NUMBERS, '{"type":"', "null", "true", "NaN"), mutate, BESIDE,
)  # fmt: skip
