"""What an operator sees and feels, in Chromium (CON-05, CON-08, CON-12, O-37)."""

from __future__ import annotations

import asyncio
import random
import time
from collections.abc import Sequence
from statistics import median

from benchmarks.console.arithmetic import Heard, Legs, key_legs, p95
from benchmarks.console.browser import GL, NO_GL, BrowserPage, browser, chromium
from benchmarks.console.gateway import Rig
from benchmarks.console.lengths import Course, count, seconds, until_interrupted
from benchmarks.console.programs import PATIENCE, PageProgram, driving, page, said
from benchmarks.plan import Plan
from usarsim_bench.figures import Aim, BenchError, Figure, in_ms

WIDTH, HEIGHT = 960, 540
TILES = 4
"""Shown in O-37."""
BLOCK = 150
"""ms for which a frame of a blocked page lasts."""
PAINT_AIM, SCENE_AIM, FRAMES_AIM = Aim("<", 2.0), Aim("<", 5.0), Aim(">=", 8.0)
RELEASE_AIM = Aim("<=", 200.0)
WITH_AIM, WITHOUT_AIM = Aim("<", 50.0), Aim("<", 35.0)
_END = 0.5
"""s for the last key to get to the wire."""

_HELD = """(robot) => {
  const { robots, welcome } = usarsim.store;
  return robots.some((one) => one.name === robot && one.holder?.page === welcome?.page);
}"""
_PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
_ENLARGE = """([width, height]) => {
  const canvas = document.querySelector("[data-panel=view3d] canvas");
  const size = `width:${width}px;height:${height}px`;
  canvas.style.cssText = `position:fixed;left:0;top:0;z-index:9;${size}`;
}"""
_DRAWN = """() => {
  const { frames, quality } = document.querySelector("[data-panel=view3d]").dataset;
  const { clientWidth, clientHeight } = document.querySelector("[data-panel=view3d] canvas");
  return [Number(frames ?? 0), quality ?? "none", clientWidth, clientHeight, performance.now()];
}"""
_BLOCK = """(ms) => {
  const block = () => {
    const end = performance.now() + ms;
    while (performance.now() < end);
    requestAnimationFrame(block);
  };
  requestAnimationFrame(block);
}"""


async def first_paint(rig: Rig, plan: Plan) -> list[Figure]:
    """CON-05: s from the request of the page to its first contents, and to the whole scene."""
    paints, scenes = [], []
    async with browser(rig, *GL) as shown:
        for _ in range(count(plan, 5, 2, 2.0)):
            async with shown.page("instructor") as one:
                await one.page.wait_for_function("benchNotes.scene > 0", timeout=60_000)
                paints.append(await one.page.evaluate(_PAINT) / 1e3)
                scenes.append(await one.page.evaluate("benchNotes.scene") / 1e3)
    return [
        Figure("first paint, median", median(paints), "s", 2, PAINT_AIM),
        Figure("first paint, longest", max(paints), "s", 2),
        Figure("scene complete, median", median(scenes), "s", 2, SCENE_AIM),
        Figure("scene complete, longest", max(scenes), "s", 2),
    ]


async def frames(rig: Rig, plan: Plan) -> list[Figure]:
    """CON-08: frames of the true world's view while all robots drive."""
    length = seconds(plan, 20.0, 8.0)
    async with (
        driving(rig, rig.robots),
        browser(rig, *GL) as shown,
        shown.page("instructor", viewport={"width": 1366, "height": 768}) as one,
    ):
        await one.page.wait_for_function("benchNotes.scene > 0", timeout=60_000)
        await one.page.evaluate(_ENLARGE, [WIDTH, HEIGHT])
        await asyncio.sleep(min(3.0, length))
        before = await one.page.evaluate(_DRAWN)
        await asyncio.sleep(length)
        after = await one.page.evaluate(_DRAWN)
    rate = (after[0] - before[0]) / (after[4] - before[4]) * 1e3
    return [
        Figure(
            f"frames of the 3D tile, {after[2]} x {after[3]}, quality {after[1]}",
            rate,
            "1/s",
            1,
            FRAMES_AIM,
        )
    ]


async def blocked(rig: Rig, plan: Plan) -> list[Figure]:
    """CON-12: from the release of a key to a zero DRIVE, with the page blocked in each frame."""
    number = count(plan, 40, 12, 1.2)
    async with browser(rig, *GL) as shown, shown.page("operator") as one:
        await _choose(rig, one)
        await one.page.evaluate(_BLOCK, BLOCK)
        legs = await _press(rig, plan, one, number, hold=(0.4, 0.6), rest=(0.3, 0.5), stops=True)
    totals = [one.total for one in legs]
    return [
        in_ms("key-up to zero DRIVE, median", median(totals)),
        in_ms("key-up to zero DRIVE, longest", max(totals), 2, RELEASE_AIM),
        Figure("releases", len(totals), "", 0),
        Figure("releases without a zero DRIVE", number - len(totals), "", 0, Aim("<=", 0)),
    ]


