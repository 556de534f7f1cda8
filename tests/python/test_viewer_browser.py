"""The viewer's page in Chromium: loads, moves, converges, saves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import veriray as vr
from tests.browser import CHROMIUM, Page, browser
from tests.viewers import done, rendering, serving, wait
from veriray.image import load

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium on PATH")
SMALL = {"width": 96, "height": 72, "spp": 24}
DATA = "document.documentElement?.dataset"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("downloads")
    with browser(folder) as opened:
        yield opened
        assert opened.errors == []


def click(page: Page, selector: str) -> None:
    page.value(f"document.querySelector({selector!r}).click()")


def middle(page: Page, u: float = 0.5, v: float = 0.5) -> tuple[float, float]:
    """The place of a point of the picture on the page."""
    box = page.value("(({x, y, width, height}) => [x, y, width, height])"
                     "(document.querySelector('#picture').getBoundingClientRect())")  # fmt: skip
    return box[0] + u * box[2], box[1] + v * box[3]


def saved(folder: Path, suffix: str) -> Path:
    def found() -> Any:
        files = [f for f in folder.glob(f"*{suffix}") if f.stat().st_size]
        return files[0] if files else None

    return wait(found)


def test_a_visit(page: Page) -> None:
    scene = vr.cornell_box()
    with rendering("cornell-box", **SMALL) as renderer, serving(renderer) as (_, port):
        page.open(f"http://127.0.0.1:{port}/")
        page.wait(f"{DATA}.done === 'true'")
        expected = vr.render(scene, **SMALL, device="cpu")
        shown = page.value("document.querySelector('#sha').textContent")
        assert shown == f"SHA-256 {expected.film_sha256}"
        first = page.value("document.querySelector('#picture').toDataURL()")

        # the pixels are those of the picture
        values = page.value("[...pen.getImageData(0, 0, 96, 72).data]")
        pixels = np.array(values, np.uint8).reshape(72, 96, 4)[..., :3]
        from veriray.saving import to_srgb8

        assert np.array_equal(pixels, to_srgb8(expected.image))

        # it orbits to where it is dragged, and converges anew
        x, y = middle(page)
        left = scene.camera.to_world[0, 3]
        page.drag((x, y), (x + 150, y))
        wait(lambda: renderer.view.camera is not None)
        page.wait(f"{DATA}.done === 'true'")
        done(renderer)
        moved = renderer.view.camera.to_world[0, 3]
        assert moved > left + 10  # the drag is to the right, so the camera goes to its left: +X
        assert page.value("document.querySelector('#picture').toDataURL()") != first

        # it flies as long as a key is down, also when the page lost it
        z = renderer.view.camera.to_world[2, 3]
        page.key("keyDown", "KeyW")
        wait(lambda: renderer.view.camera.to_world[2, 3] > z + 5)
        page.key("keyUp", "KeyW")
        time.sleep(0.2)
        rest = renderer.view.camera.to_world[2, 3]
        time.sleep(0.2)
        assert renderer.view.camera.to_world[2, 3] == rest

        # the wheel zooms, a click measures the distance, reset goes back
        page.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-300)
        wait(lambda: renderer.view.camera.to_world[2, 3] > rest)
        click(page, "#reset")
        wait(lambda: renderer.view.camera is None)
        page.drag(middle(page, 0.5, 0.25), middle(page, 0.5, 0.25), steps=1)
        wait(lambda: renderer.view.distance == pytest.approx(1359.2, rel=1e-2))

        # controls
        page.value("(() => { const e = document.querySelector('[data-name=max_depth]');"
                   "e.value = 3; e.dispatchEvent(new Event('change')); })()")  # fmt: skip
        wait(lambda: renderer.view.max_depth == 3)
        click(page, "#channel [data-value=error]")
        page.wait("!document.querySelector('#legend').hidden")
        click(page, "#channel [data-value=radiance]")
        page.value("(() => { const e = document.querySelector('[data-name=exposure]');"
                   "e.value = 1; e.dispatchEvent(new Event('input'));"
                   "e.dispatchEvent(new Event('change')); })()")  # fmt: skip
        wait(lambda: renderer.view.exposure == 1)
        frame = done(renderer)
        page.wait(f"{DATA}.number === '{frame.number}' && {DATA}.done === 'true'")
        assert page.value("document.querySelectorAll('#plot .line').length") == 1

        # it saves
        for name in ("picture.exr", "picture.png", "scene.xml"):
            click(page, f"[data-save='{name}']")
            assert saved(page.folder, Path(name).suffix)
        film = frame.render.film_sha256
        assert film == vr.render(scene, **SMALL, max_depth=3, device="cpu").film_sha256
        assert load(saved(page.folder, ".exr")).film_sha256 == film
        assert np.asarray(Image.open(saved(page.folder, ".png"))).shape == (72, 96, 3)
    page.wait("!document.querySelector('#banner').hidden")  # no connection any more
    page.errors[:] = [error for error in page.errors if "ERR_CONNECTION_REFUSED" not in error]


def test_fingers(page: Page) -> None:
    """One orbits; two move sideways and zoom, and leave the direction as it is; a tap measures."""
    with rendering("cornell-box", **SMALL) as renderer, serving(renderer) as (_, port):
        page.resize(420, 850)
        page.open(f"http://127.0.0.1:{port}/")
        page.wait(f"{DATA}.done === 'true'")
        first = vr.cornell_box().camera.to_world
        x, y = middle(page)

        def camera() -> Any:
            view = renderer.view
            return first if view.camera is None else view.camera.to_world

        def rest() -> Any:
            """Where the camera is once nothing moves it any more."""
            page.value("new Promise(f => requestAnimationFrame(() => requestAnimationFrame(f)))")
            done(renderer)
            time.sleep(0.2)
            return camera().copy()

        page.touch((x - 20, y))
        page.touch((x - 20, y), (x + 20, y))
        for k in range(1, 9):  # apart, to twice the distance
            page.touch((x - 20 - 2.5 * k, y), (x + 20 + 2.5 * k, y))
        wait(lambda: camera()[2, 3] > first[2, 3] + 1)
        near = rest()
        assert np.allclose(near[:3, :3], first[:3, :3])
        # A slow browser tells of the fingers in two frames: one step aside, and back from nearer.
        assert np.allclose(near[:2, 3], first[:2, 3], atol=0.5)
        distance = renderer.view.distance
        assert distance == pytest.approx(near[2, 3] - first[2, 3], rel=1e-6)  # half of what it was
        for k in range(1, 9):  # both to the right, and up
            page.touch((x - 40 + 5 * k, y - 2 * k), (x + 40 + 5 * k, y - 2 * k))
        wait(lambda: camera()[0, 3] > near[0, 3] + 1)
        beside = rest()
        assert np.allclose(beside[:3, :3], first[:3, :3])
        height = page.value("canvas.clientHeight")
        scale = 2 * distance * renderer.view.camera.tan_half_y(96, 72) / height
        step = (beside - near)[:3, 3]  # the picture's left is the camera's +X, which is the world's
        assert step == pytest.approx([40 * scale, -16 * scale, 0], rel=1e-2, abs=0.5)
        page.touch((x, y - 16))  # one finger is lifted: the other does nothing
        page.touch((x + 60, y - 16))
        page.touch()
        assert np.array_equal(rest(), beside)

        page.touch((x, y))
        for k in range(1, 9):
            page.touch((x + 5 * k, y))
        page.touch()
        wait(lambda: not np.allclose(camera()[:3, :3], first[:3, :3]))
        turned = rest()
        page.touch((x, y))  # a tap that slips a little
        page.touch((x + 3, y + 3))
        before = renderer.view.distance
        page.touch()
        wait(lambda: renderer.view.distance != before)
        assert np.array_equal(rest(), turned)


def test_it_connects_again(page: Page) -> None:
    """A server that comes back at the same port is found again."""
    with rendering("cornell-box", **SMALL) as renderer, serving(renderer) as (server, port):
        page.open(f"http://127.0.0.1:{port}/")
        page.wait(f"{DATA}.done === 'true'")
        page.value("socket.close()")
        page.wait(
            "socket.readyState === WebSocket.OPEN && document.querySelector('#banner').hidden"
        )
        page.value("set('max_depth', 2)")
        wait(lambda: renderer.view.max_depth == 2)


@pytest.mark.parametrize("width", [420, 1400])
def test_nothing_sticks_out(page: Page, width: int) -> None:
    with rendering("cornell-box", **SMALL) as renderer, serving(renderer) as (_, port):
        page.resize(width, 800)
        page.open(f"http://127.0.0.1:{port}/")
        page.wait(f"{DATA}.done === 'true'")
        wide = "[...document.querySelectorAll('#panel *')].filter(e => e.scrollWidth > " \
               "e.clientWidth + 1 && getComputedStyle(e).overflow === 'visible' && " \
               "getComputedStyle(e).display !== 'inline' && !e.closest('svg'))"  # fmt: skip
        assert page.value(f"{wide}.map(e => e.outerHTML.slice(0, 80))") == []
        assert page.value("document.documentElement.scrollWidth") <= width
        (x0, y0), (x1, y1) = middle(page, 0, 0), middle(page, 1, 1)
        assert 0 <= x0 < x1 <= width and 0 <= y0 < y1 <= 800
