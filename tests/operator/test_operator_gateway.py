# ruff: noqa: SIM117
"""The gateway between a real server and programs that are pages, over sockets."""

from __future__ import annotations

import asyncio
import contextlib
import math
import struct
from collections.abc import Iterator
from pathlib import Path

import aiohttp
import pytest
from console_harness import Gateway, Message, PageProgram, gateway

from usarsim_operator import watchdog, web
from usarsim_operator.roles import Role
from usarsim_server.testing import PATIENCE, running_server

Ports = dict[str, int]


@pytest.fixture(scope="module")
def ports() -> Iterator[Ports]:
    """Ports of a server with pictures and a scene."""
    with running_server(world="arena", image_port=0, scene_port=0) as (_, endpoints):
        yield {name: endpoint.port for name, endpoint in endpoints.items()}


async def _driver(page: PageProgram, robot: str, **at: object) -> None:
    """Spawn a robot by a page, take it, and wait for its pose."""
    answer = await page.ask("spawn", **{"class": "P3AT"}, name=robot, **at)
    assert answer["ok"], answer
    assert (await page.ask("take", robot=robot))["ok"]
    await page.until(lambda: (page.row(robot) or {}).get("pose") is not None)


async def _keep_driving(page: PageProgram, robot: str, left: float, right: float) -> None:
    while True:
        await page.say("drive", robot=robot, left=left, right=right, device="program")
        await asyncio.sleep(0.05)


def _event(kind: str, robot: str, value: object) -> object:
    def fits(one: Message) -> bool:
        same = one["type"] == "event" and one["kind"] == kind and one["robot"] == robot
        return same and one["value"] == value

    return fits


async def _standing(page: PageProgram, robot: str) -> float:
    """Wait until it stands; s of simulated time that took."""
    began = page.state["time"]
    last = None
    while True:
        row = page.row(robot)
        assert row is not None
        pose = row["pose"]
        if last is not None and math.dist(last[:3], pose[:3]) < 1e-3:
            return float(page.state["time"] - began)
        last, now = pose, page.state["time"]
        await page.until(lambda now=now: page.state["time"] >= now + 0.25)


@pytest.mark.slow
async def test_wheel_powers_reach_the_robot(ports: Ports) -> None:
    """O-13: both forward drives straight; O-17: the change of wheels is told."""
    async with gateway(ports["control"]) as console:
        async with console.page() as page:
            await _driver(page, "Straight", start="RobotStart1")
            before = page.row("Straight")["pose"]
            task = asyncio.create_task(_keep_driving(page, "Straight", 0.5, 0.5))
            await page.until(lambda: math.dist(before[:2], page.row("Straight")["pose"][:2]) >= 3.0)
            task.cancel()
            after = page.row("Straight")["pose"]
            turned = math.degrees(math.remainder(after[5] - before[5], math.tau))
            assert abs(turned) < 2.0
            ahead = (after[0] - before[0]) * math.cos(before[5])
            assert ahead > 2.5
            assert await page.text(lambda one: one.get("kind") == "wheel" and one["value"] == 0.5)


@pytest.mark.slow
async def test_timed_moves_end_where_they_should(ports: Ports) -> None:
    """O-14: turns within 1 degree, ways within 2 cm. O-15: a drive aborts them."""
    async with gateway(ports["control"]) as console, console.page() as page:
        await _driver(page, "Timed", start="RobotStart2")
        for kind, fields, goal in (
            ("rotate", {"degrees": 90.0}, 90.0),
            ("rotate", {"degrees": -180.0}, -180.0),
            ("travel", {"metres": 1.0}, 1.0),
            ("travel", {"metres": -0.5}, -0.5),
        ):
            before = page.row("Timed")["pose"]
            page.texts.clear()
            assert (await page.ask(kind, robot="Timed", **fields))["ok"]
            done = await page.text(lambda one: one.get("kind") == "timed_move")
            assert done["value"] == "done", done
            await _standing(page, "Timed")
            after = page.row("Timed")["pose"]
            if kind == "rotate":
                turned = math.degrees(after[5] - before[5])
                assert abs(math.remainder(turned - goal, 360.0)) < 1.0, (goal, turned)
            else:
                way = math.copysign(math.dist(before[:2], after[:2]), goal)
                assert abs(way - goal) < 0.02, (goal, way)
        page.texts.clear()
        assert (await page.ask("travel", robot="Timed", metres=5.0))["ok"]
        await page.ask("drive", robot="Timed", left=0.1, right=0.1)
        done = await page.text(lambda one: one.get("kind") == "timed_move")
        assert done["value"] == "aborted"


