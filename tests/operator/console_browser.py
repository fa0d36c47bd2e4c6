"""Pages of the console in a real Chromium, where there is one: what tests of the browser share."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from console_harness import Gateway, gateway

from usarsim_operator import watchdog
from usarsim_operator.roles import Role
from usarsim_record.proxy import Proxy
from usarsim_record.recording import CLIENT, DATA, Link
from usarsim_server.testing import PATIENCE, running_server

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ["--use-angle=gl-egl", "--ignore-gpu-blocklist", "--no-sandbox"]
NO_GL = ["--disable-gpu", "--disable-software-rasterizer", "--no-sandbox"]

PRESS_AGAIN = 5.0
"""Simulated s after which a key that did nothing is pressed again."""

FAKES = """
// Pads that a test plugs in, and frames that take as long as it says.
window.pads = [null, null, null, null];
window.padLooks = 0;
navigator.getGamepads = () => {
  window.padLooks += 1;
  return window.pads;
};
window.plug = (id, mapping = "standard", axes = [0, 0, 0, 0], count = 17, index = 0) => {
  const buttons = Array.from({ length: count }, () => ({ pressed: false, value: 0 }));
  window.pads[index] = { id, mapping, index, connected: true, timestamp: 0, axes, buttons };
  const event = new Event("gamepadconnected");
  event.gamepad = window.pads[index];
  dispatchEvent(event);
};
window.unplug = (index = 0) => {
  const event = new Event("gamepaddisconnected");
  event.gamepad = { ...window.pads[index], connected: false };
  window.pads[index] = null;
  dispatchEvent(event);
};
window.holdOn = (index, ...pressed) => window.pads[index].buttons.forEach((one, i) => {
  one.pressed = pressed.includes(i);
  one.value = Number(one.pressed);
});
window.hold = (...pressed) => window.holdOn(0, ...pressed);
window.tiltOn = (index, ...axes) => { window.pads[index].axes = axes; };
window.tilt = (...axes) => window.tiltOn(0, ...axes);
window.slowFrames = (ms) => {
  const frame = () => {
    const end = performance.now() + ms;
    while (performance.now() < end);
    requestAnimationFrame(frame);
  };
  if (ms) requestAnimationFrame(frame);
};
// What the page sends, and when hands let go: `late` counts the drives after that.
window.sent = [];
window.letGo = 0;
window.done = () => { window.letGo = performance.now(); };
addEventListener("keyup", () => { window.done(); }, true);
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function (data) {
  window.sent.push({ at: performance.now(), ...JSON.parse(data) });
  send.call(this, data);
};
window.drives = () => window.sent.filter((one) => one.type === "drive");
window.late = () => window.drives().filter(
  (one) => one.at > window.letGo && (one.left !== 0 || one.right !== 0)).length;
