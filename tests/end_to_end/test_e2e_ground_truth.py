"""Ground truth and scoring truth over real sockets, with the programs that use them in miniature.

Numbers in docstrings are those of the side channels reference, section 11.

`--truth off`: nobody is told where robots really are, on no port and by no sensor.
"""

from __future__ import annotations

import gc
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from side_clients import MetricTool, RoboCupScore, TruthConsole, WirelessModel, split_reply
from signalled import finished

from usarsim_server.base.errors import SettingsError
from usarsim_server.options import load_settings
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.testing import (
    ScriptedClient,
    ServerProcess,
    eventually,
    running_server,
)

Connect = Callable[[], ScriptedClient]


SCENE = """<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <geom name="wall" type="box" pos="6 0 1" size="0.1 8 1"/>
    <geom name="thick" type="box" pos="9 0 1" size="0.5 8 1"/>
    <body name="crate" pos="-4 0 0.3">
      <freejoint/>
      <geom name="crate" type="box" size="0.3 0.3 0.3" mass="5"/>
    </body>
  </worldbody>
</mujoco>"""

WORLD = """
title = "Yard"
level = "yard"

[[start]]
tag = "Start"
position = [0.0, 0.0, 0.3]

[[victim]]
name = "MaleVictim_0"
position = [-6.0, 3.0, 0.12]
posture = "lying"
status = "Alive"

[[victim]]
name = "FemaleVictim_0"
position = [-6.0, 0.0, 0.93]
posture = "standing"
status = "Alive"
properties = { figure = "female" }
"""
"""Two walls to the north of the origin, a crate and a standing victim to the south."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with walls, victims and its two truths."""
    folder = tmp_path_factory.mktemp("yard")
    (folder / "scene.xml").write_text(SCENE)
    (folder / "world.toml").write_text(WORLD)
    words = ("--world", str(folder), "--groundtruth-port=0", "--truth-port=0")
    with ServerProcess(*words, "--log-level", "info") as process:
        yield process


@pytest.fixture
def model(server: ServerProcess) -> Iterator[WirelessModel]:
    """The propagation model of a wireless simulation."""
    asking = WirelessModel(server.ports["groundtruth"])
    yield asking
    asking.client.close()


def robot(connect: Connect, name: str, place: str, kind: str = "P3AT") -> ScriptedClient:
    """A connection whose robot is in the world."""
    client = connect()
    client.send(f"INIT {{ClassName USARBot.{kind}}} {{Name {name}}} {{Location {place}}}")
    client.wait_for("STA")
    return client


# -- ground truth --------------------------------------------------------------------------------


def test_ready_names_both_truths(server: ServerProcess) -> None:
    """Side channels 99: the ports asked for are opened and announced."""
    assert {"control", "groundtruth", "truth"} == set(server.ports)


def test_the_server_waits_to_be_asked(model: WirelessModel) -> None:
    """Side channels 47, 48, 61: silence on connecting, nobody there, unknown verbs without a
    reply."""
    assert model.client.read_for(0.3) == []
    model.client.send("INIT {Robot A} {Port 3333}")
    model.client.send("GETPOS")
    assert model.client.read_line() == "POSITIONS {Robots 0}"


def test_positions_of_a_team(model: WirelessModel, connect: Connect) -> None:
    """Side channels 49 to 55, 65: names as given, order of spawning, four digits, framing; who
    leaves is gone."""
    team = [robot(connect, name, f"{x},0,-0.3") for x, name in ((1, "aLPHA"), (-1, "Beta"))]
    model.client.send_bytes(b"getpos\r\nGETP")
    first = model.client.read_line()
    model.client.send_bytes(b"OS\nGETOBS {From alpha} {To Beta}\r")
    second, third = model.client.read_line(), model.client.read_line()
    for line in (first, second):
        kind, groups = split_reply(line)
        assert (kind, groups[0]) == ("POSITIONS", {"Robots": "2"})
        assert [group["Name"] for group in groups[1:]] == ["aLPHA", "Beta"]
        for group in groups[1:]:
            assert list(group) == ["Name", "Location", "BatteryEmpty"]
            assert all(len(part.partition(".")[2]) == 4 for part in group["Location"].split(","))
    assert third == "NUMOBS {From alpha} {To Beta} {ObstCount 0.0000}"
    team[0].close()
    assert eventually(lambda: list(model.positions()) == ["Beta"])
    team[1].close()
    assert eventually(lambda: not model.positions())


