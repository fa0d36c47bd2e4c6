"""A rescue task over real sockets: read, write and drop RFID tags, look for victims."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from usarsim_server.testing import ScriptedClient, ServerProcess

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
    """Detection, Read and Write work as RDK and UvA use them (checks 40, 116, 163, 165)."""
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
    """Release confirms with `{status OK}` at the end of the line and leaves a tag (check 164)."""
    before = _tags(rescuer.wait_for("SEN {Type RFID} {Name RFIDReader}"))
    # RDK sends this without a line end; the next command is glued on (protocol reference 1.4).
    rescuer.send_bytes(b"SET {Type RFIDReleaser} {Name Gun} {Opcode Release}DRIVE {Left 0}\r\n")
    assert rescuer.wait_for("RES {Time").endswith("{Type RFIDReleaser} {Name Gun} {status OK}")
    after = _tags(rescuer.wait_for("SEN {Type RFID} {Name RFIDReader}"))
    assert len(set(after) - set(before)) == 1


def test_signs_of_life_stream(rescuer: ScriptedClient) -> None:
    """Victim, motion, sound and gas sensors report in the forms of 4.6 (checks 94, 96, 114)."""
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
