"""Spectra and metals by name: Mitsuba's numbers, closed forms, and the same bits everywhere.

MITSUBA and METALS hold what Mitsuba 3.9.1 (scalar_rgb) gives; `test_mitsuba_gives_these_numbers`
reads them again where it is installed.
"""

from __future__ import annotations

import decimal
import json
import warnings
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import veriray as vr
from veriray.errors import SceneError, SceneWarning
from veriray.formats import metals, spectra
from veriray.formats.colour_tables import D65, METALS, X, Y, Z

RAMP = "400:0.1, 500:0.3, 700:0.9"
#: Text -> reflectance (cut at 1), radiance, eta (not cut).
MITSUBA: dict[str, tuple[list[float], list[float], list[float]]] = {
    "0.5": ([0.5] * 3, [0.602397, 0.4741455, 0.454458], [0.5] * 3),
    RAMP: (
        [0.72657675, 0.42495587, 0.17397015],
        [0.84936094, 0.40534881, 0.15114951],
        [0.72657675, 0.42495587, 0.17397015],
    ),
    "400:1 500:3 700:9": (
        [1.0] * 3,
        [8.49360943, 4.05348778, 1.51149511],
        [7.26576757, 4.24955893, 1.73970139],
    ),
    "360:1,830:1": (
        [0.99898529, 0.99887371, 0.99880159],
        [1.20488369, 0.94822818, 0.90926683],
        [0.99898529, 0.99887371, 0.99880159],
    ),
    "500:1,520:1": (
        [0.0, 0.19376843, 0.01458608],
        [0.0, 0.17904776, 0.01324943],
        [0.0, 0.19376843, 0.01458608],
    ),
    "400:-1, 500:2": (
        [0.0, 0.14280976, 0.63877112],
        [0.0, 0.12991475, 0.54129171],
        [0.0, 0.14280976, 0.63877112],
    ),
}
#: Metal -> eta and k in Mitsuba, of tables that it does not share with us.
MITSUBA_METALS: dict[str, tuple[list[float], list[float]]] = json.loads(
    (Path(__file__).parent / "mitsuba_metals.json").read_text(encoding="utf-8")
)
SCENE = (
    '<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/></sensor>'
    '<shape type="sphere">{}</shape></scene>'
)
#: Object around a colour, and the array of the scene that it fills.
PLACES = (
    ('<bsdf type="diffuse">{}</bsdf>', "reflectance"),
    ('<emitter type="area">{}</emitter>', "radiance"),
    ('<bsdf type="conductor">{}<float name="k" value="1"/></bsdf>', "eta"),
)