def test_walls_count_and_nothing_else(model: WirelessModel, connect: Connect) -> None:
    """Side channels 56, 57, 63: one obstacle for each wall between two robots, however thick; other
    robots, crates and people are none."""
    placed = {"Far": "-8,0", "Near": "-2,0", "Mid": "0,0", "Lab": "7.5,0", "Out": "12,0"}
    team = [robot(connect, name, f"{place},-0.3") for name, place in placed.items()]
    assert model.obstacles("Near", "Mid") == 0
    assert model.obstacles("Far", "Mid") == 0
    assert model.obstacles("Far", "Lab") == model.obstacles("LAB", "far") == 1
    assert model.obstacles("Lab", "Out") == 1
    assert model.obstacles("Far", "Out") == model.obstacles("Mid", "Out") == 2
    assert model.obstacles("Mid", "Mid") == 0
    assert obstacles(model, "0,0,-0.5", "1e2,0,-0.5") == 2
    assert obstacles(model, "0,0,-2.5", "100,0,-2.5") == 0
    for client in team:
        client.close()
    assert eventually(lambda: not model.positions())


def obstacles(model: WirelessModel, start: str, end: str) -> int:
    """Side channels 59: between two points, which are echoed verbatim."""
    model.client.send(f"GETOBS {{Start {start}}} {{End {end}}}")
    kind, groups = split_reply(model.client.read_line())
    assert (kind, groups[0], groups[1]) == ("NUMOBS", {"Start": start}, {"End": end})
    assert groups[2]["ObstCount"].endswith(".0000")
    return int(groups[2]["ObstCount"].partition(".")[0])


def test_half_a_question_is_answered_by_an_empty_line(model: WirelessModel) -> None:
    """Side channels 58, 60: nobody is -1, and missing arguments give CR LF alone."""
    assert model.obstacles("Nobody", "Noone") is None
    model.client.send("GETOBS {From Nobody}")
    assert model.client.read_line() == ""
    model.client.send("GETPOS")
    assert model.client.read_line().startswith("POSITIONS")


def test_an_empty_battery_is_told(model: WirelessModel, connect: Connect) -> None:
    """Side channels 64: BatteryEmpty turns True when the battery that INIT asked for is used up."""
    client = connect()
    client.send("INIT {ClassName USARBot.P3AT} {Name Tired} {Location 0,0,-0.3} {Battery 2}")
    client.wait_for("STA")
    assert model.positions()["Tired"][1] is False
    assert eventually(lambda: model.positions()["Tired"][1])
    client.close()
    assert eventually(lambda: not model.positions())


def test_an_operators_station_is_listed(model: WirelessModel, connect: Connect) -> None:
    """Side channels 67: a communication station can be spawned, stays where it is, and never runs
    out of power; nothing stands between it and a robot in its sight."""
    base = robot(connect, "BaseStation", "3,1,-0.5", "ComStation")
    scout = robot(connect, "Scout", "0,0,-0.3")
    base.send("DRIVE {Left 5} {Right 5}")
    (x, y, _), empty = model.positions()["BaseStation"]
    assert [x, y] == pytest.approx([3.0, 1.0], abs=0.01)
    assert empty is False
    base.listen(0.3)
    assert model.positions()["BaseStation"][0][:2] == pytest.approx([x, y], abs=1e-3)
    assert model.obstacles("BaseStation", "Scout") == 0
    for client in (base, scout):
        client.close()
    assert eventually(lambda: not model.positions())


