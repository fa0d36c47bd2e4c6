# ruff: noqa: SIM117
"""Robots of other controllers taken over, tiles that no server tells, the spectator picture."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator

import pytest
from console_harness import gateway
from PIL import Image

from usarsim_client import connect, readings
from usarsim_operator.roles import Role
from usarsim_server.protocol.dialects import DialectMode
from usarsim_server.testing import PATIENCE, running_server


@pytest.fixture(scope="module")
def ports() -> Iterator[dict[str, int]]:
    """Of a server of two tiles: a spectator's and a robot's."""
    more = {"tiles": (2, 1), "tile_size": (160, 120), "spectator": ("overview",)}
    ports = {"image_port": 0, "scene_port": 0, "dialect": DialectMode.UT2004}
    with running_server(world="empty", supervise="on", **ports, **more) as (_, endpoints):
        yield {name: endpoint.port for name, endpoint in endpoints.items()}


@pytest.mark.slow
async def test_timed_moves_of_a_robot_taken_over(ports: dict[str, int]) -> None:
    """O-14: 90 degrees within 1, 1 m within 2 cm, also of a robot that tells us nothing."""
    async with (
        connect(port=ports["control"], timeout=PATIENCE) as server,
        gateway(ports["control"], scene=ports["scene"]) as console,
        console.page() as page,
    ):
        robot = await server.spawn("P3AT", "Theirs", location=(0.0, 0.0, -0.3))
        truth = robot.truth()
        await page.until(lambda: page.row("Theirs"))
        assert (await page.ask("take", robot="Theirs"))["ok"]
        for kind, fields in (("rotate", {"degrees": 90.0}), ("travel", {"metres": 1.0})):
            before = await truth.get()
            page.texts.clear()
            assert (await page.ask(kind, robot="Theirs", **fields))["ok"]
            done = await page.text(lambda one: one.get("kind") == "timed_move")
            assert done["value"] == "done", done
            after = await _rest(truth)
            if kind == "rotate":
                turned = math.degrees(after.orientation[2] - before.orientation[2])
                assert abs(math.remainder(turned - 90.0, 360.0)) < 1.0
            else:
                # Both places are told to the millimetre.
                assert abs(math.dist(before.location, after.location) - 1.0) < 0.021


async def test_a_robot_of_another_controller_fails(ports: dict[str, int]) -> None:
    """HRI-17: its controller is held back until it recovers, and then drives on."""
    async with (
        connect(port=ports["control"], timeout=PATIENCE) as server,
        gateway(ports["control"], scene=ports["scene"]) as console,
        console.page("Ina", Role.INSTRUCTOR) as page,
    ):
        robot = await server.spawn("P3AT", "Legacy", location=(0.0, 5.0, -0.3))
        truth = robot.truth()
        await page.until(lambda: page.row("Legacy"))
        await robot.drive(left=1.0, right=1.0)
        first = await truth.get()
        while math.dist((await truth.get()).location, first.location) < 0.1:
            pass
        assert (await page.ask("inject", do="robot_fails", robot="Legacy"))["ok"]
        stands = await _rest(truth)
        await robot.drive(left=1.0, right=1.0)
        assert math.dist((await _rest(truth)).location, stands.location) < 0.01
        assert "Legacy has failed" in (await page.ask("enable", robot="Legacy", on=True))["why"]
        assert (await page.ask("inject", do="robot_recovers", robot="Legacy"))["ok"]
        while math.dist((await truth.get()).location, stands.location) < 0.1:
            pass
        answer = await page.ask("inject", do="link_drops", robot="Legacy")
        assert answer["why"] == "Legacy is no robot of the console"


async def _rest(truth: object) -> readings.GroundTruth:
    """Where it stands when it stands."""
    last = await truth.get()
    while True:
        now = await truth.get()
        if now.time > last.time and math.dist(now.location, last.location) < 5e-4:
            return now
        last = now


async def test_the_scene_tells_of_our_robot_first(ports: dict[str, int]) -> None:
    """A robot of ours that the scene port told first keeps its number; pages know it by that."""
    async with (
        gateway(ports["control"], scene=ports["scene"]) as console,
        console.page() as page,
    ):
        robot = await console.station.server.spawn("P3AT", "Early", location=(0.0, 3.0, -0.3))
        await page.until(lambda: page.row("Early"))
        assert not page.row("Early")["own"]
        index = page.row("Early")["index"]
        console.station.adopt(robot)
        await page.until(lambda: page.row("Early")["own"])
        assert page.row("Early")["index"] == index


async def test_tiles_and_spectator(ports: dict[str, int]) -> None:
    """O-20: `ut2004` tells no tile, STA counts it. CON-24: who cannot draw is shown the world."""
    more = {"image_port": ports["images"], "tiles": (2, 1), "spectator": (0, 0, 160, 120)}
    async with gateway(ports["control"], scene=ports["scene"], **more) as console:
        async with (
            console.page("Ina", Role.INSTRUCTOR, webgl=False) as blind,
            console.page("Ian", Role.INSTRUCTOR) as sees,
            console.page("Ada", webgl=False) as operator,
        ):
            answer = await operator.ask(
                "spawn", **{"class": "P3AT"}, name="Cut", place=[3.0, 0.0, -0.3]
            )
            assert answer["ok"], answer
            own = lambda one: one[0] == 1 and one[1] != 255  # noqa: E731
            await operator.until(lambda: any(map(own, operator.binary)))
            picture = next(filter(own, operator.binary))
            assert Image.open(io.BytesIO(picture[16:])).size == (160, 120)
            shown = lambda one: one[0] == 1 and one[1] == 255  # noqa: E731
            await blind.until(lambda: sum(map(shown, blind.binary)) >= 3)
            picture = next(filter(shown, blind.binary))
            assert picture[2] & 1
            assert Image.open(io.BytesIO(picture[16:])).size == (160, 120)
            assert not any(map(shown, sees.binary))
            assert not any(map(shown, operator.binary))


@pytest.mark.parametrize("dialect", [DialectMode.UT2004, DialectMode.UDK])
async def test_lights_flippers_and_refusals(dialect: DialectMode) -> None:
    """What moves and what is refused, in both dialects."""
    with running_server(world="empty", dialect=dialect) as (_, endpoints):
        async with gateway(endpoints["control"].port) as console, console.page() as page:
            wrong = await page.ask("spawn", **{"class": "Knaf"}, name="X")
            assert "did you mean `Kenaf`?" in wrong["why"]
            place = [0.0, 0.0, -0.4]
            assert (await page.ask("spawn", **{"class": "Kenaf"}, name="K", place=place))["ok"]
            assert (await page.ask("take", robot="K"))["ok"]
            assert (await page.ask("light", robot="K", on=True))["ok"]
            await page.until(lambda: (page.row("K") or {}).get("light"))
            angles = dict.fromkeys(page.row("K")["joints"], 0.5)
            assert len(angles) == 4
            assert (await page.ask("flippers", robot="K", angles=angles))["ok"]
            await page.until(
                lambda: all(abs(one - 0.5) < 0.02 for one in page.row("K")["joints"].values())
            )


async def test_names_that_the_console_invents_are_free() -> None:
    """Another console has robots of such names already; a name that was asked for is refused."""
    with running_server(world="empty", dialect=DialectMode.UDK) as (assembly, endpoints):
        port = endpoints["control"].port
        async with (
            connect(port=port, timeout=PATIENCE) as other,
            gateway(port) as console,
            console.page() as page,
        ):
            for number in range(1, 6):
                place = (0.0, 3.0 * number, -0.3)
                await other.spawn("P3AT", f"Console{number}", location=place)
            answer = await page.ask("spawn", **{"class": "P3AT"}, place=[4.0, 0.0, -0.3])
            assert answer["ok"], answer
            taken = await page.ask("spawn", **{"class": "P3AT"}, name="Console5", place=[9, 0, -1])
            assert "the name Console5 is taken" in taken["why"]
            assert len(assembly.robots.vehicles) == 6
            assert not any("_" in one.name for one in assembly.robots.vehicles)
