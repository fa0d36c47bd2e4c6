"""Who sits at the pages of a desk instead of people: reads what stands there, answers, goes on.

A seat without a browser speaks the protocol of the desk (docs/studies.md); that of a browser looks
at the page and clicks. Both keep hands at the panel for as long as it stands there.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from typing import Any
from urllib.parse import urlsplit

import aiohttp

from usarsim_study.errors import StudyError
from usarsim_study.scripted.answers import Feeling, answer
from usarsim_study.scripted.browser_hands import BrowserHands
from usarsim_study.scripted.hands import PATIENCE, Hands, gateway_hands
from usarsim_study.scripted.skill import Device

Message = dict[str, Any]
_STANDS = """(before) => new Promise((settle) => {
  const look = () => {
    const step = window.study && window.study.step;
    const pages = [...document.querySelectorAll("[data-page]")].map((one) => one.textContent);
    const stands = step ? [step.step, step.kind, ...pages] : before;
    if (JSON.stringify(stands) === JSON.stringify(before)) setTimeout(look, 50);
    else settle([step, ...stands]);
  };
  look();
})"""
"""Waits for another step of the desk's page; tells it, and what else tells it from others."""
NAME = "Scripted"
"""What panels call who sits there."""


class Seat(ABC):
    """One seat, for all sessions.

    Attributes:
        feeling: of whoever sits there; answers follow from it.
        grip: device, speed and turn of the trial that comes: asked when a panel opens.
        faults: what a participant could not have gone on from.
        loading: s of wall time that a row of the truth waits for hands.
    """

    loading = PATIENCE

    def __init__(self, grip: Callable[[], tuple[Device, float, float]], number: int = 1) -> None:
        """grip: see the attributes. number: of the seat, from 1."""
        self.number = number
        self.feeling = Feeling(random.Random(0))
        self.grip = grip
        self.faults: list[str] = []
        self._hands: asyncio.Future[Hands] | None = None
        self._panel = ""
        self._stack = contextlib.AsyncExitStack()

    @abstractmethod
    async def run(self, url: str) -> None:
        """Sit at the page of a URL until cancelled."""

    @abstractmethod
    async def _open(self, url: str) -> Hands:
        """Hands at a panel, let go by the stack."""

    async def hands(self) -> Hands | None:
        """Those at the panel that stands there; None if it is not ready within `loading`."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self.loading):
                while self._hands is None:  # noqa: ASYNC110 (it comes with a step of the desk)
                    await asyncio.sleep(0.02)
                return await asyncio.shield(self._hands)
        return None

    async def _take(self, url: str) -> None:
        """A panel stands there."""
        if url == self._panel:
            return
        await self._leave()
        self._panel = url
        self._hands = asyncio.get_running_loop().create_future()
        try:
            self._hands.set_result(await self._open(url))
        except (StudyError, TimeoutError) as error:
            self.faults.append(f"no hands at the panel: {error}")

    async def _leave(self) -> None:
        """No panel stands there any more."""
        self._hands, self._panel = None, ""
        await self._stack.aclose()
        self._stack = contextlib.AsyncExitStack()


class ProgramSeat(Seat):
    """Speaks to the desk without a browser."""

    async def run(self, url: str) -> None:
        """Sit at the desk."""
        base, _, token = url.partition("/#")
        async with (
            aiohttp.ClientSession() as http,
            http.ws_connect(f"{base}/socket", headers={"Origin": base}) as ws,
        ):
            await ws.send_json({"type": "hello", "token": token})
            live = asyncio.create_task(_every_second(lambda: ws.send_json({"type": "ping"})))
            stands: Message = {}
            try:
                async for message in ws:
                    said = message.json()
                    if said["type"] == "step" and said != stands:  # a new desk may say it twice
                        stands = said
                        await self._step(ws, said)
                    elif said["type"] == "refused":
                        self.faults.append(f"refused: {said['why']} {said.get('missing') or ''}")
            finally:
                live.cancel()
                await self._leave()

    async def _step(self, ws: aiohttp.ClientWebSocketResponse, step: Message) -> None:
        kind, number = step["kind"], step["step"]
        if kind == "panel":
            await self._take(step["url"])
            return
        if kind in ("text", "end") or (kind == "form" and not step.get("freeze")):
            await self._leave()
        if kind == "text" and step["button"] is not None:
            await ws.send_json({"type": "next", "step": number})
        if kind == "form":
            clock = 0.0
            for page in step["form"]["pages"]:
                for item in page:
                    value = answer(item, self.feeling)
                    if value is not None:
                        clock += round(self.feeling.chance.uniform(1.0, 4.0), 2)
                        said = {"type": "answer", "step": number, "item": item["name"]}
                        await ws.send_json({**said, "value": value, "clock": clock})
            await ws.send_json({"type": "hand_in", "step": number})

    async def _open(self, url: str) -> Hands:
        device, _, _ = self.grip()
        return await self._stack.enter_async_context(
            gateway_hands(url, device, f"{NAME} {self.number}")
        )


class BrowserSeat(Seat):
    """Looks at the desk's page in a browser, and clicks.

    A page is told of its robots as time goes on: slowly, until it is ready.
    """

    loading = 0.5

    def __init__(
        self, grip: Callable[[], tuple[Device, float, float]], number: int, page: Any
    ) -> None:
        """page: of playwright, in which `browser_hands.SCRIPT` runs."""
        super().__init__(grip, number)
        self._page = page

    async def run(self, url: str) -> None:
        """Sit at the page."""
        await self._page.goto(url)
        stands: list[Any] = []
        while True:
            step, *stands = await self._page.evaluate(_STANDS, stands)
            await self._step(step)

    async def _step(self, step: Message) -> None:
        kind = step["kind"]
        if kind == "panel":
            await self._take(step["url"])
        elif kind in ("text", "end") or (kind == "form" and not step.get("freeze")):
            await self._leave()
        if kind == "text" and step["button"] is not None:
            await self._page.locator("[data-text] [data-do=next]").click()
        if kind == "form":
            try:
                await self._fill_in(step)
            except Exception:  # of playwright: what stood there may have gone meanwhile
                if await self._page.evaluate("window.study && window.study.step") == step:
                    raise

    async def _fill_in(self, step: Message) -> None:
        """The page of the form that is shown."""
        items = {item["name"]: item for page in step["form"]["pages"] for item in page}
        fields = self._page.locator("[data-form] [data-item]")
        for place in range(await fields.count()):
            field = fields.nth(place)
            item = items[await field.get_attribute("data-item")]
            value = answer(item, self.feeling)
            if value is None:
                continue
            if item["kind"] == "text":
                await field.locator("textarea").fill(value)
            elif await field.locator("input[type=number]").count():
                await field.locator("input[type=number]").fill(f"{value:g}")
                await field.locator("input[type=number]").press("Tab")
            else:
                text = str(value).lower() if isinstance(value, bool) else _shown(value)
                await field.locator(f'[data-value="{text}"]').click()
        await self._page.locator("[data-form] [data-do=next]").click()

    async def _open(self, url: str) -> Hands:
        origin = urlsplit(url).netloc
        found: list[Any] = []
        async with asyncio.timeout(PATIENCE):
            while not found:
                await asyncio.sleep(0.05)
                found = [one for one in self._page.frames if urlsplit(one.url).netloc == origin]
        hands = BrowserHands(self._page, found[0], *self.grip())
        await hands.begin()
        return hands


def _shown(value: object) -> str:
    """A value as JavaScript writes it."""
    return f"{value:g}" if isinstance(value, int | float) else str(value)


async def _every_second(say: Callable[[], Awaitable[None]]) -> None:
    with contextlib.suppress(ConnectionError):
        while True:
            await asyncio.sleep(1.0)
            await say()


def need_browser() -> Any:
    """The module of playwright.

    Raises:
        StudyError: it is not installed.
    """
    import importlib

    try:
        return importlib.import_module("playwright.async_api")
    except ImportError:
        cure = "pip install playwright, or say --hands gateway"
        raise StudyError(f"scripted operators at real pages need playwright ({cure})") from None
