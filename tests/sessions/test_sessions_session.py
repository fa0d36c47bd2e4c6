"""A connection's handler, played by hand: commands in, lines out, simulated time when told."""

from __future__ import annotations

import gc
import math
import re
import weakref

import pytest
from control_harness import last, numbers, truth

from usarsim_server.testing import Rehearsal, RehearsedClient


@pytest.fixture
def client(connection: RehearsedClient) -> RehearsedClient:
    """A connection that is nothing yet."""
    return connection


# -- INIT ------------------------------------------------------------------------------------------


def test_a_valid_init_is_not_answered(stage: Rehearsal, client: RehearsedClient) -> None:
    """INIT gives no reply; STA comes 0.25 to 2 s later (protocol 69, 70)."""
    client.send("INIT {ClassName USARBot.P2AT} {Location 0,0,-0.3}")
    assert client.lines == []
    stage.run(0.25)
    assert client.lines == []
    stage.run(0.1)
    assert client.take("STA")


@pytest.mark.parametrize(
    ("init", "place"),
    [
        ("{ClassName USARBot.P2AT} {Location 5,1,-0.3}", (5, 1)),
        ("{Classname p2at} {Location 5, 1, -0.3}", (5, 1)),
        ("{CLASSNAME P2at}{Name R2}{Location 5.0 1.0 -0.3}", (5, 1)),
        ("{ClassName P2AT} {Location 5,0 1,0 -0,3}", (5, 1)),
        ("{ClassName P2AT} {Location .4, .4, -.3}", (0.4, 0.4)),
        ("{ClassName P2AT} {Location 0, -50, 020}", (0, -50)),
        ("{ClassName P2AT} {Location 1,2}", (1, 2)),
        ("{ClassName P2AT} {Battery 77} {Skin x} {Team 1} {Location 5,1,-0.3}", (5, 1)),
        ("{ClassName P2AT}", (0, 0)),
    ],
)
def test_spellings_of_init(
    stage: Rehearsal, client: RehearsedClient, init: str, place: tuple[float, float]
) -> None:
    """Every spelling of protocol 3.2 spawns at the place it means (protocol 47-51, 63, 72-75,
    78)."""
    client.send(f"INIT {init}")
    stage.run(0.4)
    location, orientation = truth(stage, client)
    assert location[:2] == pytest.approx(place, abs=0.05)
    assert math.cos(orientation[2]) > math.cos(0.02)
    assert location[2] == pytest.approx(-0.2, abs=0.1)


def test_battery_of_init(stage: Rehearsal, client: RehearsedClient) -> None:
    """Battery in INIT sets the life; at zero SEN stops, DRIVE too, STA goes on (protocol 78, 92,
    162)."""
    client.send("INIT {ClassName P2AT} {Battery 3} {Location 0,10,-0.3}")
    client.send("DRIVE {Left 1} {Right 1}")
    stage.run(1.0)
    assert numbers(last(client, "GroundVehicle"), "Battery") == [2]
    stage.run(2.5)
    news = [line for line in client.take("NFO") if "{Status Battery" in line]
    assert len(news) == 1, "the client is told once"
    assert re.fullmatch(
        r"NFO \{Status BatteryEmpty\} \{Time [\d.]+\} \{Type Battery\} \{Name \w+\}", news[0]
    )
    stage.run(1.0)
    heads = {line.split()[0] for line in client.lines}
    assert heads == {"STA"}
    assert numbers(client.lines[-1], "Battery") == [0]
    client.send("DRIVE {Left 2} {Right 2}", "GETCONF {Type Robot}")
    stage.run(1.0)
    assert {line.split()[0] for line in client.lines} == {"STA"}
    vehicle = stage.assembly.robots.vehicles[-1]
    state = vehicle.body.look()
    assert state is not None
    assert abs(state.wheel_speeds).max() < 0.05


def test_start_poses(stage: Rehearsal, client: RehearsedClient) -> None:
    """The poses listed are those that Start uses, whatever its case (protocol 76, 80-83)."""
    client.send("GETSTARTPOSES")
    reply = client.take()[0]
    found = re.fullmatch(r"NFO \{StartPoses (\d+)\} \{(.*)\}", reply)
    assert found is not None
    words = found.group(2).split(" ")
    assert len(words) == 3 * int(found.group(1))
    tag, location = words[3], [float(part) for part in words[4].split(",")]
    client.send(f"INIT {{ClassName P2AT}} {{Start {tag.lower()}}} {{Location 90,90,0}}")
    stage.run(0.4)
    assert truth(stage, client)[0][:2] == pytest.approx(location[:2], abs=0.05)
    client.send("GETSTARTPOSES")
    assert client.take("NFO") == [reply]