def test_sixteen_robots_are_answered_about(model: WirelessModel, connect: Connect) -> None:
    """Side channels 62, 65: positions of sixteen robots, and obstacles of all pairs, whole and in
    order. How fast is measured by `make bench ARGS=groundtruth`; here they only have to come."""
    names = [f"R{number:02d}" for number in range(16)]
    team = []
    for number, name in enumerate(names):
        team.append(connect())
        x, y = 1.2 * (number % 4) - 2.0, 1.2 * (number // 4) - 2.0
        team[-1].send(f"INIT {{ClassName USARBot.P3AT}} {{Name {name}}} {{Location {x},{y},-0.3}}")
    for client in team:
        client.wait_for("STA")
    assert set(model.positions()) == set(names)
    pairs = [(one, other) for one in names for other in names if one < other]
    for one, other in pairs:
        model.client.send(f"GETOBS {{From {one}}} {{To {other}}}")
    for one, other in pairs:
        _, groups = split_reply(model.client.read_line())
        assert (groups[0], groups[1]) == ({"From": one}, {"To": other})
        assert float(groups[2]["ObstCount"]) >= 0.0
    for client in team:
        client.close()
    assert eventually(lambda: not model.positions())


def test_hostile_questions_disturb_nobody(server: ServerProcess, model: WirelessModel) -> None:
    """Absurd points, endless lines, bytes at random: the next answer is as good as ever."""
    model.client.send("GETOBS {Start nan,inf,-1e999} {End 1e300,1e300,x}")
    assert split_reply(model.client.read_line())[0] == "NUMOBS"
    with socket.create_connection(("127.0.0.1", server.ports["groundtruth"])) as other:
        other.sendall(bytes(range(256)) * 400 + b"\r\nGETOBS" + b"{" * 1000 + b"\r\n")
        other.sendall(b"GETPOS {" * 10_000)
    assert model.positions() == {}
    assert "Traceback" not in server.errors


# -- scoring truth -------------------------------------------------------------------------------


def test_scoring_tools_see_robots_and_victims(
    server: ServerProcess, model: WirelessModel, connect: Connect
) -> None:
    """Side channels 88, 89, 92 to 98: two tools at ten queries a second each and one without pause
    see the same actors as ground truth; one that asks and quits disturbs nobody."""
    team = [robot(connect, "One", "0,0,-0.3"), robot(connect, "Two", "2,0,-0.3")]
    team[1].listen(1.0)  # until they stand still
    tools = [RoboCupScore(server.ports["truth"]) for _ in range(2)]
    for tool in tools:
        tool.watch(10)
        assert tool.listings == 10
        tool.close()
    metric = MetricTool(server.ports["truth"])
    for _ in range(20):
        found, whole = metric.look()
        assert whole
    places = [place for place, _ in model.positions().values()]
    for tool in tools:
        assert len(tool.robots) == 2
        for seen, told in zip(tool.robots.values(), places, strict=True):
            assert seen == pytest.approx(told, abs=0.01)
        assert tool.victims
        assert set(found) == set(tool.robots) | set(tool.victims)
    metric.socket.close()
    for client in team:
        client.close()
    assert eventually(lambda: not model.positions())


def test_queries_by_class_and_name(
    server: ServerProcess, model: WirelessModel, connect: Connect
) -> None:
    """Side channels 90, 91: classes, names, and objects of a world controller for the console
    tool."""
    client = robot(connect, "One", "0,0,-0.3")
    boxes = connect()
    boxes.send("INIT {ClassName USARBot.WorldController} {Name WC} {Location 0,0,0}")
    boxes.send(
        "CONTROL {Type Create} {ClassName USARPhysObj.partc} {Name part_c_6} {Location 1,0.5,-0.9}"
    )
    boxes.send("CONTROL {Type GetSTA}")
    boxes.wait_for("STA")
    (line,) = TruthConsole(server.ports["truth"]).lines
    assert line.startswith("{Name part_c_6} {Class partc} {Time ")
    assert line.endswith("{Location 1.00,0.50,-0.90} {Rotation 0.00,0.00,0.00}")
    (line,) = TruthConsole(server.ports["truth"], "{class USARBot.P3AT}").lines
    name = line.partition("}")[0].removeprefix("{Name ")
    assert TruthConsole(server.ports["truth"], f"{{NAME {name}}}").lines[0].startswith(line[:30])
    assert TruthConsole(server.ports["truth"], f"{{name {name.lower()}}}").lines == []
    assert TruthConsole(server.ports["truth"], "{class USARBot.Zeppelin}").lines == []
    boxes.close()
    client.close()
    assert eventually(lambda: not model.positions())


# -- ports ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("option", ["--groundtruth-port", "--truth-port"])
def test_a_busy_port_that_was_asked_for_is_an_error(option: str) -> None:
    """Side channels 99: one line that names port and option, exit code 2."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        off = ("--image-port=off", "--wireless-port=off")
        result = finished("serve", "--world", "empty", "--port=0", f"{option}={port}", *off)
    assert (result.returncode, result.stdout) == (2, "")
    (error,) = [line for line in result.stderr.splitlines() if line.startswith("error:")]
    assert str(port) in error
    assert option in error


ROBOT = "INIT {ClassName USARBot.P3AT} {Name R1} {Location 0,0,-0.5}"
PORTS = {"groundtruth_port": 0, "truth_port": 0, "wireless_port": 0}


def heard(client: ScriptedClient) -> tuple[set[str], list[str]]:
    """Types that the robot's SEN lines name, and the answers about GroundTruth."""
    client.send(ROBOT)
    client.wait_for("SEN")
    client.send("GETCONF {Type GroundTruth}")
    client.send("GETGEO {Type GroundTruth}")
    lines = client.listen(1.0)
    types = {line.partition("{Type ")[2].partition("}")[0] for line in lines if "SEN" in line}
    return types, [line for line in lines if "GroundTruth" in line and "SEN" not in line]


@pytest.mark.parametrize("truth", ["on", "off"])
def test_ground_truth_is_told_or_not(truth: str) -> None:
    """Off: both ports are closed, GETPOS and GETOBS on the wireless port are unknown requests, the
    sensor is not mounted, and GETCONF and GETGEO know nothing of it."""
    with running_server(world="empty", truth=truth, **PORTS) as (_, endpoints):
        told = truth == "on"
        assert ("groundtruth" in endpoints) == ("truth" in endpoints) == told
        with ScriptedClient(endpoints["control"].port) as robot:
            types, facts = heard(robot)
            assert ("GroundTruth" in types) == bool(facts) == told
            assert "Odometry" in types
            for request in ("GETPOS", "GETOBS {From R1} {To R1}"):
                with ScriptedClient(endpoints["wireless"].port) as wireless:
                    wireless.send(request)
                    answer = wireless.read_line()
                    assert answer.startswith("ERROR") == (not told)
                    assert ("Location" in answer or "NUMOBS" in answer) == told
            with ScriptedClient(endpoints["wireless"].port) as wireless:
                wireless.send("INIT {Robot R1} {Port 1}")
                assert wireless.read_line() == "INITREPLY {Status OK}"


def test_the_switch_stands_in_files_too(tmp_path: Path) -> None:
    """And wins over ports that somebody asked for."""
    file = tmp_path / "lab.toml"
    file.write_text('truth = "off"\ntruth_port = 0\n')
    assert load_settings({}, file).truth == "off"
    assert load_settings({"truth": "on"}, file).truth == "on"
    with pytest.raises(SettingsError, match="truth"):
        load_settings({"truth": "perhaps"})


def test_services_that_were_asked_keep_no_robot_that_has_left() -> None:
    """Nor, with it, a former model of the world; until somebody asks again."""

    def kept() -> bool:
        gc.collect()
        return any(isinstance(one, Vehicle) and one.name == "Leaver" for one in gc.get_objects())

    settings = dict.fromkeys(("groundtruth_port", "truth_port", "wireless_port"), 0)
    with running_server(world="empty", **settings) as (assembly, endpoints):
        client = ScriptedClient(endpoints["control"].port)
        client.send("INIT {ClassName USARBot.P3AT} {Location 0,0,-0.3} {Name Leaver}")
        client.wait_for("STA {")
        for name, question in (
            ("groundtruth", "GETPOS"),
            ("truth", "{Actors}"),
            ("wireless", "GETPOS"),
        ):
            with ScriptedClient(endpoints[name].port) as asker:
                asker.send(question)
                asker.wait_for(lambda line: "Leaver" in line or "P3AT" in line)
        assert kept()
        client.close()
        assert eventually(lambda: not assembly.robots.vehicles)
        assert eventually(lambda: not kept())