async def test_disabled_robot_ignores_driving(ports: Ports) -> None:
    """O-16: off, it takes no drive; switched on, it does not move by that. O-17."""
    async with gateway(ports["control"]) as console, console.page() as page:
        await _driver(page, "Off", start="RobotStart3")
        assert (await page.ask("enable", robot="Off", on=False))["ok"]
        await page.text(_event("enabled", "Off", False))
        await _standing(page, "Off")
        before = page.row("Off")["pose"]
        answer = await page.ask("drive", robot="Off", left=1.0, right=1.0)
        assert not answer["ok"]
        assert "switched off" in answer["why"]
        assert (await page.ask("enable", robot="Off", on=True))["ok"]
        start = page.state["time"]
        await page.until(lambda: page.state["time"] > start + 0.6)
        assert math.dist(before[:2], page.row("Off")["pose"][:2]) < 0.005


@pytest.mark.parametrize("how", ["silent", "closed", "lost"])
async def test_watchdog_stops_robots(ports: Ports, how: str) -> None:
    """O-19: commands cease, the page closes, its socket is lost: the robot stops."""
    name = f"Watched{how}"
    async with gateway(ports["control"]) as console, console.page("Watcher") as watcher:
        async with console.page() as page:
            place = {"silent": -3.0, "closed": -5.0, "lost": -7.0}[how]
            await _driver(page, name, place=[-8.0, place, -0.3])
            driving = asyncio.create_task(_keep_driving(page, name, 0.4, 0.4))
            await watcher.until(lambda: console.station.robots[name].power > 0.0)
            driving.cancel()
            if how == "silent":
                await watcher.until(lambda: console.station.robots[name].power == 0.0)
                assert page.row(name)["holder"] is not None
            elif how == "lost":
                page.ws._response.connection.transport.abort()
        await watcher.until(lambda: console.station.robots[name].power == 0.0)
        await _standing(watcher, name)


async def test_emergency_stop_is_latched(ports: Ports, tmp_path: Path) -> None:
    """O-18, CON-15: all robots stop, drive is refused until reset, also over a restart."""
    latch = tmp_path / "estop.json"
    async with gateway(ports["control"], latch=latch) as console:
        async with console.page() as page, console.page("Eve", Role.VIEWER) as viewer:
            names = [f"Four{number}" for number in range(4)]
            for number, name in enumerate(names):
                await _driver(page, name, place=[4.0, -6.0 + 2.0 * number, -0.3])
                await page.say("drive", robot=name, left=0.3, right=0.3)
            assert not (await viewer.ask("estop", delay=0))["ok"]
            assert (await page.ask("estop"))["ok"]
            assert all(console.station.robots[name].power == 0.0 for name in names)
            refused = await page.ask("drive", robot=names[0], left=1.0, right=1.0)
            assert not refused["ok"]
            assert "emergency stop by Ada" in refused["why"]
            for name in names:
                await _standing(page, name)
    assert latch.exists()
    async with gateway(ports["control"], latch=latch) as console, console.page("Bob") as page:
        await _driver(page, "After", start="RobotStart5")
        assert page.state["estop"]["by"] == "Ada"
        assert not (await page.ask("drive", robot="After", left=1.0, right=1.0))["ok"]
        assert (await page.ask("estop_reset"))["ok"]
        assert (await page.ask("drive", robot="After", left=0.0, right=0.0))["ok"]
        assert not latch.exists()


async def test_one_driver_per_robot(ports: Ports) -> None:
    """CON-13: of two who ask one gets it; asked, granted, forced. CON-14: the other is refused."""
    async with (
        gateway(ports["control"]) as console,
        console.page("Ada") as ada,
        console.page("Bob") as bob,
        console.page("Ina", Role.INSTRUCTOR) as ina,
    ):
        await ada.ask("spawn", **{"class": "P3AT"}, name="Shared", start="RobotStart6")
        assert (await ada.ask("take", robot="Shared"))["ok"]
        wish = asyncio.create_task(bob.ask("take", robot="Shared"))
        asked = await ada.text(lambda one: one["type"] == "asked")
        assert asked["name"] == "Bob"
        sent: list[bytes] = []
        robot = console.station.robots["Shared"]
        plain = robot._send

        async def noted(data: bytes) -> None:
            sent.append(data)
            await plain(data)

        robot._send = noted
        for _ in range(50):
            await bob.say("drive", robot="Shared", left=1.0, right=1.0)
            await asyncio.sleep(0.02)
        refused = await bob.ask("drive", robot="Shared", left=1.0, right=1.0)
        assert refused["why"] == "Ada holds Shared"
        assert not sent
        await ada.ask("reply", robot="Shared", to=asked["page"], grant=True)
        assert (await wish)["ok"]
        await bob.until(lambda: bob.row("Shared")["holder"]["name"] == "Bob")
        assert not (await ada.ask("take", robot="Shared", force=True))["ok"]
        assert (await ina.ask("take", robot="Shared", force=True))["ok"]
        assert not (await bob.ask("drive", robot="Shared", left=1.0, right=1.0))["ok"]


