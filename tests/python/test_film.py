"""The film: planes of exact sums, its state, and what it refuses; against Python's integers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import veriray as vr
from veriray.device import survey
from veriray.native_scene import native_scene_arguments
from veriray.rendering import METHODS

Array = npt.NDArray[Any]
DEVICES = {device.name: device for device in survey()[0]}
WIDTH, HEIGHT = 5, 3


def plane(name: str, kind: str, channels: int, negative: bool = False) -> dict[str, Any]:
    return {"name": name, "kind": kind, "channels": channels, "negative": negative}


PLANES = [
    plane("splat", "sums", 3),
    plane("normal", "sums", 3, True),
    plane("depth", "sums and squares", 1),
    plane("motion", "sums and squares", 2, True),
    plane("shape", "integers", 1),
    plane("count", "integers", 4),
]
SCALES = {"radiance": 2.0**-5, "splat": 2.0**-5, "normal": 1.0, "depth": 2.0**100,
          "motion": 2.0**-100}  # fmt: skip


def film(device: str, planes: list[dict[str, Any]] = PLANES) -> Any:
    chosen = DEVICES[device]
    return chosen.native.Film(WIDTH, HEIGHT, device=chosen.index, planes=planes)


def numbers(words: Array) -> Array:
    """Integers (object) of pairs of words along the last axis, which has 2 or 4."""
    w = words.astype(object)
    whole = w[..., 0::2] + (w[..., 1::2] << 64)
    return np.where(whole >> 127 != 0, whole - (1 << 128), whole)


def held(result: Any) -> dict[str, Array]:
    """The numbers of each plane, (pixels, channels, 1 or 2)."""
    return {p["name"]: numbers(p["words"]).reshape(WIDTH * HEIGHT, p["channels"], -1)
            for p in result.state()["planes"]}  # fmt: skip


def rounded(x: Fraction) -> int:
    """To the nearest integer, halves away from 0."""
    return int(math.copysign(1, x)) * math.floor(abs(x) + Fraction(1, 2))


def expected(info: dict[str, Any], pixels: Array, x: Array, scale: float | None = None) -> Array:
    """What a plane holds after these samples."""
    scale = SCALES.get(info["name"], 0.0) if scale is None else scale
    squares = info["kind"] == "sums and squares"
    total = np.zeros((WIDTH * HEIGHT, info["channels"], 1 + squares), object)
    for pixel, row in zip(pixels.tolist(), x.tolist(), strict=True):
        for c, value in enumerate(row):
            if info["kind"] == "integers":
                total[pixel, c, 0] += value
                continue
            unit = Fraction(value) * Fraction(scale)
            total[pixel, c, 0] += rounded(unit * 2**72)
            if squares:
                total[pixel, c, 1] += rounded(unit**2 * 2**76)
    return total


def draw(rng: np.random.Generator, info: dict[str, Any], n: int) -> tuple[Array, Array]:
    """Pixels, a third of them one and the same, and rows of samples of every size."""
    pixels = np.where(rng.random(n) < 1 / 3, 7, rng.integers(0, WIDTH * HEIGHT, n))
    shape = n, info["channels"]
    if info["kind"] == "integers":
        x = rng.integers(0, 2**64, shape, np.uint64) >> rng.integers(0, 64, shape, np.uint64)
        x[0] = 2**64 - 1
        return pixels.astype(np.uint32), x
    values = np.ldexp(rng.uniform(0.5, 1, shape), rng.integers(-75, 21, shape))
    values[::5] = np.ldexp(rng.integers(0, 2**12, values[::5].shape), -73)  # halves of a unit
    values[0] = np.nextafter(np.float32(2**20), np.float32(0))
    values = values.astype(np.float32).astype(np.float64)
    if info["negative"]:
        values *= rng.choice([-1.0, 1.0], shape)
    return pixels.astype(np.uint32), (values / SCALES[info["name"]]).astype(np.float32)


def add(native: Any, to: Any, info: dict[str, Any], pixels: Array, x: Array) -> None:
    if info["kind"] == "integers":
        native.add_integers(to, info["name"], pixels, x)
    else:
        refused = native.add_values(to, info["name"], SCALES[info["name"]], pixels, x)
        assert refused == (0, []), refused


# ---- planes ----


RADIANCE = plane("radiance", "sums and squares", 3)


@pytest.mark.parametrize("info", [RADIANCE, *PLANES], ids=lambda p: p["name"])
def test_sums_are_exact_in_any_order_split_and_merge(info: dict[str, Any], device: str) -> None:
    native, rng = DEVICES[device].native, np.random.default_rng(7)
    pixels, x = draw(rng, info, 3000)
    wanted = expected(info, pixels, x)
    whole = film(device)
    add(native, whole, info, pixels, x)
    assert (held(whole)[info["name"]] == wanted).all()
    others = {name for name, values in held(whole).items() if values.any()}
    assert others == {info["name"]}, "another plane was written"

    order = rng.permutation(len(pixels))
    films = [film(device) for _ in range(4)]
    for k, part in enumerate(np.array_split(order, 9)):
        add(native, films[k % 4], info, pixels[part], x[part])
    for other in films[1:3]:
        films[0].add(other)
    films[0].add_state(films[3].state())
    again = films[0].state()["planes"]
    for a, b in zip(again, whole.state()["planes"], strict=True):
        assert a["scale"] == b["scale"] and a["words"].tobytes() == b["words"].tobytes()


def test_films_of_all_devices_merge() -> None:
    rng = np.random.default_rng(11)
    for info in (RADIANCE, *PLANES):
        total = film(next(iter(DEVICES)))
        parts = []
        for name, device in DEVICES.items():
            pixels, x = draw(rng, info, 300)
            one = film(name)
            add(device.native, one, info, pixels, x)
            total.add_state(one.state())
            parts.append(expected(info, pixels, x))
        assert (held(total)[info["name"]] == sum(parts)).all()


def test_samples_that_a_plane_refuses(device: str) -> None:
    """A sample is taken or refused as a whole, and logged; legitimate ones beside it are kept."""
    native, result = DEVICES[device].native, film(device)
    nan, inf, tiny = float("nan"), float("inf"), 2.0**-149
    limit = float(np.float32(2**25))  # 2^20 / scale
    below = float(np.nextafter(np.float32(limit), np.float32(0)))
    always = [[nan, 1, 1], [1, inf, 1], [1, 1, -inf], [limit, 1, 1], [1, -limit, 1], [3e38, 1, 1]]
    signed = [[-1, 1, 1], [1, 1, -tiny], [1, -below, 1]]
    fine = [[below, 0, -0.0], [tiny, 1, 2]]
    rows = np.array([*always, *signed, *fine], np.float32)
    pixels = np.arange(len(rows), dtype=np.uint32)
    for name, kept in (("splat", rows[9:]), ("normal", rows[6:]), ("radiance", rows[9:])):
        count, listed = native.add_values(result, name, 2.0**-5, pixels, rows)
        refused = rows[: len(rows) - len(kept)]
        assert count == len(listed) == len(refused)
        listed = sorted(listed, key=lambda entry: entry[1])
        assert [entry[:2] for entry in listed] == [(k, k) for k in range(count)]
        assert np.array([entry[2:] for entry in listed], np.float32).tobytes() == refused.tobytes()
        info = next(p for p in (RADIANCE, *PLANES) if p["name"] == name)
        assert (held(result)[name] == expected(info, pixels[count:], kept, 2.0**-5)).all()
    many = np.full((1000, 1), nan, np.float32)
    count, listed = native.add_values(result, "depth", 1.0, np.zeros(1000, np.uint32), many)
    assert count == 1000 and len(listed) == 64


def test_what_integrators_may_give(device: str) -> None:
    """Samples that a film of scale 1/4 takes, of integrators without and with negative ones."""
    native, big = DEVICES[device].native, 2.0**22
    rows = {
        (-0.0, 0, 0): (1, 1), (1, 2, 3): (1, 1), (-1, 0, 0): (0, 1),
        (0, -(2.0**-149), 0): (0, 1), (0, 0, big): (0, 0), (0, 0, -big): (0, 0),
        (big * (1 - 2.0**-24), 1, 0): (1, 1), (1, 1 - big, 0): (0, 1),
        (math.inf, 0, 0): (0, 0), (0, -math.inf, 0): (0, 0), (0, 0, math.nan): (0, 0),
    }  # fmt: skip
    got = native.eval_function("film_accepts", np.array([*rows], np.float32))
    assert got.tolist() == [list(wanted) for wanted in rows.values()]


def test_a_plane_holds_one_scale(device: str) -> None:
    native, result = DEVICES[device].native, film(device)
    one, x = np.zeros(1, np.uint32), np.ones((1, 3), np.float32)
    native.add_values(result, "normal", 1.0, one, x)
    with pytest.raises(ValueError, match="plane 'normal' of the film holds samples of another s"):
        native.add_values(result, "normal", 2.0, one, x)
    for scale in (0.0, -1.0, 0.3, 3.0, 2.0**-101, 2.0**101, math.inf, math.nan):
        with pytest.raises(ValueError, match="scale = "):
            native.add_values(result, "splat", scale, one, x)
    other = film(device)
    native.add_values(other, "splat", 1.0, one, x)
    native.add_values(other, "normal", 2.0, one, x)
    before = held(result)
    for merge in (lambda: result.add(other), lambda: result.add_state(other.state())):
        with pytest.raises(ValueError, match="another scale"):
            merge()
        assert all((v == before[k]).all() for k, v in held(result).items()), "added in part"
    result.clear()
    assert not any(v.any() for v in held(result).values())
    native.add_values(result, "normal", 2.0, one, x)


def test_planes_that_cannot_be(device: str) -> None:
    sums = plane("a", "sums", 1)
    for planes, words in (
        ([plane("", "sums", 1)], "without a name"),
        ([plane("radiance", "sums", 3)], "two planes 'radiance'"),
        ([sums, plane("b", "sums", 1), sums], "two planes 'a'"),
        ([plane("a", "sums", 0)], "'a' .sums, 0 channels.*1 to 64 channels"),
        ([plane("a", "sums", 65)], "65 channels"),
        ([plane("a", "sums", -1)], "plane 0: 'channels' has no valid value"),
        ([plane("a", "means", 1)], "kind = 'means'; allowed: sums and squares, sums, integers"),
        ([plane(str(k), "sums", 1) for k in range(64)], "65 planes; allowed: 1 to 64"),
        ([{"name": "a"}], "plane 0 has no 'channels'"),
        (["a"], "plane 0 is no dictionary"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            film(device, planes)  # type: ignore[arg-type]


def test_hook_checks_its_arguments(device: str) -> None:
    native, result = DEVICES[device].native, film(device)
    one, x = np.zeros(1, np.uint32), np.ones((1, 3), np.float32)
    with pytest.raises(ValueError, match="no plane 'fur'"):
        native.add_values(result, "fur", 1.0, one, x)
    with pytest.raises(ValueError, match="no pixel 15"):
        native.add_values(result, "normal", 1.0, np.array([WIDTH * HEIGHT], np.uint32), x)
    with pytest.raises(ValueError, match="3 numbers for 1 samples of 1 channels"):
        native.add_values(result, "depth", 1.0, one, x)
    with pytest.raises(ValueError, match="plane 'shape' .integers"):
        native.add_values(result, "shape", 1.0, one, x[:, :1])
    with pytest.raises(ValueError, match="plane 'normal' .sums"):
        native.add_integers(result, "normal", one, x.astype(np.uint64))


# ---- renders ----


class Host:
    """A small scene on a device."""

    def __init__(self, scene: vr.Scene, device: str):
        self.device, self.size = DEVICES[device], (scene.film.width, scene.film.height)
        arguments = native_scene_arguments(scene)
        self.held = self.device.native.Scene(**arguments, device=self.device.index)

    def film(self, planes: list[dict[str, Any]] | None = None) -> Any:
        more = {"planes": planes} if planes else {}
        return self.device.native.Film(*self.size, device=self.device.index, **more)

    def render(self, to: Any, begin: int, end: int, **more: Any) -> None:
        self.device.native.render(self.held, to, sample_begin=begin, sample_end=end, **more)


def small(**changes: Any) -> vr.Scene:
    return vr.cornell_box().with_(width=20, height=9, max_depth=4, **changes)


@pytest.mark.parametrize("filter", ["box", "mitchell"])
@pytest.mark.parametrize("sampler", ["independent", "sobol"])
def test_a_render_resumes_at_any_sample(filter: str, sampler: str, device: str) -> None:
    host, spp = Host(small(filter=filter), device), 9
    whole = host.film()
    host.render(whole, 0, spp, sampler=sampler)
    for cut, scheduler in zip(range(spp + 1), itertools.cycle(METHODS), strict=False):
        first = host.film()
        host.render(first, 0, cut, sampler=sampler, scheduler=scheduler)
        state = first.state()
        assert state["samples"] == cut
        words = np.frombuffer(state["planes"][0]["words"].tobytes(), np.uint64)  # as of a file
        state["planes"][0]["words"] = words.reshape(state["planes"][0]["words"].shape)
        second = host.film()
        second.add_state(state)
        host.render(second, cut, spp, sampler=sampler)
        assert second.words().tobytes() == whole.words().tobytes()
        assert second.samples == spp
        for a, b in zip(second.resolve(), whole.resolve(), strict=True):
            assert a.tobytes() == b.tobytes()


def test_threads_on_one_device_draw_their_own_pixels(device: str) -> None:
    """Lists of pixels, of a rim here, are on the device when the launch that reads them begins."""
    scenes = [small(filter="mitchell").with_(width=9 + k, height=5 + k) for k in range(8)]
    alone = [vr.render(scene, 2, device="cpu", seed=3).film_sha256 for scene in scenes]

    def draw(scene: vr.Scene) -> set[str]:
        return {vr.render(scene, 2, device=device, seed=3).film_sha256 for _ in range(40)}

    with ThreadPoolExecutor(len(scenes)) as pool:
        assert list(pool.map(draw, scenes)) == [{one} for one in alone]


@pytest.mark.parametrize(("filter", "parameter", "share"), [
    ("tent", 1.0, 0.477), ("gaussian", 0.5, 0.3335), ("mitchell", (1 / 3, 1 / 3), 0.502),
    ("mitchell", (0.0, 0.5), 0.740), ("lanczos", 3.0, 0.933),
])  # fmt: skip
def test_filters_leave_their_share_of_noise(
    filter: str, parameter: Any, share: float, device: str
) -> None:
    """Of noise that does not depend on place, E sum_Q ((1 - H) F_Q + h_Q)^2 (cpp/film/shared.h).

    A sky of 1 behind a black veil that lets half of the samples pass: their variance is 1/4. Sees
    2 %; and 5 standard errors of the mean, though neighbours are not independent.
    """
    veil = {"type": "mask", "opacity": 0.5, "b": {"type": "diffuse", "reflectance": 0.0}}
    scene = vr.load_dict({
        "type": "scene", "sky": {"type": "constant"},
        "camera": {"type": "orthographic",
                   "to_world": vr.transform.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])},
        "veil": {"type": "rectangle", "bsdf": veil, "to_world": vr.transform.scale([9, 9, 1])},
    }).with_(width=40, height=30, filter=filter, filter_parameter=parameter)  # fmt: skip
    made = vr.render(scene, spp=256, device=device, sampler="independent")
    variance = float((made.stderr[..., 0].astype(np.float64) ** 2).mean()) * 256
    assert abs(variance / (share / 4) - 1) < 0.02
    assert abs(made.image[..., 0].mean() - 0.5) < 5 * 0.5 / (256 * 40 * 30) ** 0.5


@pytest.mark.parametrize("lobes", [1, 3, 16])
def test_room_of_shared_samples(lobes: int) -> None:
    """The weights of a sample under lanczos are below cpp/film/shared.h's kLanczosRoom in all.

    Each h_Q lies between its extremes, H between their sums, and a weight is linear in both.
    """
    x = np.linspace(-0.5, 0.5, 513) + np.arange(-lobes, lobes + 1)[:, None]
    f = np.where(np.abs(x) < lobes, np.sinc(x) * np.sinc(x / lobes), 0.0)
    part = (f[:, 1:] + f[:, :-1]).mean(axis=1) / 2
    f, part = f / part.sum(), part / part.sum()
    ends = np.array([np.outer(a, b) for a in (f.min(1), f.max(1)) for b in (f.min(1), f.max(1))])
    share = np.outer(part, part)
    low, high = ((e - share) / (1 - share) for e in (ends.min(axis=0), ends.max(axis=0)))
    most = 0.0
    for total in (low.sum(), high.sum()):
        of_others = np.maximum(abs(share * (1 - total) + low), abs(share * (1 - total) + high))
        rest = 1 - (1 - total) * (1 - share[lobes, lobes]) - total
        own = max(abs(rest + h[lobes, lobes]) for h in (low, high))
        most = max(most, of_others.sum() - of_others[lobes, lobes] + own)
    assert {1: 7.7, 3: 12.1, 16: 26.3}[lobes] < most < {1: 7.9, 3: 12.3, 16: 26.6}[lobes] < 32


def test_devices_share_a_render() -> None:
    """Each machine and instruction set draws some samples, or some pixels; any of them adds up."""
    scene, spp = small(), 4 * len(DEVICES)
    hosts = {name: Host(scene, name) for name in DEVICES}
    every = np.arange(20 * 9, dtype=np.uint32)
    wanted = None
    for host in hosts.values():
        total, parts = host.film(), host.film()
        for k, other in enumerate(hosts.values()):
            piece = other.film()
            other.render(piece, 4 * k, 4 * k + 4)
            total.add_state(piece.state())
            piece.clear()
            other.render(piece, 0, spp, pixels=every[k :: len(hosts)])
            parts.add_state(piece.state())
        assert total.samples == spp and parts.samples == 0
        whole = host.film()
        host.render(whole, 0, spp)
        wanted = wanted or whole.words().tobytes()
        assert total.words().tobytes() == parts.words().tobytes() == wanted


def test_planes_do_not_change_radiance(device: str) -> None:
    host = Host(small(), device)
    plain, more = host.film(), host.film(PLANES)
    for result in (plain, more):
        host.render(result, 0, 8)
    state = more.state()
    assert state["planes"][0]["words"].tobytes() == plain.words().tobytes()
    assert more.words().tobytes() == plain.words().tobytes()
    assert more.sums().tobytes() == plain.sums().tobytes()
    assert not any(p["words"].any() or p["scale"] for p in state["planes"][1:])
    pixels = 20 * 9
    assert plain.memory == 96 * pixels
    assert more.memory == 8 * pixels * sum(p["words"].shape[2] * p["words"].shape[3]
                                           for p in state["planes"])  # fmt: skip


def test_radiance_of_another_brightness_does_not_add(device: str) -> None:
    films = []
    for factor in (1.0, 2.0**7):
        host = Host(small().with_emission_scaled(factor), device)
        films.append(host.film())
        host.render(films[-1], 0, 1)
    words = films[0].words()
    for merge in (lambda: films[0].add(films[1]), lambda: films[0].add_state(films[1].state())):
        with pytest.raises(ValueError, match="a scene of another brightness"):
            merge()
    with pytest.raises(ValueError, match="a scene of another brightness"):
        host.render(films[0], 1, 2)
    assert (films[0].words() == words).all() and films[0].samples == 1


def test_films_that_do_not_match(device: str) -> None:
    native, index = DEVICES[device].native, DEVICES[device].index
    result = film(device)
    with pytest.raises(ValueError, match="films of different sizes"):
        result.add(native.Film(HEIGHT, WIDTH, device=index, planes=PLANES))
    with pytest.raises(ValueError, match="films of different planes"):
        result.add(film(device, PLANES[:-1]))


# ---- states that no film had ----


def changed(index: int, **values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda state: state["planes"][index].update(values)


HOSTILE: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "no samples": (lambda s: s.pop("samples"), "the state has no 'samples'"),
    "samples below 0": (lambda s: s.update(samples=-1), "'samples' has no valid value"),
    "samples as text": (lambda s: s.update(samples="4"), "'samples' has no valid value"),
    "samples of 65 bits": (lambda s: s.update(samples=2**64), "'samples' has no valid value"),
    "too many in all": (lambda s: s.update(samples=2**64 - 2), "18446744073709551614 samples more "
                        "than the film's 2; allowed: 2.64 - 1 in all"),
    "no planes": (lambda s: s.pop("planes"), "the state has no 'planes'"),
    "planes as a number": (lambda s: s.update(planes=3), "'planes' has no valid value"),
    "a plane as text": (lambda s: s.update(planes=["x"]), "plane 0 is no dictionary"),
    "one plane less": (lambda s: s["planes"].pop(), "a state of 6 planes, the film has 7"),
    "planes swapped": (lambda s: s["planes"].insert(1, s["planes"].pop(2)),
                       "plane 1 of the state is 'normal' .*, of the film 'splat'"),
    "another name": (changed(1, name="x"), "plane 1 of the state is 'x' .*, of the film 'splat'"),
    "a name of bytes": (changed(1, name=7), "plane 1: 'name' has no valid value"),
    "another sign": (changed(2, negative=False), "plane 2 of the state is 'normal' .*not negative"),
    "an unknown kind": (changed(1, kind="mean"), "plane 1: kind = 'mean'; allowed"),
    "another kind": (changed(1, kind="integers"), "plane 1 of the state is 'splat' .integers"),
    "fewer channels": (changed(1, channels=2), r"plane 1: words must have .* \(3, 5, 2, 2\)"),
    "2^32 channels": (changed(1, channels=2**32), "plane 1: 'channels' has no valid value"),
    "no words": (lambda s: s["planes"][0].pop("words"), "plane 0 has no 'words'"),
    "words as a list": (changed(0, words=[1, 2]), "plane 0: words is no array of uint64"),
    "signed words": (changed(0, words=np.zeros((3, 5, 3, 4), np.int64)), "no array of uint64"),
    "words as floats": (changed(0, words=np.zeros((3, 5, 3, 4))), "no array of uint64"),
    "a row less": (changed(0, words=np.zeros((2, 5, 3, 4), np.uint64)), r"shape \(3, 5, 3, 4\)"),
    "flat words": (changed(0, words=np.zeros(180, np.uint64)), r"shape \(3, 5, 3, 4\)"),
    "a scale of NaN": (changed(1, scale=math.nan), "'splat' .* of the scale nan; allowed"),
    "an infinite scale": (changed(1, scale=math.inf), "of the scale inf; allowed"),
    "a negative scale": (changed(1, scale=-1.0), "of the scale -1"),
    "no power of two": (changed(1, scale=0.75), "of the scale 0.75"),
    "a tiny scale": (changed(1, scale=2.0**-101), "of the scale 0"),
    "a scale of text": (changed(1, scale="1"), "plane 1: 'scale' has no valid value"),
    "a scale of integers": (changed(5, scale=1.0), "plane 'shape' .* of the scale 1"),
    "sums without a scale": (changed(1, scale=0.0), "'splat' .* has sums, but no scale"),
    "another brightness": (changed(0, scale=2.0), "a scene of another brightness"),
    "another scale": (changed(2, scale=2.0), "plane 'normal' of the film holds samples of another"),
}  # fmt: skip


@pytest.fixture
def filled(device: str) -> Any:
    """A film with numbers in every plane."""
    native, rng, result = DEVICES[device].native, np.random.default_rng(3), film(device)
    for info in (RADIANCE, *PLANES):
        add(native, result, info, *draw(rng, info, 200))
    state = result.state()
    for p in state["planes"]:
        p["words"] = np.zeros_like(p["words"])
    result.add_state({**state, "samples": 2})
    return result


@pytest.mark.parametrize("name", HOSTILE)
def test_a_state_that_does_not_fit_adds_nothing(name: str, filled: Any) -> None:
    change, words = HOSTILE[name]
    before, state = filled.state(), filled.state()
    change(state)
    with pytest.raises(ValueError, match=words):
        filled.add_state(state)
    after = filled.state()
    assert after["samples"] == before["samples"] == 2
    for a, b in zip(after["planes"], before["planes"], strict=True):
        assert a["words"].tobytes() == b["words"].tobytes() and a["scale"] == b["scale"]


def test_any_words_add_modulo_two_to_the_128(filled: Any) -> None:
    """Words that no film had are numbers like others; a film of views of larger arrays adds too."""
    before, state = held(filled), filled.state()
    rng = np.random.default_rng(5)
    for p in state["planes"]:
        shape = p["words"].shape
        p["words"] = rng.integers(0, 2**64, (*shape[:3], 2 * shape[3]), np.uint64)[..., ::2]
    filled.add_state(state)
    for p in state["planes"]:
        more = numbers(p["words"]).reshape(before[p["name"]].shape)
        difference = held(filled)[p["name"]] - before[p["name"]] - more
        assert not (difference % 2**128).any()
    mean, error = filled.resolve()
    assert mean.shape == error.shape == (HEIGHT, WIDTH, 3)


def test_a_full_film_draws_no_more(device: str) -> None:
    host = Host(small(), device)
    result = host.film()
    host.render(result, 0, 1)
    result.add_state({**host.film().state(), "samples": 2**64 - 3})
    with pytest.raises(ValueError, match="2 samples more than the film's 18446744073709551614"):
        host.render(result, 1, 3)
    host.render(result, 1, 2)
    assert result.samples == 2**64 - 1
    with pytest.raises(ValueError, match="1 samples more"):
        result.add_state({**host.film().state(), "samples": 1})
    host.render(result, 2, 3, pixels=np.array([4], np.uint32))
