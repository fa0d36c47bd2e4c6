"""Loading and closing again and again leaves nothing behind, at the gateway and at the server."""

from __future__ import annotations

import asyncio
import gc
import math
import os
import threading
from collections import deque

import pytest
from console_harness import Gateway, PageProgram, gateway

from usarsim_operator.roles import Role
from usarsim_operator.scenarios import read_fleet
from usarsim_server.assembly import Assembly
from usarsim_server.testing import PATIENCE, running_server

CYCLES = 20
ROBOTS = ("R1", "R2", "R3", "R4")
SCENARIO = 'schema = "usar-mission/1"\ntitle = "Four"\nworld = "empty"\n' + "".join(
    f'[[robot]]\nname = "{name}"\nposition = [0.0, {2.0 * y}, 0.3]\nyaw_degrees = 90.0\n'
    for y, name in enumerate(ROBOTS)
)


async def load(page: PageProgram) -> None:
    """Bring four robots, and see a picture and a scan of each."""
    answer = await page.ask("load", scenario=SCENARIO)
    assert answer["ok"], answer
    await page.until(lambda: all(map(page.row, ROBOTS)))
    wanted = {(kind, page.row(name)["index"]) for name in ROBOTS for kind in (1, 2)}
    seen = lambda: {(one[0], one[1]) for one in page.binary}  # noqa: E731
    await page.until(lambda: wanted <= seen())


async def close(page: PageProgram) -> None:
    """Remove them all."""
    answer = await page.ask("close")
    assert answer["ok"], answer
    await page.until(lambda: not page.state["robots"])
    page.binary.clear()
    page.texts.clear()
    page.said.clear()


def held(assembly: Assembly, console: Gateway) -> dict[str, int]:
    """What could be left behind by either; both are in this process."""
    station = console.station
    gc.collect()  # sessions are counted until they are forgotten
    return {
        "files and sockets": len(os.listdir("/proc/self/fd")),
        "tasks": len(asyncio.all_tasks()),
        "threads": threading.active_count(),
        "sessions": len(assembly.sessions),
        "robots": len(assembly.robots.vehicles),
        "driven": len(station.robots),
        "cameras": len(station.cameras),
        "signals": len(station.signals.dbm),
        "locks": len(station.arbiter.holders),
    }


async def settled(assembly: Assembly, console: Gateway) -> dict[str, int]:
    """What is held when all that ends has ended: nothing changes any more."""
    looks: deque[dict[str, int]] = deque(maxlen=8)
    async with asyncio.timeout(PATIENCE):
        while len(looks) < 8 or any(one != looks[0] for one in looks) or looks[0]["robots"]:
            await asyncio.sleep(0.05)
            looks.append(held(assembly, console))
    return looks[0]


@pytest.mark.slow
async def test_twenty_scenarios_leave_nothing() -> None:
    """O-26: four robots with cameras and lasers come and go 20 times."""
    ports = {"image_port": 0, "scene_port": 0, "wireless_port": 0}
    size = {"tile_size": (80, 60), "camera_rate": 20.0}
    with running_server(world="empty", **ports, **size) as (assembly, endpoints):
        at = {name: one.port for name, one in endpoints.items()}
        more = {"image_port": at["images"], "wireless": at["wireless"], "delay": 0.0}
        async with (
            gateway(at["control"], scene=at["scene"], **more) as console,
            console.page("Ina", Role.INSTRUCTOR) as page,
        ):
            await load(page)
            again = await page.ask("load", scenario=SCENARIO)
            assert again["why"] == "R1 cannot come: there is a robot R1 already"
            there = held(assembly, console)
            await close(page)
            # The first one wakes what stays, such as what draws pictures.
            before = await settled(assembly, console)
            for key in ("files and sockets", "robots", "driven", "cameras", "tasks"):
                assert there[key] >= before[key] + len(ROBOTS), key
            for _ in range(CYCLES):
                await load(page)
                await close(page)
            after = await settled(assembly, console)
            # Pools of threads fill up, and the last sessions are held a while by who served them;
            # one for each scenario would be more.
            spare = dict.fromkeys(("threads", "sessions"), CYCLES // 2)
            assert all(after[key] <= before[key] + spare.get(key, 0) for key in before), after
            assert not any(after[key] for key in ("robots", "driven", "cameras", "locks"))


def test_robots_of_a_scenario() -> None:
    """Their places are turned into the protocol's frame; other parts of the file do not count."""
    title, (one, two) = read_fleet(
        'schema = "usar-mission/1"\ntitle = "Two"\nworld = "office"\nscoring = "rsarsim"\n'
        '[[robot]]\nname = "R1"\nclass = "P3DX"\nposition = [1.0, 2.0, 0.25]\nyaw_degrees = 90\n'
        '[[robot]]\nname = "R2"\nstart = "West"\nunattended = "patrol"\nroute = [[0, 1], [2, 3]]\n'
    )
    assert title == "Two"
    assert (one.kind, one.place, one.start) == ("P3DX", (1.0, -2.0, -0.25), None)
    assert one.yaw == pytest.approx(-math.pi / 2)
    assert (two.kind, two.start, two.policy) == ("P3AT", "West", "patrol")
    assert two.route == ((0.0, -1.0), (2.0, -3.0))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("robot = 3", "schema"),
        ('schema = "usar-mission/2"', "is not known"),
        ('schema = "usar-mission/1"\ntitle = "None"', "there is no robot"),
        ('schema = "usar-mission/1"\n[[robot]]\nclas = "P3AT"', "name"),
        ('schema = "usar-mission/1"\n[[robot]]\nname = "R"\nroute = 3', "a list of places"),
        ("schema = ", "scenario"),
    ],
)
def test_what_no_scenario_is(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        read_fleet(text)
