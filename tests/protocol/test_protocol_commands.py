"""Typed requests out of command lines (protocol reference 3, 6.3, 6.5 and 6.9 text)."""

from __future__ import annotations

import pytest

from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.grammar import IGNORED_WORDS, KNOWN_WORDS, Command, parse_line
from usarsim_server.protocol.requests import (
    Act,
    Control,
    Drive,
    GetClosestPathNode,
    GetConf,
    GetGeo,
    GetPathNodes,
    GetStartPoses,
    Goto,
    Ignored,
    LinkTarget,
    MisPkg,
    Move,
    MultiDrive,
    Request,
    Set,
    Sync,
    Unknown,
    WheelTarget,
)


def request(line: str | bytes) -> Request:
    (command,) = parse_line(line.encode("latin-1") if isinstance(line, str) else line)
    return interpret(command)


def drive(line: str) -> Drive:
    found = request(line)
    assert isinstance(found, Drive)
    return found


def set_(line: str) -> Set:
    found = request(line)
    assert isinstance(found, Set)
    return found


# Start poses and path nodes


def test_questions_about_the_world() -> None:
    """Protocol 3.3: the parameterless questions, and the one that needs a location."""
    assert request("GETSTARTPOSES") == GetStartPoses()
    assert request("getpathnodes") == GetPathNodes()
    assert request("GETCLOSESTPATHNODE {Location 1,2,3}") == GetClosestPathNode((1, 2, 3))
    assert request("GETCLOSESTPATHNODE") == GetClosestPathNode(None)


# DRIVE


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("DRIVE {Left 1} {Right -1}", Drive(left=1, right=-1)),
        ("drive {left 1} {RIGHT 1}", Drive(left=1, right=1)),
        ("Drive {Left 0.800000} {Right 0.800000}", Drive(left=0.8, right=0.8)),
        ("DRIVE {Left 1.0}", Drive(left=1.0)),
        (
            "DRIVE {Left 100} {Right 100} {Normalized true}",
            Drive(left=100, right=100, normalized=True),
        ),
        ("DRIVE {Left 1} {Normalized false}", Drive(left=1, normalized=False)),
        ("DRIVE {Left 1} {Normalize True}", Drive(left=1, normalized=True)),
        ("DRIVE {Light true}", Drive(light=True)),
        ("DRIVE {Light False}", Drive(light=False)),
        ("DRIVE {Flip True}", Drive(flip=True)),
        (
            "DRIVE {Speed 1} {FrontSteer .2} {RearSteer -.2}",
            Drive(speed=1, front_steer=0.2, rear_steer=-0.2),
        ),
        ("DRIVE {Speed 1}", Drive(speed=1)),
        (
            "DRIVE {AltitudeVelocity 1} {LinearVelocity 2} {LateralVelocity 3} "
            "{RotationalVelocity 4} {Normalized false}",
            Drive(
                altitude_velocity=1,
                linear_velocity=2,
                lateral_velocity=3,
                rotational_velocity=4,
                normalized=False,
            ),
        ),
        (
            "DRIVE {PitchAngle 5} {RollAngle 6} {Spin1 7} {Spin2 8}",
            Drive(pitch_angle=5, roll_angle=6, spin1=7, spin2=8),
        ),
        (
            "DRIVE {Propeller 1} {Rudder 2} {SternPlane 3}",
            Drive(propeller=1, rudder=2, stern_plane=3),
        ),
        (
            "DRIVE {Value 0.5} {Name Arm1} {Order 1} {Steer 1}",
            Drive(name="Arm1", value=0.5, order=1, steer=1),
        ),
        (
            "DRIVE {Name Leg} {Bone Hip} {Order 2} {Value 3} {Axis X} "
            "{PGain 1} {IGain 2} {DGain 3} {MaxTorque 4}",
            Drive(
                name="Leg",
                bone="Hip",
                order=2,
                value=3,
                axis="X",
                p_gain=1,
                i_gain=2,
                d_gain=3,
                max_torque=4,
            ),
        ),
        ("DRIVE {Name robot_0} {Left 1} {Right 2}", Drive(name="robot_0", left=1, right=2)),
        ("DRIVE", Drive()),
        ("DRIVE {Foo 1}", Drive()),
    ],
)
def test_drive_families(line: str, expected: Drive) -> None:
    """Protocol 3.4: each family fills its own fields, and absent segments stay None."""
    assert request(line) == expected


