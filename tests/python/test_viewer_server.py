"""The viewer's server: who gets in, what browsers get, and that none harms another."""

from __future__ import annotations

import contextlib
import http.client
import io
import json
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from websockets.exceptions import ConnectionClosed, InvalidStatus

import veriray as vr
from tests.viewers import Browser, done, rendering, serving, wait
from veriray.image import load
from veriray.saving import to_srgb8
from veriray.viewer.server import MOST_CLIENTS, MOST_MISTAKES, Door, is_loopback

SMALL = {"width": 40, "height": 30, "spp": 24}
Viewer = tuple[Any, Any, int]


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    """Renderer, server and port of a small Cornell box."""
    with rendering("cornell-box", **SMALL) as renderer, serving(renderer) as (server, port):
        yield renderer, server, port


def get(port: int, path: str, method: str = "GET", **headers: str) -> tuple[int, Any, bytes]:
    """Status, headers and body of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.putrequest(method, path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, answer.headers, answer.read()


# ---- what browsers get ----


def test_page(viewer: Viewer) -> None:
    port = viewer[2]
    for path, kind in (("/", "html"), ("/page.css", "css"), ("/page.js", "javascript")):
        status, headers, body = get(port, path)
        assert status == 200 and kind in headers["Content-Type"] and len(body) > 1000
        assert "default-src 'none'" in headers["Content-Security-Policy"]
    page = get(port, "/")[2].decode()
    assert "//" not in page.replace("</", "")  # it needs no network
    for path in ("/nothing", "/../server.py", "/page.js/../../x", "/save/", "/save/x", "//", "/ws"):
        assert get(port, path)[0] in (404, 426)
    with contextlib.suppress(http.client.RemoteDisconnected):
        assert get(port, "/", "POST")[0] >= 400


def test_pictures(viewer: Viewer) -> None:
    renderer, _, port = viewer
    with Browser(port) as browser:
        facts, file = browser.picture(lambda facts: facts["done"])
        expected = vr.render(vr.cornell_box(), **SMALL, device="cpu")
        assert facts["sha256"] == expected.film_sha256 and facts["type"] == "image/png"
        pixels = np.asarray(Image.open(io.BytesIO(file)))
        assert np.array_equal(pixels, to_srgb8(expected.image))
        assert facts["spp"] == 24 and facts["coarse"] == 1
        live = expected.stats["live_rays"]
        assert facts["live"] == [n / expected.stats["paths"] for n in live]
        mean = float(np.abs(expected.image).mean(dtype=np.float64))
        assert facts["error"] == pytest.approx(expected.stats["mean_stderr"] / mean)
        steps = ["taken", "scene", "samples", "picture", "queue", "facts", "tones", "file"]
        assert list(facts["steps"]) == steps and min(facts["steps"].values()) >= 0
        assert sum(facts["steps"].values()) == pytest.approx(facts["age"])
        assert browser.state["width"] == 40 and browser.state["channel"] == "radiance"

        browser.send(do="set", name="exposure", value=2.0)
        bright, file = browser.picture()
        assert bright["number"] == facts["number"]  # the same picture, shown otherwise
        assert np.array_equal(np.asarray(Image.open(io.BytesIO(file))),
                              to_srgb8(expected.image, 2.0))  # fmt: skip
        browser.send(do="set", name="channel", value="error")
        assert browser.picture()[0]["legend"]["title"] == "Relative error"
        browser.send(do="orbit", x=0.1, y=0.1)
        moved, _ = browser.picture(lambda facts: facts["done"])
        assert moved["change"] == facts["change"] + 1 and moved["sha256"] != facts["sha256"]


def test_a_picture_that_cannot_be_sent_is_told(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next one is sent again."""
    _, server, port = viewer
    with Browser(port) as browser:
        first, _ = browser.picture(lambda facts: facts["done"])
        packed = server._packed

        def broken(*_: Any) -> bytes:
            monkeypatch.setattr(server, "_packed", packed)
            raise OSError("the encoder is full")

        monkeypatch.setattr(server, "_packed", broken)
        browser.send(do="orbit", x=0.1, y=0.1)
        browser.until(lambda: "OSError: the encoder is full" in browser.notices)
        browser.send(do="orbit", x=0.1, y=0.1)
        again, _ = browser.picture(lambda facts: facts["done"] and facts["change"] > 1)
        assert again["sha256"] != first["sha256"]
        browser.send(do="set", name="width", value=70000)
        browser.until(lambda: any("65500" in text for text in browser.notices))


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_other_pages_get_no_files(viewer: Viewer, site: str) -> None:
    port = viewer[2]
    assert get(port, "/save/scene.xml", **{"Sec-Fetch-Site": site})[0] == 403
    assert get(port, "/save/scene.xml", **{"Sec-Fetch-Site": "same-origin"})[0] in (200, 409)