def arrays(folder: Path, body: str) -> vr.Scene:
    path = folder / "scene.xml"
    path.write_text(SCENE.format(body), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return vr.load_file(path)


def colour(folder: Path, place: int, inner: str) -> np.ndarray[Any, Any]:
    around, name = PLACES[place]
    scene = arrays(folder, around.format(inner.format(name)))
    return np.asarray(scene.emissions if name == "radiance" else getattr(scene, name))[-1]


@pytest.mark.parametrize("text", MITSUBA)
@pytest.mark.parametrize("place", range(3))
def test_a_list_is_mitsubas_colour(tmp_path: Path, text: str, place: int) -> None:
    found = colour(tmp_path, place, f'<spectrum name="{{}}" value="{text}"/>')
    np.testing.assert_allclose(found, MITSUBA[text][place], rtol=2e-6, atol=1e-7)


def test_mitsuba_gives_these_numbers() -> None:
    mi = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mi.set_variant("scalar_rgb")
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    try:
        for text, expected in MITSUBA.items():
            for (around, name), rgb in zip(PLACES, expected, strict=True):
                inner = f'<spectrum name="{name}" value="{text}"/>'
                text_3 = SCENE.format(around.format(inner))
                found = mi.traverse(mi.load_string(text_3))
                (key,) = [k for k in found.keys() if k.endswith(f"{name}.value")][-1:]  # noqa: SIM118
                values = np.ravel(np.array(found[key], dtype=float))
                np.testing.assert_allclose(np.broadcast_to(values, 3), rgb, rtol=2e-6, atol=1e-7)
        for name, (eta, k) in MITSUBA_METALS.items():
            found = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
            np.testing.assert_allclose(np.array(found["eta.value"]).ravel(), eta, atol=2e-6)
            np.testing.assert_allclose(np.array(found["k.value"]).ravel(), k, atol=2e-6)
    finally:
        mi.set_log_level(level)


LIST = f'<spectrum name="{{}}" value="{RAMP}"/>'
PLUGINS = {
    "irregular": (
        '<spectrum name="{}" type="irregular"><string name="wavelengths" value="400, 500, 700"/>'
        '<string name="values" value="0.1 0.3 0.9"/></spectrum>',
        LIST,
    ),
    "regular": (
        '<spectrum name="{}" type="regular"><float name="wavelength_min" value="400"/>'
        '<float name="wavelength_max" value="600"/>'
        '<string name="values" value="1, 2, 0"/></spectrum>',
        '<spectrum name="{}" value="400:1 500:2 600:0"/>',
    ),
    "regular by range": (
        '<spectrum name="{}" type="regular"><string name="range" value="400, 600"/>'
        '<string name="values" value="1, 2, 0"/></spectrum>',
        '<spectrum name="{}" value="400:1 500:2 600:0"/>',
    ),
    "d65": ('<spectrum name="{}" type="d65"/>', '<rgb name="{}" value="1"/>'),
    "d65 with scale": (
        '<spectrum name="{}" type="d65"><float name="scale" value="0.25"/></spectrum>',
        '<rgb name="{}" value="0.25"/>',
    ),
    "d65 with colour": (
        '<spectrum name="{}" type="d65"><float name="scale" value="0.5"/>'
        '<rgb name="color" value="0.2 0.4 0.8"/></spectrum>',
        '<rgb name="{}" value="0.1 0.2 0.4"/>',
    ),
    "d65 with a spectrum, whose scale Mitsuba drops": (
        '<spectrum name="{}" type="d65"><float name="scale" value="3"/>'
        '<spectrum type="uniform"><float name="value" value="0.3"/></spectrum></spectrum>',
        '<rgb name="{}" value="0.3"/>',
    ),
    "uniform": (
        '<spectrum name="{}" type="uniform"><float name="value" value="0.3"/></spectrum>',
        '<rgb name="{}" value="0.3"/>',
    ),
    "uniform as texture": (
        '<texture name="{}" type="uniform"><float name="value" value="0.3"/></texture>',
        '<rgb name="{}" value="0.3"/>',
    ),
    "rawconstant": (
        '<texture name="{}" type="rawconstant">'
        '<vector name="value" value="0.1 0.2 0.3"/></texture>',
        '<rgb name="{}" value="0.1 0.2 0.3"/>',
    ),
    "srgb plugin": (
        '<spectrum name="{}" type="srgb"><rgb name="color" value="0.1 0.2 0.3"/></spectrum>',
        '<rgb name="{}" value="0.1 0.2 0.3"/>',
    ),
    "hexadecimal": ('<rgb name="{}" value="#336699"/>', '<srgb name="{}" value="0.2 0.4 0.6"/>'),
}


def test_uniform_is_a_number(tmp_path: Path) -> None:
    """Also where a number is asked for."""
    inner = '<spectrum name="opacity" type="uniform"><float name="value" value="0.3"/></spectrum>'
    body = f'<bsdf type="mask">{inner}<bsdf type="diffuse"/></bsdf>'
    assert arrays(tmp_path, body).opacity.tolist() == [np.float32(0.3)]


@pytest.mark.parametrize("case", PLUGINS)
@pytest.mark.parametrize("place", range(3))
def test_a_plugin_is_a_simpler_colour(tmp_path: Path, case: str, place: int) -> None:
    one, other = (colour(tmp_path, place, text) for text in PLUGINS[case])
    assert one.tolist() == other.tolist()


def test_a_file_is_a_list(tmp_path: Path) -> None:
    (tmp_path / "a.spd").write_text("# a comment\n400 0.1\n\n500\t0.3\n700, 0.9\n")
    for place in range(3):
        one = colour(tmp_path, place, '<spectrum name="{}" filename="a.spd"/>')
        assert one.tolist() == colour(tmp_path, place, LIST).tolist()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("400 1\n500 1 2\n", "a.spd:2: wavelength and value"),
        ("400 1\n500 x\n", 'a.spd:2: wavelength and value = "x" is not a number'),
        ("500 1\n400 2\n", "400 nm follows 500 nm"),
        ("# none\n", "holds 0 wavelength"),
    ],
)
def test_a_bad_file_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.spd").write_text(text)
    with pytest.raises(SceneError) as caught:
        colour(tmp_path, 0, '<spectrum name="{}" filename="a.spd"/>')
    assert message in str(caught.value)


