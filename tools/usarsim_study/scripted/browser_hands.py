"""The hands of a scripted operator at a real page: mouse, keys and a pad that is made believe.

The page is told nothing that a person could not tell it. Where on the map a place is, it is asked;
when what was done has left for the gateway, too, so that a quick world waits for a slow browser.
"""

from __future__ import annotations

import asyncio
from typing import Any

from usarsim_client.truth import Point
from usarsim_study.scripted.hands import PATIENCE
from usarsim_study.scripted.skill import Device

SCRIPT = """
(() => {
  const pad = { id: "scripted pad", mapping: "standard", index: 0, connected: true, timestamp: 0,
    axes: [0, 0, 0, 0],
    buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })) };
  let there = false;
  navigator.getGamepads = () => (there ? [pad] : []);
  const heard = [];
  const hands = { drives: 0,
    said(before, ms) {  // that it drives, since there were so many; or that it does not
      if (hands.drives > before) return hands.drives;
      return new Promise((settle) => {
        heard.push(() => settle(hands.drives));
        setTimeout(() => settle(hands.drives), ms);
      });
    },
    plug() {
      there = true;
      const event = new Event("gamepadconnected");
      event.gamepad = pad;
      dispatchEvent(event);
    },
    hold(...pressed) {
      pad.buttons.forEach((one, i) => {
        one.pressed = pressed.includes(i);
        one.value = Number(one.pressed);
      });
    },
    tilt(...axes) { pad.axes = axes; } };
  window.scriptedHands = hands;
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (data) {
    const drives = typeof data === "string" && data.includes('"drive"');
    if (drives) hands.drives += 1;
    send.call(this, data);
    if (drives) for (const settle of heard.splice(0)) settle();
  };
  // A trial waits until a pad has answered: by a button that does nothing.
  window.setInterval(() => {
    if (!document.querySelector('.ready-bar:not([hidden])[data-wants="pad"]')) return;
    if (!there) hands.plug();
    hands.hold(16);
    setTimeout(() => hands.hold(), 200);
  }, 300);
  // A slow screen: nobody looks at it, and what it shows costs most.
  const every = window.setInterval.bind(window);
  window.setInterval = (run, ms, ...more) => every(run, ms < 50 ? ms : Math.max(ms, 500), ...more);
  window.requestAnimationFrame = (run) => setTimeout(() => run(performance.now()), 200);
  window.cancelAnimationFrame = (id) => clearTimeout(id);
})();
"""
"""Runs in every frame of the browser before its page does."""

_DEAD_MAN, _DEAD_ZONE, _EXPONENT = 5, 0.15, 1.5
_POLL = 0.04
"""s of wall time after which a page has looked at its pad twice."""
_HEARD_MS = 500
_ROWS = 3
"""Rows of the truth for which one `drive` of the page may last: the watchdog waits for five."""
_AIMS = 5
"""Times that a place is clicked at."""
_STEP, _SPEED, _TURN = 0.1, 0.6, 0.4
"""Speeds of the keyboard change in steps, and begin so."""
_PLACE = """([x, y]) => {
  const canvas = document.querySelector("[data-panel=map] canvas");
  const [column, row] = window.usarsim.map.at(x, y);
  const scale = canvas.clientWidth / canvas.width;
  return [column * scale, row * scale, canvas.clientWidth, canvas.clientHeight];
}"""