async def test_pictures_scans_and_ways_arrive(ports: Ports) -> None:
    """Binary messages: JPEG, scan, map, way, each with the index of its robot."""
    async with gateway(ports["control"], image_port=ports["images"]) as console:
        async with console.page() as page:
            await _driver(page, "Seen", start="RobotStart7")
            await page.ask("select", robot="Seen")
            kinds = {1, 2, 5, 6}
            await page.until(lambda: kinds <= {one[0] for one in page.binary})
            index = page.row("Seen")["index"]
            picture = next(one for one in page.binary if one[0] == 1)
            assert picture[1] == index
            assert picture[16:18] == b"\xff\xd8"
            scan = next(one for one in page.binary if one[0] == 2)
            beams, _ = struct.unpack_from("<HH", scan, 48)
            assert len(scan) == 52 + 4 * beams
            assert beams == 181


async def test_scene_is_for_those_who_may_see_it(ports: Ports) -> None:
    """O-07 by role: the operator's socket has no true pose, its token no scene."""
    async with gateway(ports["control"], scene=ports["scene"], delay=0.1) as console:
        async with (
            console.page("Ada") as ada,
            console.page("Ina", Role.INSTRUCTOR) as ina,
            console.page("Vic", Role.VIEWER) as vic,
        ):
            await _driver(ada, "Stage", start="RobotStart8")
            link = console.station.scene
            await ina.until(lambda: link.present and link.present.find("Stage"))
            await ina.until(lambda: any(one[0] == 4 for one in ina.binary))
            await vic.until(lambda: any(one[0] == 4 for one in vic.binary))
            assert not any(one[0] == 4 for one in ada.binary)
            generation = console.station.scene.scene()[0]
            for role, status in ((Role.INSTRUCTOR, 200), (Role.OPERATOR, 403)):
                headers = {"Authorization": f"Bearer {console.web.tokens[role]}"}
                url = f"{console.url}/scene/{generation}"
                async with console.http.get(url, headers=headers) as answer:
                    assert answer.status == status
                    if status == 200:
                        assert "P3AT" in (await answer.json())["kinds"]
            headers = {"Authorization": f"Bearer {console.web.tokens[Role.VIEWER]}"}
            async with console.http.get(f"{console.url}/scene/0", headers=headers) as answer:
                assert answer.status == 204


async def _refusal(console: Gateway, token: str, **headers: str) -> int:
    """Status, or code of the close, that a hello gets."""
    try:
        async with console.http.ws_connect(f"{console.url}/socket", headers=headers) as ws:
            await ws.send_json({"type": "hello", "token": token, "name": "X"})
            message = await ws.receive(timeout=PATIENCE)
            return int(ws.close_code or 0) if message.type is not aiohttp.WSMsgType.TEXT else 0
    except aiohttp.WSServerHandshakeError as error:
        return error.status


async def test_strangers_are_shut_out(ports: Ports) -> None:
    """CON-28: Origin, Host and token are checked; CSP has nothing unsafe."""
    async with gateway(ports["control"]) as console:
        good = console.web.tokens[Role.OPERATOR]
        own = {"Origin": console.url}
        assert await _refusal(console, good, Origin="http://evil.example") == 403
        assert await _refusal(console, good) == 403
        assert await _refusal(console, good, Host="evil.example", **own) == 403
        assert await _refusal(console, "wrong", **own) == 1008
        assert await _refusal(console, good, **own) == 0
        async with console.http.get(f"{console.url}/") as answer:
            policy = answer.headers["Content-Security-Policy"]
            assert "unsafe" not in policy
            assert "default-src 'none'" in policy
            assert answer.headers["Content-Encoding"] in ("gzip", "deflate")
        async with console.http.get(f"{console.url}/../command.py") as answer:
            assert answer.status == 404


async def test_hostile_pages_are_closed(ports: Ports) -> None:
    """CON-29: floods, nonsense, binary and oversized texts end that page and no other."""
    async with gateway(ports["control"]) as console, console.page() as calm:
        async with console.page(pings=False) as page:
            for _ in range(1500):
                if page.closed:
                    break
                await page.ws.send_str("{" * 20)
            await page.until(lambda: page.closed)
            assert page.ws.close_code == 1008
        async with console.page(pings=False) as page:
            await page.ws.send_str("x" * 70000)
            await page.until(lambda: page.closed)
            assert page.ws.close_code == 1009
        async with console.page() as page:
            await page.ws.send_bytes(b"\0" * 100)
            assert not (await page.text(lambda one: one["type"] == "answer"))["ok"]
        assert not (await calm.ask("take", robot="nobody"))["ok"]


