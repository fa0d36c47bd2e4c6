"""The console's page in Chromium, by playwright; what happens in it is noted in it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import time
from collections.abc import AsyncIterator, Awaitable
from dataclasses import dataclass, field
from typing import Any

from benchmarks.console.arithmetic import Arrival, clock_offset
from benchmarks.console.gateway import Rig
from usarsim_bench.figures import BenchError

GL = ("--use-angle=gl-egl", "--ignore-gpu-blocklist")
NO_GL = ("--disable-gpu", "--disable-software-rasterizer")
_ALWAYS = (
    "--no-sandbox",
    "--disable-background-timer-throttling",
    "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows",
)
DRIVE_KEY = "KeyW"
"""Code of the key that drives forward."""
_VIEWPORT = {"width": 1366, "height": 768}
_CLOSES = 5.0
_ROUNDS = 20
"""Questions by which a page's clock is found."""

_HOOKS = """
(() => {
  const notes = { downs: [], ups: [], sends: [], pictures: [], scene: 0 };
  window.benchNotes = notes;
  localStorage.setItem("usarsim-name", "bench");
  const key = (list) => (event) => { if (!event.repeat) list.push([event.code, event.timeStamp]); };
  addEventListener("keydown", key(notes.downs), true);
  addEventListener("keyup", key(notes.ups), true);
  const Plain = WebSocket;
  window.WebSocket = class extends Plain {
    constructor(...given) {
      super(...given);
      this.addEventListener("message", ({ data }) => {
        if (!(data instanceof ArrayBuffer)) return;
        const view = new DataView(data);
        if (view.getUint8(0) === 1)
          notes.pictures.push([performance.now(), view.getUint8(1), view.getUint32(4, true)]);
      });
    }
    send(text) {
      if (text.startsWith('{"type":"drive"')) notes.sends.push([performance.now(), text]);
      super.send(text);
    }
  };
  const watch = setInterval(() => {
    const view = document.querySelector("[data-panel=view3d]");
    if (!view?.dataset.scene || !(Number(view.dataset.frames) > 0)) return;
    clearInterval(watch);
    notes.scene = performance.now();
  }, 10);
})();
"""
_TAKE = """() => {
  const { downs, ups, sends, pictures } = window.benchNotes;
  return [downs.splice(0), ups.splice(0), sends.splice(0), pictures.splice(0)];
}"""


def chromium() -> str | None:
    """Where Chromium is; None if it, or playwright, is not here."""
    try:
        import playwright.async_api as _playwright
    except ImportError:
        return None
    del _playwright
    return shutil.which("chromium") or shutil.which("chromium-browser")


@dataclass
class BrowserPage:
    """A page, with what was taken from it; moments are those of our clock.

    Attributes:
        page: of playwright. downs, ups: of the key that drives. sends: drives with their texts.
        arrivals: of pictures. clock_error: by how much moments may be wrong, s.
    """

    page: Any
    offset: float = 0.0
    clock_error: float = 0.0
    downs: list[float] = field(default_factory=list)
    ups: list[float] = field(default_factory=list)
    sends: list[tuple[float, str]] = field(default_factory=list)
    arrivals: list[Arrival] = field(default_factory=list)

    async def set_clock(self) -> None:
        """Find what the page's clock has to be added."""
        rounds = []
        for _ in range(_ROUNDS):
            before = time.perf_counter()
            told = await self.page.evaluate("performance.now()")
            rounds.append((before, told / 1e3, time.perf_counter()))
        self.offset, self.clock_error = clock_offset(rounds)

    async def collect(self) -> None:
        """Take what the page has noted since."""
        downs, ups, sends, pictures = await self.page.evaluate(_TAKE)
        self.downs += [self._ours(moment) for code, moment in downs if code == DRIVE_KEY]
        self.ups += [self._ours(moment) for code, moment in ups if code == DRIVE_KEY]
        self.sends += [(self._ours(moment), text) for moment, text in sends]
        self.arrivals += [Arrival(self._ours(moment), *which) for moment, *which in pictures]

    def _ours(self, told: float) -> float:
        return told / 1e3 + self.offset

    async def id(self) -> int:
        """Which page of the gateway it is."""
        return int(await self.page.evaluate("usarsim.store.welcome.page"))

    async def say(self, type: str, **fields: object) -> None:
        """Send a text of the protocol as the page."""
        await self.page.evaluate("text => usarsim.input.link.send(text)", {"type": type, **fields})


class Browser:
    """Chromium; a page of a role at a time, or several."""

    def __init__(self, launched: Any, rig: Rig) -> None:
        self._launched, self._rig = launched, rig

    @contextlib.asynccontextmanager
    async def page(self, role: str, **options: Any) -> AsyncIterator[BrowserPage]:
        """A page that shows the robots.

        Raises:
            BenchError: if it does not.
        """
        context = await self._launched.new_context(**{"viewport": _VIEWPORT, **options})
        try:
            page = await context.new_page()
            await page.add_init_script(_HOOKS)
            await page.goto(f"{self._rig.url}/#{self._rig.tokens[role]}")
            tile = f"[data-tile='{self._rig.robots[0]}']"
            try:
                await page.wait_for_selector(tile, state="attached", timeout=30_000)
            except Exception as error:  # of playwright, which is not here at import
                raise BenchError(f"the page shows no robots: {error}") from None
            found = BrowserPage(page)
            await found.set_clock()
            yield found
        finally:
            await _ended(context.close())


@contextlib.asynccontextmanager
async def browser(rig: Rig, *flags: str) -> AsyncIterator[Browser]:
    """Start Chromium with flags of its own.

    Raises:
        BenchError: if it is not here, or does not start.
    """
    where = chromium()
    if where is None:
        raise BenchError("needs playwright (pip install playwright) and chromium on the PATH")
    from playwright.async_api import async_playwright

    tools = await async_playwright().start()
    try:
        launched = await tools.chromium.launch(
            executable_path=where,
            args=[*flags, *_ALWAYS],
            env={**os.environ, "LIBGL_ALWAYS_SOFTWARE": "1"},
            handle_sigint=False,
        )
        try:
            yield Browser(launched, rig)
        finally:
            await _ended(launched.close())
    finally:
        await _ended(tools.stop())


async def _ended(closing: Awaitable[None]) -> None:
    """Close something of a browser, which an interrupt may have ended already."""
    with contextlib.suppress(Exception, asyncio.CancelledError):
        async with asyncio.timeout(_CLOSES):
            await closing
