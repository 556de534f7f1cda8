"""Where paths end, depth by depth: exact laws, and the independent reference.

The ledger counts segments. For each depth d (0 is the camera's ray):
live[d] = escaped + emitter_end + absorbed + rr_killed + depth_cut + invalid + live[d + 1], and
live[0] = pixels x samples. `Trial.render` checks that in every render of the suite.

Roulette: from vertex rr_depth on, a path survives with probability q, its largest throughput, and
its weight is divided by q. So after the first roulette the largest throughput is 1 again. At a wall
of albedo rho, q is then rho each time, whatever came before, and survivors are binomial with a
known rate. Only this test sees a changed roulette that keeps the picture right. Laws of glass and
media are tested with their radiances in level 3.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

import veriray
from veriray import depths
from veriray.comparison import ledgers
from veriray.rendering import LEDGER_COLUMNS, METHODS, Render
from veriray.scene import Scene
from veriray_validate import dicts, references
from veriray_validate.levels.stranger import theirs
from veriray_validate.scenes import (
    MIRROR,
    TUBES,
    Part,
    box,
    camera,
    check_scene,
    checks,
    disk,
    furnace,
    make,
    point_light,
    quad,
    sphere,
)
from veriray_validate.statistics import binomial, homogeneous, sidak
from veriray_validate.trial import FIRST, Trial, case

Array = npt.NDArray[Any]

NAMES = tuple(checks())
SCHEDULERS = METHODS
#: Scenes of the quick run against the reference.
QUICK = {
    "chromatic_medium", "conductor_mirror", "disk_light", "glass_cube", "hg_forward", "mask",
    "medium_in_glass", "mesh_light", "near_lamps", "nested_dielectrics", "null_medium", "plastic",
    "spheres_300",
    "smooth_normals", "spot_light", "thindielectric", "touching_media",
}  # fmt: skip
ENDS = (*ledgers.ENDS, "invalid")


def column(r: Render, name: str) -> Array:
    """A column of the ledger."""
    return np.array(r.stats["ledger"][name], np.int64)


def single(value: float) -> float:
    """The number as the renderer stores it, in single precision."""
    return float(np.float32(value))


def survivors(t: Trial, live: Array, rates: Array, what: str) -> None:
    """Exact binomial test, at each depth, of live[d + 1] among live[d]; while 100 or more are left.

    rates: probability of going on from depth d; the last one holds for all later depths.
    """
    p = 1.0
    tested = 0
    following = np.append(live[1:], 0)
    for d, (n, k) in enumerate(zip(live, following, strict=True)):
        rate = float(rates[min(d, len(rates) - 1)])
        if rate >= 1:
            t.check(k == n, f"{what}, depth {d}: {k} of {n} go on, expected all")
        elif n >= 100:
            p, tested = min(p, binomial(int(k), int(n), rate)), tested + 1
    t.p(sidak(p, max(tested, 1)), what)


def leaks_aside(t: Trial, r: Render) -> Array:
    """Live rays of a closed furnace without the few that left it at its edges."""
    return column(r, "live") - t.leaks(r)[::-1].cumsum()[::-1]


def smallest_rate(n: float, rate: float) -> float:
    """Relative change of a survival rate that n paths show with 90 % power at level 1e-3."""
    return 4.57 * math.sqrt((1 - rate) / (rate * n))


# ---- laws ----


@case(4, each={"albedo": (0.343, 0.7, 0.98), "rr_depth": (1, 2, 5), "scheduler": SCHEDULERS},
      quick=lambda albedo, rr_depth, scheduler:
      rr_depth != 2 if scheduler == "fused" else (rr_depth == 2 and albedo < 0.5))  # fmt: skip
def closed_furnace(t: Trial, albedo: float, rr_depth: int, scheduler: str) -> None:
    """Survivors in a closed furnace are binomial at every depth.

    live[d] = N below rr_depth, then N rho^d: exact tests of live[d + 1] among live[d], whose rate
    is rho^rr_depth at the first roulette and rho at each later one, and of all later survivors
    together (negative binomial). No path may end otherwise. One albedo leaves policies untested:
    .343, .7 and .98 are needed. Sees 0.4 % in the survival probability if roulette begins at
    once. J. Arvo and D. Kirk, Particle Transport and Image Synthesis, 1990.
    """
    rho, n = single(albedo), 320_000 if albedo > 0.9 else 1_600_000
    if scheduler != "fused":  # whose ledger is theirs (level 6): no more samples in full runs
        n //= math.gcd(t.effort, 4)
    # many pixels, so that batches are full
    room = furnace(albedo, 1.0, rr_depth=rr_depth, width=40, height=40)
    r = t.render(room, n // 1600, scheduler=scheduler)
    live = leaks_aside(t, r)
    rates = [1.0] * (rr_depth - 1) + [rho**rr_depth, rho]
    survivors(t, live, np.array(rates), "survivors")
    start, later = int(live[rr_depth]), int(live[rr_depth + 1 :].sum())
    law = stats.nbinom(start, 1 - rho)
    t.p(min(1.0, 2 * float(min(law.cdf(later), law.sf(later - 1)))), "all later survivors")
    for end in set(ENDS) - {"rr_killed", "escaped", "absorbed"}:
        t.check(not column(r, end).any(), f"paths end as {end}")
    # One's own wall is no brighter from a point of it than the others together.
    lit = int(column(r, "shadow_visible").sum())
    t.check(live.sum() / 2 < lit <= live.sum(), "shadow rays")
    t.figure("live", live[:100])
    first = smallest_rate(float(live[rr_depth - 1]), rho**rr_depth) / rr_depth
    all_later = 4.57 * (1 - rho) / math.sqrt(start * rho)
    t.sees(min(first, all_later), 0.02)


@case(4)
def roulette_by_the_largest_channel(t: Trial) -> None:
    """Three albedos: the largest throughput decides.

    live[d + 1] / live[d] = .8 at each depth for albedos .2, .5, .8; and the radiance of all three
    channels, cut after 6 vertices, is E (1 - rho^7) / (1 - rho): weights of the survivors divided
    by q add up to those without roulette.
    """
    rho, depth = np.array([0.2, 0.5, 0.8]), 7
    scene = furnace(rho, 1.0, rr_depth=1, max_depth=depth)
    exact = (1 - rho**depth) / (1 - rho)
    r = t.agrees(scene, exact, 300_000, sees=0.01)
    live = leaks_aside(t, r)
    t.check(len(live) == depth, f"{len(live)} depths")
    survivors(t, live, np.array([single(0.8)] * (depth - 1) + [0.0]), "survivors")
    t.check(column(r, "depth_cut")[-1] == live[-1], "the last vertices are not cut")


@case(4, each={"albedo": (0.5, 0.98)})
def weight_of_survivors(t: Trial, albedo: float) -> None:
    """Roulette changes counts, not weights: the truncated furnace with and without it.

    E (1 - rho^k) / (1 - rho) both ways, k = 8; without roulette every path lives to the end.
    """
    k, rho = 8, single(albedo)
    exact = (1 - rho**k) / (1 - rho)
    t.agrees(furnace(albedo, 1.0, rr_depth=1, max_depth=k), exact, 200_000, sees=0.01)
    r = t.agrees(furnace(albedo, 1.0, rr_depth=1000, max_depth=k), exact, 50_000, sees=0.01)
    n = r.spp - int(t.leaks(r).sum())
    t.check(leaks_aside(t, r) == n, "a path ends before max_depth")
    t.check(column(r, "depth_cut") == [0] * (k - 1) + [n], "depth_cut")


@case(4, each={"fraction": (0.1, 0.4), "albedo": (0.343, 0.7, 0.98)})
def sphere_with_a_port(t: Trial, fraction: float, albedo: float) -> None:
    """A black port absorbs its share in a sphere at each depth.

    A black disk closes a cap of area fraction f; the form factor to it is f from everywhere on the
    sphere. live = 1, rho, then times (1 - f) rho: absorbed and killed paths are binomial too.
    """
    rho, h = single(albedo), 1 - 2 * fraction
    radius = 1.0001 * math.sqrt(1 - h * h)  # its rim is outside
    port = disk([0, 0, h], [0, radius, 0], [radius, 0, 0])
    room = sphere([0, 0, 0], 1.0, albedo, 0.0, inward=True)
    scene = make([room, port], camera([0.1, 0.2, -0.3], [0.3, -0.1, -1.0]), rr_depth=1)
    r = t.render(scene, 300_000)
    live, absorbed = column(r, "live"), column(r, "absorbed")
    survivors(t, live, np.array([rho, (1 - fraction) * rho]), "survivors")
    t.check(absorbed[0] == 0, "the camera sees the port")
    # among paths that arrive at depth d >= 1, the port's share
    p = [binomial(int(a), int(n), fraction)
         for a, n in zip(absorbed[1:], live[1:], strict=True) if n >= 100]  # fmt: skip
    t.p(sidak(min(p), len(p)), "absorbed")
    for end in set(ENDS) - {"rr_killed", "absorbed"}:
        t.check(not column(r, end).any(), f"paths end as {end}")
    t.sees(smallest_rate(300_000 * t.effort, (1 - fraction) * rho), 0.02)


@case(4, each={"inner": (0.3, 0.98), "outer": (0.6, 0.343)})
def two_spheres(t: Trial, inner: float, outer: float) -> None:
    """Concentric spheres: a chain of two states.

    From a point of the outer sphere (radius 2) a share of 1/4 of the paths meets the inner one
    (radius 1), all paths from there meet the outer one. live[d] / N is rho of the vertices met,
    summed over their orders; exact binomial test of each depth.
    """
    a, b = single(inner), single(outer)
    parts = [sphere([0, 0, 0], 1.0, inner), sphere([0, 0, 0], 2.0, outer, inward=True)]
    r = t.render(make(parts, camera([0, 0, 1.5], [0.1, 0.2, 0]), rr_depth=1), 400_000)
    live = column(r, "live")
    state, step = np.array([1.0, 0.0]), np.array([[0, 1], [0.25, 0.75]])
    p = []
    for k in live[1:]:
        state = state * [a, b]
        if r.spp * state.sum() < 10:
            break
        p.append(binomial(int(k), r.spp, float(state.sum())))
        state = state @ step
    t.p(sidak(min(p), len(p)), "survivors")
    t.check(column(r, "rr_killed").sum() == r.spp, "paths end otherwise")
    t.sees(smallest_rate(400_000 * t.effort, min(a, a * b)), 0.03)


@case(4, each={"scheduler": SCHEDULERS})
def clear_slab(t: Trial, scheduler: str) -> None:
    """Segments in a clear slab at normal incidence.

    Fresnel's .04 at each face of index 1.5: exact binomial tests with rates 1, .96, .04, .04 ...
    """
    pane = dicts.cuboid([-50, -50, -1], [50, 50, 0], dicts.glass(1.5))
    scene = dicts.scene(dicts.view([0, 0, 5], [0, 0, 0], size=40), pane, dicts.sky(1), rr_depth=100)
    r = t.render(scene, 625, scheduler=scheduler)
    survivors(t, column(r, "live"), np.array([1.0, 0.96, 0.04]), "segments")
    t.sees(smallest_rate(1_000_000 * t.effort, 0.04), 0.05)


@case(4, each={"depth": (1, 2, 3, 8, 100), "scheduler": SCHEDULERS})
def cut_at_max_depth(t: Trial, depth: int, scheduler: str) -> None:
    """Without roulette all paths of a closed scene live for max_depth segments.

    live = N for d < max_depth and 0 after; all end as depth_cut at the last. Paths that leave the
    room at its edges, at most 1 in 10^7 segments, are counted by how they end, and excluded.
    """
    room = furnace(0.5, 0.5, max_depth=depth, rr_depth=1000, width=20, height=20)
    r = t.render(room, 50, scheduler=scheduler)
    n = r.stats["paths"] - int(t.leaks(r).sum())
    live = leaks_aside(t, r)
    t.check(len(live) == depth and np.all(live == n), "live")
    t.check(column(r, "depth_cut") == [0] * (depth - 1) + [n], "depth_cut")


# ---- the books ----


@case(4, each={"name": NAMES})
def books_balance(t: Trial, name: str) -> None:
    """The ledger adds up with each scheduler; shadow rays and depths keep their bounds.

    Exact: live[d] = ends + live[d + 1], at most one shadow ray per vertex, no depth beyond
    max_depth unless something passes through, no invalid sample; `rays` and `paths` are the sums.
    """
    scene = check_scene(name, 16)
    for scheduler in SCHEDULERS:
        for depth in (-1, 3):
            r = t.render(scene, 16, scheduler=scheduler, max_depth=depth)
            said, live = r.stats, column(r, "live")
            shadow = column(r, "shadow_visible") + column(r, "shadow_occluded")
            ended = sum(column(r, c) for c in ENDS)
            t.check({len(v) for v in said["ledger"].values()} == {len(live)}, "lengths differ")
            t.check(int(np.sum(ended)) == said["paths"] == live[0], "paths")
            t.check(shadow <= live, "more shadow rays than vertices")
            t.check(said["rays"] == int(live.sum() + shadow.sum()), "rays")
            t.check(not column(r, "invalid").any(), "invalid samples")
            passes = "pass" in said["features"]
            t.check(depth < 0 or passes or len(live) <= depth, f"{len(live)} depths")


@case(4, each={"name": ("dielectric_sphere", "medium_in_mesh", "mask", "spheres_300")}, once=True)
def one_ledger_everywhere(t: Trial, name: str) -> None:
    """All devices, schedulers and batch sizes count alike.

    The integers are equal. Level 6 shows this for more scenes and fewer paths, film included; with
    equal bits the paired streams of CPU and GPU have no discordant pair.
    """
    scene, seed = check_scene(name, 64), t.fresh()
    seen = {}
    for device in t.devices:
        spp = 1 if device == "cpu:portable" else 8
        for scheduler in SCHEDULERS:
            for batch in (0, 5000):
                r = t.render(scene, spp, seed=seed, device=device, scheduler=scheduler,
                             batch_size=batch)  # fmt: skip
                first = seen.setdefault(spp, r.stats["ledger"])
                t.check(r.stats["ledger"] == first, f"{device}, {scheduler}, batch {batch}")


# ---- nothing for nothing ----


@case(4)
def nothing_for_nothing(t: Trial) -> None:
    """A scene costs no work for what it lacks.

    Exact: without lights, or with only a sky, no shadow rays; with black walls, no second segment;
    with mirrors, no shadow rays; in an empty scene, one segment; from a light that lights nothing,
    no shadow ray arrives; a lone lamp.
    """
    view = camera([0.4, 0.45, 0.3], [0.6, 0.3, 1.0], 30)
    room = ([0, 0, 0], [1, 1, 1])
    size = {"width": 8, "height": 8}

    def counts(scene: Scene, spp: int = 500) -> tuple[list[int], int]:
        r = t.render(scene, spp)
        return r.stats["live_rays"], int(
            column(r, "shadow_visible").sum() + column(r, "shadow_occluded").sum()
        )

    n = 64 * 500 * t.effort
    dark, shadow = counts(make([box(*room, True, 0.5)], view, **size))
    t.check(dark[0] == n and len(dark) > 5 and shadow == 0, "shadow rays without a light")
    t.check(counts(make([box(*room, True, 0.0)], view, **size)) == ([n], 0), "black walls")
    t.check(counts(make([], view, **size)) == ([n], 0), "an empty scene")
    t.check(counts(make([], view, 1.0, **size)) == ([n], 0), "the sky alone")
    floor = quad([-1, -1, 2], [0, 3, 0], [3, 0, 0], 0.5)
    t.check(counts(make([floor], view, 1.0, **size)) == ([n, n], 0), "shadow rays to the sky")
    lamp = quad([-1, -1, 2], [0, 3, 0], [3, 0, 0], 0.0, 2.0)
    t.check(counts(make([lamp], view, **size)) == ([n], 0), "a lamp alone")
    mirror = Part(*_shell(*room), two_sided=True, material=MIRROR)
    live, shadow = counts(make([mirror], view, lights=[point_light([0.5, 0.5, 0.5])], max_depth=9,
                               rr_depth=100, **size))  # fmt: skip
    t.check(
        len(live) == 9 and live[0] == n and live[-1] >= n - 5, "a path in a box of mirrors ends"
    )
    t.check(shadow == 0, "shadow rays from mirrors")
    below = quad([-5, -5, 1], [0, 10, 0], [10, 0, 0], 0.5)  # lit from behind only
    lit = make([below], view, lights=[point_light([0.5, 0.5, 5.0])], **size)
    r = t.render(lit, 500)
    t.check(not column(r, "shadow_visible").any(), "light through a floor")
    t.check(not r.image.any(), "radiance through a floor")


def _shell(lo: Any, hi: Any) -> tuple[Array, Array]:
    """Vertices and faces of a box from inside."""
    part = box(lo, hi, True)
    return part.vertices, part.faces


# ---- blocks ----


@case(4, each={"scene": ("cornell-box", "open"), "width": (1280, 77)},
      quick=lambda scene, width: width == 77)  # fmt: skip
def blocks_law(t: Trial, scene: str, width: int) -> None:
    """The thread blocks of a bounce are the live rays before it over 256, rounded up.

    blocks[d + 1] = ceil(live[d] / 256), exactly, with all paths in one batch; with several batches
    the sum of theirs: at least that, and at most one more per batch. This is the law of Table 1 of
    the 2016 report on thread compaction.
    """
    height = 720 if width == 1280 else 55
    paths = width * height
    loaded = veriray.load_file(scene)
    r = _one_sample(t, loaded, width, height)
    live, blocks = r.stats["live_rays"], r.stats["blocks"]
    t.check(depths.law_holds(r) is True, f"blocks {blocks[:8]} for live {live[:8]}")
    t.check(len(blocks) == len(live) and live[0] == paths, "depths")
    size = 1000 if width == 77 else 200_000
    r = _one_sample(t, loaded, width, height, batch_size=size)
    parts = math.ceil(paths / size)
    for n, b in zip(r.stats["live_rays"], r.stats["blocks"], strict=True):
        t.check(-(-n // depths.BLOCK_SIZE) <= b <= n // depths.BLOCK_SIZE + parts,
                f"{b} blocks for {n} rays in {parts} batches")  # fmt: skip
    t.figure("live", live[:60])
    t.figure("blocks", blocks[:60])


# ---- the stranger's counts ----


def against(scene: Scene, r: Render, ledger: dict[str, list[int]]) -> list[tuple[float, str]]:
    """How the paths that reach each depth end; then all together, and shadow rays.

    The shadow rays of plastics and black media are left out: each program decides which of those
    that carry nothing it casts. Where roulette is not alike, depths before it alone are compared.
    """
    theirs = {c: np.array(ledger[c], np.int64) for c in LEDGER_COLUMNS}
    own = {c: column(r, c) for c in LEDGER_COLUMNS}
    p = []
    alike = references.roulette_alike(r.stats["features"])
    depths_known = min(len(own["live"]), len(theirs["live"]))
    for d in range(depths_known if alike else min(depths_known, scene.rr_depth - 1)):
        rows = [
            [x[c][d] for c in ledgers.ENDS] + [x["live"][d + 1] if d + 1 < len(x["live"]) else 0]
            for x in (own, theirs)
        ]
        p.append((homogeneous(np.array(rows)), f"ends at depth {d}"))
    worst, where = min(p)
    if not alike:
        return [(sidak(worst, len(p)), where)]
    all_ = ledgers.ledger_test(r.stats["ledger"], ledger, FIRST)
    out = [(sidak(worst, len(p)), where), (all_.p, all_.where)]
    if "plastic" not in r.stats["features"] and np.all(np.asarray(scene.albedo) > 0):
        out.append((all_.shadow_p, f"shadow rays: {all_.shadow_where}"))
    return out


def reference_ledger(t: Trial, name: str) -> tuple[Scene, dict[str, list[int]]]:
    """A scene of scenes/checks and the reference's counts of it."""
    scene = check_scene(name, references.SIZE)
    return scene, theirs(t, name, scene).ledger


