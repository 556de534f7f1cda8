"""Trees: properties of both builders' trees, and that no picture depends on the builder."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import veriray as vr
from veriray.native_scene import BUILDERS, CATCH_UP, choose_builder, native_scene_arguments
from veriray.rendering import prepare
from veriray_validate.leaks import displaced_icosphere, mesh_scene
from veriray_validate.levels.geometry import brute_force, random_rays
from veriray_validate.scenes import Part, camera, disk, make, sphere

Array = npt.NDArray[Any]

MAX_DEPTH = 62
PAD = 2.0**-20
LEAF, EMPTY = 1 << 31, 0xFFFFFFFF
WIDTHS = (2, 4, 8)


def triangles(corners: Array) -> Part:
    """Corners (n, 3, 3)."""
    return Part(corners, np.arange(3 * len(corners)), 0.5)


def around(centres: Array, size: Any, seed: int = 7) -> Part:
    """Triangles of about `size` at the centres (n, 3)."""
    rng = np.random.default_rng(seed)
    offsets = rng.normal(size=(len(centres), 3, 3)) * np.reshape(size, (-1, 1, 1))
    return triangles(centres[:, None] + offsets)


def soup(n: int, size: float = 0.02) -> Part:
    return around(np.random.default_rng(n).uniform(-1, 1, (n, 3)), size, n)


def equal(n: int) -> Part:
    return triangles(np.tile([[0.3, 0.2, 0.1], [0.35, 0.2, 0.1], [0.3, 0.25, 0.12]], (n, 1, 1)))


def same_centre(n: int) -> Part:
    """Boxes of all sizes about one point."""
    size = np.random.default_rng(1).uniform(0.1, 1, (n, 1, 1))
    one = np.array([[-1.0, -1, -1], [1, 1, 1], [1, -1, 0.5]]) * 0.1
    return triangles(one * size)


def flat(n: int) -> Part:
    part = soup(n)
    part.vertices[:, 1] = 0.25
    return part


def graded(n: int, size: float = 1e-5) -> Part:
    """Along a line, each farther from the next: only one pair is mutually nearest."""
    x = np.cumsum(1.0 + 1e-3 * np.arange(n))
    x *= 1.5 / x[-1]
    return around(np.stack([x - 0.5, 0 * x, 0 * x], axis=1), size)


def powers(n: int) -> Part:
    """Distances from 1e-30 to 1."""
    size = 10.0 ** np.linspace(-30, 0, n)
    return around(np.stack([size, size, 0 * size], axis=1), 0.1 * size)


def all_kinds() -> list[Part]:
    rng = np.random.default_rng(3)
    p = rng.uniform(-1, 1, (400, 3))
    return [
        soup(300, 0.1),
        *(sphere(c, r, 0.4) for c, r in zip(p[:150], rng.uniform(0.01, 0.1, 150), strict=True)),
        *(disk(c, [r, 0, 0.1 * r], [0, 0.5 * r, 0], 0.6)
          for c, r in zip(p[200:], rng.uniform(0.01, 0.1, 200), strict=True)),
        sphere([0, 0, 0.9], 0.05, 0.0, 20.0),
    ]  # fmt: skip


SHAPES: dict[str, Callable[[], list[Part]]] = {
    "one": lambda: [soup(1, 1e-3)],
    "two": lambda: [soup(2, 1e-3)],
    "three": lambda: [soup(3, 1e-3)],
    "127": lambda: [soup(127)],
    "129": lambda: [soup(129)],
    "soup": lambda: [soup(20_000)],
    "hundred large": lambda: [soup(100, 0.4)],
    "large triangles": lambda: [soup(2000, 0.4)],
    "equal": lambda: [equal(2000)],
    "many equal": lambda: [equal(100_000)],
    "pairs": lambda: [soup(500), soup(500)],
    "same centre": lambda: [same_centre(5000)],
    "flat": lambda: [flat(3000)],
    "graded": lambda: [graded(3000)],
    "graded, of the size of rounding": lambda: [graded(3000, 3e-8)],
    "powers": lambda: [powers(1000)],
    "all kinds": all_kinds,
}
#: Of many equal triangles every ray visits all.
TRACED = [name for name in SHAPES if name != "many equal"]


def scene_of(name: str, scale: float = 1.0, **settings: Any) -> vr.Scene:
    """Seen from the origin."""
    scene = make(SHAPES[name](), camera([0, 0, 0], [0, 0, 1], 90), 1.0, 16, 16, **settings)
    return scene if scale == 1.0 else scene.scaled(scale)


def native(scene: vr.Scene, device: str, builder: str) -> tuple[Any, Any]:
    """The native module and its scene."""
    chosen, _ = vr.device.select(device)
    host = chosen.native.Scene(
        **native_scene_arguments(scene), device=chosen.index, builder=builder
    )
    assert "bvh" in host.features and host.tree["builder"] == builder
    return chosen.native, host


def split(nodes: Array, width: int) -> tuple[Array, Array, Array]:
    """lo, hi (n, width, 3) float64 and child (n, width)."""
    boxes = nodes[:, : 6 * width].copy().view(np.float32).reshape(-1, 2, 3, width)
    lo, hi = boxes.transpose(1, 0, 3, 2).astype(np.float64)
    return lo, hi, nodes[:, 6 * width :]


def primitive_boxes(scene: vr.Scene, host: Any) -> tuple[Array, Array]:
    """lo, hi of the triangles in normalised units, as float32 holds their corners."""
    origin, unit = host.frame
    v = ((scene.vertices - origin) / unit).astype(np.float32).astype(np.float64)[scene.triangles]
    return v.min(axis=1), v.max(axis=1)


def check_tree(nodes: Array, order: Array, width: int, count: int, largest: int = 8) -> None:
    """A tree over `count` primitives, each in one leaf; boxes hold those below them.

    largest: primitives of a leaf at most.
    """
    lo, hi, child = split(nodes, width)
    assert sorted(order.tolist()) == list(range(count))
    used, inner = child != EMPTY, (child & LEAF) == 0
    assert (used | (np.isposinf(lo).all(axis=2) & np.isneginf(hi).all(axis=2))).all()
    # Every node but the root is one node's child, and leaves share out the slots.
    assert sorted(child[inner].tolist()) == list(range(1, len(nodes)))
    leaves = child[used & ~inner]
    first, number = (leaves & ~np.uint32(LEAF)) >> 4, (leaves & 15) + 1
    at = np.argsort(first)
    assert np.array_equal(first[at], np.cumsum([0, *number[at]])[:-1]) and number.sum() == count
    assert number.max() <= largest
    parent, slot = np.nonzero(inner)
    below = child[parent, slot]
    assert (lo[parent, slot] <= lo[below].min(axis=1)).all()
    assert (hi[parent, slot] >= hi[below].max(axis=1)).all()
    depth = np.zeros(len(nodes), int)
    for p, c in sorted(zip(parent, below, strict=True)):  # parents stand before their children
        assert c > p
        depth[c] = depth[p] + 1
    assert depth.max() < MAX_DEPTH


def check_boxes(nodes: Array, order: Array, width: int, scene: vr.Scene, host: Any) -> None:
    """Leaves hold their triangles' boxes, padded."""
    lo, hi, child = split(nodes, width)
    low, high = primitive_boxes(scene, host)
    for node, slot in zip(*np.nonzero((child != EMPTY) & (child & LEAF != 0)), strict=True):
        first, number = (int(child[node, slot]) & ~LEAF) >> 4, (int(child[node, slot]) & 15) + 1
        held = order[first : first + number]
        held = held[held < len(low)]
        assert (lo[node, slot] <= low[held] - PAD).all()
        assert (hi[node, slot] >= high[held] + PAD).all()


