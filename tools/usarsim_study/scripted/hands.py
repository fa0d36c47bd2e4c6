"""What a scripted operator acts with: texts to the gateway here, a browser in `browser_hands`.

Both do the same acts. The world of a trial stands still between two rows of its truth; when
`settle` returns, the gateway has what was done at this one.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import AsyncIterator
from typing import Any, Protocol
from urllib.parse import urlsplit

import aiohttp

from usarsim_client import frames
from usarsim_client.truth import Point, TruthRow
from usarsim_study.errors import StudyError
from usarsim_study.scripted.operator import Choose, Drive, Mark, Press, ScriptedOperator
from usarsim_study.scripted.skill import Device

PATIENCE = 60.0
"""s of wall time for what a page or a gateway has to answer."""
_DEVICES = {"keyboard": "keyboard", "gamepad": "pad"}


class Hands(Protocol):
    """Does what an operator decides."""

    async def meet(self, robots: list[str]) -> None:
        """These robots are in the world."""

    async def choose(self, robot: str) -> None:
        """Look at another robot."""

    async def drive(self, robot: str, forward: float, turn: float) -> None:
        """Hold keys or stick so until further notice."""

    async def mark(self, robot: str, place: Point) -> bool:
        """Mark a victim at a place in the protocol's frame; whether that could be done."""

    async def press(self, what: str, robot: str) -> None:
        """A button, see `Press`."""

    async def settle(self) -> None:
        """Wait until all of that has come to the gateway, and hold on to what is held."""


async def act(operator: ScriptedOperator, hands: Hands, row: TruthRow) -> None:
    """Let an operator do what it does after what is true at an instant."""
    await hands.meet([one.name for one in row.robots])
    for one in operator.see(row):
        match one:
            case Choose():
                await hands.choose(one.robot)
            case Drive():
                await hands.drive(one.robot, one.forward, one.turn)
            case Mark():
                if not await hands.mark(one.robot, frames.flip(one.place)):
                    operator.fails(one.victim)
            case Press():
                await hands.press(one.what, one.robot)
    await hands.settle()


class GatewayHands:
    """A page without a browser: says to the gateway what the console's page would say.

    Attributes:
        refused: reasons of what the gateway did not do.
    """

    def __init__(self, ws: aiohttp.ClientWebSocketResponse, device: Device) -> None:
        """ws: of a page that has said hello."""
        self.refused: list[str] = []
        self._ws, self._device = ws, _DEVICES[device]
        self._ids = itertools.count(1)
        self._wheels: tuple[str, float, float] | None = None
        self._held: set[str] = set()
        self._met: set[str] = set()
        self._state: dict[str, Any] = {}
        self._pings, self._pongs = 0, 0
        self._stirred = asyncio.Event()
        self._closed = False

    async def meet(self, robots: list[str]) -> None:
        """Switches their pictures off: nobody would look at them, and they cost most."""
        for robot in robots:
            if robot not in self._met:
                self._met.add(robot)
                await self._say("camera", robot=robot, on=False)

    async def choose(self, robot: str) -> None:
        """Says `select`."""
        await self._say("select", robot=robot)

    async def drive(self, robot: str, forward: float, turn: float) -> None:
        """Takes a robot that it does not hold, and says `drive` until it is neutral."""
        if robot not in self._held and (forward or turn):
            self._held.add(robot)
            await self._say("take", robot=robot)
        left, right = forward + turn, forward - turn
        most = max(1.0, abs(left), abs(right))
        self._wheels = robot, left / most, right / most
        if not (forward or turn):
            await self._drive()
            self._wheels = None

    async def mark(self, robot: str, place: Point) -> bool:
        """Says `mark`."""
        rounded = [round(one, 2) for one in place]
        await self._say("mark", robot=robot, place=rounded, status="unknown", note="")
        return True

    async def press(self, what: str, robot: str) -> None:
        """Says what the button says; nothing where there is no mark or alarm to speak of."""
        marks = [one["id"] for one in self._state.get("marks", ())]
        alarms = [one["id"] for one in self._state.get("alarms", ()) if not one.get("acknowledged")]
        kind, _, way = what.partition(" ")
        if kind in ("camera", "laser"):
            await self._say(kind, robot=robot, on=way == "on")
        elif kind in ("estop", "estop_reset"):
            await self._say(kind)
        elif kind == "mark_edit" and marks:
            await self._say(kind, mark=marks[-1], status="alive", note="")
        elif kind == "mark_delete" and marks:
            await self._say(kind, mark=marks[-1])
        elif kind == "acknowledge" and alarms:
            await self._say(kind, alarm=alarms[0])

    async def settle(self) -> None:
        """A ping is answered at once, and all that was said before it waits for the next tick."""
        await self._drive()
        self._pings += 1
        await self._send({"type": "ping", "clock": float(self._pings)})
        async with asyncio.timeout(PATIENCE):
            while self._pongs < self._pings and not self._closed:
                self._stirred.clear()
                await self._stirred.wait()

    async def _drive(self) -> None:
        if self._wheels is not None:
            robot, left, right = self._wheels
            device = self._device
            await self._say("drive", robot=robot, left=left, right=right, device=device)

    async def _say(self, kind: str, **fields: Any) -> None:
        await self._send({"type": kind, "id": next(self._ids), **fields})

    async def _send(self, said: dict[str, Any]) -> None:
        with contextlib.suppress(ConnectionError):
            await self._ws.send_json(said)

    async def read(self) -> None:
        """Hear the gateway until it closes."""
        async for message in self._ws:
            if message.type is not aiohttp.WSMsgType.TEXT:
                continue
            said = message.json()
            if said["type"] == "state":
                self._state = said
            elif said["type"] == "pong" and (said["clock"] or 0.0) > 0.0:
                self._pongs = max(self._pongs, int(said["clock"]))
            elif said["type"] == "answer" and not said["ok"]:
                self.refused.append(said["why"])
            self._stirred.set()
        self._closed = True
        self._stirred.set()

    async def live(self) -> None:
        """Say once a second that the page is there, however long a row of the truth takes."""
        while not self._closed:
            await self._send({"type": "ping", "clock": 0.0})
            await asyncio.sleep(1.0)


@contextlib.asynccontextmanager
async def gateway_hands(url: str, device: Device, name: str) -> AsyncIterator[GatewayHands]:
    """Hands at a gateway.

    Args:
        url: of a page, with its token in the fragment.
        device: that they say to hold.
        name: of the page.

    Raises:
        StudyError: the gateway is not there, or does not take the token.
    """
    parts = urlsplit(url)
    origin = f"{parts.scheme}://{parts.netloc}"
    async with contextlib.AsyncExitStack() as stack:
        try:
            http = await stack.enter_async_context(aiohttp.ClientSession())
            socket = http.ws_connect(f"{origin}/socket", headers={"Origin": origin}, max_msg_size=0)
            ws = await stack.enter_async_context(socket)
            hello = {"type": "hello", "token": parts.fragment.partition("&")[0], "name": name}
            await ws.send_json({**hello, "webgl": True, "shown": True})
            await ws.receive_json(timeout=PATIENCE)
        except (aiohttp.ClientError, OSError, TypeError, TimeoutError) as error:
            raise StudyError(f"{origin}: no gateway lets a scripted operator in: {error}") from None
        hands = GatewayHands(ws, device)
        tasks = [asyncio.create_task(one) for one in (hands.read(), hands.live())]
        try:
            yield hands
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
