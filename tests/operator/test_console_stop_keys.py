"""The emergency stop works wherever the focus is, only stops, and is released by another act."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

from console_browser import Stage, becomes, release, staged, until

from usarsim_operator.roles import Role

ZERO = (0.0, 0.0)
DRIVES = (0.6, 0.6)
SPACE = """(how) => document.activeElement.dispatchEvent(new KeyboardEvent(how, {
    key: " ", code: "", bubbles: true, cancelable: true}))"""


@pytest.fixture(scope="module")
def stage(page_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    yield from staged(page_folder, tmp_path_factory.mktemp("latch") / "estop.json")


async def stopped(stage: Stage) -> None:
    await until(lambda: stage.gateway.station.arbiter.stop is not None)


async def let_go(stage: Stage, page: Any) -> None:
    """Release a stop at the gateway, and wait until the page has heard of it."""
    stage.gateway.station.arbiter.reset("the test", 0)
    await becomes(page, "!window.usarsim.store.state.estop")


@pytest.mark.parametrize("between", slow_but((200).__eq__, [0, 200, 700]))
@pytest.mark.parametrize(
    "way", slow_but({"mouse", "pad"}.__contains__, ["mouse", "touch", "Enter", "Space", "pad"])
)
async def test_stop_pressed_again_stays_stopped(stage: Stage, way: str, between: int) -> None:
    """A second press, at whatever time after the first, releases nothing."""
    options = {"has_touch": True} if way == "touch" else {}
    async with stage.page(name="Ada", **options) as page:
        box = await page.locator("[data-do=estop]").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        if way == "pad":
            await page.evaluate("plug('Standard pad')")
        for _ in range(2):
            match way:
                case "mouse":
                    await page.mouse.click(x, y)
                case "touch":
                    await page.touchscreen.tap(x, y)
                case "pad":
                    await page.evaluate("hold(10, 11)")
                    await asyncio.sleep(0.1)
                    await page.evaluate("hold()")
                case _:
                    await page.focus("[data-do=estop]")
                    await page.keyboard.press(way)
            await asyncio.sleep(between / 1000)
        await stopped(stage)
        await page.wait_for_selector("[data-stopped]:has-text('Ada')")
        await asyncio.sleep(0.3)
        assert stage.gateway.station.arbiter.stop is not None
        assert "estop_reset" not in [one["type"] for one in await page.evaluate("sent")]


@pytest.mark.parametrize(
    "way", slow_but({"Enter", "assistant"}.__contains__, ["mouse", "touch", "Enter", "assistant"])
)
async def test_release_is_held_for_a_second(stage: Stage, way: str) -> None:
    """A short press releases nothing; what cannot hold a button is asked by a dialog."""
    options = {"has_touch": True} if way == "touch" else {}
    async with stage.page(**options) as page:
        await page.click("[data-do=estop]")
        await page.wait_for_selector("[data-do=release]:visible")
        arbiter = stage.gateway.station.arbiter
        button = page.locator("[data-do=release]")
        if way == "assistant":
            await button.evaluate("(one) => one.click()")
            await page.wait_for_selector("dialog[open]")
            await page.keyboard.press("Enter")  # the answer that has the focus: stay stopped
            await page.wait_for_selector("dialog", state="detached")
            assert arbiter.stop is not None
            await button.evaluate("(one) => one.click()")
            await page.click("dialog [data-do=accept]")
        else:
            box = await button.bounding_box()
            at = {"x": box["x"] + 10, "y": box["y"] + 10}
            touch = await page.context.new_cdp_session(page)

            async def finger(down: bool) -> None:
                fields = {"type": "touchStart" if down else "touchEnd",
                          "touchPoints": [at] if down else []}  # fmt: skip
                if way == "touch":
                    await touch.send("Input.dispatchTouchEvent", fields)
                elif way == "Enter":
                    await (page.keyboard.down if down else page.keyboard.up)("Enter")
                else:
                    await (page.mouse.down if down else page.mouse.up)()

            await page.mouse.move(at["x"], at["y"])
            await button.focus()
            for _ in range(3):
                await finger(True)
                await finger(False)
            await page.wait_for_selector("[data-notices] p:has-text('hold')")
            assert arbiter.stop is not None
            began = await page.evaluate("performance.now()")
            await finger(True)
            await until(lambda: arbiter.stop is None)
            assert await page.evaluate("performance.now()") - began > 950
            await finger(False)
        await until(lambda: arbiter.stop is None)
        await page.wait_for_selector("[data-do=release]", state="hidden")


FOCUSES = {
    "slider": ".slider input",
    "number": ".more input[type=number]",
    "mode": "[data-do=policy]",
    "speed": "[data-do=speed]",
    "victims": "[data-field=victim]",
    "button": "[data-do=theme]",
    "disclosure": ".more summary",
    "list": "[role=listbox]",
    "tile": "[data-tile=R2]",
}


@pytest.mark.parametrize("focus", slow_but(list(FOCUSES)[2::5].__contains__, FOCUSES))
async def test_space_stops_wherever_the_focus_is(stage: Stage, focus: str) -> None:
    """Nothing else happens to what has the focus; Esc twice stops as well, and so does a press
    without a code, as remote desktops send it."""
    async with stage.page(Role.INSTRUCTOR) as page:
        await page.evaluate("document.querySelector('.more').open = true")
        await page.locator(FOCUSES[focus]).first.evaluate("(one) => { one.disabled = false; }")
        for way in ("Space", "Escape", "no code", "opened", "opened, Escape"):
            await page.locator(FOCUSES[focus]).first.focus()
            if way.startswith("opened"):
                await page.keyboard.press("Enter")
                if focus == "disclosure":
                    await page.evaluate("document.querySelector('.more').open = true")
            count = len(await page.evaluate("sent"))
            before = await page.evaluate(
                "[document.activeElement.value, document.activeElement.size]"
            )
            if way == "no code":
                await page.evaluate(SPACE, "keydown")
                await page.evaluate(SPACE, "keyup")
            elif way.endswith("Escape"):
                await page.keyboard.press("Escape")
                await page.keyboard.press("Escape")
            else:
                await page.keyboard.press("Space")
                same = "[document.activeElement.value, document.activeElement.size]"
                assert await page.evaluate(same) == before
            await stopped(stage)
            told = {one["type"] for one in (await page.evaluate("sent"))[count:]}
            assert told <= {"estop", "ping"}, way
            await becomes(page, "window.usarsim.store.state.estop")
            await let_go(stage, page)


async def test_exploring_is_chosen_by_keys_and_stopped_by_space(stage: Stage) -> None:
    """What an operator does who lets a robot explore: the list is worked by arrows, then Space
    stops, then W drives, without a click between."""
    async with stage.page() as page:
        await page.evaluate("document.querySelector('.more').open = true")
        await page.focus("[data-do=policy]")
        for _ in range(3):
            await page.keyboard.press("ArrowDown")
        await becomes(page, "document.activeElement.value === 'explore'")
        await becomes(page, "window.usarsim.store.robot.policy === 'explore'")
        await page.keyboard.press("Space")
        await stopped(stage)
        assert await page.evaluate("document.activeElement.value") == "explore"
        await release(page)
        await page.focus("[data-do=policy]")
        await stage.hold(page, "w", "R1", DRIVES)
        await page.keyboard.up("w")
        await page.focus("[data-do=policy]")
        for _ in range(3):
            await page.keyboard.press("ArrowUp")
        await becomes(page, "document.activeElement.value === 'stop'")
        await page.mouse.click(*await middle(page, "[data-do=policy]"))
        await becomes(page, "document.activeElement.size > 1")
        await page.keyboard.press("Space")
        await stopped(stage)


async def middle(page: Any, selector: str) -> tuple[float, float]:
    box = await page.locator(selector).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


async def test_fields_that_take_letters_keep_their_space(stage: Stage) -> None:
    """In a note or a name Space writes; Esc twice stops; in a dialog's other fields Space stops,
    and Stop itself is pressed with a dialog open."""
    async with stage.page() as page:
        await page.click("[data-do=name]")
        await page.fill("dialog [data-field=name]", "Ada")
        await page.keyboard.press("Space")
        await page.keyboard.type("L.")
        assert await page.input_value("dialog [data-field=name]") == "Ada L."
        assert stage.gateway.station.arbiter.stop is None
        await page.keyboard.press("Escape")
        await page.keyboard.press("Escape")
        await stopped(stage)
        await becomes(page, "window.usarsim.store.state.estop")
        await let_go(stage, page)

        await page.click("[data-do=keys]")
        for field in ("[data-pad=dead_man]", "[data-do=cancel]"):
            await page.focus(f"dialog {field}")
            await page.keyboard.press("Space")
            await stopped(stage)
            await becomes(page, "window.usarsim.store.state.estop")
            await let_go(stage, page)
        # A button that listens for a key gets it.
        await page.click("dialog [data-do=key-mark-0]")
        await page.keyboard.press("Space")
        await page.wait_for_selector("dialog [data-error]:has-text('Space is both')")
        assert stage.gateway.station.arbiter.stop is None
        await page.mouse.click(*await middle(page, "[data-do=estop]"))
        await stopped(stage)
        assert await page.locator("dialog[open]").count() == 1


async def test_another_key_stops_where_it_was_chosen(stage: Stage) -> None:
    """The emergency stop's key is that of the bindings; a viewer keeps Space for buttons."""
    async with stage.page() as page:
        await page.click("[data-do=keys]")
        await page.click("dialog [data-do=key-estop-0]")
        await page.keyboard.press("Backquote")
        await page.click("dialog [data-do=accept]")
        theme = "document.documentElement.dataset.theme"
        before = await page.evaluate(theme)
        await page.focus("[data-do=theme]")
        await page.keyboard.press("Space")
        assert await page.evaluate(theme) != before
        assert stage.gateway.station.arbiter.stop is None
        await page.keyboard.press("Backquote")
        await stopped(stage)
        await page.evaluate("localStorage.clear()")
    async with stage.page(Role.VIEWER) as page:
        before = await page.evaluate(theme)
        await page.focus("[data-do=theme]")
        await page.keyboard.press("Space")
        assert await page.evaluate(theme) != before


