"""The conformance checklist of the protocol reference over sockets: bytes, dialects, habits."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise

import pytest

from usarsim_server.settings import Settings
from usarsim_server.testing import ScriptedClient, ServerProcess, time_of

Connect = Callable[[], ScriptedClient]


def _all_bytes(client: ScriptedClient, seconds: float) -> bytes:
    """Everything that arrives until so much simulated time has been told, as it arrives."""
    heard = b""
    times: list[float] = []
    while not times or times[-1] < times[0] + seconds:
        heard += client.socket.recv(65536)
        times = [float(text) for text in re.findall(rb"\{Time (\d+\.\d+)\}", heard)]
    return heard


def test_the_default_port() -> None:
    """Without options the server listens where every legacy client looks for it (check 1)."""
    assert Settings().port == 3000


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
def test_bytes_of_a_stream(connect: Connect, dialect: str) -> None:
    """Lines end in CR LF and nothing else looks like an end, blank or tab (checks 6, 7, 8, 9)."""
    client = connect()
    client.send(f"INIT {{ClassName P3AT_real}} {{Location -60,0,-0.3}} {{Dialect {dialect}}}")
    for wire_type in ("Robot", "Sonar", "RangeScanner", "Encoder"):
        client.send(f"GETGEO {{Type {wire_type}}}")
        client.send(f"GETCONF {{Type {wire_type}}}")
    heard = _all_bytes(client, 0.9)
    lines = heard.split(b"\r\n")[:-1]
    assert len(lines) > 15
    for line in lines:
        if dialect == "udk" and line.startswith(b"CONF {Type Camera} "):
            # Side channels reference 2.10: glued as in the original.
            line = line.replace(b"}{", b"} {")
        assert re.fullmatch(rb"[A-Z]+( \{[^{}\s]+( [^{}\s]+)*\})+", line), line


def test_silence_of_strange_commands(client: ScriptedClient) -> None:
    """A connection without robot hears nothing after commands that need one (checks 5, 28, 41)."""
    for text in ("", "  ", "DRIVE {Left 1} {Right 1}", "GETCONF {Type Robot}", "NONSENSE {a b}"):
        client.send(text)
    client.send("CONTROL {Type GetSTA}\r\nMISPKG {Name x} {Link 1} {Value 1}\r\nTRACE {On true}")
    assert client.fence() == []
    assert client.read_for(0.5) == []


def test_an_unfinished_command_waits(client: ScriptedClient) -> None:
    """However long it takes, a command runs when its end arrives and not before (check 27)."""
    client.send_bytes(b"GETSTARTPOSES\r\nGETSTART")
    assert client.read_line().startswith("NFO {StartPoses")
    assert client.read_for(0.6) == []
    client.send_bytes(b"POSES\n")
    assert client.read_line().startswith("NFO {StartPoses")


def test_no_answer_for_what_does_not_exist(client: ScriptedClient) -> None:
    """Unknown types and names get no line; the next question is answered (check 126)."""
    client.send("INIT {ClassName P2AT} {Location -60,6,-0.3}")
    client.send("GETCONF {Type Zilch}\r\nGETGEO {Type Sonar} {Name F99}\r\nGETGEO {Type Robot}")
    assert client.read_line().startswith("GEO {Type GroundVehicle}")
    lines = client.listen(1.5)
    assert lines
    assert not [line for line in lines if line.startswith(("CONF", "GEO"))]


def test_every_streamed_item_answers_in_time(client: ScriptedClient) -> None:
    """CONF and GEO of every item that streams come, without another question (check 125)."""
    client.send("INIT {ClassName P2AT} {Location -60,12,-0.3}")
    items: set[tuple[str, str]] = set()
    for line in client.listen(1.0):
        kind = re.search(r"\{Type (\w+)\}", line)
        if line.startswith("MISSTA"):
            items |= {("MisPkg", name) for name in re.findall(r"\{Name (\w+)[ }]", line)}
        elif line.startswith("SEN") and kind is not None:
            items |= {(kind.group(1), name) for name in re.findall(r"\{Name (\w+)[ }]", line)}
    assert len(items) > 22
    for kind_name, name in items:
        for head in ("CONF", "GEO"):
            client.send(f"GET{head} {{Type {kind_name}}} {{Name {name}}}")
            answer = client.wait_for(head)
            assert answer.startswith(f"{head} {{Type {kind_name}}} {{Name {name}")


@pytest.mark.parametrize("speech", ["INIT", "Init", "init"])
def test_habits_of_student_controllers(client: ScriptedClient, speech: str) -> None:
    """CR LF LF after every command, any case, a decimal comma in six parts (addendum)."""
    end = "\r\n\n"
    client.send(f"{speech} {{ClassName P2AT}} {{Location 0,0000, 0,0000, 0,0000}}", end)
    client.send("Drive {Left 1,0} {Right 1,0}", end)
    client.send("MultiDrive {FRFlipper 1,0}", end)
    poses = [line for line in client.listen(3.0) if line.startswith("SEN {Type Odometry}")]
    assert re.search(r"\{Pose 0\.[1-9]", poses[-1])


def test_start_poses_on_a_connection_of_their_own(connect: Connect) -> None:
    """Asked before the greeting was read, twice, and on a connection soon closed (addendum)."""
    scout = connect()
    scout.send("GETSTARTPOSES\r\nGETSTARTPOSES")
    lines = [scout.read_line() for _ in range(3)]
    assert lines[0].startswith("NFO {Gametype")
    assert lines[1] == lines[2]
    scout.close()
    robot = connect()
    robot.send("INIT {ClassName P2AT} {Start RobotStart1}")
    assert robot.wait_for("STA")


def test_a_command_for_every_line(client: ScriptedClient) -> None:
    """A client that answers every line with a DRIVE hears every report (addendum)."""
    client.send("INIT {ClassName P3AT} {Location -60,18,-0.3}")
    times = [time_of(client.wait_for("STA")) or 0.0]
    while times[-1] < times[0] + 2.0:
        line = client.read_line()
        client.send("DRIVE {Left 0.5} {Right 0.5}")
        if line.startswith("STA"):
            times.append(time_of(line) or 0.0)
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert gaps == pytest.approx([gaps[0]] * len(gaps), abs=0.03)


# -- dialects --------------------------------------------------------------------------------------

UDK_TIME = r"\{Time \d+\.\d{4}\}"


@pytest.mark.parametrize(
    ("init", "udk"),
    [
        ("INIT {Classname USARBot.P2AT}", True),
        ("INIT {ClassName USARBot.P2AT}", False),
        ("INIT {ClassName USARBot.P2AT} {Dialect udk}", True),
        ("INIT {ClassName USARBot.P3AT_real}", True),
        ("INIT {ClassName USARBot.P3AT_real} {Dialect ut2004}", False),
        ("INIT {ClassName USARBot.P2AT}\r\nGETCONF {Type Actuator}", True),
        ("INIT {ClassName USARBot.P2AT} {Dialect ut2004}\r\nGETCONF {Type Actuator}", False),
        ("INIT {ClassName USARBot.P2AT}\r\nACT {Name x} {Link 0} {Value 0}", True),
    ],
)
def test_first_lines_have_the_dialect(connect: Connect, init: str, udk: bool) -> None:
    """From the first streamed line the shapes are those of the client's era (173 to 176)."""
    client = connect()
    client.send(init.replace("}", "} {Location -60,30,-0.3}", 1))
    status = client.wait_for("STA")
    assert bool(re.search(UDK_TIME, status)) is udk
    sonar = client.wait_for(lambda line: "{Type Sonar}" in line)
    assert sonar.count("Range ") == (1 if udk else 16)