"""


def executable() -> str:
    """Where Chromium is; skips where there is none."""
    if CHROMIUM is None:
        pytest.skip("no chromium on PATH: the page is not tried in a browser")
    return CHROMIUM


@asynccontextmanager
async def browsing(*flags: str) -> AsyncIterator[Any]:
    """A running browser."""
    program = executable()
    playwright = pytest.importorskip("playwright.async_api")
    async with playwright.async_playwright() as tools:
        environment = {**os.environ, "LIBGL_ALWAYS_SOFTWARE": "1"}
        browser = await tools.chromium.launch(
            executable_path=program, args=list(flags), env=environment
        )
        try:
            yield browser
        finally:
            await browser.close()


@asynccontextmanager
async def shown(
    browser: Any, url: str, *, clock: bool = False, name: str = "", **options: Any
) -> AsyncIterator[Any]:
    """A page in a profile of its own; fails at the end where the page threw anything.

    Args:
        browser: where. url: what it shows. options: of the profile.
        clock: whether the page's clock can be stopped and put forward.
        name: who its operator is.
    """
    context = await browser.new_context(**{"viewport": {"width": 1366, "height": 768}, **options})
    try:
        await context.add_init_script(FAKES)
        if name:
            await context.add_init_script(f"localStorage.setItem('usarsim-name', {name!r})")
        page = await context.new_page()
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on(
            "console", lambda m: errors.append(m.text) if "Content Security" in m.text else None
        )
        if clock:
            await page.clock.install()
        await page.goto(url)
        yield page
        assert errors == []
    finally:
        await context.close()


@asynccontextmanager
async def opened(
    port: int, role: str, *, flags: list[str] = FLAGS, **options: Any
) -> AsyncIterator[Any]:
    """A page of a role in a browser of its own."""
    url = f"http://127.0.0.1:{port}/#{role}"
    async with browsing(*flags) as browser, shown(browser, url, **options) as page:
        await page.wait_for_selector("[data-tile]", state="attached")
        yield page


class Wire:
    """What a gateway has told a server: the lines of each robot's connection, in their order.

    The writer of a recording, to a proxy; remembers instead of writing.
    """

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []
        self._names: dict[int, str] = {}
        self._rests: dict[int, str] = {}

    def add(self, number: int, kind: str, side: str, data: bytes = b"", link: int = 0) -> None:
        """Take a piece of a connection."""
        if kind != DATA or side != CLIENT:
            return
        *lines, rest = (self._rests.get(number, "") + data.decode("latin-1")).split("\r\n")
        self._rests[number] = rest
        for line in lines:
            if line.startswith("INIT") and (found := re.search(r"\{Name ([^}]*)\}", line)):
                self._names[number] = found[1]
            self.lines.append((self._names.get(number, ""), line))

    def drives(self, robot: str) -> list[tuple[float, float]]:
        """All wheel powers that a robot was told, left and right, parts of the most."""
        found = []
        for name, line in self.lines:
            if name == robot and line.startswith("DRIVE"):
                pair = re.findall(r"\{(?:Left|Right) ([^}]*)\}", line)
                if len(pair) == 2:
                    found.append((round(float(pair[0]) / 100, 4), round(float(pair[1]) / 100, 4)))
        return found


class Stage:
    """A server, a tap on its control port, a gateway behind that, a browser; and their loop.

    The browser draws no 3D view: what is tried here is what hands do, and frames that take long
    are made by a hook, so that they take equally long everywhere.
    """

    def __init__(self, runner: asyncio.Runner) -> None:
        self.wire = Wire()
        self.gateway: Gateway
        self.browser: Any
        self.tap = 0
        self.latch: Path
        self._runner = runner
        self._stack = AsyncExitStack()

    def run(self, work: Coroutine[Any, Any, None]) -> None:
        """Do a test on the loop of all of them, and leave no emergency stop to the next one.

        Two Esc for two dialogs stop everything, if they are quick enough.
        """
        try:
            self._runner.run(work)
        finally:
            self.gateway.station.arbiter.reset("the next test", 0)
            self.latch.unlink(missing_ok=True)

    async def open(self, port: int, latch: Path, scene: int | None = None) -> None:
        """Begin, before a server that runs; scene: its scene port."""
        self.latch = latch
        proxy = Proxy([Link(0, "127.0.0.1", port)], self.wire)  # type: ignore[arg-type]
        self.tap = (await proxy.start())[0]
        self._stack.push_async_callback(proxy.stop)
        self.browser = await self._stack.enter_async_context(browsing(*NO_GL))
        self.gateway = await self._stack.enter_async_context(
            gateway(self.tap, latch=latch, scene=scene)
        )
        for number in (1, 2, 3, 4):
            await self.gateway.station.spawn("P3AT", f"R{number}", f"RobotStart{number}")

    async def close(self) -> None:
        """End everything."""
        await self._stack.aclose()

    def url(self, role: Role = Role.OPERATOR, gateway: Gateway | None = None) -> str:
        """Where a role's page is."""
        found = gateway or self.gateway
        return f"{found.url}/#{found.web.tokens[role]}"

    @asynccontextmanager
    async def page(
        self, role: Role = Role.OPERATOR, *, gateway: Gateway | None = None, **options: Any
    ) -> AsyncIterator[Any]:
        """A page of a role that has heard of the robots; holds none of them afterwards."""
        found = gateway or self.gateway
        async with shown(self.browser, self.url(role, found), **options) as page:
            await becomes(page, "window.usarsim.store.robots.length")
            number = await page.evaluate("window.usarsim.store.welcome.page")
            yield page
        await until(lambda: number not in found.station.pages)

    async def driven(self, robot: str, pair: tuple[float, float]) -> None:
        """Wait until a robot is told a pair of wheel powers, or was told just now."""
        await until(lambda: self.wire.drives(robot)[-1:] == [pair])

    async def hold(self, page: Any, key: str, robot: str, pair: tuple[float, float]) -> None:
        """Hold a key until a robot is told a pair of wheel powers.

        A page that had lost its focus to the browser lets go of all keys when it hears of that,
        however late: after some seconds of the world the key is pressed once more, as people do.
        """
        station = self.gateway.station
        began = station.time
        await page.keyboard.down(key)
        await until(
            lambda: self.wire.drives(robot)[-1:] == [pair] or station.time > began + PRESS_AGAIN
        )
        if self.wire.drives(robot)[-1:] != [pair]:
            await page.keyboard.up(key)
            await page.keyboard.down(key)
        await self.driven(robot, pair)

    async def stopped(self, page: Any, robot: str) -> None:
        """Wait for zero on the wire; a page says at most 4 drives after hands let go of it.

        At 20 Hz those are 200 ms, told by their count: a busy machine stretches time.
        """
        await until(lambda: self.wire.drives(robot)[-1:] == [(0.0, 0.0)])
        assert await page.evaluate("late()") <= 4