@pytest.mark.parametrize("name", SHAPES)
def test_structure(name: str) -> None:
    scene = scene_of(name)
    module, host = native(scene, "cpu", "ploc")
    count = len(scene.triangles) + len(scene.spheres) + len(scene.disks)
    assert host.tree["references"] == count and host.primitives["dropped"] == 0
    assert host.tree["depth"] <= MAX_DEPTH
    orders = []
    for width in sorted({*WIDTHS, host.tree["width"]}):
        nodes, order = module.host_ploc(host, width)
        check_tree(nodes, order, width, count, max(8, host.tree["width"]))
        check_boxes(nodes, order, width, scene, host)
        orders.append(order)
    assert all(np.array_equal(o, orders[0]) for o in orders)


def test_depth_is_bounded_where_few_pairs_are_nearest_both_ways() -> None:
    depth = native(scene_of("same centre"), "cpu", "ploc")[1].tree["depth"]
    assert 50 < depth <= MAX_DEPTH, "the scene no longer calls for the bound"
    # Equally near: halved each round.
    assert native(scene_of("many equal"), "cpu", "ploc")[1].tree["depth"] == 17


@pytest.mark.parametrize("name", ["soup", "many equal", "all kinds"])
def test_threads_do_not_show(name: str) -> None:
    module, host = native(scene_of(name), "cpu", "ploc")
    one = module.host_ploc(host, 4, threads=1)
    for threads in (2, 7):
        many = module.host_ploc(host, 4, threads=threads)
        assert all(np.array_equal(a, b) for a, b in zip(one, many, strict=True))


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
@pytest.mark.parametrize("name", TRACED)
def test_hits_are_those_of_the_sah_tree(device: str, name: str, scale: float) -> None:
    scene = scene_of(name, scale)
    rng = np.random.default_rng(5)
    n = 4000
    o, d = random_rays(rng, n)
    v = scene.vertices[scene.triangles].mean(axis=1)
    d[::2] = (v[rng.integers(0, len(v), n)] / scale - o)[::2]  # half of them aimed
    module, sah = native(scene, device, "sah")
    _, ploc = native(scene, device, "ploc")
    t0, p0 = module.intersect(sah, o * scale, d)
    t1, p1 = module.intersect(ploc, o * scale, d)
    assert t0.tobytes() == t1.tobytes() and np.array_equal(p0, p1)
    assert (p0 >= 0).any()


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
@pytest.mark.parametrize("name", TRACED)
def test_rays_side_by_side_meet_what_each_meets_alone(cpu: str, name: str, scale: float) -> None:
    """Bundles of 16 rays whose spread is 1e-7 to 1; `intersect` traces them together and alone."""
    scene = scene_of(name, scale)
    rng = np.random.default_rng(6)
    n = 600
    o, d = (np.repeat(rays, 16, axis=0) for rays in random_rays(rng, n))
    v = scene.vertices[scene.triangles].mean(axis=1)
    at = v[rng.integers(0, len(v), n)] / scale
    d[: 8 * n] = (np.repeat(at, 16, axis=0) - o)[: 8 * n]  # half of them aimed
    d[::512] = [0.0, 0.0, 1.0]
    spread = np.repeat(10.0 ** rng.uniform(-7, 0, (2, n)), 16, axis=1)[..., None]
    o[: 4 * n] += (spread[0] * rng.uniform(-1, 1, o.shape))[: 4 * n]  # a quarter from one point
    d += spread[1] * rng.uniform(-1, 1, d.shape)
    module, host = native(scene, cpu, "sah")
    _, primitive = module.intersect(host, o * scale, d)
    assert (primitive >= 0).any()