@case(4, each={"name": tuple(name for name in NAMES if name not in TUBES)},
      quick=lambda name: name in QUICK)  # fmt: skip
def agrees_with_the_reference(t: Trial, name: str) -> None:
    """Ends of paths by depth, against the independent reference's counts.

    Two-sample tests: at each depth the causes of death among the paths that reach it (chi-square,
    Sidak over depths), all depths together with the largest |z| of the survivors, and shadow rays.
    Sees a survivor fraction of .5 change by 0.5 %, at effort 4 by 0.3 %. A cylinder that shines has
    256 faces here and 1,024 there, which are sampled by solid angle at other places, and other
    lights are sampled otherwise too (`references.lights_alike`): as many rays end, but other ones
    are blocked. So shadow rays of these are not compared.
    """
    scene, ledger = reference_ledger(t, name)
    r = t.render(scene, 64)
    alike = name != "cylinders" and references.lights_alike(r.stats["features"])
    for p, where in against(scene, r, ledger):
        if alike or not where.startswith("shadow rays"):
            t.p(p, where)
    n = 1 / (1 / r.stats["paths"] + 1 / ledger["live"][0])
    t.sees(smallest_rate(n, 0.5), 0.01)
    t.figure("live", np.array(r.stats["live_rays"][:90]) / r.stats["paths"])


