"""The bit contract: a film depends on scene, settings, seed and sample range alone.

The film's exact words and the whole ray ledger are compared as one SHA-256. None of these may
matter: device, instruction set, scheduler, threads, samples in flight, compiled variant, how the
samples are cut into ranges and in which order they come, the tree, the unit of length or of light.

`python -m veriray_validate.levels.bits` writes recorded.json anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from scipy import stats

import veriray
from veriray.rendering import METHODS
from veriray.scene import Scene
from veriray.shipped import SHIPPED
from veriray.units import LATE, unit_begin
from veriray_validate.scenes import Part, box, camera, check_scene, checks, furnace, make, quad
from veriray_validate.trial import Skipped, Trial, case

Array = npt.NDArray[Any]

RECORDED = Path(__file__).resolve().parents[1] / "recorded.json"
#: Small scenes that together hold every shape, material, medium, light, camera and filter.
CHECKS = tuple(checks())
SPP = {False: 24, True: 4}  # of larger scenes, and of those in scenes/checks
SLOW = "cpu:portable"


def mesh_scene() -> Scene:
    """A tree, triangle lights, an environment, a tent filter and clipping."""
    rng = np.random.default_rng(21)
    v = rng.uniform(-1, 1, (120, 1, 3)) + rng.normal(0, 0.2, (120, 3, 3))
    soup = Part(v, np.arange(360), [0.8, 0.5, 0.2], two_sided=True)
    lamp = Part(v[:6] + [0, 2, 0], np.arange(18), 0.1, [5, 4, 3])
    view = camera([0, 0, -4], [0, 0, 0], 50, near_clip=3.2, far_clip=5.0)
    return make([soup, lamp, quad([-3, -1.5, -3], [0, 0, 6], [6, 0, 0], 0.5)], view, 0.3, 24, 20,
                filter="tent")  # fmt: skip


def turned_boxes() -> Scene:
    """Boxes along the axes, rotated about each, and about all: quads of every kind of run."""
    angles = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.7, 0], [0, 0, 1.1], [0.3, 0.5, 0.9]])
    parts = [box([-3] * 3, [3] * 3, True, 0.5), quad([-1, 2.9, -1], [2, 0, 0], [0, 0, 2], 0, 9)]
    for k, turn in enumerate(angles):
        part = box([-0.6] * 3, [0.6] * 3, False, [0.8, 0.2 * k, 0.5])
        matrix = trimesh.transformations.euler_matrix(*turn)[:3, :3]
        part.vertices = part.vertices @ matrix.T + [1.2 * k - 2.4, 1.5 * (k % 2) - 1, k % 3]
        parts.append(part)
    return make(parts, camera([0, 0, -2.9], [0, 0, 0], 90), width=24, height=20)


LARGER: Mapping[str, Callable[[], Scene]] = {
    "cornell-box": lambda: veriray.cornell_box().with_(width=24, height=20),
    "cornell-box by independent": lambda: veriray.cornell_box().with_(
        width=24, height=20, sampler="independent"
    ),
    "open": lambda: veriray.load_file("open").with_(width=24, height=20),
    "turned boxes": turned_boxes,
    "mesh": mesh_scene,
    "gaussian furnace": lambda: furnace(0.5, 1.0, width=24, height=20, filter="gaussian"),
    "touching media": lambda: check_scene("touching_media", 16),
    "300 spheres": lambda: check_scene("spheres_300", 16),
    "thin lens": lambda: check_scene("thinlens", 16),
    "mitchell filter": lambda: check_scene("mitchell", 16),
}
SCENES = (*LARGER, *CHECKS)


def scene_of(name: str) -> tuple[Scene, int]:
    """A scene of SCENES and its samples per pixel."""
    small = name not in LARGER
    return check_scene(name, 16) if small else LARGER[name](), SPP[small]


class Host:
    """A scene on a device: films and ledgers of sample ranges."""

    def __init__(self, t: Trial, scene: Scene, device: str | None = None):
        self.trial = t if device is None else Trial(device)
        self.held = self.trial.native_scene(scene)
        self.size = scene.film.width, scene.film.height
        names = ("max_depth", "rr_depth", "sampler")
        self.settings = {name: getattr(scene, name) for name in names}
        self.asked = t

    def film(self) -> Any:
        """An empty film."""
        return self.trial.native_film(*self.size)

    def render(self, begin: int, end: int, film: Any = None, **more: Any) -> tuple[Any, Array]:
        """Film (a new one, or the given one with more samples) and ledger of a sample range."""
        film = self.film() if film is None else film
        done = self.trial.native.render(
            self.held, film, sample_begin=begin, sample_end=end, **self.settings, **more
        )
        self.asked.check(done["nonfinite_samples"] == 0, "non-finite samples")
        return film, done["ledger"]

    def picture(self, spp: int, seed: int) -> tuple[Array, Array]:
        """Means and standard errors of samples 0 to spp: of groups, and of one that spp cuts."""
        late = self.settings["sampler"] == "sobol" and spp >= LATE
        end = unit_begin(spp) if late else spp
        film, _ = self.render(0, end, seed=seed, units=late)
        tail = self.render(end, spp, seed=seed, units=late)[0] if end < spp else None
        made = film.picture(tail=tail)
        return made.image(), made.stderr()

    def sha(self, end: int, **more: Any) -> str:
        """Hash of samples 0 to `end`."""
        return sha(*self.render(0, end, **more))


def sha(film: Any, ledger: Array) -> str:
    """SHA-256 of the film's integers and the ledger's."""
    return hashlib.sha256(film.words().tobytes() + ledger.tobytes()).hexdigest()


def merged(host: Host, spp: int, schedulers: tuple[str, str]) -> tuple[str, str, bool]:
    """Hash of ranges added in shuffled order, of a film resumed in that order, and samples right.

    schedulers: of the even and the odd ranges.
    """
    a, b, c = sorted({1, spp // 6 + 1, spp // 2})[-3:] if spp > 6 else (1, 2, 3)
    ranges = [(b, c), (0, a), (c, spp), (a, b)]
    total, resumed = host.film(), host.film()
    sums = np.zeros((0, 9), np.uint64)
    again = np.zeros((0, 9), np.uint64)
    for k, (begin, end) in enumerate(ranges):
        film, ledger = host.render(begin, end, scheduler=schedulers[k % 2])
        total.add(film)
        sums = add_rows(sums, ledger)
        again = add_rows(again, host.render(begin, end, resumed)[1])
    return sha(total, sums), sha(resumed, again), total.samples == resumed.samples == spp


def in_parts(host: Host, spp: int) -> str:
    """Hash of every third pixel, then the next ones, then the rest, rendered by list."""
    film, every = host.film(), np.arange(host.size[0] * host.size[1], dtype=np.uint32)
    counts = np.zeros((0, 9), np.uint64)
    for k, scheduler in enumerate(METHODS):
        listed = every[k :: len(METHODS)]
        counts = add_rows(counts, host.render(0, spp, film, scheduler=scheduler, pixels=listed)[1])
    return sha(film, counts)


def add_rows(a: Array, b: Array) -> Array:
    """Sum of two ledgers of any lengths."""
    short, long = sorted((a, b), key=len)
    return np.asarray(long + np.pad(short, ((0, len(long) - len(short)), (0, 0))))


# ---- one hash ----


@case(6, each={"name": SCENES}, once=True)
def one_hash(t: Trial, name: str) -> None:
    """One SHA-256 in every way of rendering: device, scheduler, threads, batch, variant, resume.

    These give equal hashes: all devices and instruction sets of this machine x fused, thrust,
    wavefront x 1, 2, 16 threads x samples in flight (half of these ways for slow code); code for
    absent features forced on; the run repeated, cut into ranges that are merged in shuffled order,
    stopped and resumed, and rendered by lists of pixels.
    """
    scene, spp = scene_of(name)
    wanted: str | None = None
    ways: list[dict[str, Any]] = [
        {"scheduler": scheduler, "threads": threads, "batch": batch}
        for scheduler in METHODS
        for threads, batch in ((1, 0), (2, 300), (2, 1000), (2, 0), (1, 77), (16, 0))
    ]
    ways += [{}, *({"scheduler": scheduler, "all_features": True} for scheduler in METHODS)]
    ways += [{"scheduler": "wavefront-unsorted", "batch": batch} for batch in (0, 33)]
    for device in t.devices:
        host = Host(t, scene, device)
        mine = ways[::2] if device == SLOW else ways
        for way in (*mine, *[{}] * (4 if name in ("cornell-box", "mesh") else 0)):
            found = host.sha(spp, **way)
            wanted = wanted or found
            t.check(found == wanted, f"{device}: different bits with {way}")
        for order in (("thrust", "fused"), ("fused", "wavefront")):
            added, resumed, complete = merged(host, spp, order)
            t.check(added == wanted, f"{device}: different bits from merged ranges, {order}")
            t.check(resumed == wanted, f"{device}: different bits when resumed, {order}")
            t.check(complete, "samples of merged films")
        t.check(in_parts(host, spp) == wanted, f"{device}: different bits from lists of pixels")


@case(6, once=True)
def films_add_across_devices(t: Trial) -> None:
    """Half of the samples on one device, half on another, through the films' states.

    The film that takes both states, and the sum of their 128-bit words, equal the whole render.
    """
    scene, spp = scene_of("cornell-box")
    first = t.devices[0]
    host = Host(t, scene, first)
    whole, half = host.render(0, spp)[0].words(), host.render(0, 10)[0]
    a = half.words()
    for device in t.devices:
        rest = Host(t, scene, device).render(10, spp)[0]
        b = rest.words()
        low = a[..., 0::2] + b[..., 0::2]
        high = a[..., 1::2] + b[..., 1::2] + (low < a[..., 0::2])
        t.check((low == whole[..., 0::2]).all() and (high == whole[..., 1::2]).all(), device)
        total = host.film()
        for part in (rest, half):
            total.add_state(part.state())
        t.check(total.words() == whole, f"{device}: another film of both states")
        t.check(total.samples == spp, "samples of both states")


@case(6)
def batches_of_a_render(t: Trial) -> None:
    """A render in equal batches is the render in one go, and every sample counts.

    Equal to films of the native module: the whole bit for bit, and each batch's mean to the sums of
    its range over their number. The ledgers are equal, with as many paths as were requested. The
    number of paths in flight does not divide a batch.
    """
    scene, spp = scene_of("cornell-box")
    seed, host = t.fresh(), Host(t, scene)
    for batches in (0, 2, 3, 24):
        r = t.render(scene, spp, seed=seed, batches=batches, batch_size=77, sampler=scene.sampler)
        film, ledger = host.render(0, r.spp, seed=seed)
        whole = zip((r.image, r.stderr), host.picture(r.spp, seed), strict=True)
        t.check(all(np.array_equal(a, b) for a, b in whole), f"another film, {batches} batches")
        t.check(np.transpose(list(r.stats["ledger"].values())) == ledger, "another ledger")
        t.check(r.stats["paths"] == r.width * r.height * r.spp == film.samples * r.image.size // 3)
        size = r.spp // (batches or 1)
        for k, mean in enumerate(() if r.batch_means is None else r.batch_means):
            piece, _ = host.render(k * size, (k + 1) * size, seed=seed)
            t.check(mean == piece.sums() / size, f"another mean of batch {k} of {batches}")
        t.check(batches == (0 if r.batch_means is None else len(r.batch_means)), "batches kept")


# ---- exact relations ----


@case(6, each={"name": SCENES})
def light_times_a_power_of_two(t: Trial, name: str) -> None:
    """All emission times 2^k: the same integers, the picture times 2^k.

    Equal bits for k = 20, 10, -20: there is no clamp and no absolute threshold of radiance.
    """
    scene, spp = scene_of(name)
    host = Host(t, scene)
    film, ledger = host.render(0, spp)
    plain = film.resolve()
    t.check(all(v.any() for v in plain) or name in CHECKS, "a dark picture shows nothing")
    for exponent in (20, 10, -20):
        other, counts = Host(t, scene.with_emission_scaled(2.0**exponent)).render(0, spp)
        t.check(sha(film, ledger) == sha(other, counts), f"different bits for 2^{exponent}")
        for value, times in zip(plain, other.resolve(), strict=True):
            t.check(value * np.float32(2.0**exponent) == times, f"picture for 2^{exponent}")


@case(6, each={"name": SCENES})
def lengths_times_a_power_of_two(t: Trial, name: str) -> None:
    """All lengths times 2^k: the same bits.

    Equal for k = 7, 10, -20, 20, 30: no absolute epsilon anywhere.
    """
    scene, spp = scene_of(name)
    wanted = Host(t, scene).sha(spp)
    for exponent in (7, 10, -20, 20, 30) if name in LARGER else (10, -20):
        t.check(Host(t, scene.scaled(2.0**exponent)).sha(spp) == wanted, f"lengths, {exponent}")


@case(6)
def an_object_that_no_ray_can_reach(t: Trial) -> None:
    """A quad, or a mesh, inside a closed block changes no bit.

    Flat primitives without a tree, and a room of triangles whose tree becomes another one.
    """
    view = camera([0.2, 0.4, 0.1], [0.6, 0.4, 0.8], 60)
    ball = trimesh.creation.icosphere(2, radius=0.1)
    room = box([0, 0, 0], [1, 1, 1], True, 0.7, 0.4)
    block = box([0.6, 0.2, 0.6], [0.9, 0.5, 0.9], False, 0.5)
    hidden = quad([0.7, 0.3, 0.7], [0.1, 0, 0], [0, 0.1, 0], 0.9)
    statue = Part(ball.vertices + [0.3, 0.3, 0.6], ball.faces, 0.6)
    inside = Part(ball.vertices + [0.75, 0.35, 0.75], ball.faces, 0.9)
    for seen, unseen in (([room, block], hidden), ([room, block, statue], inside)):
        pair = [Host(t, make(p, view, width=16, height=16)) for p in (seen, [*seen, unseen])]
        t.check(pair[0].sha(24) == pair[1].sha(24), "what nobody sees changes the picture")


@case(6, each={"seed": (1, 2)})
def another_order_of_triangles(t: Trial, seed: int) -> None:
    """Triangles of a mesh in another order, and with rotated indices: the same bits.

    The tree is built from another list; hits are those of the triangles, not of boxes or leaves.
    """
    mesh = trimesh.creation.icosphere(3)
    rng = np.random.default_rng(seed)
    vertices = mesh.vertices * (1 + 0.1 * rng.standard_normal(len(mesh.vertices)))[:, None]
    lamp = quad([-1, 3, -1], [2, 0, 0], [0, 0, 2], 0.1, 5.0)
    floor = quad([-4, -1.2, -4], [0, 0, 8], [8, 0, 0], 0.5)
    view = camera([0, 1, -5], [0, 0, 0], 40)
    films = []
    for order in (np.arange(len(mesh.faces)), rng.permutation(len(mesh.faces))):
        body = Part(vertices, mesh.faces[order], 0.7)
        host = Host(t, make([lamp, floor, body], view, 0.2, 24, 24))
        t.check(host.held.tree, "no tree")
        films.append(host.sha(16))
    t.check(films[0] == films[1], "different bits for another order")


@case(6)
def many_samples_of_few_pixels(t: Trial) -> None:
    """Films of 30, 37, 16 and 1 pixels with 200, 7, 257 and 1,100 samples: all schedulers agree.

    A tile of a CPU sums 64 samples of a pixel at a time, side by side with other pixels; of one
    pixel alone, samples are side by side.
    """
    for width, height, spp in ((6, 5, 200), (37, 1, 7), (16, 1, 257), (1, 1, 1100)):
        scene = veriray.cornell_box().with_(width=width, height=height)
        films = {Host(t, scene).sha(spp, scheduler=scheduler) for scheduler in METHODS}
        t.check(len(films) == 1, f"{width} x {height}, {spp} samples")


@case(6)
def faintest_light(t: Trial) -> None:
    """A lamp of 1e-30 in a room that reflects 1e-9, mitchell filter: all schedulers agree.

    Samples are subnormal until they are scaled for the film.
    """
    parts = [
        box([-3] * 3, [3] * 3, True, 1e-9),
        quad([-1, 2.9, -1], [2, 0, 0], [0, 0, 2], 0, 1e-30),
    ]
    scene = make(parts, camera([0, 0, -2.9], [0, 0, 0], 60), width=24, height=20, filter="mitchell")
    host = Host(t, scene)
    t.check(host.render(0, 16)[0].words().any(), "no light")
    hashes = {host.sha(16, scheduler=scheduler) for scheduler in METHODS}
    t.check(len(hashes) == 1, "different bits")


@case(6)
def dust_shows_no_tree(t: Trial) -> None:
    """3,000 triangles of 1e-8 to 1e-7 of the scene, in trees by both builders: the same hits.

    Distances and primitives are equal bit for bit, for 100,000 rays, half of them aimed. Edge
    functions of edge-on triangles may be rounded to 0 for rays far beside them.
    """
    rng = t.rng
    centre = np.stack([np.linspace(-0.5, 1, 3000), np.zeros(3000), np.zeros(3000)], axis=1)
    size = 10 ** rng.uniform(-8, -7, (3000, 1, 1))
    corners = centre[:, None] + size * rng.standard_normal((3000, 3, 3))
    scene = make([Part(corners, np.arange(9000), 0.5)], camera([0, 0, 0], [0, 0, 1], 90))
    origins = rng.normal(0, 1.2, (100_000, 3))
    directions = rng.normal(0, 1, (100_000, 3))
    directions[::2] = centre[rng.integers(0, 3000, 50_000)] - origins[::2]
    hits = [t.native.intersect(t.native_scene(scene, builder), origins, directions)
            for builder in ("sah", "ploc")]  # fmt: skip
    t.check((hits[0][1] >= 0).sum() > 1000, "few hits")
    t.check(hits[0][0].tobytes() == hits[1][0].tobytes(), "distances")
    t.check(hits[0][1] == hits[1][1], "primitives")


@case(6)
def every_width_of_the_tree(t: Trial) -> None:
    """Nodes of 2, 4 and 8 boxes find the same hits.

    Distances and primitives are equal bit for bit, for rays from inside, past and through a mesh.
    Only CUDA modules contain widths other than their own.
    """
    if not hasattr(t.native, "intersect_width"):
        raise Skipped("the CPU modules have one width")
    mesh = trimesh.creation.icosphere(4)
    rng = t.rng
    vertices = mesh.vertices * (1 + 0.1 * rng.standard_normal(len(mesh.vertices)))[:, None]
    held = t.native_scene(make([Part(vertices, mesh.faces, 0.5)]))
    origins = rng.normal(0, 1.2, (200_000, 3))
    directions = rng.normal(0, 1, (200_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    t_, primitive = t.native.intersect(held, origins, directions)
    for width in (2, 4, 8):
        other, index, _ = t.native.intersect_width(held, width, origins, directions)
        t.check(other.tobytes() == t_.tobytes(), f"distances at width {width}")
        t.check(index == primitive, f"primitives at width {width}")


@case(6)
def replayed_paths_add_up(t: Trial) -> None:
    """Single paths, replayed on the CPU, add up to the film's sums.

    Relative 1e-6 (a sum of eight float32 numbers), in four scenes, whatever device made the film.
    """
    try:
        veriray.device.select("cpu")
    except veriray.DeviceError as error:
        raise Skipped(str(error)) from None
    for scene in (scene_of("open")[0], *(check_scene(n, 16) for n in REPLAYED)):
        small = scene.with_(width=4, height=3)
        once = Trial(t.device, t.fresh(), 1, t.threads)
        r = once.render(small, 8)
        for y in range(3):
            for x in range(4):
                paths = [veriray.trace_path(small, x, y, k, seed=r.seed) for k in range(8)]
                total = np.sum([np.array(p[-1]["radiance"]) for p in paths], axis=0)
                t.check(np.allclose(total / 8, r.image[y, x], rtol=1e-6), f"pixel {x}, {y}")


REPLAYED = ("touching_media", "mask", "thinlens")


# ---- lengths that are not a power of two ----


def nearly(t: Trial, a: Scene, b: Scene) -> None:
    """Two scenes give the same picture but for rounding, which sends a few paths elsewhere."""
    seed = t.fresh()
    once = Trial(t.device, seed, 1, t.threads)
    x, y = (once.render(s, 64, seed=seed).image.astype(np.float64) for s in (a, b))
    t.samples += once.samples
    t.check((np.abs(y - x) > 1e-4 * x).mean() < 0.01, "more than 1 % of the pixels differ")
    # as many paths turn brighter as darker, a few of them by much
    d = (y - x).mean(axis=2).ravel()
    off = abs(d.sum()) - 1e-6 * x.sum() / 3
    t.p(2 * float(stats.norm.sf(max(off, 0) / math.sqrt((d * d).sum() or 1.0))), "means differ")


@case(8, each={"factor": (1e-6, 1e-3, 1e3, 1e9)})
def lengths_times_another_factor(t: Trial, factor: float) -> None:
    """The Cornell box in other units of length.

    Only rounding differs: at most 1 % of the pixels by more than 1e-4 of their value, and the mean
    by no more than the sum of random signs allows.
    """
    scene = scene_of("cornell-box")[0]
    nearly(t, scene, scene.scaled(factor))


@case(8)
def moved_by_a_million(t: Trial) -> None:
    """The Cornell box moved by 1e6 in each axis.

    Recentred in float64 before float32: the same picture but for rounding, as above.
    """
    scene = scene_of("cornell-box")[0]
    to_world = np.array(scene.camera.to_world)
    to_world[:3, 3] += 1e6
    moved = dataclasses.replace(
        scene,
        vertices=scene.vertices + 1e6,
        camera=dataclasses.replace(scene.camera, to_world=to_world),
    )
    nearly(t, scene, moved)


# ---- recorded values ----


#: Largest depth of recorded films. In glass_mesh total reflection traps paths for ever.
DEPTHS = {"checks/glass_mesh": 64}
ALONE = " by independent"


def recorded_scene(name: str, width: int) -> Scene:
    """A scene as recorded.json names it, its depth as in DEPTHS, else without a limit."""
    if name.endswith(ALONE):
        return recorded_scene(name.removesuffix(ALONE), width).with_(sampler="independent")
    if name in SHIPPED:
        scene = veriray.load_file(name).with_(width=width, height=width)
    else:
        scene = check_scene(name.removeprefix("checks/"), width)
    return scene.with_(max_depth=DEPTHS.get(name, -1))


def record(device: str, scene: Scene, name: str, spp: int, **settings: Any) -> dict[str, Any]:
    """An entry of recorded.json: hashes of scene, film and ledger, and the first live rays."""
    r = veriray.render(scene, spp=spp, device=device, **settings)
    ledger = json.dumps(r.stats["ledger"], sort_keys=True).encode()
    return {
        "scene": name,
        "width": scene.film.width,
        "spp": spp,
        "max_depth": scene.max_depth,
        "scene_sha256": r.stats["scene_sha256"],
        "film_sha256": r.film_sha256,
        "ledger_sha256": hashlib.sha256(ledger).hexdigest(),
        "live_rays": r.stats["live_rays"][:8],
    }


def label(entry: Mapping[str, Any]) -> str:
    """Name of an entry of recorded.json."""
    return f"{entry['scene']} {entry['width']}x{entry['width']}x{entry['spp']}"


ENTRIES = {label(entry): entry for entry in json.loads(RECORDED.read_text("utf-8"))}


@case(6, once=True)
def every_check_is_recorded(t: Trial) -> None:
    """recorded.json holds each scene of scenes/checks; at least 20 scenes.

    A new scene needs a line: python -m veriray_validate.levels.bits.
    """
    recorded = {entry["scene"] for entry in ENTRIES.values()}
    missing = [name for name in CHECKS if f"checks/{name}" not in recorded]
    t.check(not missing, f"not recorded: {', '.join(missing)}")
    t.check(len(CHECKS) >= 20, f"{len(CHECKS)} scenes in scenes/checks")


def is_small(entry: str) -> bool:
    """Whether a recorded film takes little time on any device."""
    return bool(ENTRIES[entry]["width"] ** 2 * ENTRIES[entry]["spp"] < 100_000)


@case(6, each={"entry": ENTRIES}, once=True, quick=is_small)
def recorded_films(t: Trial, entry: str) -> None:
    """The films of recorded.json, from every device and in every way.

    The hashes on this processor or GPU, with its driver and compiler, equal the recorded ones,
    under fused, thrust and wavefront; for the large film also with threads x samples in flight, but
    not with slow code. `one_hash` tests all ways for small films.
    """
    wanted = ENTRIES[entry]
    name, spp, small = wanted["scene"], wanted["spp"], is_small(entry)
    scene = recorded_scene(name, wanted["width"])
    for device in t.devices:
        if not small and device == SLOW:
            continue  # the small films say the same of that code
        ways: list[dict[str, Any]] = [{"scheduler": scheduler} for scheduler in METHODS]
        if not small:
            ways += [
                {"scheduler": scheduler, "threads": threads, "batch_size": batch}
                for scheduler in METHODS
                for threads in (1, 2)
                for batch in (0, 3000)
            ]
        for way in ways:
            found = record(device, scene, name, spp, **way)
            differ = [key for key in found if found[key] != wanted[key]]
            t.check(not differ, f"{device}, {way}: other {', '.join(differ)}")


def write() -> None:
    """Regenerates recorded.json with the fastest CPU device."""
    lines = [("cornell-box", 32, 16), ("open", 32, 16), ("cornell-box", 128, 64)]
    lines += [("cornell-box" + ALONE, 32, 16), ("checks/gaussian" + ALONE, 24, 4),
              ("cornell-box" + ALONE, 128, 64), ("checks/thinlens", 24, 80)]  # fmt: skip
    lines += [(f"checks/{name}", 24, 4) for name in CHECKS]
    rows = ",\n".join(
        json.dumps(record("cpu", recorded_scene(name, width), name, spp))
        for name, width, spp in lines
    )
    RECORDED.write_text(f"[\n{rows}\n]\n", "utf-8")


if __name__ == "__main__":
    write()
