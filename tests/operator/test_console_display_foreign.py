"""The same page at servers of every dialect, recorded ones too, with nothing but the protocol."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

from console_browser import NO_GL
from console_harness import gateway
from console_rig import Console, canvas, chromium, escaped_twice, shown, until
from recorded_server import RecordedServer

from usarsim_record.proxy import Proxy
from usarsim_record.recording import Link, Writer, read
from usarsim_server.testing import ServerProcess, running_server

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("page_folder")]

CLASSES = {"ut2004": "P2AT", "udk": "P3AT", "own": "P3AT"}


async def _record(dialect: str, file: Path) -> None:
    """Record what a server says to a gateway, with one robot that drives for a while."""
    with running_server(world="empty", dialect=dialect) as (_, ports), file.open("wb", 0) as out:
        links = [Link(0, "127.0.0.1", ports["control"].port)]
        proxy = Proxy(links, Writer(out, links))
        (port,) = await proxy.start()
        try:
            async with gateway(port) as console, console.page() as page:
                await console.station.spawn(CLASSES[dialect], "R0", "RobotStart1")
                await page.ask("take", robot="R0")
                await page.until(lambda: (page.row("R0") or {}).get("laser"))
                begun = page.state["time"]
                while page.state["time"] < begun + 2.0:
                    await page.say("drive", robot="R0", left=0.6, right=0.6, device="program")
                    await asyncio.sleep(0.05)
        finally:
            await proxy.stop()


class Site:
    """A page at a server, and what is known of that server: what it was told; how it hangs."""

    def __init__(self, page: Any, moved: Callable[[], bool], hang: Callable[[bool], None]) -> None:
        self.page, self.moved, self.hang = page, moved, hang


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """By dialect. Made before the browser starts, which has an event loop of its own."""
    folder = tmp_path_factory.mktemp("recordings")
    files = {dialect: folder / f"{dialect}.jsonl" for dialect in ("ut2004", "udk")}
    for dialect, file in files.items():
        asyncio.run(_record(dialect, file))
    return files


@pytest.fixture(scope="module")
def browser(recordings: dict[str, Path]) -> Iterator[Any]:
    """Without WebGL: the 3D tile is off."""
    with chromium(NO_GL) as running:
        yield running


@pytest.fixture(scope="module", params=slow_but("ut2004".__eq__, ["own", "ut2004", "udk"]))
def site(
    request: pytest.FixtureRequest, browser: Any, recordings: dict[str, Path], tmp_path_factory: Any
) -> Iterator[Site]:
    """A page of a console whose only robot is R0."""
    kind: str = request.param
    with contextlib.ExitStack() as stack:
        if kind == "own":
            server = stack.enter_context(ServerProcess("--world=empty"))
            port, told = server.ports["control"], None

            def hang(on: bool) -> None:
                os.kill(server.process.pid, signal.SIGSTOP if on else signal.SIGCONT)

        else:
            told = stack.enter_context(RecordedServer(read(recordings[kind])))
            port = told.port

            def hang(on: bool) -> None:
                told.silent = on

        robot = f"--robot={CLASSES[kind]}=R0"
        console = stack.enter_context(Console(port, robot, folder=tmp_path_factory.mktemp(kind)))
        page = stack.enter_context(shown(browser, console.urls["operator"]))

        def moved() -> bool:
            if told is None:
                return bool(page.evaluate("usarsim.store.robots[0].speed > 0.03"))
            drives = [line for line in told.heard if line.startswith("DRIVE")]
            return any("{Left 60.0" in line and "{Right 60.0" in line for line in drives)

        yield Site(page, moved, hang)


def test_what_the_robot_reports_is_shown(site: Site) -> None:
    """O-28, CON-30: pose, battery, sensors, scan and the mission clock."""
    page = site.page
    until(lambda: page.evaluate("usarsim.store.robots[0].pose !== null"))
    until(lambda: page.get_attribute("[data-panel=laser]", "data-stale") == "false")
    until(lambda: page.locator("[data-sensor][data-stale=false]").count() >= 3)
    until(lambda: page.get_attribute('[data-robot="R0"]', "data-stale") == "false")
    until(lambda: "m" in page.inner_text("[data-field=pose]"))
    until(lambda: np.count_nonzero(canvas(page, "[data-panel=laser] canvas")[..., 3]) > 1000)
    first = page.inner_text("[data-clock]")
    until(lambda: page.inner_text("[data-clock]") != first)
    # What such a server lacks is off, and says so.
    assert page.get_attribute("[data-panel=view3d]", "data-source") == "reports"
    assert page.get_attribute('[data-tile="R0"]', "data-camera") in ("none", "waiting")
    assert not page.is_visible("[data-do=pause]")


def test_it_is_driven_and_stopped(site: Site) -> None:
    """O-28, CON-30: a key reaches the server as DRIVE; the stop holds."""
    page = site.page
    page.keyboard.down("w")
    until(site.moved)
    page.keyboard.up("w")
    pressed = "document.querySelector('[data-do=estop]').ariaPressed === 'true'"
    until(lambda: escaped_twice(page, lambda: page.evaluate(pressed)))
    page.hover("[data-do=release]")
    page.mouse.down()
    until(lambda: page.get_attribute("[data-do=estop]", "aria-pressed") == "false")
    page.mouse.up()


def test_a_server_that_hangs_is_noticed(site: Site) -> None:
    """CON-19, CON-30: laser, map, robot and card are stale, and live again when it goes on."""
    page, parts = site.page, ("[data-panel=laser]", "[data-panel=map]", "[data-panel=card]",
                              '[data-robot="R0"]')  # fmt: skip
    until(lambda: all(page.get_attribute(one, "data-stale") == "false" for one in parts))
    site.hang(True)
    until(lambda: all(page.get_attribute(one, "data-stale") == "true" for one in parts))
    until(lambda: page.get_attribute(".header", "data-stale") == "false")  # the gateway lives
    site.hang(False)
    until(lambda: all(page.get_attribute(one, "data-stale") == "false" for one in parts))
