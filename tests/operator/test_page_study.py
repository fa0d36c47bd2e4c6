"""The page of a study in a real browser: forms, the panel inside it, the experimenter's view."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

pytest.importorskip("aiohttp")

from console_browser import NO_GL, becomes, browsing, executable, shown, until
from fake_desk import (
    END,
    EXPERIMENTER,
    OVERVIEW,
    PROBE,
    QUESTIONS,
    TEXT,
    TOKEN,
    FakeDesk,
    form_step,
)
from fake_gateway import FakeGateway
from test_console_input_access import AUDIT, AXE

from usarsim_study.instruments import nasa_tlx, nasa_tlx_weighted, sus
from usarsim_study.session.screens import panel_line
from usarsim_study.session.steps import Session, Step
from usarsim_study.study_file import read_study, shipped_studies

SCALES = ("mental", "physical", "temporal", "performance", "effort", "frustration")


class Stage:
    """One browser, and its loop, for the tests of this module."""

    def __init__(self, runner: asyncio.Runner, browser: Any) -> None:
        self._runner, self.browser = runner, browser

    def run(self, work: Coroutine[Any, Any, None]) -> None:
        """Do a test on the loop of the browser."""
        self._runner.run(work)

    @asynccontextmanager
    async def page(self, port: int, token: str = TOKEN, **options: Any) -> AsyncIterator[Any]:
        """The page of a seat that has heard of its desk."""
        async with shown(self.browser, f"http://127.0.0.1:{port}/#{token}", **options) as page:
            await becomes(page, "window.study?.connected")
            yield page


@pytest.fixture(scope="module")
def stage(page_folder: object) -> Iterator[Stage]:
    executable()
    pytest.importorskip("playwright.async_api")
    with asyncio.Runner() as runner:
        context = browsing(*NO_GL)
        browser = runner.run(context.__aenter__())
        try:
            yield Stage(runner, browser)
        finally:
            runner.run(context.__aexit__(None, None, None))


async def checked(page: Any) -> dict[str, str]:
    """What is chosen, by item."""
    return dict(
        await page.evaluate(
            """[...document.querySelectorAll("[data-item] :checked")].map((one) =>
                [one.closest("[data-item]").dataset.item,
                 one.closest("[data-value]").dataset.value])"""
        )
    )


async def test_a_form_holds_up_and_loses_nothing(stage: Stage) -> None:
    """O-42, HRI-07, CON-25: multiples of 5 by keys alone; what is missing holds up the end and is
    pointed at; answers survive a reload, and a desk that is gone while they are given."""
    desk = FakeDesk(form_step(nasa_tlx("tlx")), END)
    async with desk.serve() as port, stage.page(port) as page:
        values = await page.eval_on_selector_all(
            "[data-item=effort] [data-value]", "all => all.map((one) => Number(one.dataset.value))"
        )
        assert values == list(range(0, 101, 5))
        await page.keyboard.press("Tab")
        await page.keyboard.press("ArrowRight")  # from the first tick, which Tab reached, to 5
        await page.keyboard.press("ArrowRight")
        await page.keyboard.press("Enter")  # hands in
        await becomes(page, "document.querySelectorAll('[data-missing=true]').length === 5")
        where = "document.activeElement.closest('[data-item]').dataset.item"
        assert await page.evaluate(where) == "physical"
        assert "5 answers are missing" in await page.text_content("[data-note]")
        assert [one for one in desk.texts if one["type"] == "hand_in"] == []
        height = "document.querySelector('[data-item=physical]').offsetHeight"
        before = await page.evaluate(height)
        await page.click("[data-item=physical] [data-value='35']")
        await until(lambda: desk.state.answers == {"mental": 10, "physical": 35})
        assert await page.evaluate(height) == before, "what stands below must not jump"
        assert await page.evaluate("location.hash") == ""
        await page.reload()
        await becomes(page, "document.querySelectorAll('[data-item] :checked').length === 2")
        assert await page.evaluate("location.hash") == ""
        assert await checked(page) == {"mental": "10", "physical": "35"}

        await desk.stop()
        await becomes(page, "document.querySelector('.link').dataset.link === 'lost'")
        for name, value in zip(SCALES[2:], (0, 50, 95, 100), strict=True):
            await page.click(f"[data-item={name}] [data-value='{value}']")
        await page.click("[data-do=next]")
        assert "does not answer" in await page.text_content("[data-note]")
        assert "your answers are kept here" in await page.text_content(".link")
        again = FakeDesk(*desk.steps)
        again.states = desk.states
        async with again.serve(port):
            await until(lambda: len(again.state.answers) == len(SCALES))
            assert list(again.state.answers.values()) == [10, 35, 0, 50, 95, 100]
            times = list(again.state.times.values())
            assert times == sorted(times)
            await becomes(page, "document.querySelector('.link').textContent === 'connected'")
            await page.focus("[data-do=next]")
            await page.keyboard.press("Enter")
            await page.wait_for_selector("[data-text=end]")
            assert again.states[0].done
            assert await page.is_visible(".link")
            await again.stop()
            await becomes(page, "document.querySelector('.link').dataset.link === 'lost'")
            assert not await page.is_visible(".link"), "whoever has done all needs no desk"


async def test_all_kinds_of_questions_over_two_pages(stage: Stage) -> None:
    """HRI-06: choices, yes and no, a number, a text that is handed in as soon as it is typed; what
    may stay open can be cleared, what is out of range is none, and a page can be turned back."""
    desk = FakeDesk(form_step(QUESTIONS), END)
    async with desk.serve() as port, stage.page(port) as page:
        await page.click("[data-item=games] [data-value='7']")
        await page.click("[data-item=hand] [data-value=left]")
        await page.click("[data-item=glasses] [data-value=false]")
        await page.fill("[data-item=age] input", "200")
        await page.click("[data-do=next]")
        assert "from 18 to 99" in await page.text_content("[data-item=age] .missing-note")
        await page.fill("[data-item=age] input", "41")
        await page.keyboard.press("Tab")
        await until(lambda: desk.state.answers.get("age") == 41)
        assert [one["value"] for one in desk.texts if one.get("item") == "age"] == [None, 41]
        await page.click("[data-item=age] [data-do=clear]")
        await page.click("[data-do=next]")
        await page.fill("textarea", "<b>little</b>")
        await page.click("[data-do=back]")
        assert await checked(page) == {"games": "7", "hand": "left", "glasses": "false"}
        assert await page.input_value("[data-item=age] input") == ""
        await page.click("[data-do=next]")
        await page.fill("textarea", "<b>nothing</b>")
        await page.click("[data-do=next]")
        await page.wait_for_selector("[data-text=end]")
        answers = {"games": 7, "hand": "left", "glasses": False, "words": "<b>nothing</b>"}
        assert desk.states[0].answers == answers
        assert [one["page"] for one in desk.texts if one["type"] == "turn"] == [2, 1, 2]


async def test_a_freeze_hides_the_panel_and_keeps_it(stage: Stage) -> None:
    """HRI-18: keys and pad reach the panel, here that of the paper, without a click; during a
    probe the picture of the page is that of the form alone, also if the panel filled the screen,
    nothing drives, and the panel goes on as it was."""
    probe = form_step(PROBE, freeze=True)
    desk = FakeDesk(probe, TEXT, {"kind": "panel", "line": "Drive with the gamepad", "url": ""})
    async with desk.serve() as port:
        gateway = FakeGateway(2, framed_by=(f"127.0.0.1:{port}",))
        async with gateway.serve() as panel, stage.page(port) as page:
            desk.steps[2]["url"] = f"http://127.0.0.1:{panel}/#operator&panel=classic"
            alone = await page.screenshot()
            await desk.go(2)
            await until(lambda: gateway.pages == 1)
            frame = page.frames[1]
            await becomes(frame, "window.usarsim?.store.robots.length")
            panels = (
                "[...document.querySelectorAll('[data-panel]')].map((one) => one.dataset.panel)"
            )
            found = await frame.evaluate(panels)
            assert found.count("laser") == 2
            assert "map" not in found
            assert await frame.evaluate("document.featurePolicy.allowsFeature('gamepad')")
            await becomes(frame, "document.hasFocus()")
            await frame.click("[data-tile=R1]")
            await frame.evaluate("document.documentElement.requestFullscreen()")
            await page.keyboard.down("w")
            await until(lambda: gateway.drives.get("R1", (0, 0))[:2] == (0.6, 0.6))
            assert await page.screenshot() != alone

            await desk.go(0)
            await until(lambda: gateway.drives["R1"][:2] == (0, 0))
            await page.keyboard.up("w")
            await becomes(page, "document.activeElement.tagName === 'H1'")
            await becomes(page, "document.fullscreenElement === null")
            assert await page.screenshot() == alone
            await page.click("[data-value=R2]")
            await frame.evaluate("plug('Pad'); hold(5); tilt(0, -1, 0, 0)")
            desk.steps[1] = desk.steps[2]
            await page.click("[data-do=next]")
            await until(lambda: gateway.drives["R1"][:2] == (1, 1))
            assert gateway.pages == 1
            await frame.evaluate("unplug()")
            assert desk.states[0].answers == {"nearest": "R2"}


CUT = """() => {
  const grid = document.querySelector(".grid").getBoundingClientRect();
  const inside = (one, low, high) => {
    const { top, bottom, height } = one.getBoundingClientRect();
    return height > 0 && top >= low - 1 && bottom <= high + 1;
  };
  const whole = [...document.querySelectorAll("[data-tile], [data-panel=map]")]
    .every((one) => inside(one, grid.top, grid.bottom));
  const map = document.querySelector("[data-panel=map] .stage").clientHeight;
  const rest = [...document.querySelectorAll("[data-do=estop], .strip")]
    .every((one) => inside(one, 0, innerHeight));
  const { scrollHeight, clientHeight } = document.querySelector(".grid");
  return [whole, rest, map >= 100, scrollHeight <= clientHeight];
}"""


@pytest.mark.parametrize(
    "robots", [4, pytest.param(1, marks=pytest.mark.slow), pytest.param(12, marks=pytest.mark.slow)]
)
async def test_a_laptop_shows_all_of_a_panel_without_scrolling(stage: Stage, robots: int) -> None:
    """HRI-18: below the shortest and the longest line of a shipped study, with a robot of as many
    sensors as a P3DX has, map, cameras, Stop and the foot are whole; the page does not scroll."""
    lines = []
    for path in shipped_studies():
        study = read_study(path)
        tasks = [one for one in Session(study, study.orders[0]).tasks if one.joint]
        lines += [panel_line(study, Step("panel", one, 1, 1), 300.0) for one in tasks]
    assert any("Gamepad:" in one and "Training:" in one for one in lines)
    desk = FakeDesk(*({"kind": "panel", "line": one, "url": ""} for one in _ends(lines)))
    async with desk.serve() as port:
        gateway = FakeGateway(robots, framed_by=(f"127.0.0.1:{port}",))
        gateway.sensors = [f"Sensor{at:02}" for at in range(18)]
        async with gateway.serve() as panel:
            for step in desk.steps:
                step["url"] = f"http://127.0.0.1:{panel}/#operator"
            async with stage.page(port) as page:
                await until(lambda: gateway.pages == 1)
                frame = page.frames[1]
                await becomes(frame, "document.querySelectorAll('.sensors li').length")
                for place, line in enumerate(_ends(lines)):
                    await desk.go(place)
                    await becomes(page, f"document.body.innerText.includes({line[:60]!r})")
                    for width, height in ((1366, 768), (1280, 720)):
                        await page.set_viewport_size({"width": width, "height": height})
                        await becomes(frame, f"innerWidth === {width}")
                        await becomes(frame, f"({CUT})().every(Boolean)")


def _ends(lines: list[str]) -> tuple[str, str]:
    """The shortest one and the longest one."""
    return min(lines, key=len), max(lines, key=len)


async def test_axe_finds_nothing_grave_on_any_screen(stage: Stage, npm: Any) -> None:
    """CON-25: texts, forms with what is missing pointed at, and the experimenter's view, dark and
    light in turns; on a phone without scrolling sideways."""
    forms = (QUESTIONS, nasa_tlx("tlx"), nasa_tlx_weighted("weighted"), sus("sus"))
    desk = FakeDesk(TEXT, *map(form_step, forms))
    wide = "document.scrollingElement.scrollWidth > innerWidth"
    async with desk.serve() as port:
        for token in (TOKEN, EXPERIMENTER):
            async with stage.page(port, token) as page:
                await page.evaluate(AXE.read_text(encoding="utf-8"))
                for place in range(len(desk.steps) if token == TOKEN else 1):
                    await desk.go(place)
                    if place:
                        await page.click("[data-do=next]")
                        await page.wait_for_selector("[data-missing=true]")
                    assert await page.evaluate(AUDIT) == [], (place, token)
                    await page.set_viewport_size({"width": 390, "height": 844})
                    assert not await page.evaluate(wide), (place, token)
                    if place == 1:
                        assert await page.evaluate(AUDIT) == []
                    await page.set_viewport_size({"width": 1366, "height": 768})
                    await page.click("[data-do=theme]")


async def test_what_needs_a_trial_is_off_without_one(stage: Stage) -> None:
    """HRI-17: between trials none can be ended or void, and nothing made happen; nobody is asked
    for a reason of what the desk then refuses."""
    desk = FakeDesk(TEXT)
    waits = {"trial": None, "time": None, "score": None, "panel": None, "robots": []}
    desk.overview = {**OVERVIEW, **waits}
    async with desk.serve() as port, stage.page(port, EXPERIMENTER) as page:
        await page.wait_for_selector("[data-fact=participant]:has-text('K7QX')")
        for name, off in (
            *(("end-trial", True), ("void", True), ("inject", True)),
            *(("next", False), ("end", False)),
        ):
            assert await page.locator(f"[data-do={name}]").is_disabled() == off, name


async def test_a_training_is_called_one(stage: Stage) -> None:
    """HRI-17: what runs is ended or void by its name, and what that means for it is told."""
    desk = FakeDesk(TEXT)
    desk.overview = {**OVERVIEW, "training": True, "now": "training 1 of 2", "trial": None}
    async with desk.serve() as port, stage.page(port, EXPERIMENTER) as page:
        await page.wait_for_selector("[data-do=pass-training]:visible")
        for name, told in (("end-trial", "is passed only if"), ("void", "is repeated")):
            assert "training" in await page.text_content(f"[data-do={name}]")
            await page.click(f"[data-do={name}]")
            text = await page.text_content("dialog[open]")
            assert told in text
            assert "this training?" in text
            await page.click("dialog [data-do=cancel]")


async def test_the_experimenter_sees_and_orders(stage: Stage) -> None:
    """HRI-17: injects; what ends a trial or a session is asked for once more, with a reason."""
    desk = FakeDesk(TEXT)

    def ordered() -> list[Any]:
        return [
            {key: value for key, value in one.items() if key != "type"}
            for one in desk.texts
            if one["type"] == "order"
        ]

    async with desk.serve() as port, stage.page(port, EXPERIMENTER) as page:
        assert "K7QX, number 3" in await page.text_content("[data-fact=participant]")
        assert await page.text_content("[data-fact=time]") == "05:18"
        assert await page.get_attribute("[data-seats] li:nth-child(2)", "data-connected") == "false"
        await page.select_option("[data-field=inject]", "link_drops")
        assert await page.text_content("[data-fact=step]") == "trial 2 of 4"
        assert await page.text_content("[data-fact=next]") == "the form workload after trial 2"
        assert await page.locator("[data-do=pass-training]").is_hidden()
        shown = await page.locator("[data-field=whom] option").all_text_contents()
        assert shown == ["R1", "R2", "R3", "R4"]
        await page.select_option("[data-field=whom]", "R2")
        await page.fill("[data-field=lasts]", "20")
        await page.click("[data-do=inject]")
        await page.wait_for_selector("[data-notice]:has-text('done: inject')")
        await page.click("[data-do=void]")
        await page.click("dialog [data-do=accept]")
        assert await page.locator("dialog[open]").count() == 1  # a reason is wanted
        await page.fill("dialog [data-field=why]", "the pad fell")
        await page.keyboard.press("Enter")
        await until(lambda: len(ordered()) == 2)
        await page.click("[data-do=end-trial]")
        await page.fill("dialog [data-field=why]", "fire alarm")
        await page.click("dialog [data-do=accept]")
        await until(lambda: len(ordered()) == 3)
        assert ordered() == [
            {"do": "inject", "inject": {"do": "link_drops", "robot": "R2", "lasts": 20}},
            {"do": "void", "reason": "the pad fell"},
            {"do": "end_trial", "reason": "fire alarm"},
        ]
