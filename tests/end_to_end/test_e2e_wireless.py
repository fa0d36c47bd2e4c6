"""Robots talk to each other and to their base by radio, over real sockets (side channels 4, 5)."""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from usarsim_server.base.launch import LaunchError
from usarsim_server.testing import PATIENCE, ScriptedClient, ServerProcess, eventually

BASE, NEAR_ONE, NEAR_TWO = (-12.0, 0.0), (-9.0, 1.5), (-9.0, -1.5)
WORKSHOP = (12.5, 8.0)
"""Wire frame: behind six walls of the office, seen from the lobby."""


def read(end: socket.socket, size: int) -> bytes:
    """So many bytes, or what there is until the end."""
    data = b""
    while len(data) < size and (chunk := end.recv(65536)):
        data += chunk
    return data


def hung_up(end: socket.socket) -> bool:
    """Whether the connection ends without further data."""
    with contextlib.suppress(ConnectionError):
        return end.recv(1) == b""
    return True


def refused(port: int) -> bool:
    """Whether nobody listens on a port."""
    try:
        socket.create_connection(("127.0.0.1", port), PATIENCE).close()
    except ConnectionRefusedError:
        return True
    return False


class Controller:
    """A legacy controller with a robot, a radio and a port that it listens on."""

    def __init__(
        self, server: ServerProcess, name: str, place: tuple[float, float], kind: str = "P2AT"
    ) -> None:
        self.name = name
        self.robot = server.client()
        self.robot.wait_for("NFO {Gametype")
        x, y = place
        self.robot.send(
            f"INIT {{ClassName USARBot.{kind}}} {{Name {name}}} {{Location {x},{y},-0.3}}"
        )
        self.robot.wait_for("STA")
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.settimeout(PATIENCE)
        self.radio = ScriptedClient(server.ports["wireless"])
        port = self.listener.getsockname()[1]
        assert self.ask(f"INIT {{Robot {name}}} {{Port {port}}}") == "INITREPLY {Status OK}"

    def ask(self, line: str) -> str:
        """Ask the wireless simulation."""
        self.radio.send(line)
        return self.radio.read_line()

    def strength(self, other: str) -> float:
        """dBm of another station."""
        head = f"SS {{Robot {other}}} {{Strength "
        answer = self.ask(f"GETSS {{Robot {other}}}")
        assert answer.startswith(head), answer
        return float(answer.removeprefix(head).partition("}")[0])

    def road(self, other: str) -> int:
        """Port of the server that leads to another station."""
        return int(self.ask(f"DNS {{Robot {other}}}").rpartition(" ")[2].rstrip("}"))

    def accept(self) -> socket.socket:
        """Take a connection."""
        end, _ = self.listener.accept()
        end.settimeout(PATIENCE)
        return end

    def call(self, other: Controller) -> tuple[socket.socket, socket.socket]:
        """Connect to another station: our end and theirs, which learns who called."""
        mine = socket.create_connection(("127.0.0.1", self.road(other.name)), PATIENCE)
        theirs = other.accept()
        port = theirs.getpeername()[1]
        answer = other.ask(f"REVERSEDNS {{Port {port}}}")
        assert answer == f"REVERSEDNSREPLY {{Port {port}}} {{Robot {self.name}}}"
        return mine, theirs

    def close(self) -> None:
        """Hang up everything."""
        for one in (self.radio, self.robot, self.listener):
            one.close()


