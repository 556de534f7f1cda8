"""Chromium without a window, driven through its DevTools protocol."""

from __future__ import annotations

import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


class Page:
    """A page in a tab. folder: of what it saves."""

    def __init__(self, socket: ClientConnection, folder: Path, width: int, height: int) -> None:
        self.socket, self.number, self.session = socket, 0, ""
        self.errors: list[str] = []
        self.touching = 0
        self.folder = folder
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self.session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Calls a method of the protocol, and gathers what the page complains about meanwhile."""
        self.number += 1
        message: dict[str, Any] = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        self.socket.send(json.dumps(message))
        while True:
            answer = json.loads(self.socket.recv(timeout=60))
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(answer["params"]["exceptionDetails"]))
            if answer.get("method") == "Log.entryAdded":
                entry = answer["params"]["entry"]
                if entry["level"] == "error":
                    self.errors.append(entry["text"])
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                result: dict[str, Any] = answer["result"]
                return result

    def resize(self, width: int, height: int) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height,
            deviceScaleFactor=1, mobile=False,
        )  # fmt: skip

    def open(self, address: str) -> None:
        self.call("Page.navigate", url=address)

    def value(self, expression: str) -> Any:
        """The value of an expression in the page."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"])
        return found["result"].get("value")

    def wait(self, expression: str, seconds: float = 60.0) -> Any:
        """The value of an expression once it is true."""
        last = time.monotonic() + seconds
        while not (value := self.value(expression)):
            assert time.monotonic() < last, f"{expression} is not true after {seconds} s"
            time.sleep(0.02)
        return value

    def mouse(self, kind: str, x: float, y: float, button: str = "left", **more: Any) -> None:
        pressed = {"left": 1, "right": 2}.get(button, 0) if kind != "mouseReleased" else 0
        self.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=1,
            buttons=pressed, **more,
        )  # fmt: skip

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 10,
             pause: float = 0.02, button: str = "left") -> None:  # fmt: skip
        self.mouse("mousePressed", *start, button)
        for k in range(1, steps + 1):
            x, y = (a + (b - a) * k / steps for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", x, y, button)
            time.sleep(pause)
        self.mouse("mouseReleased", *end, button)

    def touch(self, *places: tuple[float, float]) -> None:
        """The fingers that are down from now on; those that were down move there, in this order."""
        down = self.touching
        kind = (
            "touchMove"
            if len(places) == down
            else "touchStart"
            if len(places) > down
            else "touchEnd"
        )
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        self.touching = len(places)

    def key(self, kind: str, code: str) -> None:
        self.call("Input.dispatchKeyEvent", type=kind, code=code, key=code[-1].lower())

    def screenshot(self, path: Path) -> None:
        data = self.call("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))


@contextlib.contextmanager
def browser(downloads: Path, width: int = 1280, height: int = 800) -> Iterator[Page]:
    """A page in a Chromium of its own, which saves files in a folder."""
    assert CHROMIUM is not None
    with tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True) as profile:
        command = [
            CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-dev-shm-usage", "--disable-extensions", "--disable-background-networking",
            "--disable-component-update", "--hide-scrollbars", "--remote-debugging-port=0",
            f"--user-data-dir={profile}", "about:blank",
        ]  # fmt: skip
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        try:
            port, path = _place(Path(profile), process)
            with connect(f"ws://127.0.0.1:{port}{path}", max_size=None) as socket:
                page = Page(socket, downloads, width, height)
                page.call(
                    "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(downloads)
                )
                yield page
        finally:
            process.terminate()
            process.wait(20)


def _place(profile: Path, process: subprocess.Popen[bytes]) -> tuple[str, str]:
    """Port and path of the protocol's socket, which Chromium writes to a file."""
    file = profile / "DevToolsActivePort"
    for _ in range(600):
        if file.exists() and len(lines := file.read_text().split("\n")) >= 2:
            return lines[0], lines[1]
        assert process.poll() is None, "Chromium ended"
        time.sleep(0.05)
    raise AssertionError("Chromium did not start within 30 s")