def test_two_browsers_see_one_view(viewer: Viewer) -> None:
    port = viewer[2]
    with Browser(port) as one, Browser(port) as two:
        first = [b.picture(lambda facts: facts["done"])[0]["sha256"] for b in (one, two)]
        assert first[0] == first[1]
        one.send(do="orbit", x=0.2, y=0.0)
        two.send(do="set", name="max_depth", value=4)
        both = [b.picture(lambda f: f["done"] and f["change"] == 2)[0] for b in (one, two)]
        assert both[0]["sha256"] == both[1]["sha256"] != first[0]
        two.until(lambda: two.state["max_depth"] == 4)
        assert two.state["clients"] == 2
    with Browser(port) as three:
        three.until(lambda: three.state.get("clients") == 1)


def test_a_slow_browser_gets_the_newest_picture(viewer: Viewer) -> None:
    """Without an acknowledgement there is no second picture, and then the one of that moment."""
    renderer, _, port = viewer
    with Browser(port) as slow, Browser(port) as fast:
        received = None
        while received is None:
            received = slow.receive()
        fast.picture(lambda facts: facts["done"])
        for k in range(5):
            fast.send(do="orbit", x=0.1, y=0.0)
            fast.picture(lambda facts, k=k: facts["done"] and facts["change"] == k + 1)
        with pytest.raises(TimeoutError):
            while True:
                assert slow.receive(timeout=0.3) is None  # states alone
        slow.ack()
        received = None
        while received is None:
            received = slow.receive()
        assert received[0]["change"] == 5 and received[0]["done"]


# ---- saving ----


def test_saved_files(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "scenes" / "cornell", tmp_path, dirs_exist_ok=True)
    scene = str(tmp_path / "cornell_box.xml")
    with rendering(scene, **SMALL) as renderer, serving(renderer) as (_, port):
        with Browser(port) as browser:
            browser.send(do="orbit", x=0.3, y=-0.1)
            facts, _ = browser.picture(lambda facts: facts["done"] and facts["change"] == 1)
        for name in ("picture.exr", "picture.png", "scene.xml"):
            status, headers, body = get(port, f"/save/{name}")
            assert status == 200 and headers["Content-Disposition"].startswith("attachment")
            (tmp_path / name).write_bytes(body)
    picture = load(tmp_path / "picture.exr")
    assert picture.film_sha256 == facts["sha256"] and picture.spp == 24
    shown = np.asarray(Image.open(tmp_path / "picture.png"))
    assert np.array_equal(shown, to_srgb8(picture.image))
    again = vr.render(vr.load_file(tmp_path / "scene.xml"), device="cpu")
    assert again.film_sha256 == facts["sha256"]


# ---- who gets in ----


def test_loopback() -> None:
    for host in ("127.0.0.1", "127.9.9.9", "::1", "localhost", "LOCALHOST"):
        assert is_loopback(host) and not Door.of(host).token
    for host in ("0.0.0.0", "::", "192.168.0.1", "example.org", ""):
        assert not is_loopback(host) and len(Door.of(host).token) >= 32
    assert Door.of("0.0.0.0").token != Door.of("0.0.0.0").token
    assert Door.of("127.0.0.1", ask=True).token