def staged(page_folder: Path, latch: Path, **settings: object) -> Any:
    """The body of a module's fixture `stage`: gives it, and ends it; settings: of its server."""
    executable()
    pytest.importorskip("playwright.async_api")
    with (
        pytest.MonkeyPatch.context() as patched,
        running_server(world="arena", **settings) as (_, endpoints),
        asyncio.Runner() as runner,
    ):
        # A browser beside others may not have the processor for three seconds.
        patched.setattr(watchdog, "PAGE_TIME", PATIENCE)
        stage = Stage(runner)
        scene = endpoints["scene"].port if "scene" in endpoints else None
        runner.run(stage.open(endpoints["control"].port, latch, scene))
        try:
            yield stage
        finally:
            runner.run(stage.close())


async def until(check: Callable[[], object]) -> None:
    """Wait until something has come about."""
    async with asyncio.timeout(PATIENCE):
        while not check():  # noqa: ASYNC110 (what is looked at is a browser's or a server's)
            await asyncio.sleep(0.01)


async def becomes(page: Any, expression: str) -> None:
    """Wait until something is so in a page; its policy forbids playwright's own way to."""
    async with asyncio.timeout(PATIENCE):
        while not await page.evaluate(expression):  # noqa: ASYNC110
            await asyncio.sleep(0.02)


async def escape_twice(page: Any, stopped: Callable[[], object]) -> None:
    """Press Esc twice until that has stopped everything: both count within 0.6 s only."""
    async with asyncio.timeout(PATIENCE):
        while not stopped():
            await page.keyboard.press("Escape")
            await page.keyboard.press("Escape")
            for _ in range(100):
                if stopped():
                    break
                await asyncio.sleep(0.02)


async def release(page: Any) -> None:
    """Hold the button that releases the emergency stop until nothing is stopped any more."""
    await page.hover("[data-do=release]")
    await page.mouse.down()
    try:
        await becomes(page, "!window.usarsim.store.state.estop")
    finally:
        await page.mouse.up()


async def looks_at_pads(page: Any) -> None:
    """Wait until a page has looked at its pads once more, from the beginning."""
    looks = await page.evaluate("window.padLooks")
    await becomes(page, f"window.padLooks > {looks + 1}")
