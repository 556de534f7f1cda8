"""A viewer for tests: its renderer and server, with the loop of the server on a thread."""

from __future__ import annotations

import asyncio
import contextlib
import json
import struct
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from websockets.sync.client import ClientConnection, connect

from veriray.viewer.controls import View
from veriray.viewer.renderer import Renderer
from veriray.viewer.server import Door, Server
from veriray.viewer.source import Source

PATIENCE = 60.0


def wait(condition: Callable[[], Any], what: str = "") -> Any:
    """The condition's value once it is true."""
    last = time.monotonic() + PATIENCE
    while not (value := condition()):
        assert time.monotonic() < last, f"not within {PATIENCE} s {what}"
        time.sleep(0.005)
    return value


@contextlib.contextmanager
def rendering(scene: str, device: str = "cpu", **view: Any) -> Iterator[Renderer]:
    """A renderer that runs."""
    renderer = Renderer(Source(scene), device, view=View(**view))
    renderer.start()
    try:
        yield renderer
    finally:
        renderer.stop()


def done(renderer: Renderer) -> Any:
    """The frame of the current view with all its samples."""

    def finished() -> Any:
        frame = renderer.frame
        current = frame is not None and frame.change == renderer._change
        return frame if current and frame.done else None

    return wait(finished, renderer.message)


@contextlib.contextmanager
def serving(renderer: Renderer, token: str = "") -> Iterator[tuple[Server, int]]:
    """A server for it on a free port of this machine, and the port."""
    server = Server(renderer, Door(token), "box.xml")
    loop = asyncio.new_event_loop()
    stop, port = asyncio.Event(), []

    async def serve() -> None:
        async with server.listening("127.0.0.1", 0) as number:
            port.append(number)
            await stop.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    try:
        wait(lambda: port)
        yield server, port[0]
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join()
        loop.close()


class Browser:
    """The other end of the protocol."""

    def __init__(self, port: int, query: str = "", **options: Any) -> None:
        self.socket: ClientConnection = connect(
            f"ws://127.0.0.1:{port}/ws{query}", max_size=None, max_queue=None, compression=None,
            **options,
        ).__enter__()  # fmt: skip
        self.state: dict[str, Any] = {}
        self.notices: list[str] = []

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def ack(self) -> None:
        self.socket.send('{"do":"ack"}')

    def receive(self, timeout: float = PATIENCE) -> tuple[dict[str, Any], bytes] | None:
        """The next message; facts and file of a picture, None for what is none."""
        message = self.socket.recv(timeout=timeout)
        if isinstance(message, str):
            content = json.loads(message)
            self.state = content.get("state", self.state)
            self.notices += [content["notice"]] if "notice" in content else []
            return None
        (length,) = struct.unpack("<I", message[:4])
        return json.loads(message[4 : 4 + length]), message[4 + length :]

    def picture(self, good: Callable[[dict[str, Any]], Any] = lambda _: True) -> Any:
        """The first picture whose facts are good, with all before it acknowledged."""
        last = time.monotonic() + PATIENCE
        while time.monotonic() < last:
            received = self.receive()
            if received is not None:
                self.ack()
                if good(received[0]):
                    return received
        raise AssertionError(f"no such picture within {PATIENCE} s")

    def until(self, condition: Callable[[], Any]) -> None:
        """Receives until the condition is true."""
        last = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < last
            if self.receive() is not None:
                self.ack()