async def presses(rig: Rig, plan: Plan) -> list[Figure]:
    """O-37: from key to wire with all other robots driven and four tiles shown."""
    number = count(plan, 1000, 150, 0.25)
    figures: list[Figure] = []
    async with driving(rig, rig.robots[1:]):
        if chromium() is None:
            async with page(rig, scans=False) as program:
                legs = await _press_program(rig, program, number)
            return _told("by a program", legs, number, None)
        for name, flags, aim in (("with 3D", GL, WITH_AIM), ("without 3D", NO_GL, WITHOUT_AIM)):
            plan.say(f"{number} presses {name}")
            async with browser(rig, *flags) as shown, shown.page("instructor") as one:
                for robot in rig.robots[TILES:]:
                    await one.say("camera", robot=robot, on=False)
                await _choose(rig, one)
                legs = await _press(rig, plan, one, number, hold=(0.05, 0.1), rest=(0.08, 0.16))
                figures += _told(name, legs, number, aim)
    return figures


def _told(name: str, legs: Sequence[Legs], number: int, aim: Aim | None) -> list[Figure]:
    if not legs:
        raise BenchError("no key got to the wire")
    parts = (
        ("key to page's send", [one.page for one in legs]),
        ("page to gateway", [one.transit for one in legs]),
        ("gateway to wire", [one.gateway for one in legs]),
    )
    total = [one.total for one in legs]
    return [
        in_ms(f"{name}, key to wire, median", median(total)),
        in_ms(f"{name}, key to wire, 95th percentile", p95(total), 2, aim),
        *(in_ms(f"{name}, {part}, 95th percentile", p95(values)) for part, values in parts),
        Figure(f"{name}, presses", number, "", 0),
        Figure(f"{name}, presses without a DRIVE", number - len(legs), "", 0),
    ]


async def _choose(rig: Rig, one: BrowserPage) -> None:
    """Choose the first robot and hold it.

    Raises:
        BenchError: if the page does not get it.
    """
    robot, begun = rig.robots[0], time.perf_counter()
    await one.page.evaluate("robot => usarsim.store.select(robot)", robot)
    while not await one.page.evaluate(_HELD, robot):
        if time.perf_counter() > begun + PATIENCE:
            raise BenchError(f"the page does not get {robot}")
        # Again and again: a page that was held up may have a new link by now.
        await one.say("take", robot=robot)
        await asyncio.sleep(0.5)
    await asyncio.sleep(_END)


async def _press(
    rig: Rig,
    plan: Plan,
    one: BrowserPage,
    number: int,
    *,
    hold: tuple[float, float],
    rest: tuple[float, float],
    stops: bool = False,
) -> list[Legs]:
    """Press the key that drives so often; the way of each that moved, or stopped, the robot.

    Interrupted, those so far.
    """
    dice, course, begun = random.Random(plan.seed), Course(plan, "keys", number), 0.0
    await one.collect()
    one.downs, one.ups, one.sends = [], [], []
    id, begun = await one.id(), time.perf_counter()
    keys = one.page.keyboard
    with until_interrupted():
        for done in range(number):
            await keys.down("w")
            await asyncio.sleep(dice.uniform(*hold))
            await keys.up("w")
            await asyncio.sleep(dice.uniform(*rest))
            if done % 20 == 19:
                await one.collect()
            course.at(done + 1)
        await asyncio.sleep(_END)
        await one.collect()
    notes = rig.notes(begun)
    wired = [(w.moment, w.zero) for w in notes.wired if w.robot == rig.robots[0]]
    heard = _drives(notes.heard, id)[: len(one.sends)]
    found = key_legs(one.ups if stops else one.downs, one.sends, heard, wired, stops=stops)
    return [legs for legs in found if legs is not None]


def _drives(heard: Sequence[Heard], id: int) -> list[float]:
    return [one.moment for one in heard if one.page == id and one.text.startswith(_DRIVE)]


_DRIVE = said("drive")[:-1]


async def _press_program(rig: Rig, program: PageProgram, number: int) -> list[Legs]:
    """What a page sends when a key is pressed and released, without page or key."""
    robot, begun = rig.robots[0], time.perf_counter()
    await program.ask("take", robot=robot)
    sends: list[tuple[float, str]] = []
    for _ in range(number):
        for power in (0.6, 0.0):
            text = said("drive", robot=robot, left=power, right=power, device="program")
            sends.append((time.perf_counter(), text))
            await program.ws.send_str(text)
            await asyncio.sleep(0.1)
    await asyncio.sleep(_END)
    notes = rig.notes(begun)
    wired = [(w.moment, w.zero) for w in notes.wired if w.robot == robot]
    keys = [moment for moment, text in sends if '"left":0.6' in text]
    found = key_legs(keys, sends, _drives(notes.heard, program.id), wired)
    return [legs for legs in found if legs is not None]
