"""The server of the viewer: the page, its socket, and what users save.

Protocol, on the socket /ws. A browser sends JSON texts (`controls.parse`), and {"do": "ack"} once
it has shown a picture; without that it gets no further one, so that a slow one has the newest, and
none queue up. It gets texts, {"state": {...}} or {"notice": "..."}, and pictures: four bytes with
the length of a JSON text (little-endian), the text (`Server._facts`), and an image file.

All browsers see and steer one view. Who may: see `Door`.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import hmac
import http
import ipaddress
import itertools
import json
import logging
import math
import secrets
import struct
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

from websockets.asyncio.server import Server as Sockets
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from ..errors import printable
from ..settings import SETTINGS
from . import controls, display
from .renderer import Frame, Renderer

#: Browsers at once, and messages that make no sense after which one is turned away.
MOST_CLIENTS, MOST_MISTAKES = 16, 100
#: Pixels up to which a picture that is done is sent without loss.
LOSSLESS_PIXELS = 1 << 22
_FILES = {"/": "page.html", "/page.css": "page.css", "/page.js": "page.js"}
_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a server that listens there."""
    if host.lower() == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return False


@dataclass(frozen=True)
class Door:
    """Who gets in: requests with the token, where there is one.

    Without one the server listens to this machine alone, and the request must name it so: a name
    that somebody made to point here is refused. A socket that a page of another origin opens is
    refused in any case.
    """

    token: str = ""

    @classmethod
    def of(cls, host: str, ask: bool = False) -> Door:
        """For a server that listens at `host`; ask: for a token on a loopback address too."""
        return cls(secrets.token_urlsafe(24) if ask or not is_loopback(host) else "")

    def refuses(self, request: Request, socket: bool) -> str:
        """Why a request gets no answer; "" if it gets one."""
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        if len(hosts) != 1 or len(origins) > 1:
            return "expected one header Host"
        if self.token:
            given = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
            if not hmac.compare_digest(given.encode(), self.token.encode()):
                return "the address lacks the token that `veriray view` printed"
        else:
            name = urlsplit(f"//{hosts[0]}").hostname
            if not name or not is_loopback(name):
                return (
                    f"Host is {printable(hosts[0])[:80]}; this server answers its own machine only"
                )
        other = request.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin")
        if socket and origins:
            other |= urlsplit(origins[0]).netloc.lower() != hosts[0].lower()
        if other:
            return "a page of another origin may not connect"
        return ""


@dataclass(eq=False)
class _Client:
    """A browser. shown: whether it has shown what it got."""

    socket: ServerConnection
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    state: str = ""
    picture: bytes = b""
    shown: bool = True
    notices: list[str] = field(default_factory=list)
    mistakes: int = 0


