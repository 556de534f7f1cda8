"""What compute-sanitizer watches: every kernel, both schedulers, flat scenes and a tree.

compute-sanitizer --tool memcheck --error-exitcode 1 python benchmarks/sanitizer_target.py
(likewise --tool racecheck, --tool initcheck, --tool synccheck)
"""

from __future__ import annotations

import numpy as np

import veriray as vr

SIZE = {"width": 32, "height": 24}


def main() -> None:
    """Render small pictures on `cuda` and compare their bits with the CPU's."""
    sphere = {
        "type": "scene",
        "sensor": {"type": "perspective", "fov": 40.0, "film": {"type": "hdrfilm"}},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
    }
    rng = np.random.default_rng(1)
    for k in range(70):  # more than the flat path holds: a tree
        x, y, z = rng.uniform(-1, 1, 3)
        corner = np.eye(4)
        corner[:3, :3] *= 0.2
        corner[:3, 3] = (x, y, 4 + z)
        sphere[f"cube{k}"] = {"type": "cube", "to_world": corner}
    scenes = {name: vr.load_file(name) for name in ("cornell-box", "cornell-box-mitsuba", "open")}
    scenes["tree"] = vr.load_dict(sphere)
    for name, scene in scenes.items():
        small = scene.with_(**SIZE)
        for scheduler in ("fused", "thrust"):
            for all_features in (False, True):
                shas = {
                    vr.render(
                        small, spp=3, device=device, scheduler=scheduler, all_features=all_features
                    ).film_sha256
                    for device in ("cuda", "cpu")
                }
                assert len(shas) == 1, f"{name}, {scheduler}: CUDA and CPU differ"
                print(f"{name:20} {scheduler:7} all_features={all_features!s:5} {shas.pop()[:16]}")


if __name__ == "__main__":
    main()
