"""RFID readers and releasers (robots 108, protocol 40, 116, 163 to 165)."""

from __future__ import annotations

import math
import threading
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from life_fakes import Stage, person, wall
from sensor_fakes import UDK, UT2004, FakeRobot, numbers

from usarsim_server.protocol.messages import result
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.mounting import SetReply, SetResult
from usarsim_server.sensors.report import find_sensors, sen_lines
from usarsim_server.worlds.description import RfidTag


def tag(number: int, x: float, y: float = 0.0, z: float = 0.0, **rest: Any) -> RfidTag:
    """A tag in the simulation frame."""
    return RfidTag(number, (x, y, z), **rest)


def line(sensor: Any, dialect: Any = UT2004) -> str:
    """The SEN line of the last reading."""
    (text,) = sen_lines([sensor], 5.0, dialect)
    return text


def ids(sensor: Any) -> list[int]:
    """Numbers of the last reading."""
    return [int(value) for key, value in sensor.data(UT2004) if key == "ID"]


# ---- reading ------------------------------------------------------------------------------


def test_the_line_repeats_id_location_and_mem() -> None:
    """Protocol 116, the template of protocol 4.6: no Time in ut2004, nearest tag
    first."""
    stage = Stage(tags=(tag(131, 1.02, -0.61, -0.05, memory="x"), tag(118, 0.44, 0.20, -0.04)))
    sensor = stage.make("RFID", "RFIDReader")
    assert stage.read(sensor)
    data = (
        "{Type RFID} {Name RFIDReader} {ID 118} {Location 0.44,-0.20,0.04} {Mem 0} "
        "{ID 131} {Location 1.02,0.61,0.05} {Mem 1}"
    )
    assert line(sensor) == f"SEN {data}"
    assert line(sensor, UDK) == f"SEN {{Time 5.0000}} {data}"


def test_places_are_relative_to_the_reader() -> None:
    """A reader 0.2 m above a robot that looks along +y of the wire frame."""
    stage = Stage(tags=(tag(1, 0.0, -2.0, 0.0),))
    sensor, robot = stage.make("RFID", location=(0.0, 0.0, -0.2)), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2))
    assert stage.read(sensor, robot)
    assert dict(sensor.data(UT2004))["Location"] == "2.00,0.00,0.20"


def test_each_tag_in_range_is_reported_at_every_interval() -> None:
    """Robots 108: once per interval; a tag out of range is absent."""
    stage = Stage(tags=(tag(1, 5.9), tag(2, 6.1), tag(3, 1.0)))
    sensor = stage.make("RFID")
    assert sensor.interval(UT2004) == sensor.interval(UDK) == 0.2
    for _ in range(3):
        assert stage.read(sensor)
        assert ids(sensor) == [3, 1]
    near = stage.make("RFID", max_range=2.0)
    assert stage.read(near)
    assert ids(near) == [3]


def test_a_reader_is_silent_where_no_tag_is() -> None:
    """There is no line without a tag."""
    stage = Stage(tags=(tag(1, 20.0),))
    assert not stage.read(stage.make("RFID"))


def test_many_tags_make_no_line_too_long() -> None:
    """Protocol 107: the sixteen nearest, below 1024 bytes."""
    tags = tuple(tag(2_000_000_000 + n, -5.0 - n / 100, -1.0, -1.0) for n in range(40))
    stage = Stage(tags=tags)
    sensor = stage.make("RFID", "RFIDReader")
    assert stage.read(sensor)
    assert ids(sensor) == [2_000_000_000 + n for n in range(16)]
    assert len(line(sensor, UDK)) < 1024


def test_a_single_shot_tag_answers_once_and_from_near() -> None:
    """It is silent beyond 1 m, then every reader hears it one time."""
    stage = Stage(tags=(tag(1, 3.0, single_shot=True), tag(2, 3.0)))
    sensor, other, robot = stage.make("RFID"), stage.make("RFID"), FakeRobot()
    assert stage.read(sensor, robot)
    assert ids(sensor) == [2]
    robot.place((2.2, 0.0, 0.0))
    stage.read(sensor, robot)
    assert ids(sensor) == [1, 2]
    stage.read(sensor, robot)
    assert ids(sensor) == [2]
    stage.read(other, robot)
    assert ids(other) == [1, 2]
    wide = stage.make("RFID", single_shot_range=4.0, max_range=1.0)
    assert stage.read(wide, FakeRobot())
    assert ids(wide) == [1]