def test_unknown_start(stage: Rehearsal, client: RehearsedClient) -> None:
    """An unknown Start spawns all the same (protocol 77)."""
    client.send("INIT {ClassName P2AT} {Start Nowhere}")
    stage.run(0.4)
    assert client.take("STA")


def test_unknown_class_then_a_known_one(stage: Rehearsal, client: RehearsedClient) -> None:
    """An unknown class gives nothing, and the next INIT works (protocol 71)."""
    client.send("INIT {ClassName USARBot.Unheard} {Location 0,20,-0.3}")
    stage.run(0.5)
    assert client.lines == []
    client.send("INIT {ClassName USARBot.P2DX} {Location 0,20,-0.3}")
    stage.run(0.5)
    assert client.take("STA")


def test_a_second_init_is_ignored(stage: Rehearsal, client: RehearsedClient) -> None:
    """A second INIT makes no second robot (protocol 79)."""
    client.send("INIT {ClassName P2AT} {Location 0,30,-0.3}")
    count = len(stage.assembly.robots.vehicles)
    client.send("INIT {ClassName P3AT} {Location 0,33,-0.3}")
    assert len(stage.assembly.robots.vehicles) == count
    client.send("GETGEO {Type Robot}")
    assert "{Name P2AT}" in client.lines[-1]


def test_a_second_init_can_replace() -> None:
    """With second_init=replace the first robot leaves and the second one reports (protocol 1.1)."""
    with Rehearsal(world="empty", second_init="replace") as stage:
        client = stage.connect()
        client.send("INIT {ClassName P2AT} {Location 0,0,-0.3}")
        client.send("INIT {ClassName P3AT} {Location 5,0,-0.3}")
        stage.run(0.5)
        assert [one.description.name for one in stage.assembly.robots.vehicles] == ["P3AT"]
        assert len(stage.assembly.simulation.snapshot.layouts) == 1


def test_commands_before_init_are_ignored(client: RehearsedClient) -> None:
    """Only global commands work without a robot (protocol 1.7, 3.8)."""
    client.send("DRIVE {Left 1} {Right 1}", "GETGEO {Type Robot}", "SET {Type INS}", "FROBNICATE")
    assert client.lines == []


# -- frames ----------------------------------------------------------------------------------------


def test_frames_on_the_wire(stage: Rehearsal, client: RehearsedClient) -> None:
    """Spawn rotation, right, and clockwise are as protocol 2.5 has them (protocol 57, 58, 61,
    143)."""
    client.send("INIT {ClassName P2AT} {Location 10,10,-0.3} {Rotation 0,0,1.5708}")
    stage.run(0.4)
    location, orientation = truth(stage, client)
    assert orientation[2] == pytest.approx(1.5708, abs=0.02)
    client.send("DRIVE {Left 2} {Right 2}")
    stage.run(2.0)
    further, _ = truth(stage, client)
    assert further[1] > location[1] + 0.3, "it faces +y, its right"
    assert further[0] == pytest.approx(location[0], abs=0.03)
    client.send("DRIVE {Left 2} {Right -2}")
    stage.run(0.5)
    _, turned = truth(stage, client)
    assert turned[2] > orientation[2] + 0.2, "clockwise seen from above"
    client.send("DRIVE {Left -2} {Right -2}")


def test_height_grows_downwards(stage: Rehearsal, client: RehearsedClient) -> None:
    """A robot spawned higher has the smaller z (protocol 56)."""
    client.send("INIT {ClassName P2AT} {Location 20,10,-1.3} {Dialect udk}")
    stage.run(0.36)
    first = [line for line in client.lines if "GroundTruth" in line]
    high = numbers(first[0], "Location")[2]
    stage.run(1.5)
    assert high < -0.6
    assert numbers(last(client, "GroundTruth"), "Location")[2] == pytest.approx(-0.15, abs=0.05)


@pytest.mark.parametrize(
    ("rotation", "index"), [("0,0.15,0", 1), ("0.15,0,0", 0)], ids=["nose up", "right side down"]
)
def test_tilt_signs(stage: Rehearsal, client: RehearsedClient, rotation: str, index: int) -> None:
    """A raised nose is positive pitch, a lowered right side positive roll (protocol 59, 60, 62)."""
    client.send(
        f"INIT {{ClassName P3AT}} {{Location 30,10,-2.2}} {{Rotation {rotation}}} {{Dialect udk}}"
    )
    stage.run(0.36)
    falling = [line for line in client.lines if "GroundTruth" in line]
    angles = numbers(falling[0], "Orientation")
    assert angles[index] == pytest.approx(0.15, abs=0.01)
    assert abs(angles[1 - index]) < 0.01


