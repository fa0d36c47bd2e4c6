"""`usarsim mission check` finds what cannot be, and what follows from a scenario that can."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from mission_worlds import MISSION, ROBOT, VICTIM, ZONES, write_mission

from usarsim_mission.grid import FREE, UNKNOWN, WALL
from usarsim_mission.model import read_world, world_json
from usarsim_mission.scenario import faults
from usarsim_mission.scenario.check import findings
from usarsim_mission.scenario.faults import MOST
from usarsim_mission.scenario.reader import parse_scenario, read_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_mission.scenario.staging import Staged
from usarsim_mission.zones import ZoneMap
from usarsim_operator.impairment import read_plan
from usarsim_server.base.lined import key_lines
from usarsim_server.cli import main
from usarsim_server.worlds.loader import load_world

PLACE = "[[place]]\nposition = [{}, {}, 0.12]\n"
LOST = '[[victim]]\nname = "Bob"\n'


def staged(folder: Path, *parts: str, head: str = MISSION, seed: int | None = None) -> Staged:
    """A scenario in the two rooms."""
    return stage(read_scenario(write_mission(folder, *parts, head=head)), seed=seed)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        # O-01
        ((ROBOT, VICTIM, ZONES.replace("[0, -3]", "[-1, -3]")), "line 17: [[zone]] 2 (east): "
         "zones west and east overlap (let them share a border at most)"),
        ((ROBOT, VICTIM, ZONES.replace("[6, 3]", "[9, 3]")), "line 20: [[zone]] 2 (east): polygon: "
         "corner (9, 3) is outside of the world (stay within x -6 to 6 and y -3 to 3)"),
        ((ROBOT, ROBOT.replace("R1", "R2"), VICTIM), "line 12: [[robot]] 2 (R2): start: R2 and R1 "
         "start at one place (take North or Hidden)"),
        ((ROBOT.replace("West", "Hidden"), VICTIM), "line 8: [[robot]] 1 (R1): start: "
         "(0, 2, 0.25) is within a wall (take West or North)"),
        ((ROBOT.replace('start = "West"', "position = [-5.9, 2, 0.25]"), VICTIM), "there is no "
         "floor with room for a P3AT_real there"),
        ((ROBOT.replace('start = "West"', "position = [9, 2, 0.25]"), VICTIM), "is outside of the"),
        ((ROBOT + 'unattended = "patrol"\nroute = [[1, 2], [20, 2]]\n', VICTIM), "line 10: "
         "[[robot]] 1 (R1): route: nobody gets to (20, 2)"),
        ((ROBOT,), "victim: there is nobody to be found"),
        ((ROBOT, VICTIM.replace("3.0, -2.0, 0.12", "0.0, -2.0, 0.4")), "line 11: [[victim]] 1 "
         "(Ann): position: Ann is within a wall or below the floor"),
        ((ROBOT, VICTIM.replace("3.0, -2.0", "8.0, -2.0")), "Ann is outside of the world"),
        ((ROBOT, VICTIM.replace("3.0, -2.0", "5.3, 2.6")), "Ann cannot be reached: no robot"),
        ((ROBOT, LOST, PLACE.format(3, 2), PLACE.format(5.3, 2.6)), "line 14: [[place]] 2: "
         "position: whoever is there cannot be reached"),
        (("time_limit = 8.0\n", ROBOT, VICTIM), "s at 0.7 m/s (write time_limit = "),
        (('[radio]\nmodel = "telepathy"\n', ROBOT, VICTIM), "unknown propagation model"),
    ],
)  # fmt: skip
def test_what_cannot_be(
    tmp_path: Path, parts: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2; file, line, what is wrong and the cure."""
    path = write_mission(tmp_path, *parts)
    assert main(["mission", "check", str(path)]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"error: {path}: ")
    assert said in told