def test_walls_matter_on_request_only() -> None:
    """A tag behind a wall is read, unless the robot file asks for a line of sight."""
    stage = Stage(tags=(tag(1, 3.0), tag(2, 1.0)), walls=[wall(2.0)])
    plain, strict = stage.make("RFID"), stage.make("RFID", line_of_sight=True)
    assert stage.read(plain)
    assert stage.asked == 0
    assert ids(plain) == [2, 1]
    assert stage.read(strict)
    assert ids(strict) == [2]
    assert plain.set("READ", "1", FakeRobot()) != SetResult.FAILED
    assert strict.set("READ", "1", FakeRobot()) is SetResult.FAILED
    assert strict.set("READ", "2", FakeRobot()) != SetResult.FAILED


def test_the_form_of_rfidtag() -> None:
    """Protocol reference 4.6: one tag, ID and Location; the nearest one."""
    stage = Stage(tags=(tag(131, 1.0), tag(118, 0.44, 0.20, -0.04)))
    sensor = stage.make("RFIDTag", "RFIDTag")
    assert stage.read(sensor)
    assert line(sensor) == "SEN {Type RFIDTag} {Name RFIDTag} {ID 118} {Location 0.44,-0.20,0.04}"


def test_rfidtag_wastes_no_single_shot() -> None:
    """A single-shot tag that was not reported, because another was nearer, still can be."""
    stage = Stage(tags=(tag(1, 0.2), tag(2, 0.5, single_shot=True)))
    sensor, robot = stage.make("RFIDTag"), FakeRobot()
    stage.read(sensor, robot)
    assert ids(sensor) == [1]
    robot.place((0.6, 0.0, 0.0))
    stage.read(sensor, robot)
    assert ids(sensor) == [2]


# ---- memory -------------------------------------------------------------------------------


def test_write_then_read_returns_the_text() -> None:
    """Robots 108, protocol 40 and 165: inner blanks are kept."""
    stage = Stage(tags=(tag(118, 1.0),))
    sensor, robot = stage.make("RFID"), FakeRobot()
    assert sensor.set("WRITE", "118 two  words here", robot) is SetResult.OK
    reply = sensor.set("READ", "118", robot)
    assert reply == SetReply(SetResult.OK, (("ID", "118"), ("Mem", "two  words here")))
    assert result(63.41, "RFID", "RFID", True, reply.segments) == (
        "RES {Time 63.41} {Type RFID} {Name RFID} {status OK} {ID 118} {Mem two  words here}"
    )
    stage.read(sensor)
    assert dict(sensor.data(UT2004))["Mem"] == "1"


def test_all_readers_share_the_memory() -> None:
    """What one robot writes another reads, until it is erased."""
    stage = Stage(tags=(tag(5, 1.0, memory="as delivered"),))
    one, other, robot = stage.make("RFID"), stage.make("RFID"), FakeRobot()
    assert other.set("READ", "5", robot).segments[1] == ("Mem", "as delivered")
    one.set("WRITE", "5 victim seen here", robot)
    assert other.set("READ", "5", robot).segments[1] == ("Mem", "victim seen here")
    one.set("WRITE", "5", robot)
    assert other.set("READ", "5", robot).segments[1] == ("Mem", "")
    stage.read(other)
    assert dict(other.data(UT2004))["Mem"] == "0"


@pytest.mark.parametrize(
    ("params", "text"),
    [("7 a b", "a b"), (" 7  a", " a"), ("7abc", "abc"), ("7\tx", "x"), ("007 x", "x")],
)
def test_irregular_parameters_are_understood(params: str, text: str) -> None:
    """Python clients glue the text to the number; one blank separates, further ones are text."""
    stage = Stage(tags=(tag(7, 1.0),))
    sensor = stage.make("RFID")
    assert sensor.set("WRITE", params, FakeRobot()) is SetResult.OK
    known = stage.surroundings.tag(7)
    assert known is not None
    assert known.memory == text