# -- driving ---------------------------------------------------------------------------------------


def _wheels(stage: Rehearsal, seconds: float = 1.5) -> list[float]:
    stage.run(seconds)
    state = stage.robot_state(-1)
    speeds: list[float] = state.wheel_speeds.tolist()
    return speeds


def test_one_sided_drive(stage: Rehearsal, client: RehearsedClient) -> None:
    """One side alone keeps the other in ut2004 (protocol 148); zero stops (protocol 145)."""
    client.send("INIT {ClassName P2AT} {Location 40,0,-0.3}")
    client.send("DRIVE {Left 1} {Right 2}", "DRIVE {Left 2}")
    assert _wheels(stage) == pytest.approx([2, 2, 2, 2], abs=0.1)
    client.send("DRIVE {Left 0} {Right 0}")
    assert _wheels(stage) == pytest.approx([0, 0, 0, 0], abs=0.02)


def test_one_sided_drive_in_udk(stage: Rehearsal, client: RehearsedClient) -> None:
    """One side alone does nothing in udk (protocol 36, 148); glued junk does no harm (29,
    32-38)."""
    client.send("INIT {ClassName P2AT} {Location 40,8,-0.3} {Dialect udk}")
    client.send("DRIVE {Left 1}", "DRIVE {Left 1} {Right 1")
    assert _wheels(stage, 0.5) == pytest.approx([0, 0, 0, 0], abs=0.02)
    client.send("drive }{left 1}junk{  RIGHT   1  } {Bad} {Left 5}")
    assert _wheels(stage) == pytest.approx([1, 1, 1, 1], abs=0.1)


def test_normalized_and_limits(stage: Rehearsal, client: RehearsedClient) -> None:
    """100 percent is MaxSpeed, more is clamped, the next command is rad/s (protocol 131, 146,
    147)."""
    client.send("INIT {ClassName P2AT} {Location 40,16,-0.3}")
    client.send("DRIVE {Left 100} {Right 100} {Normalized True}")
    assert _wheels(stage) == pytest.approx([5.385] * 4, abs=0.06)
    client.send("DRIVE {Left 99} {Right 99}")
    assert _wheels(stage) == pytest.approx([5.385] * 4, abs=0.06)
    client.send("DRIVE {Left 1} {Right 1}")
    assert _wheels(stage) == pytest.approx([1] * 4, abs=0.05)


def test_a_drive_command_persists(stage: Rehearsal, client: RehearsedClient) -> None:
    """There is no watchdog: 60 s later the wheels still turn (protocol 144)."""
    client.send("INIT {ClassName P3AT} {Location 60,0,-0.3}", "DRIVE {Left 0.5} {Right 0.5}")
    assert _wheels(stage, 60.0) == pytest.approx([0.5] * 4, abs=0.05)


def test_light(stage: Rehearsal, client: RehearsedClient) -> None:
    """Light shows in STA and does not move the robot (protocol 90)."""
    client.send("INIT {ClassName P2AT} {Location 60,8,-0.3}")
    stage.run(0.6)
    before, _ = truth(stage, client)
    client.send("DRIVE {Light true}")
    client.take()
    stage.run(0.4)
    assert "{LightToggle True} {LightIntensity 100}" in client.take("STA")[-1]
    assert truth(stage, client)[0] == pytest.approx(before, abs=0.02)


def test_flip(stage: Rehearsal, client: RehearsedClient) -> None:
    """Flip rights an overturned robot in ut2004 and leaves an upright one alone (protocol 153)."""
    client.send("INIT {ClassName P2AT} {Location 60,16,-0.6} {Rotation 3.14159,0,0.7}")
    stage.run(1.0)
    state = stage.robot_state(-1)
    assert state.pose.rotate((0, 0, 1))[2] < -0.8
    client.send("DRIVE {Flip True}")
    stage.run(1.0)
    state = stage.robot_state(-1)
    assert state.pose.rotate((0, 0, 1))[2] > 0.99
    client.send("DRIVE {Flip True}")
    stage.run(0.2)
    still = stage.robot_state(-1)
    assert still.pose.position == pytest.approx(state.pose.position, abs=0.01)