SPOILT = """schema = "usar-mission/1"
title = "Two rooms"
world = "./rooms"
time_limitt = 300
scoring = "rsarsin"
reveal = ["klock"]
seed = "x"
[[robot]]
name = "R1"
class = "P3AT_rael"
start = "West"
unattended = "explor"
[[robot]]
name = "R2"
start = "Wst"
[[victim]]
name = "Ann"
position = [3, "a", 0.12]
status = "Ded"
[[victim]]
name = "Bob"
position = [600, 2, 0.12]
color = 3
[[zone]]
name = "z"
colour = "pink"
x = [0, 1]
y = [0, 1]
[[event]]
name = "e"
at = 1300.0
do = "robot_fails"
robot = "R2"
[[event]]
name = "f"
at = 3.0
do = "victim_calls"
victim = "Ann"
[[event]]
name = "g"
at = 3.0
do = "victim_calls"
victim = "Anne"
"""
WRONG = {
    4: "time_limitt",
    5: "scoring",
    6: "reveal",
    7: "seed",
    10: "class",
    12: "unattended",
    15: "start",
    18: "position",
    19: "status",
    22: "position",
    23: "color",
    26: "colour",
    31: "at",
    43: "victim",
}
"""Key by line; nothing that is only wrong because of another one, such as the event about Ann."""