async def test_slow_page_delays_nobody(ports: Ports, monkeypatch: pytest.MonkeyPatch) -> None:
    """CON-22: a page that reads nothing holds one message per stream; another goes on."""
    monkeypatch.setattr(watchdog, "PAGE_TIME", PATIENCE)  # it says nothing, either
    async with gateway(ports["control"], scene=ports["scene"]) as console:
        headers = {"Origin": console.url}
        async with (
            console.http.ws_connect(f"{console.url}/socket", headers=headers) as slow,
            console.page("Ina", Role.INSTRUCTOR) as page,
        ):
            token = console.web.tokens[Role.INSTRUCTOR]
            await slow.send_json({"type": "hello", "token": token, "name": "Slow"})
            await page.until(lambda: len(console.station.pages) == 2)
            late = max(console.station.pages.values(), key=lambda one: one.id)
            stuck = asyncio.Event()
            late._socket.send_str = late._socket.send_bytes = lambda *_: stuck.wait()
            await page.until(lambda: late.dropped.get("poses", 0) > 20)
            assert late.waiting < 256 * 1024
            seen = len(page.binary)
            await page.until(lambda: len(page.binary) > seen + 20)
            stuck.set()


async def test_silent_page_is_gone(ports: Ports) -> None:
    """O-19: a page without a word for 3 s counts as gone and is hung up; its lock is free."""
    async with gateway(ports["control"]) as console, console.page() as other:
        async with console.page("Mute", pings=False) as page:
            await page.ask("spawn", **{"class": "P3AT"}, name="Alone", start="RobotStart9")
            assert (await page.ask("take", robot="Alone"))["ok"]
            await page.until(lambda: page.closed)
            await other.until(lambda: (other.row("Alone") or {"holder": 1})["holder"] is None)


async def test_a_late_viewer_is_answered_at_once(ports: Ports) -> None:
    """Only what tells of the world is late; HRI-08: a pong that waited would tell a wrong clock."""
    async with (
        gateway(ports["control"], delay=3600.0) as console,
        console.page("Vic", Role.VIEWER) as vic,
    ):
        assert (await vic.ask("ping", clock=7.0))["ok"]
        assert (await vic.text(lambda one: one["type"] == "pong" and one["clock"] == 7.0))[
            "gateway_clock"
        ]
        assert not vic.state
        assert vic.welcome["delay_s"] == 3600.0


async def test_who_never_says_hello_takes_no_place(ports: Ports) -> None:
    """90 sockets that say nothing: an operator who reloads gets in, and stops everything."""
    async with gateway(ports["control"]) as console, contextlib.AsyncExitStack() as stack:
        headers = {"Origin": console.url}
        for _ in range(90):
            mute = console.http.ws_connect(f"{console.url}/socket", headers=headers)
            await stack.enter_async_context(mute)
        for _ in range(2):
            async with console.page() as page:
                assert (await page.ask("estop"))["ok"]
                assert (await page.ask("estop_reset"))["ok"]


async def test_a_full_console_lets_operators_in(
    ports: Ports, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 64 places 8 are kept for operators and instructors; then the page that has been silent
    longest gives way to the next one, a viewer first."""
    monkeypatch.setattr(watchdog, "PAGE_TIME", PATIENCE)  # they say nothing meanwhile
    async with gateway(ports["control"]) as console, contextlib.AsyncExitStack() as stack:

        async def came(name: str, role: Role) -> PageProgram:
            return await stack.enter_async_context(console.page(name, role, pings=False))

        viewers = [await came(f"V{n}", Role.VIEWER) for n in range(web.MOST_PAGES - 8)]
        await viewers[0].say("ping", clock=0.0)
        await viewers[0].text(lambda one: one["type"] == "pong")
        await came("late", Role.VIEWER)
        await viewers[1].until(lambda: viewers[1].closed)
        assert viewers[1].ws.close_code == 1013
        assert not viewers[0].closed
        for n in range(8):
            assert (await (await came(f"O{n}", Role.OPERATOR)).ask("estop"))["ok"]
        assert len(console.web._places) == web.MOST_PAGES
        ina = await came("Ina", Role.INSTRUCTOR)
        assert (await ina.ask("estop_reset"))["ok"]
        await viewers[2].until(lambda: viewers[2].closed)
        assert viewers[2].ws.close_code == 1013
        assert len(console.web._places) == web.MOST_PAGES
    assert not console.web._places
