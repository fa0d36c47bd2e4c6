"""World controllers and avatars over real sockets (protocol reference 3.13, 3.14, 4.11).

A rescue task over real sockets: read, write and drop RFID tags, look for victims.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator

import pytest

from usarsim_server.testing import (
    Rehearsal,
    RehearsedClient,
    ScriptedClient,
    ServerProcess,
    eventually,
)

Connect = Callable[[], ScriptedClient]


def controller(connect: Connect) -> ScriptedClient:
    """A connection that is a world controller."""
    client = connect()
    client.wait_for("NFO {Gametype")
    client.send("INIT {ClassName USARBot.WorldController} {Name WC} {Location 0,0,0}")
    return client


def status(client: ScriptedClient, filters: str = "") -> dict[str, dict[str, str]]:
    """GetSTA as a table by name."""
    client.send(f"CONTROL {{Type GetSTA}} {filters}")
    line = client.wait_for("STA")
    assert line.count("{") == line.count("}")
    pairs = [pair.partition(" ")[::2] for pair in re.findall(r"\{([^{}]*)\}", line)]
    rows = [dict(pairs[start : start + 5]) for start in range(0, len(pairs), 5)]
    return {row["Name"]: row for row in rows}


def where(client: ScriptedClient, name: str) -> list[float]:
    """Location of an object."""
    return vector(status(client, f"{{Name {name}}}")[name]["Location"])


def vector(text: str) -> list[float]:
    """Numbers of a vector."""
    return [float(part) for part in text.split(",")]


def scan(robot: ScriptedClient) -> float:
    """What the middle beam of the next scan says, m."""
    line = robot.wait_for(lambda line: "{Type RangeScanner}" in line)
    found = re.search(r"\{Range ([^}]*)\}", line)
    assert found is not None
    values = vector(found.group(1))
    return values[len(values) // 2]


def test_a_whole_session(connect: Connect) -> None:
    """Create, ask, move, see, push, remove by name and by box, go round, clean up (protocol 167 to
    172)."""
    wc, robot = controller(connect), connect()
    robot.send("INIT {ClassName USARBot.P2AT} {Name Pusher} {Location -60,40,-0.3}")
    robot.wait_for("STA")
    far = scan(robot)

    wc.send(
        "CONTROL {Type Create} {ClassName USARPhysObj.Wall} {Name Target} "
        "{Location -50, 40, -0.6} {Rotation 0, 0, 0} {Memory seen?} {Physics None}"
    )
    target = status(wc)["Target"]
    assert target["Size"] == "0.1000,1.2000,1.2000"
    assert (target["Location"], target["Memory"]) == ("-50.0000,40.0000,-0.6000", "seen?")
    assert eventually(lambda: scan(robot) < far - 1.0)
    at_ten = scan(robot)

    wc.send("CONTROL {Type AbsMove} {Name Target} {Location -54,40,-0.6}")
    assert where(wc, "Target") == [-54.0, 40.0, -0.6]
    assert eventually(lambda: abs(at_ten - scan(robot) - 4.0) < 0.1)

    wc.send("CONTROL {Type Kill} {Name Target}")
    wc.send("CONTROL {Type GetSTA} {Name Target}")
    assert wc.wait_for("STA") == "STA"

    wc.send(
        "CONTROL {Type Create} {ClassName WCCrate} {Name Load} {Location -59,40,-0.25} "
        "{Physics RigidBody}"
    )
    robot.send("DRIVE {Left 4} {Right 4}")
    assert eventually(lambda: where(wc, "Load")[0] > -58.3)
    robot.send("DRIVE {Left 0} {Right 0}")
    assert where(wc, "Load")[2] == pytest.approx(-0.25, abs=0.02)

    for n in range(3):
        wc.send(
            f"CONTROL {{Type Create}} {{ClassName Box}} {{Name b{n}}} {{Location {n},60,-0.15}}"
        )
    wc.send("CONTROL {Type KillAll} {MinPos 1.5,61,0.5} {MaxPos -0.5,59,-1}")
    assert set(status(wc)) == {"Load", "b2"}

    wc.send("CONTROL {Type SetWP} {Name b2} {Speed 2} {Loop true}")
    wc.send("CONTROL {Type AddWP} {Name b2} {WP 2,61,-0.15;3,61,-0.15;3,60,-0.15;2,60,-0.15}")
    places = set()

    def been_everywhere() -> bool:
        x, y, z = where(wc, "b2")
        assert (1.99 <= x <= 3.01, 59.99 <= y <= 61.01, z) == (True, True, -0.15)
        places.add((round(x), round(y)))
        return places == {(2, 60), (2, 61), (3, 60), (3, 61)}

    assert eventually(been_everywhere)

    witness = controller(connect)
    assert set(status(witness)) == {"Load", "b2"}
    wc.close()
    assert eventually(lambda: status(witness) == {})


def test_others_may_not_control(connect: Connect) -> None:
    """CONTROL with a robot, or with nothing, is neither obeyed nor answered (protocol 167)."""
    robot, nobody, wc = connect(), connect(), controller(connect)
    robot.send("INIT {ClassName P2AT} {Location 90,-60,-0.3}")
    for client in (robot, nobody):
        client.send("CONTROL {Type Create} {ClassName Box} {Name Sly} {Location 0,-60,-0.15}")
        client.send("CONTROL {Type GetSTA}")
        assert not [line for line in client.fence() if line.startswith("STA {Name")]
    assert status(wc, "{Name Sly}") == {}


def test_objects_leave_with_a_broken_connection(connect: Connect) -> None:
    """A controller that creates in a hurry and hangs up leaves nothing behind (protocol 172)."""
    wc, witness = controller(connect), controller(connect)
    for n in range(20):
        wc.send(f"CONTROL {{Type Create}} {{ClassName Ball}} {{Name h{n}}} {{Location {n},-80,-1}}")
    wc.close()
    assert eventually(lambda: not any(name.startswith("h") for name in status(witness)))
    time.sleep(0.3)  # wherever an order may still hide
    assert not any(name.startswith("h") for name in status(witness))


def test_an_avatar_walks(connect: Connect) -> None:
    """INIT, MOVE, STA twenty times a second, and goodbye."""
    client = connect()
    client.wait_for("NFO {Gametype")
    client.send(
        "INIT {ClassName USARAvatar.USARAvatarNewMale} {Name Worker1} {Location -20,-60,-1}\r\n"
        "MOVE {Type Walk_Forward} {Action New} {Location -18, -60}"
    )
    lines = [client.wait_for("STA")]
    while "{Walking False}" not in lines[-1] or not any("{Walking True}" in x for x in lines):
        lines.append(client.read_line())
    heads = {line.split()[0] for line in lines}
    assert heads == {"STA", "BSTA"}
    reports = [line for line in lines if line.startswith("STA")]
    times = [float(line.split()[2].rstrip("}")) for line in reports]
    assert len(reports) == pytest.approx((times[-1] - times[0]) * 20.0 + 1.0, rel=0.1)
    assert re.fullmatch(
        r"STA \{Time \d+\.\d{4}\} \{Type USARAvatarNewMale\} \{Name Worker1\} "
        r"\{Location -18\.\d\d,-60\.\d\d,-0\.9\d\} \{Orientation \S+\} \{Walking False\}",
        reports[-1],
    )
    assert any("{Walking True}" in line for line in reports)


def play() -> list[str]:
    """The session of the first test, in lockstep; all lines of all clients."""

    def send(client: RehearsedClient, *lines: str) -> None:
        client.send(*(f"CONTROL {{Type {line}" for line in lines))

    with Rehearsal(world="empty") as stage:
        wc, robot, person = (stage.connect() for _ in range(3))
        wc.send("INIT {ClassName USARBot.WorldController} {Name WC}")
        robot.send("INIT {ClassName P2AT} {Location 0,0,-0.3}")
        person.send("INIT {ClassName USARAvatar.Worker} {Location 3,3,-1}")
        send(
            wc,
            "Create} {ClassName WCCrate} {Name a} {Location 1,0,-0.25} {Physics RigidBody}",
            "Create} {ClassName Box} {Name b} {Location 2,0,-0.15}",
            "SetWP} {Name b} {Loop 1}",
            "AddWP} {Name b} {WP 2,1,-0.15;3,1,-0.15;2,0,-0.15}",
            "Rotate} {Name b} {Speed 0,0,1}",
        )
        robot.send("DRIVE {Left 3} {Right 3}")
        person.send("MOVE {Type Run} {Action New} {Location 1.5,0}")
        for _ in range(10):
            stage.run(0.4)
            send(wc, "GetSTA}")
        send(wc, "KillAll} {MinPos 0,-1,-1} {MaxPos 9,9,1}", "GetSTA}")
        return wc.lines + robot.lines + person.lines


def test_in_lockstep_runs_are_bit_identical() -> None:
    """The same session twice gives the very same lines."""
    first, second = play(), play()
    assert "STA" in first
    assert first == second


GATE = 101
"""Id of the tag beside which the robot starts."""


@pytest.fixture(scope="module")
def rescuer() -> Iterator[ScriptedClient]:
    """A robot with a rescuer's sensors beside the gate of the arena."""
    with ServerProcess("--world", "arena") as server:
        client = server.client()
        client.send("INIT {ClassName USARBot.RescueP2AT} {Name rescuer} {Location -9.0,0,-0.3}")
        client.wait_for("STA")
        yield client
        client.close()


