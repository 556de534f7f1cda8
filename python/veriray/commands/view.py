"""`veriray view`."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import signal
from typing import Any

from .. import interrupts
from ..extras import need
from .common import (
    SCENE_SETTINGS,
    CommandError,
    add_scene,
    add_settings,
    definitions,
    integer,
    report_notes,
    say,
    show_warning,
)

PORT = 8470
_SETTINGS = ("spp", "seed", "max_depth", "rr_depth", "sampler", "scheduler")


def add(commands: Any) -> None:
    """Adds `view` to the parser."""
    parser = commands.add_parser("view", help="look at a scene in the browser, and move in it")
    add_scene(parser)
    add_settings(parser, *_SETTINGS, "threads")
    parser.add_argument(
        "--host", default="127.0.0.1", metavar="ADDRESS",
        help="where to listen (127.0.0.1: this machine alone; another one asks for a token)",
    )  # fmt: skip
    parser.add_argument(
        "--port", type=integer, default=PORT, metavar="N", help=f"0 for any free one ({PORT})"
    )
    parser.add_argument("--token", action="store_true", help="ask for a token on this machine too")
    parser.set_defaults(handler=_view)


def _view(arguments: argparse.Namespace) -> int:
    if not 0 <= arguments.port < 1 << 16:
        raise CommandError(f"--port {arguments.port}: expected 0 to 65535")
    need("the viewer", "view")
    from .. import device as device_module
    from ..settings import RenderSettings
    from ..viewer import server
    from ..viewer.controls import View
    from ..viewer.renderer import Renderer
    from ..viewer.source import Source

    names = (*_SETTINGS, *SCENE_SETTINGS, "threads")
    RenderSettings(**{name: getattr(arguments, name) for name in names})
    chosen, reason = device_module.select(arguments.device)
    own = {name: getattr(arguments, name) for name in (*_SETTINGS, "width", "height")}
    source = Source(arguments.scene, definitions(arguments), arguments.sensor, arguments.strict)
    renderer = Renderer(source, chosen.name, arguments.threads, View(**own))
    report_notes(renderer.file.notes)
    say(f"device     {chosen.name}, {chosen.description} ({reason})")
    door = server.Door.of(arguments.host, arguments.token)
    serving = server.Server(renderer, door, os.path.basename(arguments.scene))
    try:
        asyncio.run(_serve(renderer, serving, arguments.host, arguments.port))
    finally:
        renderer.stop()
    say("stopped")
    return 0


async def _serve(renderer: Any, serving: Any, host: str, port: int) -> None:
    """Serves until Ctrl-C, SIGTERM or the end of the terminal."""
    from ..viewer.server import is_loopback

    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in interrupts.SIGNALS:
        if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:  # nohup
            continue
        with contextlib.suppress(ValueError, RuntimeError):  # not the main thread
            loop.add_signal_handler(number, stop.set)
    async with contextlib.AsyncExitStack() as stack:
        try:
            port = await stack.enter_async_context(serving.listening(host, port))
        except OSError as error:
            reason = error.strerror or str(error)
            raise CommandError(f"cannot listen at {host}, port {port}: {reason}") from None
        renderer.start()
        token = f"?token={serving.door.token}" if serving.door.token else ""
        place = f"[{host}]" if ":" in host else host
        say(f"viewer     http://{place}:{port}/{token}")
        if is_loopback(host):
            say(f"from afar  ssh -L {port}:127.0.0.1:{port} THIS-MACHINE, then the same address")
        else:
            show_warning(
                f"whoever reaches {host}:{port} with the token sees the scene and its file, and "
                "uses this device; the connection is not encrypted (ssh -L is)"
            )
        say("Ctrl-C ends it")
        await stop.wait()