@pytest.mark.parametrize("text", [".5", "0.5", "+0.5", "5e-1", "0,5"])
def test_drive_number_spellings(text: str) -> None:
    """Protocol 43: all spellings of a half drive alike."""
    assert drive(f"DRIVE {{Left {text}}}").left == 0.5


@pytest.mark.parametrize(
    ("text", "value"), [("1.5abc", 1.5), ("abc", 0.0), ("nan", 0.0), ("inf", 0.0), ("", 0.0)]
)
def test_drive_with_unreadable_numbers(text: str, value: float) -> None:
    """Protocol 44, 45: trailing junk is ignored, and a member that cannot be read is 0, not
    absent."""
    assert drive(f"DRIVE {{Left {text}}} {{Right 1}}") == Drive(left=value, right=1)


@pytest.mark.parametrize("key", ["Normalized", "Light", "Flip"])
@pytest.mark.parametrize(
    ("text", "truth"),
    [("true", True), ("True", True), ("TRUE", True), ("1", True), ("false", False), ("x", False)],
)
def test_drive_booleans(key: str, text: str, truth: bool) -> None:
    """Protocol 46: the spellings of true hold for every flag of DRIVE."""
    assert getattr(drive(f"DRIVE {{{key} {text}}}"), key.lower()) is truth


def test_drive_repeated_and_broken_segments() -> None:
    """Protocol 36, 37, 39: the first of a repeated segment counts, broken ones are skipped."""
    assert request("DRIVE {Left 1} {Left 5} {Right 1}") == Drive(left=1, right=1)
    assert request("DRIVE {Left 1} {Bad} {Right 1}") == Drive(left=1, right=1)
    assert request("DRIVE {Left 1} {Right 1") == Drive(left=1)


def test_drive_wheel_by_wheel() -> None:
    """Protocol 150: every WheelNumber opens a group, and members may be missing inside it."""
    found = drive(
        "DRIVE {WheelNumber 0} {WheelSpeed 1} {WheelSteer .1} {WheelNumber 1} {WheelSpeed 2} "
        "{WheelNumber 2} {WheelSteer .3} {Normalized true}"
    )
    assert found.wheels == (
        WheelTarget(0, 1, 0.1),
        WheelTarget(1, 2, None),
        WheelTarget(2, None, 0.3),
    )
    assert found.normalized is True


def test_wheel_members_before_any_group_are_ignored() -> None:
    """Protocol 3.4.3: groups are positional, so a WheelSpeed in front of them addresses no
    wheel."""
    assert drive("DRIVE {WheelSpeed 9} {WheelNumber 3} {WheelSpeed 1}").wheels == (
        WheelTarget(3, 1),
    )


def test_stop_of_a_client_that_sends_all_families_at_once() -> None:
    """Protocol 5.1.2: one DRIVE may carry the segments of all vehicle kinds."""
    found = drive(
        "DRIVE {Left 0.00} {Right 0.00} {Speed 0.00} {FrontSteer 0.00} {RearSteer 0.00} "
        "{AltitudeVelocity 0.00} {LinearVelocity 0.00} {LateralVelocity 0.00} "
        "{RotationalVelocity 0.00}"
    )
    assert (found.left, found.speed, found.altitude_velocity) == (0.0, 0.0, 0.0)


# MULTIDRIVE


def test_multi_drive() -> None:
    """Protocol 154: joints are named without regard to case, and the first of a repeated name
    counts."""
    assert request("MultiDrive {FRFlipper 0.5} {FLflipper -0,5} {frflipper 9}") == MultiDrive(
        {"frflipper": 0.5, "flflipper": -0.5}
    )
    assert request("MULTIDRIVE") == MultiDrive({})