# -- reports ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dialect", "period"), [("ut2004", 0.2), ("udk", 0.1)])
def test_status_period(
    stage: Rehearsal, client: RehearsedClient, dialect: str, period: float
) -> None:
    """STA keeps its period within 10 percent of simulated time (protocol 91, 122; robots 114)."""
    client.send(f"INIT {{ClassName P3AT}} {{Location 80,0,-0.3}} {{Dialect {dialect}}}")
    stage.run(0.5)
    client.take()
    stage.run(10.0)
    assert len(client.take("STA")) == pytest.approx(10.0 / period, rel=0.02)


def test_sensor_periods(stage: Rehearsal, client: RehearsedClient) -> None:
    """Every sensor keeps its interval, on average to a step (protocol 122; robots 92, 114)."""
    client.send("INIT {ClassName P2AT} {Location 80,8,-0.3}")
    stage.run(0.5)
    client.take()
    stage.run(20.0)
    lines = client.take("SEN")
    count = {
        kind: sum(f"{{Type {kind}}}" in line for line in lines)
        for kind in ("GroundTruth", "Odometry", "RangeScanner", "Sonar", "INS")
    }
    expected = {"GroundTruth": 400, "Odometry": 100, "RangeScanner": 100, "Sonar": 100, "INS": 100}
    for kind, number in expected.items():
        assert count[kind] == pytest.approx(number, abs=1), kind


def test_set_and_res(stage: Rehearsal, client: RehearsedClient) -> None:
    """RESET zeroes the odometry; ut2004 gets one RES, udk none (protocol 108, 109, 163)."""
    client.send("INIT {ClassName P2AT} {Location 80,16,-0.3}", "DRIVE {Left 2} {Right 2}")
    stage.run(3.0)
    assert numbers(last(client, "Odometry"), "Pose")[0] > 0.4
    client.send("DRIVE {Left 0} {Right 0}")
    stage.run(1.0)
    client.take()
    client.send("SET {Type Odometry} {Name Odometry} {Opcode RESET} ")
    assert re.fullmatch(
        r"RES \{Time \d+\.\d\d\} \{Type Odometry\} \{Name Odometry\} \{Status OK\}",
        client.take("RES")[0],
    )
    stage.run(0.3)
    assert numbers(last(client, "Odometry"), "Pose") == pytest.approx([0, 0, 0], abs=0.002)
    client.send("SET {Type Odometry} {Name Nobody} {Opcode RESET}", "SET {Type Odometry}")
    assert client.take("RES") == []


def test_scan_on_request(stage: Rehearsal, client: RehearsedClient) -> None:
    """SCAN gives one measurement at once, in both dialects (protocol 3.7)."""
    client.send("INIT {ClassName P3AT} {Location 80,24,-0.3}")
    stage.run(0.5)
    client.take()
    client.send("SET {Type RangeScanner} {Name lms200} {Opcode SCAN}")
    assert len(client.take("SEN")) == 1


def test_every_streamed_item_answers(stage: Rehearsal, client: RehearsedClient) -> None:
    """CONF and GEO exist once for everything that streams; nothing else answers
    (protocol 125-128)."""
    client.send("INIT {ClassName P2AT} {Location 100,0,-0.3}")
    stage.run(1.0)
    items: set[tuple[str, str]] = set()
    for line in client.take("SEN"):
        kind = re.search(r"\{Type (\w+)\}", line)
        assert kind is not None
        items |= {(kind.group(1), name) for name in re.findall(r"\{Name (\w+)[ }]", line)}
    assert len({kind for kind, _ in items}) >= 7
    for kind, name in items:
        client.send(f"GETCONF {{Type {kind.lower()}}} {{Name {name.upper()}}}")
        client.send(f"GETGEO {{Type {kind}}} {{Name {name}}}")
        conf, geo = client.take()
        assert conf.startswith(f"CONF {{Type {kind}}} {{Name {name}}}")
        assert geo.startswith(f"GEO {{Type {kind}}} {{Name {name} Location ")
    client.send("GETCONF {Type Sonar}", "GETCONF {Type Zilch}", "GETGEO {Type Sonar} {Name Zip}")
    assert len(client.take()) == 1


def test_switch_to_udk_on_the_fly(stage: Rehearsal, client: RehearsedClient) -> None:
    """A request only UDK clients make switches shapes from the next line on (protocol 175)."""
    client.send("INIT {ClassName P2AT} {Location 100,8,-0.3}", "GETCONF {Type Actuator}")
    stage.run(1.0)
    assert all(re.search(r"\{Time \d+\.\d{4}\}", line) for line in client.take("STA"))