def talk(mine: socket.socket, theirs: socket.socket) -> None:
    """A few kilobytes of everything, both ways."""
    data = bytes(range(256)) * 40
    mine.sendall(data)
    assert read(theirs, len(data)) == data
    theirs.sendall(data[::-1])
    assert read(mine, len(data)) == data[::-1]


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the events of the office go."""
    return tmp_path_factory.mktemp("wireless") / "events.csv"


@pytest.fixture(scope="module")
def office(record: Path) -> Iterator[ServerProcess]:
    """An office with the default model."""
    options = ("--wireless-port", "0", "--comserver-port", "0", "--wireless-log", str(record))
    with ServerProcess("--world", "office", *options) as process:
        yield process


class Team:
    """Two robots and a base in the lobby, and a world controller that can move them."""

    def __init__(self, office: ServerProcess) -> None:
        self.office = office
        self.base = Controller(office, "Base", BASE, "ComStation")
        self.one = Controller(office, "Robot1", NEAR_ONE)
        self.two = Controller(office, "Robot2", NEAR_TWO)
        self.god = office.client()
        self.god.send("INIT {ClassName USARBot.WorldController} {Name WC} {Location 0,0,0}")

    def put(self, name: str, place: tuple[float, float]) -> None:
        """Put a robot elsewhere."""
        x, y = place
        self.god.send(f"CONTROL {{Type AbsMove}} {{Name {name}}} {{Location {x},{y},-0.3}}")

    def close(self) -> None:
        """Everybody hangs up."""
        for one in (self.base, self.one, self.two, self.god):
            one.close()


@pytest.fixture
def team(office: ServerProcess) -> Iterator[Team]:
    """A team of its own for each test."""
    with contextlib.closing(Team(office)) as made:
        yield made


def positions(server: ServerProcess) -> dict[str, list[float]]:
    """Places of all stations as the ground truth on the wireless port tells them."""
    with ScriptedClient(server.ports["wireless"]) as asker:
        asker.send("GETPOS")
        _, *groups = asker.read_line().split("{Name ")
    words = [group.split() for group in groups]
    return {word[0]: [float(part) for part in word[2].split(",")] for word in words}


def test_strengths_are_those_of_the_formula(team: Team) -> None:
    """-49.67 dBm at 2 m less 10 dB a decade, with the places that GETPOS tells
    (side channels 78)."""
    places = positions(team.office)
    assert set(places) == {"Base", "Robot1", "Robot2"}
    for asker, other in ((team.one, "Robot2"), (team.two, "Base"), (team.base, "Robot1")):
        distance = math.dist(places[asker.name], places[other])
        assert asker.strength(other) == pytest.approx(
            -49.67 - 10 * math.log10(distance / 2), abs=0.02
        )


def test_a_link_is_lost_behind_walls_and_made_again(team: Team, record: Path) -> None:
    """Robot2 is taken behind six walls and back; its links and ports follow, others do not
    (side channels 73 to 75, 78)."""
    links = [team.one.call(team.two), team.two.call(team.base), team.one.call(team.base)]
    for link in links:
        talk(*link)
    road = team.one.road("Robot2")
    team.put("Robot2", WORKSHOP)
    for end in (*links[0], *links[1]):
        assert hung_up(end)
    assert eventually(lambda: refused(road))
    talk(*links[2])
    # 6 obstacles at 22.46 m: -49.67 - 10.504 - 6 * 6.325
    assert team.one.strength("Robot2") == pytest.approx(-98.124, abs=0.05)
    assert team.one.road("Robot2") == road
    team.put("Robot2", NEAR_TWO)
    assert eventually(lambda: not refused(road))
    team.two.accept().close()
    talk(*team.one.call(team.two))
    told = [line.split(",") for line in record.read_text().splitlines()]
    pair = [row[0] for row in told if row[2:4] == ["Robot1", "Robot2"] and "RANGE" in row[0]]
    assert pair[-3:] == ["IN_RANGE", "OUT_OF_RANGE", "IN_RANGE"]


def test_a_robot_that_left_the_simulator_is_dropped(team: Team) -> None:
    """Without its robot a station is dismissed, and its name is free again (side channels 76)."""
    mine, theirs = team.one.call(team.two)
    team.two.robot.close()
    assert hung_up(mine)
    assert hung_up(theirs)
    with pytest.raises(ConnectionError):
        team.two.radio.read_line()
    team.two.close()
    team.two = Controller(team.office, "Robot2", NEAR_TWO)
    talk(*team.one.call(team.two))


def test_an_operator_station_stands_still(team: Team) -> None:
    """ComStation is a robot like others on the wire, without battery, and does not move
    (side channels 67)."""
    before = positions(team.office)["Base"]
    team.base.robot.send("GETGEO {Type Robot}")
    assert team.base.robot.wait_for("GEO") == "GEO {Type StaticPlatform} {Name ComStation}"
    team.base.robot.send("GETCONF {Type Robot}")
    assert team.base.robot.wait_for("CONF").startswith("CONF {Name ComStation} {Type StaticPlat")
    team.base.robot.send("DRIVE {Left 1} {Right 1}")
    assert "{Battery 99999} {Type StaticPlatform}" in team.base.robot.wait_for("STA")
    team.base.robot.listen(0.5)
    assert positions(team.office)["Base"] == before


def test_comserver(team: Team) -> None:
    """The older simulation tells the same strengths and carries data (side channels 79 to 85)."""
    with ScriptedClient(team.office.ports["comserver"]) as control:

        def say(message: str) -> str:
            control.send(message, end="")
            return control.socket.recv(1000).decode()

        ends = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
        for one in ends:
            one.settimeout(PATIENCE)
        a, b = (one.getsockname()[1] for one in ends)
        assert say("REGISTER Robot1 127.0.0.1;") == "OK;"
        assert say("REGISTER Base 127.0.0.1;") == "OK;"
        assert say(f"LISTEN Base {b};") == "OK;"
        assert eventually(lambda: say("GETSS Robot1 Base;").startswith("OK:-"))
        told = float(say("GETSS Robot1 Base;")[3:-1])
        assert told == pytest.approx(team.one.strength("Base"), abs=0.02)
        assert say(f"OPEN Robot1 {a} Base {b};") == "OK;"
        (mine, _), (theirs, _) = (one.accept() for one in ends)
        mine.sendall(b"SEND 5 he;\0o;CLOSE;")
        assert read(theirs, 6) == b"he;\0o"


def test_a_robot_drives_out_of_sight_and_back(tmp_path: Path) -> None:
    """With the line-of-sight model a robot that drives round the corner of the corridor loses its
    link, hears no signal there, and can connect again when it has driven back."""
    file = tmp_path / "radio.toml"
    file.write_text('model = "line-of-sight"\npoll = 0.1\n')
    options = ("--wireless-port", "0", "--wireless", str(file), "--speed", "2")
    with ServerProcess("--world", "office", *options) as server:
        base = Controller(server, "Base", (-12.0, -3.0), "ComStation")
        robot = Controller(server, "Rover", (-5.5, 0.0))
        mine, theirs = robot.call(base)
        talk(mine, theirs)
        robot.robot.send("DRIVE {Left 5} {Right 5}")
        mine.settimeout(PATIENCE)
        assert hung_up(mine)
        assert hung_up(theirs)
        assert positions(server)["Rover"][0] == pytest.approx(-4.1, abs=0.6)
        assert robot.strength("Base") == -200.0
        road = robot.road("Base")
        assert refused(road)
        robot.robot.send("DRIVE {Left -5} {Right -5}")
        assert eventually(lambda: not refused(road))
        robot.robot.send("DRIVE {Left 0} {Right 0}")
        base.accept().close()
        talk(*robot.call(base))
        assert robot.strength("Base") == pytest.approx(-55.5, abs=0.5)
        robot.close()
        base.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--wireless-model", "telepathy"), "--wireless-model: unknown propagation model"),
        (("--wireless", "/no/such.toml"), "/no/such.toml: cannot be read"),
        (("--wireless-log", "/no/such/file"), "/no/such/file: cannot be written"),
    ],
)
def test_mistakes_end_the_server(arguments: tuple[str, ...], words: str) -> None:
    """A wrong model or file is one line, not a server without radio."""
    with pytest.raises(LaunchError) as caught:
        ServerProcess("--world", "empty", "--wireless-port", "0", *arguments)
    assert words in str(caught.value)
    assert "Traceback" not in str(caught.value)


@pytest.mark.slow
def test_mistakes_in_the_settings_file(tmp_path: Path) -> None:
    """A [wireless] table is checked, and the error names file, table and key."""
    file = tmp_path / "lab.toml"
    file.write_text('world = "empty"\n[wireless]\nmodel = "obstacle"\nlatncy = 1\n')
    with pytest.raises(LaunchError) as caught:
        ServerProcess("--config", str(file), "--wireless-port", "0")
    assert f"{file}: [wireless]: latncy: unknown key" in str(caught.value)