LOST = {
    "Meta down": "press('Meta', 'MetaLeft', 'keydown', {metaKey: true})",
    "Meta up": "press('Meta', 'MetaLeft', 'keyup', {})",
    "Alt": "press('Alt', 'AltLeft', 'keydown', {altKey: true})",
    "Control": "press('Control', 'ControlLeft', 'keydown', {ctrlKey: true})",
    "a command": "press('c', 'KeyC', 'keydown', {metaKey: true})",
    "blur": "dispatchEvent(new Event('blur'))",
    "menu": "document.body.dispatchEvent(new MouseEvent('contextmenu', {bubbles: true}))",
    "drag": "document.body.dispatchEvent(new Event('dragstart', {bubbles: true}))",
    "input method": "document.body.dispatchEvent(new CompositionEvent('compositionstart',"
    " {bubbles: true}))",
    "print": "dispatchEvent(new Event('beforeprint'))",
    "frozen": "document.dispatchEvent(new Event('freeze'))",
    "left": "dispatchEvent(new Event('pagehide'))",
    "a field": "document.querySelector('.join input').focus()",
    "asleep": "nap(2500)",
    "elsewhere": "Object.defineProperty(document, 'hasFocus', {value: () => false})",
}
HANDS = """
window.press = (key, code, how, more) => document.activeElement.dispatchEvent(
  new KeyboardEvent(how, {key, code, bubbles: true, cancelable: true, ...more}));
window.nap = (ms) => { const end = performance.now() + ms; while (performance.now() < end); };
"""


