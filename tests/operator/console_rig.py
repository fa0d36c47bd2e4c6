"""A real server, a real `usarsim console` and Chromium, each a process: what display tests share.

The world is a row of stalls. In each stands a robot that looks at a wall of two panels, 2 m ahead
of its scanner; the pair of their colours is another one in every stall. Behind them is a hill.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import io
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from console_browser import CHROMIUM, FLAGS
from fake_gateway import FakeGateway
from numpy.typing import NDArray
from PIL import Image

from usarsim_server.base.launch import Program, python
from usarsim_server.testing import PATIENCE, Closing, ServerProcess

HUES = {"red": (0.9, 0.05, 0.05), "green": (0.05, 0.8, 0.05), "blue": (0.1, 0.15, 0.95),
        "yellow": (0.9, 0.85, 0.05)}  # fmt: skip
ZONES = ("yellow", "orange", "red", "blue")
"""Of the first four stalls."""
STALLS = 16
APART = 3.0
"""m between two stalls, and from their first to their last one along y."""
WALL = 2.0
"""m from the scanner of a robot to the panels ahead of it."""
SCANNER = (0.2085, 0.0, 0.2)
"""Where a P3AT has its scanner: x, y (left), z (up) from its reference point, m."""
PANEL_TOP = 1.2
"""m above the floor."""

HILL = ((-6.5, 0.0), (-10.2, 2.1), (-10.2, -2.1))
"""Places on the side of a smooth hill behind the stalls: x, y (left), m."""

_ROAMER = """
name = "Roamer"
extends = "P3AT"
[[sensor]]
type = "GroundTruth"
name = "GndTruth"
interval = 0.05
[drive]
max_wheel_speed = 8.17
"""
_LOOKER = """
name = "Looker"
extends = "P3AT"
[[sensor]]
type = "RangeScanner3D"
name = "Deep"
position = [0.2085, 0, -0.5]
fov = 0.7
resolution = 0.07
vertical_fov = 0.3
vertical_resolution = 0.06
[drive]
max_wheel_speed = 8.17
"""


def pair(stall: int) -> tuple[str, str]:
    """Colours of the left and of the right panel of a stall."""
    names = list(HUES)
    return names[stall % 4], names[stall // 4]


def place(stall: int) -> float:
    """y of a stall, m to the left."""
    return APART * (stall - (STALLS - 1) / 2.0)


def yard(folder: Path) -> tuple[Path, Path]:
    """Write the world and a folder of robots; their paths."""
    world, robots = folder / "stalls", folder / "robots"
    world.mkdir()
    robots.mkdir()
    face = SCANNER[0] + WALL
    panels, starts = [], []
    for stall in range(STALLS):
        for side, colour in zip((0.5, -0.5), pair(stall), strict=True):
            rgba = " ".join(map(str, HUES[colour]))
            panels.append(
                f'<geom type="box" size="0.05 0.5 {PANEL_TOP / 2}" rgba="{rgba} 1" '
                f'pos="{face + 0.05} {place(stall) + side} {PANEL_TOP / 2}"/>'
            )
        starts.append(f'[[start]]\ntag = "Stall{stall}"\nposition = [0.0, {place(stall)}, 0.25]\n')
    panels.append('<geom type="ellipsoid" size="6 6 1" rgba=".4 .5 .4 1" pos="-9 0 -0.6"/>')
    for number, (x, y) in enumerate(HILL):
        starts.append(f'[[start]]\ntag = "Hill{number}"\nposition = [{x}, {y}, 0.6]\n')
    (world / "scene.xml").write_text(
        '<mujoco><visual><headlight ambient=".6 .6 .6" diffuse=".3 .3 .3"/></visual><worldbody>'
        '<geom type="plane" size="0 0 1" rgba=".5 .5 .5 1"/>' + "".join(panels) +
        "</worldbody></mujoco>"
    )  # fmt: skip
    zones = [
        f'[[zone]]\nname = "{one}"\nkind = "{one}"\nx = [-1.0, 3.0]\ny = [{y - 1.5}, {y + 1.5}]\n'
        for one, y in zip(ZONES, map(place, range(4)), strict=True)
    ]
    (world / "world.toml").write_text('title = "Stalls"\n' + "".join(starts + zones))
    (robots / "Looker.toml").write_text(_LOOKER)
    (robots / "Roamer.toml").write_text(_ROAMER)
    return world, robots


class Tap(Closing):
    """Stands between the console and a port of the server; `hold` lets nothing through."""

    def __init__(self, port: int) -> None:
        self._to, self._open = port, threading.Event()
        self._open.set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def hold(self, held: bool) -> None:
        """Keep what comes from the server, or let it through again."""
        (self._open.clear if held else self._open.set)()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self._to))
                self._sockets += [near, far]
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._pump, args=(one, other), daemon=True).start()

    def _pump(self, one: socket.socket, other: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := one.recv(65536):
                self._open.wait()
                other.sendall(data)

    def close(self) -> None:
        self._open.set()
        # A thread that waits in accept or recv is not woken by a mere close.
        for one in (self._listener, *self._sockets):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()


class Console(Program):
    """`usarsim console` in a process of its own; of a server without images, unless one is named.

    Attributes:
        urls: of the page, by role.
    """

    def __init__(self, control: int, *arguments: str, folder: Path) -> None:
        # Bound and not listening: nothing else on this machine answers there.
        self._nowhere = socket.socket()
        self._nowhere.bind(("127.0.0.1", 0))
        images = ["--image-port", str(self._nowhere.getsockname()[1])]
        words = ["console", "--no-browser", "--connect", f"127.0.0.1:{control}",
                 "--console-port", "0", "--latch", str(folder / "latch"),
                 "--viewer-delay", "0", *images, *arguments]  # fmt: skip
        super().__init__("the console", python("-m", "usarsim_server", *words, tied=True))
        self.urls = {one[2]: one[1] for one in self.announced(r"CONSOLE (\S+) (\w+)", 3)}

    def close(self) -> None:
        """Kill it."""
        self.end(signal.SIGKILL)
        self._nowhere.close()


class Played:
    """A fake gateway on a loop of its own."""

    def __init__(self, robots: int) -> None:
        self.gateway = FakeGateway(robots)
        self._ready, self._done = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(target=asyncio.run, args=(self._serve(),), daemon=True)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        async with self.gateway.serve() as self.port:
            self._ready.set()
            await self._done.wait()

    def __enter__(self) -> FakeGateway:
        self._thread.start()
        self._ready.wait()
        return self.gateway

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._done.set)
        self._thread.join()

    def url(self, role: str) -> str:
        return f"http://127.0.0.1:{self.port}/#{role}"


@contextlib.contextmanager
def chromium(flags: list[str] = FLAGS) -> Iterator[Any]:
    """A browser for the tests of a module; skips where there is none."""
    if CHROMIUM is None:
        pytest.skip("no chromium on PATH: the page is not tried in a browser")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(
            executable_path=CHROMIUM, args=flags, env={**os.environ, "LIBGL_ALWAYS_SOFTWARE": "1"}
        )
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def shown(
    browser: Any, url: str, before: Callable[[Any], None] | None = None, **options: Any
) -> Iterator[Any]:
    """A page; fails at the end where it threw anything or asked anybody else for anything.

    Args:
        browser: where. url: of the page. options: of the profile.
        before: done to the page before it is loaded.
    """
    page = browser.new_page(**{"viewport": {"width": 1366, "height": 768}, **options})
    page.set_default_timeout(1000.0 * PATIENCE)
    errors: list[str] = []
    origin = url.partition("/#")[0]
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
    page.on(
        "request",
        lambda r: None if r.url.startswith((origin, "blob:")) else errors.append(f"asked {r.url}"),
    )
    if before is not None:
        before(page)
    page.goto(url)
    page.wait_for_selector("[data-tile]", state="attached")
    try:
        yield page
    finally:
        page.close()
    assert not errors, errors


def pixels(page: Any, selector: str) -> NDArray[np.float64]:
    """(height, width, 3): what an element looks like on the screen, 0 to 255."""
    data = page.locator(selector).first.screenshot()
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), float)


def canvas(page: Any, selector: str) -> NDArray[np.float64]:
    """(height, width, 4): the pixels of a 2D canvas, 0 to 255, with its opacity."""
    url = page.eval_on_selector(selector, "(c) => c.toDataURL()")
    data = base64.b64decode(url.partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"), float)


def escaped_twice(page: Any, stopped: Callable[[], bool]) -> bool:
    """Press Esc twice; whether that has stopped everything: both count within 0.6 s only."""
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    page.wait_for_timeout(300)
    return stopped()


def until(condition: Callable[[], Any]) -> Any:
    """Wait until something is so; what it was."""
    deadline = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < deadline, "it did not come about"
        time.sleep(0.05)
    return found


@contextlib.contextmanager
def real(
    folder: Path, robots: int, *server: str, kind: str = "P3AT", view: str = ""
) -> Iterator[tuple[ServerProcess, Console, Tap]]:
    """Server, console with robots R0, R1, ... in their stalls, and a tap on the pictures.

    Args:
        folder: for files. robots: how many, and their class is kind. server: more of its arguments.
        view: what a spectator in the first tile sees, for pages without WebGL.
    """
    world, classes = yard(folder)
    arguments = ("--world", str(world), "--robots", str(classes), "--image-port=0",
                 "--scene-port=0", "--supervise=on", "--tile-size=160x120",
                 "--camera-rate=5", *server)  # fmt: skip
    if view:
        arguments += (f"--spectator={view}", "--tiles=5x4")
    with ServerProcess(*arguments) as process, Tap(process.ports["images"]) as tap:
        more = [f"--robot={kind}=R{one}" for one in range(robots)]
        ports = [f"--image-port={tap.port}", f"--scene-port={process.ports['scene']}"]
        if view:
            ports.append("--spectator=0,0,160,120")
        with Console(process.ports["control"], *ports, *more, folder=folder) as console:
            yield process, console, tap