@pytest.mark.parametrize("size", [1e-7, 3e-8, 1e-8])
def test_no_tree_shows_in_triangles_of_the_size_of_rounding(
    device: str, size: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For triangles seen edge-on, edge functions of rays far beside them are rounded to 0."""
    monkeypatch.setitem(SHAPES, "tiny", lambda: [graded(3000, size)])
    scene = scene_of("tiny")
    rng = np.random.default_rng(5)
    o, d = random_rays(rng, 100_000)
    centre = scene.vertices[scene.triangles].mean(axis=1)
    d[::2] = (centre[rng.integers(0, len(centre), len(d))] - o)[::2]
    module, sah = native(scene, device, "sah")
    _, ploc = native(scene, device, "ploc")
    t, primitive = module.intersect(sah, o, d)
    assert (primitive >= 0).sum() > 1000
    others = [module.intersect(ploc, o, d)]
    if hasattr(module, "intersect_width"):
        others += [module.intersect_width(ploc, width, o, d)[:2] for width in WIDTHS]
    for other, index in others:
        assert other.tobytes() == t.tobytes() and np.array_equal(index, primitive)


@pytest.mark.parametrize("name", ["hundred large", "large triangles"])
def test_hits_are_those_of_brute_force(device: str, name: str) -> None:
    scene = scene_of(name)
    module, host = native(scene, device, "ploc")
    o, d = random_rays(np.random.default_rng(9), 1000)
    _, expected, _, clear = brute_force(scene, o, d)
    assert clear.mean() > 0.5 and (expected[clear] >= 0).sum() > 10
    _, found = module.intersect(host, o, d)
    assert np.array_equal(found[clear], expected[clear])


@pytest.mark.parametrize("name", ["one", "soup", "all kinds", "equal"])
def test_films_are_those_of_the_sah_tree(device: str, name: str) -> None:
    scene = scene_of(name)
    films = {b: vr.render(scene, 8, device=device, builder=b) for b in BUILDERS}
    assert len({film.film_sha256 for film in films.values()}) == 1
    auto = choose_builder(device.split(":")[0], len(scene.triangles), 0)
    assert [films[b].stats["tree"]["builder"] for b in BUILDERS] == [auto, "sah", "ploc"]
    ledgers = [film.stats["ledger"] for film in films.values()]
    assert ledgers[0] == ledgers[1] == ledgers[2]
    assert prepare(scene, device, builder="ploc")["tree"] == films["ploc"].stats["tree"]
    for film in films.values():
        assert film.stats["tree"]["cost"] > 0 and film.stats["tree"]["seconds"] > 0


@pytest.mark.parametrize(
    "others", [(), (sphere([0, 0, 0.2], 0.3), disk([0.1, 0, 0], [0.4, 0, 0], [0, 0.4, 0]))]
)
def test_triangles_without_area_are_as_if_not_there(device: str, others: tuple[Part, ...]) -> None:
    corners = soup(3000).vertices.reshape(-1, 3, 3)
    corners[1::5, 1] = corners[1::5, 0]
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)

    def film(kept: Array) -> tuple[str, int]:
        view = camera([0, 0.2, 4], [0, 0, 0], 40)
        scene = make([triangles(kept), *others], view, 1.0, 32, 24)
        render = vr.render(scene, device=device, spp=2)
        return render.film_sha256, render.stats["primitives"]["dropped"]

    assert film(corners) == (film(corners[area > 0])[0], int((area == 0).sum()))


def test_progress_stops_the_build(device: str) -> None:
    scene = scene_of("soup")
    shares: list[float] = []

    def stop(share: float) -> None:
        shares.append(share)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        prepare(scene, device, progress=stop, builder="ploc")
    assert len(shares) == 1 and 0 < shares[0] < 1
    shares.clear()
    assert prepare(scene, device, progress=shares.append, builder="ploc")["tree"]["nodes"] > 0
    assert len(shares) > 2 and shares == sorted(shares)


def test_auto_takes_the_other_tree_where_memory_is_short(
    cpu: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = vr.device.select(cpu)[0].native
    real, tried = module.Scene, []

    def short(**arguments: Any) -> Any:
        tried.append(arguments["builder"])
        if arguments["builder"] == "ploc":
            raise module.OutOfMemoryError("tree: needs 9 bytes of device memory, 1 are free")
        return real(**arguments)

    monkeypatch.setattr(module, "Scene", short)
    monkeypatch.setattr(sys.modules["veriray.native_scene"], "choose_builder", lambda *_: "ploc")
    scene = scene_of("three")
    for _ in range(2):
        assert prepare(scene, cpu)["tree"]["builder"] == "sah"
    assert tried == ["ploc", "sah"]
    with pytest.raises(vr.OutOfMemoryError, match="needs 9 bytes of device memory, 1 are free"):
        prepare(scene, cpu, builder="ploc")
    assert tried == ["ploc", "sah", "ploc", "ploc"]  # the last without the tree by sah


SHORT_OF_MEMORY = """
import resource, sys
import numpy as np
import veriray
from veriray.native_scene import native_scene_arguments
from veriray.rendering import prepare
from veriray_validate.scenes import Part, camera, make

vertices = np.random.default_rng(1).uniform(-1, 1, (900_000, 3))
scene = make([Part(vertices, np.arange(900_000), 0.5)], camera([0, 0, 0], [0, 0, 1], 90))
module = veriray.device.select(sys.argv[1])[0].native
held = module.Scene(**native_scene_arguments(scene), builder="ploc")
with open("/proc/self/statm") as file:
    now = int(file.read().split()[0]) * resource.getpagesize()
_, most = resource.getrlimit(resource.RLIMIT_AS)
resource.setrlimit(resource.RLIMIT_AS, (now + (64 << 20), most))
for build in (module.host_ploc, lambda *_: prepare(scene, sys.argv[1], builder="ploc")):
    try:
        build(held, 8)
    except MemoryError as error:
        print(type(error).__name__, error)
resource.setrlimit(resource.RLIMIT_AS, (most, most))
again = prepare(scene, sys.argv[1], builder="ploc")["tree"]
print(again | {"seconds": 0} == held.tree | {"seconds": 0})
"""


@pytest.mark.skipif(
    "libasan" in os.environ.get("LD_PRELOAD", ""),
    reason="AddressSanitizer ends a process whose operator new fails",
)
def test_a_build_without_memory_leaves_the_process_whole(cpu: str) -> None:
    """64 MiB of address space for something that takes 82 in one piece."""
    done = subprocess.run(
        [sys.executable, "-c", SHORT_OF_MEMORY, cpu], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    first, second, third = done.stdout.splitlines()
    assert first.startswith("MemoryError") and third == "True"
    # a thread takes memory as well
    assert second in (
        "OutOfMemoryError scene: the host has too little memory for 300000 triangles",
        "OutOfMemoryError scene: no thread can be started",
    )


@pytest.mark.gpu
@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="fills the GPU: run it without -n")
def test_a_build_without_memory_of_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """A film fills the device so far that `sah` fits and `ploc` does not."""
    count = 1_000_000
    monkeypatch.setitem(SHAPES, "million", lambda: [soup(count, 0.003)])
    scene = scene_of("million")
    chosen, _ = vr.device.select("cuda")

    def free() -> int:
        return int(chosen.native.devices()[chosen.index]["memory_free"])

    trees = [native(scene, "cuda", builder)[1].tree for builder in ("sah", "ploc")]
    before = free()  # all kernels are loaded
    held = native(scene, "cuda", "sah")[1]
    used = before - free()
    del held
    # The primitives and the order of slots besides; 216 bytes a primitive for `ploc`.
    room = used + 64 * count + 4 * trees[0]["references"] + (16 << 20)
    assert room + (16 << 20) < used - trees[0]["memory"] + (64 + 216) * count
    row = 1024 * 96
    film = chosen.native.Film(1024, (free() - room) // row, device=chosen.index)
    full = free()
    with pytest.raises(vr.OutOfMemoryError, match=r"^tree: needs \d+ bytes .* \d+ are free$"):
        prepare(scene, "cuda", builder="ploc")
    assert full - free() < 4 << 20  # the primitives are 64 MB
    assert prepare(scene, "cuda")["tree"]["builder"] == "sah"
    del film
    assert prepare(scene, "cuda", builder="ploc")["tree"]["nodes"] == trees[1]["nodes"]


def test_auto_takes_the_fast_builder_on_cuda_until_the_other_pays() -> None:
    many = 1 << 14
    assert choose_builder("cpu", many, 1) == "sah"
    assert choose_builder("cuda", many, CATCH_UP * many - 1) == "ploc"
    assert choose_builder("cuda", many, CATCH_UP * many) == "sah"
    assert choose_builder("cuda", many - 1, 1) == "sah"


def test_a_better_tree_that_is_there_is_taken(device: str) -> None:
    scene = mesh_scene(*displaced_icosphere(5), vr.Camera.look_at([0, 0, 4], [0, 0, 0]))
    first = "ploc" if device.startswith("cuda") else "sah"
    assert vr.render(scene, 1, device=device).stats["tree"]["builder"] == first
    vr.render(scene, 1, device=device, builder="sah")
    assert vr.render(scene, 1, device=device).stats["tree"]["builder"] == "sah"


def _paid_after(monkeypatch: pytest.MonkeyPatch, paths: int) -> None:
    def chosen(_backend: str, _triangles: int, traced: int) -> str:
        return "ploc" if traced < paths else "sah"

    monkeypatch.setattr(sys.modules["veriray.native_scene"], "choose_builder", chosen)


def test_renders_pay_for_a_better_tree(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the third on, other cameras counted; it is made once, of what is there."""

    def drawn() -> list[vr.Render]:
        scene = mesh_scene(*displaced_icosphere(5), vr.Camera.look_at([0, 0, 4], [0, 0, 0]))
        scene = scene.with_(width=16, height=16)
        near = scene.with_(camera=scene.camera.dolly(0.01))
        made = [vr.render(which, 4, device=device) for which in (scene, near, scene, near, scene)]
        assert len({form.native.family for form in scene.native_forms}) == 1
        return made

    _paid_after(monkeypatch, 1 << 60)
    plain = drawn()
    _paid_after(monkeypatch, 3 * 16 * 16 * 4)
    better = drawn()
    assert [r.stats["tree"]["builder"] for r in plain] == ["ploc"] * 5
    assert [r.stats["tree"]["builder"] for r in better] == ["ploc"] * 2 + ["sah"] * 3
    assert [r.film_sha256 for r in better] == [r.film_sha256 for r in plain]


def test_a_better_tree_without_memory_is_not_tried_again(
    cpu: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = vr.device.select(cpu)[0].native
    scene = mesh_scene(*displaced_icosphere(3), vr.Camera.look_at([0, 0, 4], [0, 0, 0]))
    _paid_after(monkeypatch, 2)
    prepare(scene, cpu, spp=1)
    real, tried = scene.native_forms[0], []

    class Short:
        def __getattr__(self, name: str) -> Any:
            if name == "rebuilt":
                tried.append(name)
                raise module.OutOfMemoryError("tree: needs 9 bytes")
            return getattr(real.native, name)

    scene.native_forms[0] = real._replace(native=Short())  # type: ignore[arg-type]
    for _ in range(3):
        assert prepare(scene, cpu, spp=1)["tree"]["builder"] == "ploc"
    assert tried == ["rebuilt"]


def test_unknown_builders_are_refused(cpu: str) -> None:
    scene = scene_of("one")
    for call in (vr.render, prepare):
        with pytest.raises(ValueError, match=r"builder = 'lbvh' is unknown; allowed: auto, sah, p"):
            call(scene, device=cpu, builder="lbvh")
    with pytest.raises(ValueError, match=r"builder = 'auto'; allowed: sah, ploc"):
        native(scene, cpu, "auto")


@pytest.mark.gpu
@pytest.mark.parametrize("name", [*SHAPES, "large"])
def test_the_device_builds_the_tree_of_the_host(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setitem(SHAPES, "large", lambda: [soup(300_000, 0.005)])
    scene = scene_of(name)
    module, host = native(scene, "cuda", "ploc")
    nodes, order = module.device_tree(host)
    expected_nodes, expected_order = module.host_ploc(host, 4)
    assert np.array_equal(order, expected_order)
    assert nodes.shape == expected_nodes.shape
    assert np.array_equal(nodes, expected_nodes)
    again = native(scene, "cuda", "ploc")
    assert all(np.array_equal(a, b) for a, b in zip(
        module.device_tree(again[1]), (nodes, order), strict=True))  # fmt: skip


def test_a_scene_is_prepared_for_the_render_that_follows(device: str) -> None:
    scene = mesh_scene(*displaced_icosphere(5), vr.Camera.look_at([0, 0, 4], [0, 0, 0]))
    long = CATCH_UP * len(scene.triangles)
    assert prepare(scene, device, spp=long)["tree"]["builder"] == "sah"
    assert vr.render(scene, 1, device=device).stats["tree"]["builder"] == "sah"