@pytest.mark.parametrize("lost", slow_but(list(LOST)[::8].__contains__, LOST))
async def test_a_key_whose_way_up_may_be_lost_is_let_go_of(stage: Stage, lost: str) -> None:
    """Command on a Mac and all of its kind: W goes down, something takes the keyboard, and the way
    up of W is never told. The robot stands, until W is pressed once more."""
    async with stage.page() as page:
        await page.evaluate(HANDS)
        await page.evaluate("document.querySelector('.more').open = true")
        await page.evaluate("press('w', 'KeyW', 'keydown', {})")
        await stage.driven("R1", DRIVES)
        await page.evaluate(f"done(); {LOST[lost]}")
        await stage.stopped(page, "R1")
        count = len(stage.wire.drives("R1"))
        await asyncio.sleep(0.3)
        assert set(stage.wire.drives("R1")[count:]) <= {ZERO}
        if lost != "elsewhere":
            await page.evaluate("document.activeElement.blur()")
            await page.evaluate("press('w', 'KeyW', 'keydown', {})")
            await stage.driven("R1", DRIVES)
            await page.evaluate("press('w', 'KeyW', 'keyup', {})")
            await stage.driven("R1", ZERO)


async def test_a_strange_device_does_not_hide_a_pad(stage: Stage) -> None:
    """A receiver of a mouse stands first in the browser's list: the pad behind it drives, chooses
    and stops; nothing asks for the receiver's layout."""
    async with stage.page() as page:
        await page.evaluate("plug('Mouse receiver', '', [0, 0, 1, 0], 8)")
        await page.evaluate("plug('Standard pad', 'standard', [0, 0, 0, 0], 17, 1)")
        await page.wait_for_selector("dialog", state="detached")
        await page.evaluate("holdOn(1, 1)")
        await becomes(page, "window.usarsim.store.selected === 'R2'")
        await page.evaluate("holdOn(0, 0, 1, 2, 3, 4, 5)")
        await page.evaluate("holdOn(1, 5); tiltOn(1, 0, -1, 0, 0)")
        await stage.driven("R2", (1.0, 1.0))
        await page.evaluate("holdOn(1)")
        await stage.driven("R2", ZERO)
        assert await page.locator("dialog").count() == 0
        # The emergency stop of a pad that does not drive works as well.
        await page.evaluate("plug('Second pad', 'standard', [0, 0, 0, 0], 17, 2)")
        await page.evaluate("holdOn(1, 5); tiltOn(1, 0, -1, 0, 0)")
        await stage.driven("R2", (1.0, 1.0))
        await page.evaluate("holdOn(2, 10, 11)")
        await stopped(stage)
        await page.evaluate("holdOn(1); holdOn(2)")
        await let_go(stage, page)
        # Of two pads the one drives that is touched.
        await page.evaluate("holdOn(2, 5); tiltOn(2, 0, 1, 0, 0)")
        await stage.driven("R2", (-1.0, -1.0))
        await page.evaluate("unplug(2)")
        await stage.driven("R2", ZERO)