class Server:
    """Serves what a renderer shows. Its `changed` must be this server's `wake`."""

    def __init__(self, renderer: Renderer, door: Door, title: str) -> None:
        self.renderer, self.door, self.title = renderer, door, title
        self.clients: set[_Client] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._news = asyncio.Event()
        self._saving = asyncio.Lock()
        self._state = ""
        self._picture = b""
        self._made: tuple[Any, ...] = ()
        self._encoder = concurrent.futures.ThreadPoolExecutor(1, "veriray-encode")
        renderer.changed = self.wake

    def wake(self) -> None:
        """Says that the renderer has news; from any thread."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._news.set)

    @contextlib.asynccontextmanager
    async def listening(self, host: str, port: int) -> Any:
        """Listens at an address as long as the block lasts, which gets the port's number.

        Raises OSError where that is not possible.
        """
        self._loop = asyncio.get_running_loop()
        logger = logging.getLogger("veriray.viewer")
        logger.setLevel(logging.CRITICAL)  # what strangers send is no news
        tasks = [asyncio.create_task(task()) for task in (self._pump, self._watch)]
        try:
            async with serve(
                self._client, host, port, process_request=self._request, max_size=controls.LONGEST,
                max_queue=64, compression=None, ping_interval=10, ping_timeout=20, open_timeout=30,
                close_timeout=2, logger=logger, server_header=None,
            ) as sockets:  # fmt: skip
                self.wake()
                yield _port(sockets)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._encoder.shutdown(wait=False, cancel_futures=True)

    # ---- what there is to send ----

    async def _pump(self) -> None:
        """Makes a message of each new picture and state."""
        assert self._loop is not None
        while True:
            await self._news.wait()
            self._news.clear()
            try:
                self._tell()
                frame, shown = self.renderer.frame, self.renderer.view.shown()
                if frame is None or self._made == (frame.number, shown):
                    continue
                if display.CHANNELS[shown[0]].of_scene and shown[0] not in frame.made:
                    continue  # the renderer makes it
                self._made = frame.number, shown
                self._picture = await self._loop.run_in_executor(
                    self._encoder, self._packed, frame, shown
                )
                self._tell()
            except Exception as error:  # of one picture; the next one may work
                self._notify(printable(f"{type(error).__name__}: {error}"))

    def _tell(self) -> None:
        self._state = json.dumps({"state": self._values()})
        for client in self.clients:
            client.wake.set()

    def _notify(self, text: str) -> None:
        for client in self.clients:
            client.notices.append(text)
            client.wake.set()

    async def _watch(self) -> None:
        """Has the scene read again when its file changes."""
        assert self._loop is not None
        while True:
            await asyncio.sleep(0.5)
            changed = False
            with contextlib.suppress(OSError):  # asked again next time
                changed = await self._loop.run_in_executor(None, self.renderer.source.changed)
            if changed:
                await asyncio.sleep(0.1)  # for who writes it in several steps
                loads = self.renderer.loads
                self.renderer.reload()
                for _ in range(100):
                    await asyncio.sleep(0.05)
                    if self.renderer.loads != loads or self.renderer.message:
                        break

    def _values(self) -> dict[str, Any]:
        """All that the page shows of the view."""
        renderer = self.renderer
        view = renderer.view
        scene = view.scene(renderer.file)
        camera = scene.camera
        values: dict[str, Any] = {name: getattr(view, name) for name in controls.FIELDS}
        values |= {name: getattr(camera, name) for name in controls.LENS}
        values |= {
            "width": scene.film.width, "height": scene.film.height, "spp": scene.spp,
            "max_depth": scene.max_depth, "rr_depth": scene.rr_depth, "sampler": scene.sampler,
            "projection": camera.projection, "distance": view.distance, "title": self.title,
            "message": renderer.message, "loads": renderer.loads, "clients": len(self.clients),
            "position": [float(x) for x in camera.to_world[:3, 3]],
            "channels": {name: c.title for name, c in display.CHANNELS.items()},
            "curves": list(display.CURVES), "ups": list(controls.UPS),
            "samplers": list(SETTINGS["sampler"].choices),
            "schedulers": list(SETTINGS["scheduler"].choices),
        }  # fmt: skip
        return values

    def _packed(self, frame: Frame, shown: tuple[str, float, str]) -> bytes:
        """The message of a picture. Beside `_facts` it says its age, in seconds since the change
        that it shows, and of which steps that consists (`Frame.marks`)."""
        channel, exposure, curve = shown
        marks = frame.marks | {"queue": time.perf_counter()}
        facts = self._facts(frame)
        marks["facts"] = time.perf_counter()
        final = frame.done and frame.render.width * frame.render.height <= LOSSLESS_PIXELS
        pixels, legend = display.as_bytes(
            frame.render, channel, exposure, curve, exact=final, made=frame.made
        )
        marks["tones"] = time.perf_counter()
        kind, data = display.encoded(pixels, None if final else 80 if frame.preview else 92)
        marks["file"] = time.perf_counter()
        if not frame.done:
            size = frame.render.width * frame.render.height
            self.renderer.took("file", size, marks["file"] - marks["queue"])
        facts |= {
            "type": kind, "legend": legend and {"title": legend.title, "marks": legend.marks},
            "age": marks["file"] - marks["asked"],
            "steps": {b: marks[b] - marks[a] for a, b in itertools.pairwise(marks)},
        }  # fmt: skip
        text = json.dumps(facts).encode()
        return struct.pack("<I", len(text)) + text + data

    def _facts(self, frame: Frame) -> dict[str, Any]:
        """What is said of a picture. live: rays alive at each depth as a share of the paths;
        sha256: of one that is done."""
        render = frame.render
        stats = render.stats
        error = frame.error()
        paths = max(stats["paths"], 1)
        return {
            "number": frame.number, "change": frame.change, "coarse": frame.coarse,
            "width": render.width, "height": render.height, "spp": render.spp, "done": frame.done,
            "preview": frame.preview, "seconds": stats["seconds"],
            "rate": stats["samples_per_second"], "device": stats["device"],
            "device_name": stats["device_name"], "scheduler": stats["scheduler"],
            "error": error if error is not None and math.isfinite(error) else None,
            "live": [n / paths for n in stats["live_rays"]],
            "sha256": render.film_sha256 if frame.done else "",
        }  # fmt: skip

    # ---- browsers ----

    async def _client(self, socket: ServerConnection) -> None:
        if len(self.clients) >= MOST_CLIENTS:
            await socket.close(1013, f"{MOST_CLIENTS} browsers are connected already")
            return
        client = _Client(socket)
        self.clients.add(client)
        self.wake()
        sender = asyncio.create_task(self._send(client))
        try:
            async for message in socket:
                await self._receive(client, message)
        except ConnectionClosed:
            pass
        finally:
            self.clients.discard(client)
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
                await sender
            self.wake()

    async def _receive(self, client: _Client, message: str | bytes) -> None:
        if message == '{"do":"ack"}':
            client.shown = True
            client.wake.set()
            return
        try:
            self.renderer.submit(controls.parse(message))
        except ValueError as error:
            client.mistakes += isinstance(error, controls.ControlError)
            client.notices = [*client.notices[-3:], str(error)]
            client.wake.set()
            if client.mistakes > MOST_MISTAKES:
                await client.socket.close(1008, "too many malformed messages")

    async def _send(self, client: _Client) -> None:
        """Sends a browser what is new to it."""
        with contextlib.suppress(ConnectionClosed):
            while True:
                while client.notices:
                    await client.socket.send(json.dumps({"notice": client.notices.pop(0)}))
                if self._state and client.state != self._state:
                    client.state = self._state
                    await client.socket.send(client.state)
                if self._picture and client.shown and client.picture is not self._picture:
                    client.picture, client.shown = self._picture, False
                    await client.socket.send(client.picture)
                await client.wake.wait()
                client.wake.clear()

    async def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        """The answer to a request; None opens a socket."""
        if getattr(request, "method", "GET") != "GET":  # websockets < 17 refuses them itself
            return _text(http.HTTPStatus.METHOD_NOT_ALLOWED, "this server answers GET alone")
        try:
            path = urlsplit(request.path).path
        except ValueError:
            return _text(http.HTTPStatus.BAD_REQUEST, "the address cannot be read")
        socket = path == "/ws"
        if path not in ("/page.css", "/page.js"):  # which say nothing of the scene
            if reason := self.door.refuses(request, socket):
                return _text(http.HTTPStatus.FORBIDDEN, reason)
        if socket:
            if "websocket" in request.headers.get("Upgrade", "").lower():
                return None
            return _text(http.HTTPStatus.UPGRADE_REQUIRED, "this address is for WebSockets")
        if path in _FILES:
            file = Path(__file__).with_name(_FILES[path])
            return _answer(http.HTTPStatus.OK, _TYPES[file.suffix], file.read_bytes())
        if path.startswith("/save/"):
            return await self._save(path.removeprefix("/save/"))
        return _text(http.HTTPStatus.NOT_FOUND, "there is nothing at this address")

    async def _save(self, name: str) -> Response:
        """A file of what is shown."""
        makers = {"picture.exr": self._exr, "picture.png": self._png, "scene.xml": self._xml}
        frame = self.renderer.frame
        if name not in makers:
            return _text(http.HTTPStatus.NOT_FOUND, f"expected {', '.join(makers)}")
        if frame is None or (name != "scene.xml" and frame.preview):
            return _text(http.HTTPStatus.CONFLICT, "there is no whole picture yet: wait a moment")
        assert self._loop is not None
        try:
            async with self._saving:  # one at a time: it takes memory
                kind, data = await self._loop.run_in_executor(None, makers[name], frame)
        except (ValueError, OSError, MemoryError) as error:
            return _text(http.HTTPStatus.CONFLICT, str(error))
        samples = "" if name == "scene.xml" else f"-{frame.render.spp}spp"
        file = quote(f"{Path(self.title).stem}{samples}{Path(name).suffix}")
        place = f"attachment; filename*=UTF-8''{file}"
        return _answer(http.HTTPStatus.OK, kind, data, ("Content-Disposition", place))

    def _exr(self, frame: Frame) -> tuple[str, bytes]:
        with tempfile.TemporaryDirectory(prefix="veriray-") as folder:
            file = Path(folder) / "picture.exr"
            frame.render.save(file)
            return "image/x-exr", file.read_bytes()

    def _png(self, frame: Frame) -> tuple[str, bytes]:
        shown = self.renderer.view.shown()
        found = display.CHANNELS[shown[0]]
        if found.of_scene and shown[0] not in frame.made:
            raise ValueError(f"{found.title} is not there yet: wait a moment")
        pixels, _ = display.as_bytes(frame.render, *shown, exact=True, made=frame.made)
        return display.encoded(pixels, None)

    def _xml(self, _: Frame) -> tuple[str, bytes]:
        renderer = self.renderer
        scene = renderer.view.scene(renderer.file).with_(seed=renderer.view.seed)
        return "application/xml", renderer.source.xml(scene).encode()


def _port(sockets: Sockets) -> int:
    return int(next(iter(sockets.sockets)).getsockname()[1])


def _text(status: http.HTTPStatus, text: str) -> Response:
    return _answer(status, "text/plain", f"veriray view: {printable(text)}\n".encode())


def _answer(status: http.HTTPStatus, kind: str, body: bytes, *more: tuple[str, str]) -> Response:
    headers = Headers(
        [
            ("Content-Type", f"{kind}; charset=utf-8" if kind.startswith("text/") else kind),
            ("Content-Length", str(len(body))),
            ("Cache-Control", "no-store"),
            ("Content-Security-Policy", _POLICY),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
            ("Connection", "close"),
            *more,
        ]
    )
    return Response(status.value, status.phrase, headers, body)
