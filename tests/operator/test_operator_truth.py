"""O-07 by role: what operators are never told, searched in every message of a session."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from console_harness import PageProgram, gateway

from usarsim_client import connect
from usarsim_mission.scenario.reader import find_mission, read_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_operator.roles import Role
from usarsim_server.testing import PATIENCE, running_server

CLOSE = 0.02  # m


@pytest.fixture(scope="module")
def ports(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, int]]:
    """Ports of a server with a scene, in the world of a mission with victims and zones."""
    mission = stage(read_scenario(find_mission("arena-zones")))
    folder = mission.write_world(tmp_path_factory.mktemp("mission"))
    with running_server(world=str(folder), image_port=0, scene_port=0) as (_, endpoints):
        yield {name: endpoint.port for name, endpoint in endpoints.items()}


def numbers(message: str | bytes) -> np.ndarray:
    """All numbers of a message in order, of a binary one the floats behind its head."""
    if isinstance(message, str):
        found: list[float] = []

        def walk(value: object) -> None:
            if isinstance(value, dict):
                value = list(value.values())
            if isinstance(value, list):
                for one in value:
                    walk(one)
            elif isinstance(value, int | float) and not isinstance(value, bool):
                found.append(float(value))

        walk(json.loads(message))
        return np.array(found)
    if message[0] == 1:  # a picture
        return np.empty(0)
    rest = message[16:]
    parts = [np.frombuffer(rest[at : at + (len(rest) - at) // 4 * 4], "<f4") for at in range(4)]
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.concatenate(parts).astype(float), posinf=0.0, neginf=0.0)


def tells(page: PageProgram, place: Sequence[float]) -> bool:
    """Whether two numbers side by side, in any message, are x and y of a place; either frame."""
    x, y = place[:2]
    for message in page.said:
        told = numbers(message)
        beside = np.abs(np.abs(told[1:]) - abs(y)) < CLOSE
        if (beside & (np.abs(told[:-1] - x) < CLOSE)).any():
            return True
    return False


async def test_operators_are_told_no_truth(ports: dict[str, int]) -> None:
    """Neither victims nor zones nor robots of others; instructors and viewers are told of those."""
    async with (
        connect(port=ports["control"], timeout=PATIENCE) as server,
        gateway(ports["control"], scene=ports["scene"], delay=0.1) as console,
        console.page("Ada") as ada,
        console.page("Ina", Role.INSTRUCTOR) as ina,
        console.page("Vic", Role.VIEWER) as vic,
    ):
        robot = await server.spawn("P3AT", "Theirs", start="RobotStart4")
        answer = await ada.ask("spawn", **{"class": "P3AT"}, name="Ours", start="RobotStart1")
        assert answer["ok"], answer
        await robot.drive(left=4.0, right=2.0)
        for page in (ada, ina, vic):
            await page.until(lambda page=page: page.row("Ours") and page.row("Ours")["pose"])
            await page.until(lambda page=page: page.row("Theirs"))
            for name in ("Ours", "Theirs"):
                await page.say("select", robot=name)
        for page in (ina, vic):
            await page.until(lambda page=page: page.row("Theirs")["pose"])
            await page.until(lambda page=page: page.row("Theirs")["speed"] > 0.02)
        await robot.drive(left=0.0, right=0.0)
        truth = await robot.truth().get()
        while math.dist(truth.location, (now := await robot.truth().get()).location) > 1e-4:
            truth = now
        began = ina.state["time"]
        for page in (ada, ina, vic):
            await page.until(lambda page=page: page.state["time"] > began + 1.0)
        for page in (ina, vic):
            row = page.row("Theirs")
            assert row["pose_source"] == "Truth"
            assert row["pose"][:3] == pytest.approx(truth.location, abs=0.005)
            turned = [math.remainder(a - b, math.tau) for a, b in
                      zip(row["pose"][3:], truth.orientation, strict=True)]  # fmt: skip
            assert max(map(abs, turned)) < math.radians(0.5)
            assert row["pose_age"] < 1.0
            assert row["speed"] < 0.01
            assert page.row("Ours")["pose_source"] == "GroundTruth"  # what it reported itself
            assert tells(page, truth.location)
            assert tells(page, page.state["zones"][0]["corners"][0])
        assert ada.row("Theirs")["pose"] is None
        assert ada.row("Theirs")["pose_source"] is None
        assert ada.row("Theirs")["speed"] == 0.0
        assert not any(one[0] == 4 for one in ada.binary)
        assert not tells(ada, truth.location)
        for zone in ina.state["zones"]:
            assert not any(tells(ada, corner) for corner in zone["corners"])
        assert tells(ada, ada.row("Ours")["pose"])  # the search finds what is told
        victims = [
            geom["pos"]
            for one in console.station.scene.reader.scene.still
            if one["what"] == "victim"
            for geom in one["geoms"]
        ]
        assert len(victims) > 10
        assert not any(tells(ada, victim) for victim in victims)