AZERTY = """navigator.keyboard.getLayoutMap = async () => new Map([["KeyW", "z"], ["KeyA", "q"],
    ["KeyQ", "a"], ["KeyZ", "w"], ["KeyM", ","], ["KeyS", "s"], ["KeyD", "d"]]);"""
UNKNOWN = "Object.defineProperty(navigator, 'keyboard', {value: undefined});"


@pytest.mark.parametrize("told", slow_but(bool, [True, False]))
async def test_keys_are_named_by_what_is_printed_on_them(stage: Stage, told: bool) -> None:
    """On AZERTY the place of W has a Z: the browser tells it, or the first press does."""
    async with stage.page() as page:
        await page.context.add_init_script(AZERTY if told else UNKNOWN)
        await page.reload()
        await becomes(page, "window.usarsim?.store.robots.length")
        await page.evaluate(HANDS)
        if not told:
            await page.wait_for_selector(".hint:has-text('WASD drive')")
            for key, code in (("z", "KeyW"), ("q", "KeyA"), (",", "KeyM")):
                for how in ("keydown", "keyup"):
                    await page.evaluate(f"press({key!r}, {code!r}, {how!r}, {{}})")
            await page.keyboard.press("Escape")
        await page.wait_for_selector(".hint:has-text('ZQSD drive')")
        await page.wait_for_selector(".hint:has-text(', mark')")
        await page.wait_for_selector("[data-marks]:has-text('none; , marks one')")
        await page.click("[data-do=keys]")
        assert await page.text_content("[data-do=key-forward-0]") == "Z"
        await page.click("[data-do=key-back-0]")
        await page.evaluate("press('z', 'KeyW', 'keydown', {})")
        await page.wait_for_selector("dialog [data-error]:has-text('Z (KeyW) is both')")