@pytest.mark.parametrize("opcode", ["READ", "WRITE"])
@pytest.mark.parametrize("params", ["", "  ", "abc", "8 x", "-7 x", "99999999999999999999", "9 x"])
def test_what_cannot_be_addressed_fails(opcode: str, params: str) -> None:
    """Protocol 165: unknown numbers and nonsense fail; so do tags out of range."""
    stage = Stage(tags=(tag(7, 1.0), tag(9, 50.0)))
    assert stage.make("RFID").set(opcode, params, FakeRobot()) is SetResult.FAILED


def test_a_memory_is_finite() -> None:
    """A text that does not fit fails and changes nothing."""
    stage = Stage(tags=(tag(7, 1.0, memory="old"),))
    sensor = stage.make("RFID")
    assert sensor.set("WRITE", "7 " + "x" * 1024, FakeRobot()) is SetResult.OK
    assert sensor.set("WRITE", "7 " + "x" * 1025, FakeRobot()) is SetResult.FAILED
    known = stage.surroundings.tag(7)
    assert known is not None
    assert len(known.memory) == 1024


def test_other_opcodes_are_unknown() -> None:
    """Nothing happens and nothing is answered."""
    stage = Stage(tags=(tag(7, 1.0),))
    assert stage.make("RFID").set("ERASE", "7", FakeRobot()) is SetResult.UNKNOWN
    assert stage.make("RFIDReleaser").set("SCAN", "", FakeRobot()) is SetResult.UNKNOWN


@given(st.text(max_size=30))
def test_any_parameters_give_an_answer(params: str) -> None:
    """Whatever a client sends, the command succeeds or fails, never raises."""
    stage = Stage(tags=(tag(1, 1.0),))
    sensor = stage.make("RFID")
    for opcode in ("WRITE", "READ"):
        answer = sensor.set(opcode, params, FakeRobot())
        outcome = answer.result if isinstance(answer, SetReply) else answer
        assert outcome in (SetResult.OK, SetResult.FAILED)


@pytest.mark.parametrize("asked", ["RFID", "rfid", "RFIDReader", "Front"])
def test_clients_may_call_the_reader_by_its_usual_names(asked: str) -> None:
    """Appendix B: SET says RFID or RFIDReader whatever the item is called."""
    stage = Stage()
    reader = stage.make("RFIDReader", "Front")
    assert find_sensors([reader], "RFID", asked, Dialect.UDK) == [reader]
    assert find_sensors([reader], "RFID", "Rear", Dialect.UDK) == []


def test_true_names_have_precedence_over_usual_ones() -> None:
    """With two readers, the one that bears the name is meant."""
    stage = Stage()
    front, rear = stage.make("RFID", "RFID"), stage.make("RFID", "Rear")
    assert find_sensors([front, rear], "RFID", "RFID", Dialect.UDK) == [front]
    assert find_sensors([front, rear], "RFID", "RFIDReader", Dialect.UDK) == [front, rear]


# ---- dropping -----------------------------------------------------------------------------


def test_a_dropped_tag_lies_where_the_releaser_was() -> None:
    """Any reader in the world finds it there, with a number of its own and nothing in memory."""
    stage = Stage(tags=(tag(118, 1.0),))
    gun, reader, robot = stage.make("RFIDReleaser", "Gun"), stage.make("RFID"), FakeRobot()
    robot.place((4.0, 2.0, 0.0))
    assert gun.set("RELEASE", "", robot) is SetResult.OK
    robot.place((3.0, 2.0, 0.0))
    assert stage.read(reader, robot)
    new = dict(reader.data(UT2004)[:3])
    assert (new["Location"], new["Mem"]) == ("1.00,0.00,0.00", "0")
    assert new["ID"] != "118"
    assert result(63.4, "RFIDReleaser", "Gun", True).endswith("{status OK}")


def test_releasers_run_out_of_tags() -> None:
    """The last tag drops, the next command fails; another releaser still has some."""
    stage = Stage()
    gun, spare = stage.make("RFIDReleaser", capacity=2), stage.make("RFIDReleaser", capacity=2)
    robot = FakeRobot()
    answers = [gun.set("RELEASE", "", robot) for _ in range(3)]
    assert answers == [SetResult.OK, SetResult.OK, SetResult.FAILED]
    assert spare.set("RELEASE", "", robot) is SetResult.OK
    assert [tag.id for tag in stage.surroundings.tags((0.0, 0.0, 0.0), 1.0)] == [1, 2, 3]