def test_dictionaries_take_spectra() -> None:
    def emission(value: Any) -> list[float]:
        scene = {
            "type": "scene",
            "sensor": {"type": "perspective", "fov": 40.0},
            "lamp": {"type": "sphere", "emitter": {"type": "area", "radiance": value}},
        }
        return np.asarray(vr.load_dict(scene).emissions)[-1].tolist()

    expected = emission({"type": "spectrum", "value": [(400, 0.1), (500, 0.3), (700, 0.9)]})
    np.testing.assert_allclose(expected, MITSUBA[RAMP][1], rtol=2e-6)
    assert emission({"type": "spectrum", "value": RAMP}) == expected
    lists = {"wavelengths": [400, 500, 700], "values": [0.1, 0.3, 0.9]}
    assert emission({"type": "irregular", **lists}) == expected
    regular = {"type": "regular", "wavelength_min": 400, "wavelength_max": 800, "values": "1 2"}
    assert emission(regular) == emission({"type": "spectrum", "value": [(400, 1), (800, 2)]})
    assert emission({"type": "d65", "scale": 3.0}) == [3.0] * 3
    assert emission({"type": "d65", "any": {"type": "uniform", "value": 2}}) == [2.0] * 3
    assert emission({"type": "rgb", "value": "#ffffff"}) == [1.0] * 3


def test_a_spectrum_is_written_exactly() -> None:
    spectrum = spectra.blackbody(5000.0, 360.0, 830.0, 1e-9)
    assert spectra.parse(spectrum.written(), "", "") == spectrum