def test_all_faults_are_told_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of keys, values, names and places, a line each, in the order of the lines."""
    path = write_mission(tmp_path, head=SPOILT)
    assert main(["mission", "check", str(path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith(f"error: {path}: line ") for line in lines)
    told = [re.search(r": line (\d+): (?:\[\[.*?\): )?(\w+): ", line) for line in lines]
    assert [(int(one[1]), one[2]) for one in told if one] == list(WRONG.items())


@pytest.mark.parametrize(
    ("without", "said"),
    [
        ('title = "Two rooms"\n', ["title: is missing"]),
        ('world = "./rooms"\n', ["world: is missing"]),
        ('name = "R1"\n', ["[[robot]] 1: name: is missing"]),
        ("position = [3.0, -2.0, 0.12]\n", ["1 victims without a position and 0 places"]),
    ],
)
def test_what_is_missing_is_one_fault(
    tmp_path: Path, without: str, said: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """It is told by itself, and beside another one."""
    for more in ("", "reveal = 3\n"):
        text = (MISSION + more + ROBOT + VICTIM).replace(without, "")
        assert main(["mission", "check", str(write_mission(tmp_path, head=text))]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == len(said) + bool(more), lines
        assert all(any(one in line for line in lines) for one in said), lines


def test_of_a_huge_file_fewer_faults_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """For each of a hundred faults a million keys were read anew, and their lines looked for."""
    path = write_mission(tmp_path, ROBOT, VICTIM)
    text = "".join(f"k{number} = 1\n" for number in range(300)) + path.read_text()
    path.write_text(text)
    for most, told in ((MOST, MOST), (7, 7), (0, 1)):
        monkeypatch.setattr(faults, "MOST_READ", most * len(text))
        assert main(["mission", "check", str(path)]) == 2
        assert len(capsys.readouterr().err.splitlines()) == told
    assert key_lines(text) is key_lines(text)


def test_all_findings_are_told(tmp_path: Path) -> None:
    """Not only the first."""
    found = findings(
        staged(
            tmp_path,
            ROBOT.replace("West", "Hidden"),
            VICTIM.replace("3.0, -2.0", "8.0, -2.0"),
            ZONES.replace("[0, -3]", "[-1, -3]"),
        )
    )
    assert len(found) == 3


def test_a_good_mission(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is described, and its world is written."""
    path = write_mission(tmp_path, ROBOT, VICTIM, ZONES)
    assert main(["mission", "check", str(path), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "zones       2, with 1 bands" in told
    assert "victims     1, 6 to 6 m away" in told
    world = load_world(tmp_path / "out")
    assert [zone.kind for zone in world.zones] == ["blue", "orange", "yellow"]
    assert all(zone.strip for zone in world.zones)


def test_drops_that_some_teams_never_meet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """HRI-17: a link of a team's own program cannot drop; the check says so, and a run of such a
    team, before anything begins."""
    gust = '[[event]]\nname = "a gust"\nat = 2.0\ndo = "link_drops"\nrobot = "R1"\n'
    path = write_mission(tmp_path, ROBOT, VICTIM, ZONES, gust)
    assert main(["mission", "check", str(path)]) == 0
    note = "note: link_drops ('a gust') acts on robots of the console"
    assert note in capsys.readouterr().out
    words = ["mission", "run", str(path), f"--out={tmp_path / 'out'}"]
    for driver, told in (("wait = true", True), ("console = true", False)):
        team = tmp_path / "team.toml"
        team.write_text(f'name = "T"\n{driver}\n')
        assert main([*words, f"--team={team}", f"--team={team}"]) == 2  # no two teams are alike
        assert (note in capsys.readouterr().err) is told


def test_victims_are_those_of_the_scenario(tmp_path: Path) -> None:
    """O-07: nobody else is in the world that is served, unless the scenario keeps them."""
    alone = staged(tmp_path, ROBOT, VICTIM)
    world = load_world(alone.write_world(tmp_path / "alone"))
    assert [victim.name for victim in world.victims] == ["Ann"]
    kept = staged(tmp_path, ROBOT, VICTIM, head=MISSION + "keep_victims = true\n")
    world = load_world(kept.write_world(tmp_path / "kept"))
    assert [victim.name for victim in world.victims] == ["Old", "Ann"]
    assert "Ann" not in str(alone.server_settings("./w")) + alone.impairment()


def test_states_of_victims(tmp_path: Path) -> None:
    """Calls, motion, heat and status reach the world."""
    victim = (
        VICTIM + 'posture = "standing"\nstatus = "Injured"\ncalls = 65.0\nhot = false\n'
        'moves = { kind = "walk", to = [5.0, -2.0, 0.93] }\n'
    ).replace("0.12", "0.93")
    world = load_world(staged(tmp_path, ROBOT, victim).write_world(tmp_path / "w"))
    (ann,) = world.victims
    assert (ann.posture, ann.status) == ("standing", "Injured")
    assert ann.properties["sound"] == 65.0
    assert ann.properties["hot"] is False
    assert ann.properties["motion"] == {"kind": "walk", "to": [5.0, -2.0, 0.93]}


def test_a_seed_chooses_places(tmp_path: Path) -> None:
    """The same seed the same places; the run's own file holds them, whatever the seed then."""
    parts = (ROBOT, LOST, LOST.replace("Bob", "Eve"), *(PLACE.format(x, 2) for x in range(1, 4)))
    seen = set()
    for seed in range(8):
        one, other = (staged(tmp_path, *parts, seed=seed) for _ in range(2))
        places = [victim.pose.position for victim in one.victims]
        assert places == [victim.pose.position for victim in other.victims]
        assert len(set(places)) == 2
        seen.add(tuple(places))
        text = one.mission_text()
        assert "place" not in tomllib.loads(text)
        again = stage(parse_scenario(text, tmp_path / "elsewhere" / "mission.toml"), seed=99)
        assert [victim.pose.position for victim in again.victims] == places
        assert again.scenario.seeds == one.scenario.seeds
    assert len(seen) > 2


def test_another_world(tmp_path: Path) -> None:
    """`--world` wins over the file, also in the run's own file."""
    scenario = read_scenario(write_mission(tmp_path, ROBOT.replace("West", "RobotStart1"), VICTIM))
    text = stage(scenario, world="office").mission_text()
    assert tomllib.loads(text)["world"] == "office"
    kept = tomllib.loads(staged(tmp_path, ROBOT, VICTIM).mission_text())["world"]
    assert Path(kept).resolve() == (tmp_path / "rooms").resolve()


def test_bands_are_at_the_door(tmp_path: Path) -> None:
    """1 m to either side of the border of yellow, as wide as the door; where the referee has one.

    A given band stands for all of them.
    """
    both = staged(tmp_path, ROBOT, VICTIM, ZONES)
    (band,) = [zone for zone in both.painted if zone.kind == "blue"]
    assert band.x == (-1.0, 1.0)
    assert band.y == pytest.approx((-0.6, 0.6), abs=0.11)
    referee = ZoneMap(both.referee_world(), both.rules.zones, both.referee_mission().band)
    east = next(zone for zone in referee.zones if zone.name == "east")
    assert referee.in_band(east, 0.9, 0.0)
    assert not referee.in_band(east, 1.1, 0.0)
    assert not referee.in_band(east, 0.9, 2.0)  # behind the wall
    blue = '[[zone]]\nname = "line"\ncolour = "blue"\nx = [-0.5, 0.5]\ny = [-3, 3]\n'
    given = staged(tmp_path, ROBOT, VICTIM, ZONES, blue)
    assert findings(given) == []
    assert [zone.name for zone in given.painted if zone.kind == "blue"] == ["line"]
    assert given.referee_mission().band == 0.0


def test_what_the_referee_knows(tmp_path: Path) -> None:
    """`world.json`: victims, starts with what they see, floor and walls; read back as written."""
    one = staged(tmp_path, ROBOT, VICTIM, ZONES)
    path = tmp_path / "world.json"
    path.write_text(world_json(one.referee_mission(), one.referee_world()))
    mission, world = read_world(path)
    assert (mission.name, mission.time_limit, mission.band) == ("test-mission", 1200.0, 1.0)
    (ann,) = world.victims
    assert math.dist(ann.pos[:2], (3.0, -2.0)) < 0.4
    (start,) = world.starts
    assert (start.name, start.pos, start.yaw) == ("R1", (-5.0, 0.0, 0.25), 0.0)
    assert start.sensors[0].range == 20.0
    assert start.sensors[0].fov == pytest.approx(math.pi, abs=0.01)
    assert world.floor is not None
    assert world.floor.at(-3.0, 0.0) == world.floor.at(0.0, 0.0) == FREE
    assert world.floor.at(5.3, 2.6) == UNKNOWN
    assert world.floor.at(-0.05, 2.0) == WALL
    area = float((world.floor.cells == FREE).sum()) * world.floor.cell**2
    assert area == pytest.approx(2 * 5.4 * 5.4, rel=0.06)


def test_link_and_radio(tmp_path: Path) -> None:
    """Impairment as the console reads it, radio as the server does; seeds follow from one."""
    parts = ("[radio]\nfading = 3.0\n", "[video]\ndelay_ms = 400.0\nloss_percent = 10.0\n")
    one = staged(tmp_path, *parts, ROBOT, VICTIM)
    file = tmp_path / "link.toml"
    file.write_text(one.impairment())
    rest = read_plan(file).rest
    assert (rest.delay, rest.loss, rest.seed) == (0.4, 0.1, one.scenario.seeds.video)
    settings = one.server_settings("./w")
    assert settings["wireless"] == {"fading": 3.0, "seed": one.scenario.seeds.radio}
    assert settings["seed"] == one.scenario.seeds.server
    seeds = {one.scenario.seeds.video, one.scenario.seeds.radio, one.scenario.seeds.server}
    assert len(seeds) == 3


def test_the_mission_of_the_page_keeps_its_robot(tmp_path: Path) -> None:
    """docs/howto/mission.md: from its start a robot sees a wall before each border of the world."""
    page = (Path(__file__).parents[2] / "docs" / "howto" / "mission.md").read_text(encoding="utf-8")
    for name, content in re.findall(r"`([\w/.]+)`:\n\n```\w+\n(.*?)```", page, re.DOTALL):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content, encoding="utf-8")
    found = stage(read_scenario(tmp_path / "search.toml"))
    assert findings(found) == []
    (west, south, _), (east, north, _) = found.base.lower, found.base.upper
    eye = (-3.0, 0.0, 0.3)
    around = [(west - 1.0, y) for y in range(-6, 7)] + [(east + 1.0, y) for y in range(-6, 7)]
    around += [(x, side) for x in range(-6, 12) for side in (south - 1.0, north + 1.0)]
    beyond = np.array([(x, y, 0.3) for x, y in around])
    assert not found.ground.sees(beyond, eye).any()