def test_a_releaser_never_reports() -> None:
    """Its interval is 0 and it has no data."""
    stage = Stage()
    gun = stage.make("RFIDReleaser", "Gun")
    assert gun.interval(UT2004) == gun.interval(UDK) == 0.0
    assert not stage.read(gun)
    assert gun.data(UT2004) == ()


def test_tags_can_be_dropped_and_written_from_many_threads() -> None:
    """Every dropped tag has its own number; none is lost."""
    stage = Stage()
    guns = [stage.make("RFIDReleaser", capacity=100) for _ in range(8)]

    def drop(gun: Any) -> None:
        for _ in range(100):
            gun.set("RELEASE", "", FakeRobot())
            stage.surroundings.write(1, "x")

    threads = [threading.Thread(target=drop, args=(gun,)) for gun in guns]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = stage.surroundings.tags((0.0, 0.0, 0.0), 1.0)
    assert sorted(tag.id for tag in found) == list(range(1, 801))
    assert next(tag for tag in found if tag.id == 1).memory == "x"


# ---- tags of victims ----------------------------------------------------------------------


def test_the_form_of_victrfid() -> None:
    """Protocol reference 4.6: VictimId, VictimName, VictimStatus, Location; no Time in ut2004."""
    stage = Stage(person("Victim4", 0.8, -0.1, "lying", rfid=4), person("Mute", 1.0))
    sensor = stage.make("VictRFID", "VictRFID")
    assert stage.read(sensor)
    text = line(sensor)
    head = "SEN {Type VictRFID} {Name VictRFID} {VictimId 4} {VictimName Victim4} "
    assert text.startswith(head + "{VictimStatus Alive} {Location ")
    assert line(sensor, UDK).startswith("SEN {Time 5.0000} {Type VictRFID}")


def test_only_tagged_victims_in_range_answer() -> None:
    """Nobody else is reported, and without anybody there is no line."""
    stage = Stage(person("Far", 9.0, rfid=1), person("Mute", 1.0))
    sensor, robot = stage.make("VictRFID"), FakeRobot()
    assert not stage.read(sensor, robot)
    robot.place((5.0, 0.0, 0.0))
    assert stage.read(sensor, robot)
    assert dict(sensor.data(UT2004))["VictimName"] == "Far"
    assert numbers(dict(sensor.data(UT2004))["Location"])[0] == pytest.approx(4.0, abs=0.05)


def test_several_victims_take_turns() -> None:
    """One victim per line: RDK keeps only the last of a line."""
    stage = Stage(person("A", 1.0, rfid=1), person("B", 2.0, rfid=True, status="Injured"))
    sensor = stage.make("VictRFID")
    seen = []
    for _ in range(4):
        assert stage.read(sensor)
        data = dict(sensor.data(UT2004))
        assert len(sensor.data(UT2004)) == 4
        seen.append((data["VictimId"], data["VictimName"], data["VictimStatus"]))
    assert seen == [("1", "A", "Alive"), ("2", "B", "Injured")] * 2


def test_the_keys_of_2006() -> None:
    """The form that UvA's client quotes: ID, Status, Location, the name as ID."""
    stage = Stage(person("Becky_stpax", 2.0, rfid=1, status="Injured"))
    sensor = stage.make("VictRFID", "VictRFID", keys="short")
    stage.read(sensor)
    assert line(sensor).startswith(
        "SEN {Type VictRFID} {Name VictRFID} {ID Becky_stpax} {Status Injured} {Location "
    )


def test_a_walking_victim_carries_its_tag_along() -> None:
    """The place is that of the reading."""
    stage = Stage(person("Bob", 2.0, rfid=1, motion={"kind": "walk", "to": [5.0, 0.0, -0.07]}))
    sensor = stage.make("VictRFID")
    stage.read(sensor, FakeRobot(time=4.0))
    assert numbers(dict(sensor.data(UT2004))["Location"])[0] == pytest.approx(4.0, abs=0.1)