def test_other_names_and_origins_are_refused(viewer: Viewer) -> None:
    port = viewer[2]
    for host in ("evil.example", "evil.example:80", "127.0.0.1.evil.example", ""):
        assert get(port, "/", Host=host)[0] == 403
        assert get(port, "/save/picture.exr", Host=host)[0] == 403
    for host in (f"localhost:{port}", "127.0.0.1", f"[::1]:{port}", "localhost:1"):
        assert get(port, "/", Host=host)[0] == 200
    for origin in ("http://evil.example", "null", f"http://127.0.0.1:{port + 1}"):
        with pytest.raises(InvalidStatus, match="403"):
            Browser(port, origin=origin)
    with Browser(port, origin=f"http://127.0.0.1:{port}") as browser:
        browser.picture()


def test_token() -> None:
    token = Door.of("0.0.0.0").token
    wrong = token[:-1] + ("A" if token[-1] != "A" else "B")
    with rendering("cornell-box", **SMALL) as renderer, serving(renderer, token) as (_, port):
        for path in ("/", "/save/picture.png", "/save/scene.xml", "/ws", "/nothing"):
            for query in ("", "?token=", f"?token={wrong}", f"?token={token}x", "?token=%FF%00é"):
                raw = path + query.encode("ascii", "ignore").decode()
                assert get(port, raw)[0] == 403
        assert get(port, f"/?token={token}", Host="gpu.example:8470")[0] == 200
        for query in ("", f"?token={wrong}"):
            with pytest.raises(InvalidStatus, match="403"):
                Browser(port, query)
        with pytest.raises(InvalidStatus, match="403"):
            Browser(port, f"?token={token}", origin="http://evil.example")
        with Browser(port, f"?token={token}") as browser:
            assert browser.picture()[1]


# ---- harm ----


def works(port: int) -> None:
    """A new browser gets a picture, and moves it."""
    with Browser(port) as browser:
        browser.picture()
        before = browser.state["position"]
        browser.send(do="orbit", x=0.1, y=0.0)
        browser.until(lambda: browser.state["position"] != before)


@pytest.mark.parametrize("farewell", ["reset", "silent", "half"])
def test_browsers_that_vanish(viewer: Viewer, farewell: str) -> None:
    renderer, server, port = viewer
    for _ in range(8):
        browser = Browser(port)
        browser.send(do="orbit", x=0.01, y=0.0)
        raw = browser.socket.socket
        if farewell == "half":  # of a frame of the socket's protocol
            raw.sendall(b"\x81\xfe\x01")
        if farewell == "reset":
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
        if farewell == "silent":
            raw.shutdown(socket.SHUT_RD)
        raw.close()
    works(port)
    wait(lambda: not server.clients)


def test_messages_without_sense(viewer: Viewer) -> None:
    renderer, _, port = viewer
    done(renderer)
    number, view = renderer.frame.number, renderer.view
    with Browser(port) as rude, Browser(port) as polite:
        for message in ("", "{", "[]", '{"do":"orbit"}', '{"do":"set","name":"spp","value":-1}'):
            rude.socket.send(message)
        rude.socket.send(bytes(range(256)))
        rude.until(lambda: len(rude.notices) >= 1)
        assert renderer.view == view and renderer.frame.number == number
        with pytest.raises(ConnectionClosed):
            for _ in range(MOST_MISTAKES + 10):
                rude.socket.send("garbage")
                rude.receive()
            while True:
                rude.receive()
        polite.picture()
    with Browser(port) as large, pytest.raises(ConnectionClosed):
        large.socket.send("x" * 100_000)
        while True:
            large.receive()
    works(port)


def test_garbage_on_the_port(viewer: Viewer) -> None:
    port = viewer[2]
    rng = np.random.default_rng(4)
    upgrade = b"GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n\r\n"
    lines = [b"", b"\r\n\r\n", b"GET", b"GET / HTTP/1.1\r\n", b"GET / HTTP/9\r\n\r\n", upgrade,
             b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 5000 + b"\r\n", b"GET /" + b"x" * 99999,
             b"\x16\x03\x01\x02\x00\x01\x00", *(rng.bytes(400) for _ in range(20))]  # fmt: skip
    for line in lines:
        with socket.create_connection(("127.0.0.1", port), 10) as raw:
            raw.sendall(line)
            raw.shutdown(socket.SHUT_WR)
            raw.settimeout(20)
            try:
                while raw.recv(65536):
                    pass
            except ConnectionResetError:
                pass
    idle = [socket.create_connection(("127.0.0.1", port), 10) for _ in range(30)]
    works(port)
    for raw in idle:
        raw.close()