@case(4, each={"planted": ("rr_depth", "max_depth", "albedo")},
      quick=lambda planted: planted == "rr_depth")  # fmt: skip
def finds_another_policy(t: Trial, planted: str) -> None:
    """Planted: roulette a bounce later, fewer bounces, walls 1 % brighter: counts are rejected.

    The picture of the first is right, so only the counts reveal it. A closed room in a sphere, with
    long paths.
    """
    scene, ledger = reference_ledger(t, "flip_normals")
    if planted == "rr_depth":
        other = scene.with_(rr_depth=scene.rr_depth + 1)
    elif planted == "max_depth":
        other = scene.with_(max_depth=8)
    else:
        other = dataclasses.replace(scene, reflectance=scene.reflectance * np.float32(1.01))
    judgement = against(scene, t.render(other, 128), ledger)
    p = sidak(min(judgement)[0], len(judgement))
    t.figure("p", p)
    t.check(p < FIRST, f"{planted} passes: p = {p:.2g}")


def _one_sample(t: Trial, scene: Scene, width: int, height: int, **more: Any) -> Render:
    """One sample per pixel with the thrust scheduler, whatever the effort."""
    once = Trial(t.device, t.fresh(), 1, t.threads)
    settings: dict[str, Any] = {"scheduler": "thrust", "batch_size": 2**26, **more}
    r = once.render(scene, 1, width=width, height=height, **settings)
    t.checks, t.samples = t.checks + once.checks, t.samples + once.samples
    return r