class BrowserHands:
    """Hands at the console's page, in a window or in a frame of another page.

    `speed` and `turn` are those of the operator's skill: keys are set to them once.
    """

    def __init__(self, page: Any, frame: Any, device: Device, speed: float, turn: float) -> None:
        """page: of playwright, for keys. frame: where the console is shown."""
        self._page, self._frame, self._device = page, frame, device
        self._speed, self._turn = speed, turn
        self._keys: set[str] = set()
        self._held = 0.0, 0.0
        self._since = self._drives = 0
        self._robots: list[str] = []

    async def begin(self) -> None:
        """Wait for the page, take the device, set the speeds."""
        frame = self._frame
        await self._becomes("window.usarsim && window.usarsim.store.robots.length > 0")
        await self._becomes(
            "window.usarsim.store.robots.length === document.querySelectorAll('[data-tile]').length"
        )
        self._robots = await frame.evaluate("window.usarsim.store.robots.map((one) => one.name)")
        await frame.locator("[data-tile]").first.click()
        if self._device == "gamepad":
            await frame.evaluate("window.scriptedHands.plug()")
        else:
            for key, wanted, first in (("rf", self._speed, _SPEED), ("tg", self._turn, _TURN)):
                steps = round((wanted - first) / _STEP)
                for _ in range(abs(steps)):
                    await self._page.keyboard.press(key[0] if steps > 0 else key[1])

    async def meet(self, robots: list[str]) -> None:
        """The page shows them by itself."""

    async def choose(self, robot: str) -> None:
        """By a digit, a coloured button, or a click beyond those."""
        place = self._robots.index(robot) if robot in self._robots else 99
        if self._device == "keyboard" and place < 9:
            await self._page.keyboard.press(str(place + 1))
        elif self._device == "gamepad" and place < 4:
            await self._frame.evaluate(f"window.scriptedHands.hold({place})")
            await asyncio.sleep(_POLL)
            await self._frame.evaluate("window.scriptedHands.hold()")
            await asyncio.sleep(_POLL)
        else:
            await self._frame.locator(f'[data-tile="{robot}"]').click()

    async def drive(self, robot: str, forward: float, turn: float) -> None:
        """By WASD, or by the stick with the dead man's button held."""
        if self._device == "gamepad":
            await self._stick(forward, turn)
        else:
            wanted = {"w": forward > 0, "s": forward < 0, "d": turn > 0, "a": turn < 0}
            keys = {key for key, down in wanted.items() if down}
            for key in sorted(self._keys - keys):
                await self._page.keyboard.up(key)
            for key in sorted(keys - self._keys):
                await self._page.keyboard.down(key)
            self._keys = keys
        self._held, self._since = (forward, turn), _ROWS

    async def _stick(self, forward: float, turn: float) -> None:
        length = min(1.0, (forward**2 + turn**2) ** 0.5)
        if length:
            tilt = _DEAD_ZONE + (1.0 - _DEAD_ZONE) * length ** (1.0 / _EXPONENT)
            x, y = tilt * turn / length, -tilt * forward / length
            await self._frame.evaluate(
                f"(window.scriptedHands.tilt({x:.4f}, {y:.4f}, 0, 0),"
                f" window.scriptedHands.hold({_DEAD_MAN}))"
            )
        else:
            await self._frame.evaluate(
                "(window.scriptedHands.hold(), window.scriptedHands.tilt(0, 0, 0, 0))"
            )
        await asyncio.sleep(_POLL)

    async def mark(self, robot: str, place: Point) -> bool:
        """By a double click on the map, if the place is on it, and the button of the dialog."""
        canvas = self._frame.locator("[data-panel=map] canvas")
        for _ in range(_AIMS):
            aim = await self._frame.evaluate(_PLACE, [place[0], place[1]])
            column, row, width, height = aim
            if not (2.0 <= column <= width - 2.0 and 2.0 <= row <= height - 2.0):
                return False
            await canvas.dblclick(position={"x": column, "y": row})
            still = await self._frame.evaluate(_PLACE, [place[0], place[1]]) == aim
            await self._frame.locator(f"dialog [data-do={'accept' if still else 'cancel'}]").click()
            if still:
                return True
        return False  # the map grew under the mouse

    async def press(self, what: str, robot: str) -> None:
        """By the button of the page, where it can be pressed."""
        kind = what.partition(" ")[0]
        if kind == "acknowledge":
            await self._page.keyboard.press("k")
            return
        name = {"estop_reset": "estop"}.get(kind, kind.replace("_", "-"))
        button = self._frame.locator(f"[data-do={name}]").first
        if await button.count() and await button.is_enabled() and await button.is_visible():
            await button.click()
            if kind == "mark_edit":
                await self._frame.locator("dialog [data-do=accept]").click()

    async def settle(self) -> None:
        """While it drives, wait until the page has said so again."""
        if self._held == (0.0, 0.0):
            if self._since:
                self._since = 0
                await asyncio.sleep(_POLL / 2.0)
            return
        self._since += 1
        if self._since < _ROWS:
            return
        self._since = 0
        said = f"window.scriptedHands.said({self._drives}, {_HEARD_MS})"
        self._drives = await self._frame.evaluate(said)  # a page may refuse to drive

    async def _becomes(self, expression: str) -> None:
        async with asyncio.timeout(PATIENCE):
            while not await self._frame.evaluate(expression):  # noqa: ASYNC110 (a browser)
                await asyncio.sleep(0.05)