def test_too_many_browsers(viewer: Viewer) -> None:
    port = viewer[2]
    browsers = [Browser(port) for _ in range(MOST_CLIENTS)]
    for browser in browsers:
        browser.picture()
    with Browser(port) as late, pytest.raises(ConnectionClosed, match="16 browsers"):
        late.picture()
    for browser in browsers:
        browser.socket.close()
    works(port)


def test_the_file_is_watched(tmp_path: Path) -> None:
    text = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="FOV"/>
        <transform name="to_world"><lookat origin="0,0,-5" target="0,0,0" up="0,1,0"/></transform>
        </sensor><shape type="sphere"/><emitter type="constant"/></scene>"""
    file = tmp_path / "scene.xml"
    file.write_text(text.replace("FOV", "40"))
    with rendering(str(file), **SMALL) as renderer, serving(renderer) as (_, port):
        with Browser(port) as browser:
            browser.picture(lambda facts: facts["done"])
            assert browser.state["fov"] == 40
            file.write_text(text.replace("FOV", "200"))
            browser.until(lambda: "200" in browser.state["message"])
            file.write_text(text.replace("FOV", "55"))
            browser.until(lambda: browser.state["fov"] == 55 and not browser.state["message"])
            browser.picture(lambda facts: facts["done"])


# ---- the command ----

COMMAND = [sys.executable, "-m", "veriray", "view", "cornell-box", "--device", "cpu"]


def started(*arguments: str) -> tuple[subprocess.Popen[str], str, list[str]]:
    """The command once it listens: process, address, and lines so far."""
    process = subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True)  # fmt: skip
    lines = []
    assert process.stdout is not None
    for line in process.stdout:
        lines.append(line)
        if found := re.search(r"^viewer +(http://\S+)", line):
            return process, found[1], lines
    raise AssertionError(f"{lines} {process.communicate()}")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_cleanly(number: signal.Signals) -> None:
    process, address, _ = started("--port", "0", "--width", "3000", "--height", "3000")
    port = int(address.rsplit(":", 1)[1].strip("/"))
    try:
        with Browser(port) as browser:
            browser.picture()  # it is in the middle of a pass now
            start = time.monotonic()
            process.send_signal(number)
            out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 0 and "stopped" in out and err == ""
    assert time.monotonic() - start < 15


def test_other_hosts_ask_for_a_token() -> None:
    process, address, lines = started("--port", "0", "--host", "0.0.0.0")
    try:
        found = re.fullmatch(r"http://0\.0\.0\.0:(\d+)/\?token=([\w-]{32,})", address)
        assert found
        assert get(int(found[1]), "/")[0] == 403
        assert get(int(found[1]), f"/?token={found[2]}")[0] == 200
    finally:
        process.terminate()
        err = process.communicate(timeout=30)[1]
    assert "with the token sees the scene" in err and "not encrypted" in err


def test_a_port_in_use_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ended = subprocess.run([*COMMAND, "--port", str(port)], capture_output=True, text=True,
                               timeout=60)  # fmt: skip
    assert ended.returncode == 2 and f"port {port}" in ended.stderr
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize(("arguments", "text"), [
    (["--port", "70000"], "--port 70000: expected 0 to 65535"),
    (["--host", "no such host"], "cannot listen"), (["--spp", "0"], "spp = 0"),
])  # fmt: skip
def test_bad_arguments(arguments: list[str], text: str) -> None:
    ended = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=60)
    assert ended.returncode == 2 and text in ended.stderr and ended.stderr.count("\n") == 1


def test_messages_are_json() -> None:
    """Numbers of a state that JSON lacks would end every browser's page."""
    with rendering("cornell-box", **SMALL) as renderer, serving(renderer) as (server, _):
        json.loads(json.dumps(server._values(), allow_nan=False))
        json.loads(json.dumps(server._facts(done(renderer)), allow_nan=False))
