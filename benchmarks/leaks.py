"""Rays from inside closed meshes, aimed at their vertices and edges: none may leave.

Meshes of 12 to 81,920 triangles, convex ones, bumpy ones, a knot and one of slivers (1 : 2e6), at
scales 1e-3 to 1e6, around the origin and shifted by 1e6. The rays are made by the hook
`count_leaks` on the device, from points known to be inside: on the way from a kernel that sees the
whole mesh (of a sphere its middle, of the knot the middle of a section) towards the surface, up to
1e-4 of the way before it (of the knot 0.1). 1e9 rays on CUDA, 1e7 on a CPU. Exit status 1 if one
leaks.
"""

from __future__ import annotations

import sys

from common import header, parser, write

import veriray
from veriray_validate.leaks import MESHES, run


def main() -> int:
    """Command line."""
    p = parser(__doc__, "leaks_DEVICE.json")
    p.add_argument("meshes", nargs="*", help=f"of: {'; '.join(MESHES)}")
    p.add_argument("--device", default="cuda")
    p.add_argument("--rays", type=float, help="in all; default 1e9 on CUDA, 1e7 on a CPU")
    args = p.parse_args()
    unknown = set(args.meshes) - set(MESHES)
    if unknown:
        p.error(f"unknown meshes: {', '.join(unknown)}")
    chosen, _ = veriray.device.select(args.device)
    rays = int(args.rays or (1e9 if chosen.backend == "cuda" else 1e7))
    result = header("leaks")
    result["device"] = {"name": chosen.name, "description": chosen.description, **chosen.details}
    result["build"] = chosen.native.build_info()
    done = run(args.device, rays, tuple(args.meshes))
    for name in dict.fromkeys(row["mesh"] for row in done["rows"]):
        rows = [row for row in done["rows"] if row["mesh"] == name]
        total = {key: sum(row[key] for row in rows)
                 for key in ("rays", "vertex_misses", "edge_misses", "seconds")}  # fmt: skip
        print(f"{name}: {total['rays']:.3g} rays in {total['seconds']:.2f} s, misses at vertices "
              f"{total['vertex_misses']}, at edges {total['edge_misses']}")  # fmt: skip
    print(f"{done['leaks']} leaks in {done['rays']:.3g} rays")
    name = args.output.name.replace("DEVICE", chosen.backend)
    write({**result, **done}, args.output.with_name(name))
    return 1 if done["leaks"] else 0


if __name__ == "__main__":
    sys.exit(main())