def test_encoders_are_found_by_either_name(stage: Rehearsal, client: RehearsedClient) -> None:
    """What streams as Wk in udk answers to that name (protocol 125)."""
    client.send("INIT {ClassName P2AT} {Location 100,16,-0.3} {Dialect udk}")
    stage.run(0.5)
    name = re.search(r"\{Name (W\d)\}", last(client, "Encoder"))
    assert name is not None
    client.take()
    client.send(f"GETGEO {{Type Encoder}} {{Name {name.group(1)}}}")
    assert f"{{Name {name.group(1)}}}" in client.take("GEO")[0]


def test_mounts_do_not_turn_with_the_robot(stage: Rehearsal, client: RehearsedClient) -> None:
    """GEO is in the body frame whatever the spawn yaw (protocol 135)."""
    client.send("INIT {ClassName P2AT} {Location 100,24,-0.3} {Rotation 0,0,2.0}")
    client.send("GETGEO {Type RangeScanner}")
    assert "Location 0.1439,0.0000,-0.0920" in client.take("GEO")[0]


def test_path_nodes_are_told() -> None:
    """Protocol 84: without INIT; the closest one by planar distance, nothing without a location."""
    with Rehearsal(world="office") as office:
        client = office.connect()
        client.send("GETPATHNODES", "GETCLOSESTPATHNODE {Location 5,2,99}", "GETCLOSESTPATHNODE")
        nodes, closest = client.take()
    assert nodes.startswith("NFO {PathNodes 24} {Lobby -9.0000,0.0000,0.0000 0.0000,0.0000,0.0000 ")
    assert closest == "NFO {Pathnode Lounge} {Location 5.1000,2.6000,0.0000}"


# -- Names that are exact or not at all ------------------------------------------------------------


def test_a_taken_name_is_refused_where_an_exact_one_is_asked_for(stage: Rehearsal) -> None:
    """With the segment INIT fails, and its client hears why; without it all is as ever."""
    first, second = stage.connect(), stage.connect()
    first.send("INIT {ClassName USARBot.P3AT} {Name Twin} {exactname TRUE}")
    assert first.lines == []
    second.send("INIT {ClassName USARBot.P3AT} {Name twin} {Location 3,0,0} {ExactName true}")
    assert second.take() == ["NFO {Status Refused} {Reason the name twin is taken}"]
    second.send("INIT {ClassName USARBot.P3AT} {Name twin} {Location 3,0,0} {ExactName false}")
    assert second.lines == []
    assert [one.name for one in stage.assembly.robots.vehicles] == ["Twin", "twin_2"]


@pytest.mark.parametrize(
    ("init", "reason"),
    [
        ("{ClassName P3TA} {Name R1}", "unknown class; did you mean `P3AT`?"),
        ("{ClassName USARAvatar.Nobody}", "there is no avatar of this class"),
        ("{Name R1}", "unknown class"),
        (f"{{ClassName P3AT}} {{Name {'x' * 65}}}", "the name has 65 characters, 64 are possible"),
    ],
)
def test_who_asks_for_an_exact_name_hears_why_init_failed(
    client: RehearsedClient, init: str, reason: str
) -> None:
    """Whatever the reason; nobody else does."""
    client.send(f"INIT {init}")
    assert client.lines == []
    client.send(f"INIT {init} {{ExactName true}}")
    [line] = client.take()
    assert line.startswith(f"NFO {{Status Refused}} {{Reason {reason}")


def test_a_name_that_would_be_cleaned_is_no_exact_one(client: RehearsedClient) -> None:
    """The reason says how to write it."""
    client.send("INIT {ClassName P3AT} {Name a b} {ExactName true}")
    reason = "no name has blanks, braces or what cannot be printed: write a_b"
    assert client.take() == [f"NFO {{Status Refused}} {{Reason {reason}}}"]


def test_the_segment_can_be_asked_for(client: RehearsedClient) -> None:
    """GETSTARTPOSES with it says that it is known, and answers as ever."""
    client.send("GETSTARTPOSES")
    ever = client.take()
    client.send("GETSTARTPOSES {ExactName true}")
    assert client.take() == ["NFO {Status ExactNames}", *ever]
    assert len(ever) == 1


def test_who_has_left_keeps_no_former_model(fresh: Rehearsal) -> None:
    """A model that grew is freed when its robots are gone, without the garbage collector."""
    guest, other = fresh.connect(), fresh.connect()
    guest.send("INIT {ClassName USARBot.P2AT} {Location 0,0,-0.3}")
    fresh.run(1.0)
    former = weakref.ref(fresh.assembly.simulation.look().world)
    gc.disable()
    try:
        other.send("INIT {ClassName USARBot.Nao} {Location 3,0,-0.5}")
        guest.close()
        fresh.run(1.0)
        assert former() is None
    finally:
        gc.enable()