def _tags(line: str) -> dict[int, int]:
    """Ids and memory flags of an RFID line."""
    ids = [int(text) for text in re.findall(r"\{ID (\d+)\}", line)]
    flags = [int(text) for text in re.findall(r"\{Mem (\d)\}", line)]
    return dict(zip(ids, flags, strict=True))


def test_a_tag_is_seen_read_and_written(rescuer: ScriptedClient) -> None:
    """Detection, Read and Write work as RDK and UvA use them (protocol 40, 116, 163, 165)."""
    line = rescuer.wait_for("SEN {Type RFID} {Name RFIDReader} {ID ")
    assert _tags(line)[GATE] == 1, "the tag holds text"
    rescuer.send(f"SET {{Type RFID}} {{Name RFIDReader}} {{Opcode Read}} {{Params {GATE}}}")
    assert f"{{status OK}} {{ID {GATE}}} {{Mem gate Staging}}" in rescuer.wait_for("RES")
    rescuer.send(
        f"SET {{Type RFID}} {{Name RFIDReader}} {{Opcode Write}} {{Params {GATE} two words}}"
    )
    assert rescuer.wait_for("RES").endswith("{status OK}")
    rescuer.send(f"SET {{Type RFID}} {{Name RFIDReader}} {{Opcode Read}} {{Params {GATE}}}")
    assert "{Mem two words}" in rescuer.wait_for("RES")
    rescuer.send("SET {Type RFID} {Name RFIDReader} {Opcode Read} {Params 999999}")
    assert "{status Failed}" in rescuer.wait_for("RES")