def test_a_spectrum_may_have_an_id(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(
        '<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/></sensor>'
        '<spectrum type="d65" id="white"><float name="scale" value="4"/></spectrum>'
        '<emitter type="constant"><ref name="radiance" id="white"/></emitter></scene>'
    )
    assert vr.load_file(path).environment.tolist() == [4.0] * 3


def test_what_is_cut_is_told(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    body = '<bsdf type="diffuse"><spectrum name="reflectance" value="500:1 520:1"/></bsdf>'
    path.write_text(SCENE.format(body), encoding="utf-8")
    with pytest.warns(SceneWarning, match=r"reflectance.*\(-0.165, .* cut to \[0, 1\]"):
        vr.load_file(path)


# Closed forms.


def chromaticity(xyz: tuple[float, float, float]) -> tuple[float, float]:
    return xyz[0] / sum(xyz), xyz[1] / sum(xyz)


def unexpected(text: str, where: str) -> None:
    raise AssertionError(text)


STEPS = tuple(range(360, 831, 5))


def test_d65_has_its_chromaticity() -> None:
    found = chromaticity(spectra.xyz(spectra.Spectrum(tuple(map(float, STEPS)), D65)))
    np.testing.assert_allclose(found, (0.31272, 0.32903), atol=5e-5)  # CIE 15
    lit = spectra.xyz(spectra.Spectrum((360.0, 830.0), (1.0, 1.0)), lit=True)
    np.testing.assert_allclose(chromaticity(lit), (0.31272, 0.32903), atol=5e-5)
    np.testing.assert_allclose(lit[1], 0.99889, rtol=1e-5)


def test_equal_energy_is_at_one_third() -> None:
    found = spectra.xyz(spectra.Spectrum((360.0, 830.0), (1.0, 1.0)))
    np.testing.assert_allclose(chromaticity(found), (1 / 3, 1 / 3), atol=5e-5)
    np.testing.assert_allclose(found[1], 1.0, rtol=1e-5)


@pytest.mark.parametrize("kelvin", [1500.0, 2855.54, 5000.0, 20000.0])
def test_a_blackbody_is_plancks_integral(kelvin: float) -> None:
    """Gaussian quadrature of Planck's law times the observer, interval by interval; the sum is
    999 / 1000 of it, as Mitsuba divides by the count of its wavelengths."""
    h, c, k = mpmath.mpf("6.62607015e-34"), 299792458, mpmath.mpf("1.380649e-23")

    def planck(w: Any) -> Any:
        metres = w * mpmath.mpf("1e-9")
        return (
            2
            * h
            * c**2
            * mpmath.mpf("1e-9")
            / metres**5
            / mpmath.expm1(h * c / (metres * k * kelvin))
        )

    nodes, weights = np.polynomial.legendre.leggauss(4)
    expected = []
    for table in (X, Y, Z):
        total = mpmath.mpf(0)
        for i, low in enumerate(STEPS[:-1]):
            for node, weight in zip(nodes, weights, strict=True):
                share = (1 + node) / 2
                y = (1 - share) * table[i] + share * table[i + 1]
                total += planck(low + 5 * share) * y * weight * 2.5
        expected.append(float(total) / 106.7502593994140625)
    spectrum = spectra.blackbody(kelvin, 360.0, 830.0, 1.0)
    found = spectra.xyz(spectrum)
    np.testing.assert_allclose(found, 0.999 * np.array(expected), rtol=1e-4)
    w = spectrum.wavelengths[500]
    np.testing.assert_allclose(spectrum.values[500], float(planck(w)), rtol=1e-14)
    if kelvin == 2855.54:  # illuminant A
        np.testing.assert_allclose(chromaticity(found), (0.44758, 0.40745), atol=5e-5)
    twice = spectra.xyz(spectra.blackbody(kelvin, 360.0, 830.0, 2.0))
    np.testing.assert_allclose(twice, 2 * np.array(found), rtol=1e-14)


def test_a_blackbody_is_mitsubas() -> None:
    """In the spectral variant; its constants are those of 2014, in float32."""
    mi = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mi.set_variant("scalar_spectral")
    try:
        theirs = mi.load_dict({"type": "blackbody", "temperature": 5000.0})
        ours = spectra.blackbody(5000.0, 360.0, 830.0, 1.0)
        place = mi.SurfaceInteraction3f()
        for i in range(0, 1000, 111):
            place.wavelengths = [ours.wavelengths[i]] * 4
            assert theirs.eval(place)[0] == pytest.approx(ours.values[i], rel=1e-5)
    finally:
        mi.set_variant("scalar_rgb")


def test_a_cut_range_is_dark_outside() -> None:
    whole = spectra.xyz(spectra.blackbody(5000.0, 360.0, 830.0, 1.0))
    parts = (spectra.xyz(spectra.blackbody(5000.0, a, b, 1.0)) for a, b in ((360, 600), (600, 830)))
    np.testing.assert_allclose(np.sum(list(parts), axis=0), whole, rtol=1e-12)


def test_numbers_are_the_same_everywhere() -> None:
    """The bits, also in another decimal context."""
    expected = "0x1.dcf8553790960p+13"
    with decimal.localcontext() as context:
        context.prec = 3
        spectra.blackbody.cache_clear()
        values = spectra.blackbody(5000.0, 360.0, 830.0, 1.0)
        red = spectra.to_rgb(values, True, False, "", "", unexpected)[0]
        codes = [spectra.srgb(f"#{i:02x}0000", "", "")[0] for i in range(256)]
    assert red.hex() == expected
    assert codes[0] == 0.0 and codes[255] == 1.0 and codes[10] == 10 / 255 / 12.92
    with mpmath.workdps(40):
        for i in range(11, 256):
            exact = ((mpmath.mpf(i) / 255 + mpmath.mpf("0.055")) / mpmath.mpf("1.055")) ** (
                mpmath.mpf("2.4")
            )
            assert codes[i] == float(exact)


def test_huge_values_are_refused() -> None:
    spectrum = spectra.Spectrum((400.0, 500.0), (1e308, 1e308))
    with pytest.raises(SceneError, match="its RGB must be finite"):
        spectra.to_rgb(spectrum, True, False, "", "", unexpected)


# Metals.


def reflectance(eta: Any, k: Any) -> Any:
    n, k = np.array(eta), np.array(k)
    return ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)


def test_every_metal_of_mitsuba_is_known() -> None:
    assert set(MITSUBA_METALS) == set(metals.NAMES) - {
        name for name in metals.NAMES if name.endswith("_palik") and name not in MITSUBA_METALS
    }
    assert not set(metals.MITSUBAS) & set(METALS)


@pytest.mark.parametrize("name", MITSUBA_METALS)
def test_metals_reflect_as_in_mitsuba(name: str) -> None:
    """At normal incidence; both are measurements, of different samples for some."""
    ours = reflectance(*metals.metal(name, "", ""))
    theirs = reflectance(*MITSUBA_METALS[name])
    limit = 0.05 if name in ("Ir", "Te") else 0.026
    assert np.abs(ours - theirs).max() < (1e-12 if name in metals.MITSUBAS else limit)


def test_gold_is_a_row_of_the_scene(tmp_path: Path) -> None:
    body = '<bsdf type="conductor"><string name="material" value="Au"/></bsdf>'
    scene = arrays(tmp_path, body)
    eta, k = metals.metal("Au", "", "")
    np.testing.assert_array_equal(scene.eta[-1], np.float32(eta))
    np.testing.assert_array_equal(scene.k[-1], np.float32(k))
    red, green, blue = reflectance(eta, k)
    assert red > 0.9 > green > 0.7 > 0.5 > blue