# SET


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "SET {Type Joint} {Name HeadPitch} {Opcode Angle} {Params 0.35}",
            ("Joint", "HeadPitch", "ANGLE", "0.35"),
        ),
        (
            "SET {Type Odometry} {Name Odometry} {Opcode RESET} ",
            ("Odometry", "Odometry", "RESET", ""),
        ),
        (
            "SET {Type INS} {Name InsTest} {Opcode POSE} {Params 1.0,2.0,0.0,0,0,1.57}",
            ("INS", "InsTest", "POSE", "1.0,2.0,0.0,0,0,1.57"),
        ),
        (
            "SET {Type RFID} {Name RFID} {Opcode Write} {Params 118 victim seen here}",
            ("RFID", "RFID", "WRITE", "118 victim seen here"),
        ),
        (
            "SET {Type Gripper} {Name Gripper1} {Opcode close}",
            ("Gripper", "Gripper1", "CLOSE", ""),
        ),
        ("SET {Type RangeScanner} {Opcode SCAN}", ("RangeScanner", None, "SCAN", "")),
        (
            "SET {Type Camera} {Name Cam} {Opcode Zoom} {0.349066}",
            ("Camera", "Cam", "ZOOM", "0.349066"),
        ),
        ("SET {Type Camera} {Name c} {Opcode Zoom} {0.35}", ("Camera", "c", "ZOOM", "0.35")),
        ("SET {Type Camera} {Name Cam} {FOV 0.7}", ("Camera", "Cam", "FOV", "0.7")),
        ("SET {Type Camera} {Name Cam} {Zoom 0.7}", ("Camera", "Cam", "ZOOM", "0.7")),
        ("SET", ("", None, None, "")),
        ("SET {Type Gripper} {Opcode}", ("Gripper", None, None, "")),
        ("SET {Type Gripper} {Opcode OPEN} {Name}", ("Gripper", None, "OPEN", "")),
        ("SET {Type Gripper} {Opcode GRIP} {Params 1} {x}", ("Gripper", None, "GRIP", "1")),
    ],
)
def test_set(line: str, expected: tuple[str, str | None, str | None, str]) -> None:
    """Protocol 109, 166 and 3.7: type, name, upper case opcode and parameter, irregular forms
    included."""
    found = set_(line)
    assert (found.type, found.name, found.opcode, found.params) == expected


def test_set_keeps_the_segments_of_special_types() -> None:
    """Protocol 3.7: Viewports and the spectator Camera have segments of their own."""
    found = set_("SET {Type Viewports} {Config QuadView} {Viewport1 Camera1} {Viewport2 Disabled}")
    assert found.get("viewport1") == "Camera1"
    assert found.get("Config") == "QuadView"
    assert found.get("Viewport3", "None") == "None"
    camera = set_("SET {Type Camera} {Robot R1} {Name Cam} {Client 10.0.0.7}")
    assert (camera.opcode, camera.params) == (None, "")
    assert camera.get("Client") == "10.0.0.7"


# GETCONF, GETGEO


def test_get_conf_and_get_geo() -> None:
    """Protocol 3.8: type as sent, name only if it is there and not empty."""
    assert request("GETCONF {Type rangescanner} {Name lms200}") == GetConf("rangescanner", "lms200")
    assert request("GETGEO {Type Robot}") == GetGeo("Robot", None)
    assert request("GETGEO {Type Sonar} {Name }") == GetGeo("Sonar", None)
    assert request("GETCONF") == GetConf("", None)


# MISPKG, ACT


@pytest.mark.parametrize(
    "line",
    [
        "MISPKG {Name CameraPanTilt} {Link 1} {Value 0.50} {Link 2} {Value -0.10}",
        "MISPKG {Name CameraPanTilt} {Link 1} {Value 0.50} {Order 0} {Link 2} {Value -0.10} "
        "{Order 0}",
        "mispkg {name CameraPanTilt} {LINK 1} {order 0} {VALUE 0.50} {link 2} {value -0.10}",
    ],
)
def test_mission_package_forms(line: str) -> None:
    """Protocol 157: with and without Order, in any case; a group starts at Link."""
    assert request(line) == MisPkg(
        name="CameraPanTilt", groups=(LinkTarget(1, 0.5, 0), LinkTarget(2, -0.1, 0))
    )