def test_a_tag_is_dropped(rescuer: ScriptedClient) -> None:
    """Release confirms with `{status OK}` at the end of the line and leaves a tag
    (protocol 164)."""
    before = _tags(rescuer.wait_for("SEN {Type RFID} {Name RFIDReader}"))
    # RDK sends this without a line end; the next command is glued on (protocol reference 1.4).
    rescuer.send_bytes(b"SET {Type RFIDReleaser} {Name Gun} {Opcode Release}DRIVE {Left 0}\r\n")
    assert rescuer.wait_for("RES {Time").endswith("{Type RFIDReleaser} {Name Gun} {status OK}")
    after = _tags(rescuer.wait_for("SEN {Type RFID} {Name RFIDReader}"))
    assert len(set(after) - set(before)) == 1


def test_signs_of_life_stream(rescuer: ScriptedClient) -> None:
    """Victim, motion, sound and gas sensors report in the forms of protocol 4.6 (protocol 94, 96,
    114)."""
    forms = {
        "VictSensor": r"SEN \{Time [\d.]+\} \{Type VictSensor\} \{Name VictSensor\} "
        r"(\{Status NoVictims\}|\{PartName \w+\} \{Location [^}]+\}.*)",
        "HumanMotion": r"SEN \{Type HumanMotion\} \{Name HumanMotion\} \{Prob [\d.]+\}",
        "Sound": r"SEN \{Type Sound\} \{Name Sound\} \{Loudness [\d.]+\} \{Duration [\d.]+\}",
        "CO2Sensor": r"SEN \{Type CO2Sensor\} \{Name CO2\} \{Gas CO2\} \{Density [\d.]+\}",
    }
    for wire_type, form in forms.items():
        line = rescuer.wait_for(lambda line, kind=wire_type: f"{{Type {kind}}}" in line)
        assert re.fullmatch(form, line), line