@pytest.mark.parametrize("fixed", ["ut2004", "udk"])
def test_a_fixed_port_never_changes(fixed: str) -> None:
    """Neither class, nor spelling, nor request, nor INIT's own wish counts there (check 177)."""
    with ServerProcess("--world", "empty", "--dialect", fixed) as server:
        for index, init in enumerate(
            (
                "{Classname USARBot.P3AT} {Dialect udk}",
                "{ClassName USARBot.P2AT} {Dialect ut2004}",
                "{Classname P2AT}",
            )
        ):
            client = server.client()
            client.send(f"INIT {init} {{Location {index * 4},0,-0.3}}\r\nGETCONF {{Type Actuator}}")
            client.send("ACT {Name x} {Link 0} {Value 0}")
            assert bool(re.search(UDK_TIME, client.wait_for("STA"))) is (fixed == "udk")
            client.close()


def test_the_question_after_init_is_answered_first(client: ScriptedClient) -> None:
    """INIT and GETCONF Actuator in one packet: the next line is the CONF (check 142)."""
    client.send("INIT {ClassName P2AT} {Location -60,36,-0.3}\r\nGETCONF {Type Actuator}")
    assert client.read_line().startswith("CONF {Type Actuator} {Name CameraPanTilt} {Link 1} ")
    assert client.read_line().startswith("CONF {Type Camera} {Name Camera}{TextureOffsetX ")
    assert client.read_line().startswith(("STA", "SEN", "ASTA"))
