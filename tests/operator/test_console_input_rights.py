"""Who may do what, as people meet it in the page: asking, stopping, being shut out, leaving."""

from __future__ import annotations

import asyncio
import contextlib
import operator
import os
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

from aiohttp import web
from console_browser import Stage, becomes, escape_twice, release, shown, staged, until
from console_harness import gateway

from usarsim_operator.roles import Role

pytestmark = pytest.mark.slow

ZERO = (0.0, 0.0)
EVIL = "<img/src=x/onerror=alert(1)>"  # as names have no blanks
CYCLES = 20


@pytest.fixture(scope="module")
def stage(page_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    yield from staged(page_folder, tmp_path_factory.mktemp("latch") / "estop.json")


async def holder(page: Any, text: str) -> None:
    await page.wait_for_selector(f"[data-field=holder]:text-is({text!r})")


async def notice(page: Any, text: str) -> None:
    await page.wait_for_selector(f"[data-notices] p:has-text({text!r})")


@contextlib.asynccontextmanager
async def elsewhere() -> AsyncIterator[str]:
    """A page of somebody else on this machine."""

    async def page(_: web.Request) -> web.Response:
        return web.Response(
            text="<!doctype html><title>elsewhere</title>", content_type="text/html"
        )

    app = web.Application()
    app.router.add_get("/", page)
    runner = web.AppRunner(app)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    yield f"http://127.0.0.1:{runner.addresses[0][1]}/"
    await runner.cleanup()


async def test_a_robot_is_asked_for_kept_handed_over_and_forced(stage: Stage) -> None:
    """CON-13: both pages see who holds it; a question does not stop the robot; consent, refusal,
    and an instructor's force."""
    async with (
        stage.page(name="Ada") as ada,
        stage.page(name="Bob") as bob,
        stage.page(Role.INSTRUCTOR, name="Ina") as ina,
    ):
        await ada.click("[data-do=take]")
        await holder(ada, "you drive")
        await holder(bob, "Ada")
        await ada.keyboard.down("w")
        await stage.driven("R1", (0.6, 0.6))

        await bob.click("[data-do=take]:has-text('Ask')")
        await notice(bob, "asking Ada for R1")
        await ada.wait_for_selector("[data-asked=R1]:has-text('Bob asks for R1')")
        count = await ada.evaluate("drives().length")
        await becomes(ada, f"drives().length > {count + 5}")
        assert all(one["left"] == 0.6 for one in await ada.evaluate("drives()"))
        await ada.click("[data-asked] [data-do=keep]")
        await notice(bob, "Ada keeps R1")
        await holder(bob, "Ada")

        await bob.click("[data-do=take]")
        await ada.click("[data-asked] [data-do=hand-over]")
        await holder(bob, "you drive")
        await notice(bob, "R1 is yours")
        await notice(ada, "Bob drives R1 now")
        await until(lambda: stage.wire.drives("R1")[-1] == ZERO)
        await ada.keyboard.up("w")
        lines = len(stage.wire.drives("R1"))
        await ada.keyboard.down("w")
        await notice(ada, "Bob drives R1: ask for it")
        await ada.keyboard.up("w")
        assert set(stage.wire.drives("R1")[lines:]) <= {ZERO}  # one of the stop may come late

        assert await bob.locator("[data-do=force]").is_hidden()
        await ina.click("[data-do=force]")
        await holder(ina, "you drive")
        await notice(bob, "Ina drives R1 now")
        await ina.click("[data-do=take]:has-text('Hand back')")
        await holder(ada, "free")


@pytest.mark.parametrize(
    "way", slow_but({"escape", "pad"}.__contains__, ["escape", "button", "pad", "space"])
)
async def test_one_action_stops_every_robot(stage: Stage, way: str) -> None:
    """CON-15: Esc twice, the button, the pad's two sticks, Space; also with a dialog open."""
    async with stage.page(name="Ada") as page:
        arbiter = stage.gateway.station.arbiter
        names = ("R1", "R2", "R3", "R4")
        before = {name: len(stage.wire.drives(name)) for name in names}
        if way in ("escape", "pad"):
            await page.click("[data-do=keys]")
            await page.wait_for_selector("dialog[open]")
        match way:
            case "escape":
                await escape_twice(page, lambda: arbiter.stop is not None)
            case "button":
                await page.click("[data-do=estop]")
            case "pad":
                await page.evaluate("plug('Standard pad'); hold(10)")
                await asyncio.sleep(0.1)
                assert arbiter.stop is None
                await page.evaluate("hold(10, 11)")
            case "space":
                await page.focus("[data-do=theme]")
                await page.keyboard.press("Space")
        await until(lambda: arbiter.stop is not None)
        for name in names:
            await until(lambda name=name: ZERO in stage.wire.drives(name)[before[name] :])
        await page.wait_for_selector('[data-do=estop][aria-pressed="true"]:has-text("Ada")')
        if way == "pad":
            await page.keyboard.press("Escape")
        await release(page)
        await until(lambda: arbiter.stop is None)


async def test_a_stop_outlives_the_gateway(stage: Stage) -> None:
    """CON-15: the page of the next gateway is stopped, says by whom, and drives after release."""
    async with stage.page(name="Ada") as page:
        await page.click("[data-do=estop]")
        await until(stage.latch.exists)
    async with gateway(stage.tap, latch=stage.latch) as second:
        await second.station.spawn("P3AT", "Later", "RobotStart9")
        async with stage.page(gateway=second) as page:
            await page.wait_for_selector('[data-do=estop][aria-pressed="true"]:has-text("Ada")')
            await page.keyboard.down("w")
            await notice(page, "stopped by Ada")
            await page.keyboard.up("w")
            assert all(pair == ZERO for pair in stage.wire.drives("Later"))
            await release(page)
            await page.wait_for_selector('[data-do=estop][aria-pressed="false"]')
            await page.keyboard.down("w")
            await stage.driven("Later", (0.6, 0.6))
            await page.keyboard.up("w")
        assert not stage.latch.exists()
    async with stage.page() as page:
        await release(page)  # the first gateway goes on as it was
        await until(lambda: stage.gateway.station.arbiter.stop is None)


async def test_strangers_are_told_why(stage: Stage) -> None:
    """CON-28: a wrong token, none, a foreign name of the machine, a foreign page."""
    gate, url = stage.gateway.web, stage.gateway.url
    async with shown(stage.browser, f"{url}/#wrong") as page:
        await page.wait_for_selector("[data-link=lost]:has-text('the token is wrong')")
    async with shown(stage.browser, f"{url}/") as page:
        await page.wait_for_selector("[data-link=lost]:has-text('no token')")
    async with shown(stage.browser, url.replace("127.0.0.1", "evil.localhost")) as page:
        assert "this Host is not served here" in await page.text_content("body")
    async with elsewhere() as other, shown(stage.browser, other) as page:
        refused = gate.refused
        address = url.replace("http", "ws") + "/socket"
        code = await page.evaluate(
            f"""new Promise((done) => {{
                const socket = new WebSocket({address!r});
                socket.onopen = () => done("open");
                socket.onclose = (event) => done(event.code);
            }})"""
        )
        assert code == 1006
        assert gate.refused == refused + 1
    assert not stage.gateway.station.pages


async def test_a_name_is_a_text_in_every_panel(stage: Stage) -> None:
    """CON-28: robots, operators and notes that look like markup are shown letter by letter."""
    async with gateway(stage.tap) as second:
        await second.station.spawn("P3AT", EVIL, "RobotStart10")
        async with (
            stage.page(Role.INSTRUCTOR, gateway=second, name=EVIL) as page,
            stage.page(gateway=second, name="Bob") as bob,
        ):
            await page.click("[data-do=take]")
            await holder(bob, EVIL)
            fields = {"robot": EVIL, "place": (1.0, 2.0, 0.0), "note": EVIL}
            second.station.marks.set(fields, EVIL, 0.0)
            second.station.alarms.see(EVIL, "battery", True, EVIL, second.station.time)
            for where in (
                "[data-tile] [data-name]",
                "[data-robot]",
                "[data-selected]",
                "[data-marks] li",
                "[data-alarms] li",
            ):
                await bob.wait_for_selector(f"{where}:has-text({EVIL!r})", state="attached")
            await bob.click("[data-do=take]")
            await notice(bob, f"asking {EVIL} for {EVIL}")
            await page.wait_for_selector(f"[data-asked]:has-text({EVIL!r})")
            for one in (page, bob):
                assert await one.locator("img").count() == 0


async def test_an_operator_says_who_it_is(stage: Stage) -> None:
    """The name in the header is told to others and kept; what the old one held is free."""
    async with stage.page() as page, stage.page(name="Bob") as bob:
        await page.keyboard.press("3")
        await page.click("[data-do=take]")
        await holder(page, "you drive")
        await page.click("[data-do=name]")
        await page.fill("dialog [data-field=name]", "Eve")
        await page.keyboard.press("Enter")
        await page.wait_for_selector("[data-do=name]:text-is('Eve · operator')")
        await until(lambda: "R3" not in stage.gateway.station.arbiter.holders)
        await becomes(page, "window.usarsim?.store.connected")
        await page.click("[data-do=take]")
        await holder(page, "you drive")
        await bob.keyboard.press("3")
        await holder(bob, "Eve")
        await page.reload()
        await page.wait_for_selector("[data-do=name]:text-is('Eve · operator')")
        pages = stage.gateway.station.pages  # that before the reload leaves when it is noticed
        await until(lambda: sorted(one.name for one in pages.values()) == ["Bob", "Eve"])


async def test_the_token_leaves_the_address(stage: Stage) -> None:
    """After hello it stands neither in the address bar nor in the tab's history; a reload says
    hello all the same, and another token in the address counts at once."""
    tokens = stage.gateway.web.tokens
    async with stage.page(name="Ada") as page:
        await becomes(page, "window.usarsim?.store.connected")
        assert await page.evaluate("location.href") == f"{stage.gateway.url}/"
        for _ in range(2):
            await page.reload()
            await becomes(page, "window.usarsim?.store.connected")
            assert await page.evaluate("location.href") == f"{stage.gateway.url}/"
        history = await page.context.new_cdp_session(page)
        entries = (await history.send("Page.getNavigationHistory"))["entries"]
        secrets = [token for _, token in tokens.all()]
        assert not any(secret in one["url"] for one in entries for secret in secrets)
        await page.goto(f"{stage.gateway.url}/#{tokens[Role.VIEWER]}")
        await page.wait_for_selector("[data-do=name]:has-text('viewer')")
        assert await page.evaluate("location.href") == f"{stage.gateway.url}/"


async def test_a_wrong_token_is_not_kept(stage: Stage) -> None:
    """An address that is refused stays as it is, so that it can be mended."""
    async with stage.page(name="Ada") as page:
        await becomes(page, "window.usarsim?.store.connected")
        await page.goto(f"{stage.gateway.url}/#wrong")
        await page.wait_for_selector("body:has-text('the token is wrong')")
        assert await page.evaluate("location.hash") == "#wrong"
        assert "wrong" not in await page.evaluate("sessionStorage.getItem('usarsim-fragment')")


async def test_who_gives_no_name_is_told_of_by_role_and_number(stage: Stage) -> None:
    """Others read whom to ask: never the number of a page, and each name is of one of them only."""
    async with stage.page() as first, stage.page() as second, stage.page(Role.INSTRUCTOR) as third:
        pages = (first, second, third)
        names = [await page.inner_text("[data-do=name]") for page in pages]
        assert names == ["operator 1", "operator 2", "instructor 1"]
        assert {one.name for one in stage.gateway.station.pages.values()} == set(names)
        await second.keyboard.press("3")
        await second.click("[data-do=take]")
        await first.keyboard.press("3")
        await holder(first, "operator 2")
        await third.click("[data-do=estop]")
        for page in pages:
            await page.wait_for_selector("[data-do=estop]:text-is('Stopped by instructor 1')")
            assert "by instructor 1 at" in await page.inner_text("[data-stopped] p")
        await release(first)


async def test_a_viewer_is_offered_nothing_that_it_may_not_do(stage: Stage) -> None:
    """No button, key or double click of a viewer asks for what would be refused; it is told how
    late it sees, and its own switches are answered at once."""
    looks = {"hello", "ping", "shown", "select", "camera", "laser"}
    async with gateway(stage.tap, delay=0.5) as second:
        await second.station.spawn("P3AT", "Watched", "RobotStart13")
        second.station.marks.set({"robot": "Watched", "place": (1.0, 2.0, 0.0)}, "Ada", 0.0)
        second.station.alarms.see("Watched", "battery", True, "low", second.station.time)
        async with stage.page(Role.VIEWER, gateway=second) as page:
            await page.wait_for_selector("[data-do=name]:text-is('viewer 1, 0.5 s late')")
            await page.wait_for_selector("[data-mark]")
            await page.wait_for_selector("[data-alarm]")
            await page.wait_for_selector("[data-panel=laser] [data-age]:text-matches('\\\\d')")
            seen = "[...document.querySelectorAll('[data-do]')].filter((b) => b.offsetParent)"
            for place in range(await page.evaluate(f"{seen}.length")):
                await page.evaluate(f"{seen}[{place}]?.click()")
                await page.keyboard.press("Escape")
            await page.locator("[data-panel=map] canvas").dblclick()
            for key in ("w", "m", "l", "o", "k", "Space", "Escape", "Escape"):
                await page.keyboard.press(key)
            await notice(page, "a viewer only looks")
            await page.wait_for_function("window.sent.some((one) => one.type === 'ping')")
            sent = await page.evaluate("window.sent")
            # Pictures may or may not have come meanwhile.
            assert {one["type"] for one in sent} | {"shown"} == looks
            assert await page.locator("[data-stick]:visible").count() == 0


@pytest.mark.slow
async def test_coming_and_going_leaves_nothing(stage: Stage) -> None:
    """O-26: 20 times gateway, robot and page come and go, and every socket, stream and task is
    gone; the robot's name is free again each time, so its session has ended, too. (Scenarios,
    which would be loaded and closed in between, are not known here.)"""
    most: list[int] = []
    async with shown(stage.browser, "about:blank") as page:
        for cycle in range(CYCLES):
            async with gateway(stage.tap) as one:
                driven = await one.station.spawn("P3AT", "Guest", "RobotStart11")
                assert driven.name == "Guest"
                await page.goto(stage.url(gateway=one))
                await page.wait_for_selector("[data-tile=Guest]", state="attached")
                await page.goto("about:blank")
                await until(lambda one=one: not one.station.pages)
            if cycle < 3:  # a browser keeps a connection or two, and not from the first one on
                await asyncio.sleep(0.3)  # what is let go of late is not kept
                most = list(map(max, kept(), most or kept()))
            await until(lambda most=most: all(map(operator.le, kept(), most)))


def kept() -> list[int]:
    """Tasks, and open files and sockets, those of the server among them."""
    return [len(asyncio.all_tasks()), len(os.listdir("/proc/self/fd"))]
