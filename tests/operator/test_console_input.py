"""Hands on the page, a real gateway and server behind it: keyboard, pad and touch to the wire.

What reaches the robot is read between gateway and server. Limits in time are told by counting: a
page that drives says so 20 times a second, so 200 ms are four lines, on however busy a machine.
"""

from __future__ import annotations

import asyncio
import random
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

from console_browser import Stage, becomes, looks_at_pads, release, staged, until
from console_harness import gateway

from usarsim_operator.observers import MissionRow
from usarsim_operator.recorder import ID
from usarsim_operator.recording import Recording, Text

ZERO = (0.0, 0.0)
PAIRS = {
    "w": (0.6, 0.6),
    "s": (-0.6, -0.6),
    "a": (-0.4, 0.4),
    "d": (0.4, -0.4),
    "wa": (0.2, 1.0),
    "wd": (1.0, 0.2),
    "sa": (-1.0, -0.2),
    "sd": (-0.2, -1.0),
    "ws": ZERO,
    "ad": ZERO,
}
LEFT, UP, RIGHT_BUMPER, SELECT, START = (-1, 0), (0, -1), 5, 8, 9
FRAME_MS = slow_but((0).__eq__, (0, 150))


@pytest.fixture(scope="module")
def stage(page_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    yield from staged(page_folder, tmp_path_factory.mktemp("latch") / "estop.json")


async def chosen(page: Any) -> tuple[str, str, str, str]:
    """The robot that the list, the tiles, the card and the page's store say is chosen."""
    return tuple(
        await page.evaluate(
            """() => [
                document.querySelector('[data-robot][aria-selected=true]')?.dataset.robot,
                document.querySelector('[data-tile][aria-pressed=true]')?.dataset.tile,
                document.querySelector('[data-selected]').textContent,
                window.usarsim.store.selected,
            ]"""
        )
    )


async def notice(page: Any, text: str) -> None:
    await page.wait_for_selector(f"[data-notices] p:has-text({text!r})")


@pytest.mark.parametrize("frame_ms", FRAME_MS)
async def test_keys_give_their_wheel_pairs(stage: Stage, frame_ms: int) -> None:
    """O-29, CON-12: combinations of W, A, S, D; key-up and lost focus give zero within 200 ms."""
    async with stage.page() as page:
        await page.evaluate(f"slowFrames({frame_ms})")
        for keys, pair in PAIRS.items() if not frame_ms else [("w", PAIRS["w"])]:
            for key in keys:
                await page.keyboard.down(key)
            if pair == ZERO:
                await until(lambda: (0.6, 0.6) in stage.wire.drives("R1"))
            await stage.driven("R1", pair)
            for key in keys:
                await page.keyboard.up(key)
            await stage.stopped(page, "R1")
        for lost in ("blur", "visibilitychange"):
            await page.keyboard.down("w")
            await stage.driven("R1", (0.6, 0.6))
            if lost == "blur":
                await page.evaluate("done(); dispatchEvent(new Event('blur'))")
            else:
                await page.evaluate(
                    "done(); Object.defineProperty(document, 'hidden', { get: () => true });"
                    "document.dispatchEvent(new Event('visibilitychange'))"
                )
            await stage.stopped(page, "R1")
            await page.keyboard.up("w")
        assert stage.wire.drives("R1")[-1] == ZERO


async def test_a_dialog_takes_the_keys(stage: Stage) -> None:
    """O-29: what is typed into a dialog drives nothing, and one that opens under way stops."""
    async with stage.page() as page:
        await page.keyboard.down("w")
        await stage.driven("R1", (0.6, 0.6))
        await page.evaluate("done(); document.querySelector('[data-do=keys]').click()")
        await stage.stopped(page, "R1")
        count = len(stage.wire.drives("R1"))
        await page.keyboard.down("s")
        await page.wait_for_selector("[data-device=none]")
        await page.keyboard.press("Escape")
        await page.wait_for_selector("dialog", state="detached")
        assert len(stage.wire.drives("R1")) == count


async def test_power_beyond_the_limit_is_said(stage: Stage) -> None:
    """What hands can never ask for, and a changed page can: full power, and a notice."""
    async with stage.page() as page:
        await page.click("[data-do=take]")
        await becomes(page, "window.usarsim.store.mine")
        text = "{type: 'drive', robot: 'R1', left: 3, right: 3}"
        await page.evaluate(f"window.usarsim.input.link.send({text})")
        await stage.driven("R1", (1.0, 1.0))
        await page.wait_for_selector(
            "[data-notices] p:text-is('left 3 is beyond the limit: 1 is taken; "
            "right 3 is beyond the limit: 1 is taken')"
        )


@pytest.mark.slow
async def test_twenty_drives_a_second_and_none_while_neutral(stage: Stage) -> None:
    """O-36: by the page's own clock, put forward by hand: 20 Hz, then a minute of silence on the
    wire in which the heartbeat between page and gateway goes on."""
    async with stage.page(clock=True) as page:
        await page.clock.pause_at(await page.evaluate("Date.now() / 1000 + 600"))
        begun = len(stage.wire.drives("R1"))
        await page.keyboard.down("w")
        await page.clock.run_for(2000)
        await page.keyboard.up("w")
        drives = [one["type"] for one in await page.evaluate("sent.splice(0)")].count("drive")
        assert 40 <= drives - 1 <= 42  # one of them is the zero at the end
        # The zero of the end, not that of a robot that has just been taken.
        told = lambda: stage.wire.drives("R1")[begun:]  # noqa: E731
        await until(lambda: told()[-1:] == [ZERO] and any(one != ZERO for one in told()))
        lines = len(stage.wire.lines)
        for _ in range(6):
            await page.clock.run_for(10_000)
        heard = [one["type"] for one in await page.evaluate("sent.splice(0)")]
        assert set(heard) - {"shown"} == {"ping"}  # a picture may still come
        assert 59 <= heard.count("ping") <= 61
        assert [one for one in stage.wire.lines[lines:] if one[1].startswith("DRIVE")] == []


async def test_every_way_to_choose_is_one_choice(stage: Stage) -> None:
    """O-25: list, keys, tiles and the coloured buttons of a pad (O-30) change the same state."""
    async with stage.page() as page:
        await page.evaluate("plug('Standard pad')")

        async def is_chosen(robot: str) -> None:
            await becomes(page, f"window.usarsim.store.selected === '{robot}'")
            await page.wait_for_selector(f'[data-robot="{robot}"][aria-selected="true"]')
            assert await chosen(page) == (robot,) * 4
            pages = stage.gateway.station.pages.values()
            await until(lambda: {one.selected for one in pages} == {robot})

        await page.click('[data-robot="R3"]')
        await is_chosen("R3")
        await page.focus("[role=listbox]")
        await page.keyboard.press("ArrowDown")
        await is_chosen("R4")
        await page.keyboard.press("2")
        await is_chosen("R2")
        await page.click('[data-tile="R1"]')
        await is_chosen("R1")
        for button, robot in enumerate(("R1", "R2", "R3", "R4")):
            await page.evaluate(f"hold({button})")
            await is_chosen(robot)
        await page.evaluate("hold()")
        assert stage.wire.drives("R4") == []


async def test_pad_drives_while_its_button_is_held(stage: Stage) -> None:
    """O-30: Start takes, Select toggles the laser. O-31: no RB, no motion; letting go stops.
    O-32: 0.14 is nothing, 0.16 is not; a full diagonal stays within one."""
    async with stage.page() as page:
        station = stage.gateway.station
        await page.keyboard.press("2")
        await page.evaluate("plug('Standard pad'); hold(9)")
        await until(lambda: "R2" in station.arbiter.holders)
        (number,) = station.pages
        assert station.arbiter.holders["R2"].page == number
        for off in (True, False):
            await page.evaluate("hold(8)")
            await until(lambda off=off: ("R2" in station.pages[number].lasers_off) == off)
            await page.evaluate("hold()")
            # The page has to see the button up before it goes down once more.
            await looks_at_pads(page)
            await becomes(page, f"window.usarsim.store.robot.laser?.on === {str(not off).lower()}")
        before = len(stage.wire.drives("R2"))
        await page.evaluate("tilt(0, -1, 0, 0)")
        await page.evaluate("new Promise((done) => setTimeout(done, 200))")
        assert stage.wire.drives("R2")[before:] == []
        await page.evaluate("hold(5); tilt(0, -0.14, 0, 0)")
        await page.evaluate("new Promise((done) => setTimeout(done, 200))")
        assert stage.wire.drives("R2")[before:] == []
        await page.evaluate("tilt(0, -0.16, 0, 0)")
        await until(lambda: any(one != ZERO for one in stage.wire.drives("R2")[before:]))
        left, right = next(one for one in stage.wire.drives("R2")[before:] if one != ZERO)
        assert 0.0 < left == right < 0.01
        await page.evaluate("tilt(1, -1, 0, 0)")
        await stage.driven("R2", (1.0, 0.0))
        await page.evaluate("done(); hold()")
        await stage.stopped(page, "R2")
        assert all(abs(power) <= 1.0 for pair in stage.wire.drives("R2") for power in pair)


@pytest.mark.parametrize("frame_ms", FRAME_MS)
async def test_a_pad_that_goes_away_stops_what_it_drove(stage: Stage, frame_ms: int) -> None:
    """O-33: zero within 200 ms and a message."""
    async with stage.page() as page:
        await page.keyboard.press("3")
        await page.evaluate(f"slowFrames({frame_ms}); plug('Loose pad')")
        await page.evaluate("hold(5); tilt(0, -1, 0, 0)")
        await stage.driven("R3", (1.0, 1.0))
        await page.evaluate("done(); unplug()")
        await stage.stopped(page, "R3")
        await notice(page, "the pad is gone")


async def test_devices_are_never_mixed(stage: Stage) -> None:
    """O-35: who began drives until neutral for 250 ms, and no command is a sum of both."""
    async with stage.page() as page:
        await page.evaluate("plug('Standard pad')")
        await page.keyboard.down("w")
        await stage.driven("R1", (0.6, 0.6))
        await page.evaluate("hold(5); tilt(1, 0, 0, 0)")
        count = len(stage.wire.drives("R1"))
        await until(lambda: len(stage.wire.drives("R1")) > count + 5)
        await page.keyboard.up("w")
        await stage.driven("R1", (1.0, -1.0))
        await page.keyboard.down("s")
        count = len(stage.wire.drives("R1"))
        await until(lambda: len(stage.wire.drives("R1")) > count + 5)
        await page.evaluate("hold()")
        await stage.driven("R1", (-0.6, -0.6))
        await page.keyboard.up("s")
        await until(lambda: stage.wire.drives("R1")[-1] == ZERO)
        told = [(one["left"], one["right"]) for one in await page.evaluate("drives()")]
        changes = [pair for i, pair in enumerate(told) if i == 0 or pair != told[i - 1]]
        assert changes == [(0.6, 0.6), ZERO, (1.0, -1.0), ZERO, (-0.6, -0.6), ZERO]


async def test_touch_sticks_drive_like_the_pad(stage: Stage) -> None:
    """CON-26: two virtual sticks on a phone, mixed as the pad is; letting go stops."""
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
    async with stage.page(**phone) as page:
        box = await page.locator("[data-stick=drive]").bounding_box()
        x, y, half = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, box["width"] / 2
        touch = await page.context.new_cdp_session(page)

        async def finger(kind: str, *at: float) -> None:
            points = [{"x": at[0], "y": at[1]}] if at else []
            await touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        await finger("touchStart", x, y - half)
        await stage.driven("R1", (1.0, 1.0))
        await finger("touchMove", x + 2 * half, y)
        await stage.driven("R1", (1.0, -1.0))
        await page.evaluate("addEventListener('pointerup', () => done(), true)")
        await finger("touchEnd")
        await stage.stopped(page, "R1")
        half_way = half * (0.15 + 0.85 * 0.5)
        await finger("touchStart", x, y + half_way)
        await until(lambda: stage.wire.drives("R1")[-1] != ZERO)
        left, right = stage.wire.drives("R1")[-1]
        assert left == right == pytest.approx(-(0.5**1.5), abs=0.02)
        await finger("touchCancel")
        await until(lambda: stage.wire.drives("R1")[-1] == ZERO)


async def test_a_stop_is_not_driven_away_by_a_held_key(stage: Stage) -> None:
    """CON-15: a key held over stop and release drives nothing until it was let go."""
    async with stage.page() as page:
        await page.keyboard.down("w")
        await stage.driven("R1", (0.6, 0.6))
        await page.click("[data-do=estop]")
        await until(lambda: stage.gateway.station.arbiter.stop is not None)
        await page.wait_for_selector('[data-do=estop][aria-pressed="true"]')
        await release(page)
        await page.wait_for_selector('[data-do=estop][aria-pressed="false"]')
        count = len(stage.wire.drives("R1"))
        await asyncio.sleep(0.3)
        assert stage.wire.drives("R1")[count:] == []
        await page.keyboard.up("w")
        await page.keyboard.down("w")
        await stage.driven("R1", (0.6, 0.6))
        await page.keyboard.up("w")


async def test_inputs_are_kept_with_both_clocks(stage: Stage, tmp_path: Path) -> None:
    """HRI-08: every text has the page's clock; the offset between both is right within 5 ms, and by
    it inputs lie before they were heard, in their order. CON-21: the header has the score that
    the mission has told, 20 times."""
    file = tmp_path / "session.rec"
    async with gateway(stage.tap) as second:
        second.station.record(file)
        await second.station.spawn("P3AT", "Clocked", "RobotStart12")
        async with stage.page(gateway=second, name="Ada") as page:
            (number,) = set(second.station.pages) - {ID}
            clock = second.station.pages[number].clock
            await page.click("[data-do=take]")
            await page.keyboard.down("w")
            await stage.driven("Clocked", (0.6, 0.6))
            await page.keyboard.up("w")
            await page.keyboard.press("Space")
            await page.wait_for_selector('[data-do=estop][aria-pressed="true"]')
            # The browser counts from `timeOrigin` on, the gateway's clock is the machine's.
            origin = await page.evaluate("performance.timeOrigin") / 1e3
            expected = origin - (time.time() - time.monotonic())
            await until(lambda: abs(clock.offset - expected) < 0.005)
            for count in range(20):
                score = round(random.uniform(-50.0, 100.0), 9)
                row = {"name": "M", "remaining": 60.0, "score": score, "found": count}
                second.station.mission = MissionRow(row, row)
                await page.wait_for_selector(f'header [data-score="{score!r}"]', state="attached")
    notes = [one.fields for one in Recording(file) if isinstance(one, Text)]
    offsets = [one["offset"] for one in notes if one["type"] == "page_clock"]
    assert offsets[-1] == pytest.approx(expected, abs=0.006)  # told from 1 ms on
    inputs = [one for one in notes if one["type"] == "input"]
    assert {"ping", "select", "take", "drive", "estop"} <= {one["text"]["type"] for one in inputs}
    said = [one["text"]["clock"] + expected for one in inputs]
    heard = [one["gateway_clock"] for one in inputs]
    assert said == sorted(said)
    assert heard == sorted(heard)
    assert all(a - b < 0.005 for a, b in zip(said, heard, strict=True))