def test_mission_package_orders_and_gripper() -> None:
    """Protocol 3.9: orders 1 and 2, Gripper and Seq or Sequence are kept."""
    assert request("MISPKG {Name a} {Link 1} {Value 2} {Order 1} {Gripper 1} {Seq 4}") == MisPkg(
        name="a", groups=(LinkTarget(1, 2, 1),), gripper=1, seq=4
    )
    found = request("MISPKG {Name a} {Sequence 5}")
    assert isinstance(found, MisPkg)
    assert found.seq == 5


def test_early_pan_tilt_form() -> None:
    """Protocol 3.6: Rotation's third number pans link 1, its second tilts link 2."""
    assert request("MISPKG {Name Cam} {Rotation 0,-0.2,0.6} {Order 1}") == MisPkg(
        name="Cam", groups=(LinkTarget(1, 0.6, 1), LinkTarget(2, -0.2, 1))
    )


def test_act_links_are_never_renumbered() -> None:
    """Protocol 158 and 5.2 no. 5: ACT counts from 0, and the number is passed on as sent."""
    assert request("ACT {Name ArmA} {Link 0} {Value 0.5} {Link 3} {Value -1} {Gripper 1}") == Act(
        name="ArmA", groups=(LinkTarget(0, 0.5), LinkTarget(3, -1)), gripper=1
    )


@pytest.mark.parametrize("word", ["ACT", "MISPKG"])
def test_a_link_without_value_disturbs_no_other(word: str) -> None:
    """Protocol 159: an incomplete group is dropped, the other groups of the command stay."""
    found = request(f"{word} {{Name a}} {{Value 7}} {{Link 1}} {{Link 2}} {{Value 3}}")
    assert isinstance(found, Act | MisPkg)
    assert found.groups == (LinkTarget(2, 3),)


# Avatars and the world controller


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "MOVE {Type Walk_Forward} {Action New} {Location 1.00, 2.00}",
            Move(type="Walk_Forward", action="New", location=(1, 2)),
        ),
        (
            "MOVE {Type Run} {Action Append} {Pathnode N1}",
            Move(type="Run", action="Append", pathnode="N1"),
        ),
        ("MOVE {Action Pause}", Move(action="Pause")),
        ("GOTO {Name PathNode_0}", Goto("PathNode_0")),
        ("GOTO", Goto("")),
        ("SYNC", Sync(1)),
        ("sync {ticks 5}", Sync(5)),
        ("SYNC {Ticks -3}", Sync(1)),
        ("SYNC {Ticks 1e300}", Sync(1_000_000)),
    ],
)
def test_avatar_commands(line: str, expected: Request) -> None:
    """Protocol 3.13: MOVE takes two numbers, in the order x, y."""
    assert request(line) == expected


def test_control() -> None:
    """Protocol 3.14: type and all segments, whose meaning depends on the type."""
    found = request("CONTROL {Type KillAll} {MinPos -1, -1, -1} {MaxPos 1, 1, 1}")
    assert isinstance(found, Control)
    assert found.type == "KillAll"
    assert found.get("minpos") == "-1, -1, -1"
    assert found.get("Name") is None


# The rest


@pytest.mark.parametrize("word", sorted(IGNORED_WORDS))
def test_accepted_and_ignored_words(word: str) -> None:
    """Protocol 3.12, 3.15: these are known, whatever their case and segments, and have no
    effect."""
    assert request(f"{word.lower()} {{On true}} {{Color Red}}") == Ignored(word)


@pytest.mark.parametrize(
    "line", ["FOO", "FOO {A 1}", "DRIVER {Left 1}", "MISPGK {Link 1}", "{A 1}"]
)
def test_unknown_words(line: str) -> None:
    """Protocol 41: everything else is unknown, never an error."""
    assert isinstance(request(line), Unknown)


def test_an_unknown_word_is_cut_for_the_log() -> None:
    """A line of 64 KiB without blanks does not reach the log as a whole."""
    assert request("A" * 60000) == Unknown("A" * 40)


@pytest.mark.parametrize("word", sorted(KNOWN_WORDS))
def test_every_known_word_has_a_meaning(word: str) -> None:
    """The words that may start a glued command and those that mean something are the same."""
    assert not isinstance(interpret(Command(word)), Unknown)


def test_requests_are_frozen() -> None:
    """Requests pass between threads and cannot be changed."""
    with pytest.raises(AttributeError):
        drive("DRIVE {Left 1}").left = 2  # type: ignore[misc]
