"""SET and its results (protocol reference 3.7, 4.10, 6.10)."""

from __future__ import annotations

import math

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import Robot, turned
from usarsim_conformance.lines import Line
from usarsim_conformance.recordings import items_of, standing, wheels_of
from usarsim_conformance.registry import NotApplicable, Severity, once, udk, unreal, ut2004

_RESCUE = ("RescueP2AT", "P2AT_ATLANTA", "MultiView")
"""Classes of the original's contests; some carry an RFID reader."""
_TURNS_WITHIN = 20.0
"""s in which a skid steered robot turns about."""


async def _item(case: Case, type: str) -> str:
    """Name of the first item of a type."""
    for found, name in items_of((await standing(case)).streamed):
        if found == type:
            return name
    raise NotApplicable(f"the robot has no {type}")


async def _responses(robot: Robot, command: str, seconds: float = 0.7) -> list[Line]:
    lines = await robot.client.outcome(command, seconds=seconds)
    return [line for line in lines if line.head == "RES"]


_TURN = 1.2
"""rad; a pose that is reset has a theta worth mention."""


async def _reset(case: Case, end: str) -> None:
    name = await _item(case, "Odometry")
    robot = await case.spawn()
    await wheels_of(robot)
    await robot.under("DRIVE {Left 3} {Right 3}", seconds=1.0)
    await robot.under("DRIVE {Left 3} {Right -3}", seconds=0.6)
    latest = robot.now + _TURNS_WITHIN
    while (moved := await robot.odometry())[2] < _TURN and robot.now < latest:
        await robot.run(0.4)
    case.need(
        moved[0] > 0.03 and moved[2] > _TURN, f"odometry shows {moved} after way ahead and a turn"
    )
    await robot.send("DRIVE {Left 0} {Right 0}")
    await robot.run(0.8)
    await robot.send(f"SET {{Type Odometry}} {{Name {name}}} {{Opcode RESET}}{end}")
    await robot.run(0.4)
    for axis, value in zip(("x", "y", "theta"), await robot.odometry(), strict=True):
        case.expect(abs(value) < 0.02, f"{axis} of Pose is {value:.3f} after RESET, not 0")


@unreal("set.odometry-reset", "RESET of Odometry", "6, no. 109")
async def odometry_reset(case: Case) -> None:
    """`SET {Type Odometry} {Name n} {Opcode RESET}` returns the pose to 0,0,0, also after a
    turn."""
    await _reset(case, "")


@once("set.trailing-blank", "A blank behind SET", "6, no. 109")
async def trailing_blank(case: Case) -> None:
    """A trailing blank behind SET does no harm."""
    await _reset(case, " ")


@ut2004("set.result", "SET is answered by RES", "6, no. 163")
async def result(case: Case) -> None:
    """In ut2004 every SET with an Opcode known to the item gives one RES with Time, Type, Name,
    Status."""
    name = await _item(case, "Odometry")
    robot = await case.spawn()
    found = await _responses(robot, f"SET {{Type Odometry}} {{Name {name}}} {{Opcode RESET}}")
    case.expect(len(found) == 1, f"SET RESET is answered by {len(found)} RES lines, not by 1")
    case.expect_names(found[0], ("Time", "Type", "Name", "Status"))
    case.expect(
        found[0].get("Status") == "OK",
        f"Status of RES is {found[0].get('Status')}, not OK: {found[0]}",
    )


@udk("set.no-result-udk", "SET is not answered in udk", "6, no. 163")
async def no_result(case: Case) -> None:
    """In udk no SET gives a RES."""
    name = await _item(case, "Odometry")
    robot = await case.spawn()
    found = await _responses(robot, f"SET {{Type Odometry}} {{Name {name}}} {{Opcode RESET}}")
    case.expect_silence(found, "SET in udk")


@unreal("set.unknown", "An unknown SET does no harm", "3.7")
async def unknown(case: Case) -> None:
    """SET of unknown types, items and opcodes, or without any, does no harm."""
    robot = await case.spawn()
    await robot.send(
        "SET", "SET {Type Nothing}", "SET {Type Odometry} {Opcode Explode}",
        "SET {Type Sonar} {Name none} {Opcode RESET} {Params 1,2,3}", "SET {Name x}",
        "SET {Type Camera} {Opcode Zoom} {Params much}", "SET {Opcode RESET}",
    )  # fmt: skip
    await case.expect_alive(robot.client, "SET of unknown types, items and opcodes")
    await robot.wait(lambda line: line.head == "STA", what="STA")


@unreal("set.scan", "SCAN measures at once", "3.7", Severity.SHOULD)
async def scan(case: Case) -> None:
    """`SET {Type RangeScanner} {Name n} {Opcode SCAN}` gives a measurement beside the periodic
    ones: more lines come than without."""
    name = await _item(case, "RangeScanner")
    robot = await case.spawn()

    def scans(lines: list[Line]) -> int:
        return sum(line.head == "SEN" and line.type == "RangeScanner" for line in lines)

    usual = scans(await robot.client.listen(1.5))
    command = f"SET {{Type RangeScanner}} {{Name {name}}} {{Opcode SCAN}}"
    more = scans(await robot.client.outcome(*[command] * 8, seconds=1.5))
    case.expect(
        more >= usual + 4,
        f"{more} scans come in 1.5 s with eight SCAN, not at least {usual + 4}, four more than "
        "without",
    )


@unreal("set.ins-pose", "POSE sets the estimate of INS", "3.7", Severity.SHOULD)
async def ins_pose(case: Case) -> None:
    """`SET {Type INS} {Name n} {Opcode POSE} {Params x,y,z,roll,pitch,yaw}` sets the estimate, each
    number where it belongs: angles within 0.03 rad."""
    name = await _item(case, "INS")
    robot = await case.spawn()
    await robot.run(0.8)
    pose = (7.0, 8.0, -9.0, 0.1, 0.2, 0.5)
    params = ",".join(f"{value:g}" for value in pose)
    await robot.send(f"SET {{Type INS}} {{Name {name}}} {{Opcode POSE}} {{Params {params}}}")
    await robot.run(0.4)
    line = await robot.sensor("INS")
    told = (*line.numbers("Location"), *line.numbers("Orientation"))
    case.need(len(told) == len(pose), f"no Location and Orientation of three numbers each: {line}")
    for number, (found, wanted) in enumerate(zip(told, pose, strict=True)):
        key, axis, slack = ("Location", "xyz"[number], 0.3) if number < 3 else (
            "Orientation", ("roll", "pitch", "yaw")[number - 3], 0.03)  # fmt: skip
        off = abs(found - wanted) if number < 3 else abs(turned(wanted, found))
        case.expect(
            off < slack,
            f"{axis} of {key} of INS is {found:.2f} after SET POSE {params}, not {wanted:g}",
        )


@unreal("set.zoom", "Zoom with a nameless parameter", "6, no. 166")
async def zoom(case: Case) -> None:
    """`SET {Type Camera} {Name c} {Opcode Zoom} {0.5}`, a segment without a name, is understood
    as Params 0.5: CameraFov of CONF follows."""
    recording = await standing(case)
    line = recording.replies.get(("GETCONF", "Camera", ""))
    if line is None:
        case.skip("the robot has no Camera")
    assert line is not None
    name = line.items()[0]["Name"]
    robot = await case.spawn()
    wanted = math.degrees(0.5) if case.dialect == "udk" else 0.5
    await robot.send(f"SET {{Type Camera}} {{Name {name}}} {{Opcode Zoom}} {{0.5}}")
    await robot.run(0.5)
    told = await robot.client.ask(f"GETCONF {{Type Camera}} {{Name {name}}}", "CONF {Type Camera")
    fov = told.number("CameraFov")
    case.expect(abs(fov - wanted) < 0.02 * wanted, f"CameraFov is {fov}, not {wanted:.4f}")


@unreal("set.zoom-limits", "Zoom stays within limits", "3.7", Severity.SHOULD)
async def zoom_limits(case: Case) -> None:
    """A field of view beyond the camera's limits is clamped to them; 0 is the default again."""
    recording = await standing(case)
    line = recording.replies.get(("GETCONF", "Camera", ""))
    if line is None:
        case.skip("the robot has no Camera")
    assert line is not None
    name = line.items()[0]["Name"]
    robot = await case.spawn()
    for value, wanted in (("3.1", "CameraMaxFov"), ("0.01", "CameraMinFov"), ("0", "CameraDefFov")):
        await robot.send(f"SET {{Type Camera}} {{Name {name}}} {{Opcode FOV}} {{Params {value}}}")
        await robot.run(0.4)
        told = await robot.client.ask(
            f"GETCONF {{Type Camera}} {{Name {name}}}", "CONF {Type Camera"
        )
        gap = abs(told.number("CameraFov") - told.number(wanted))
        case.expect(
            gap < 0.01 * told.number(wanted),
            f"CameraFov is {told.number('CameraFov'):g} after FOV {value}, not "
            f"{told.number(wanted):g}, {wanted}: {told}",
        )


@unreal("set.viewports", "SET of viewports does no harm", "side channels reference 11, no. 46")
async def viewports(case: Case) -> None:
    """`SET {Type Viewports} ...` never breaks the connection."""
    robot = await case.spawn()
    await robot.send(
        "SET {Type Viewports} {Config QuadView} {Viewport1 Camera1} {Viewport2 Disabled}"
        " {Viewport3 Disabled} {Viewport4 Disabled}",
        "SET {Type Viewports} {Config SingleView} {Viewport1 Camera2}",
    )
    await case.expect_alive(robot.client, "SET {Type Viewports}")


@ut2004("set.releaser", "RFIDReleaser answers with OK at the end", "6, no. 164", Severity.SHOULD)
async def releaser(case: Case) -> None:
    """The RES of an RFIDReleaser ends in `{status OK}`, lower case, directly before CR LF."""
    robot = await _with_rfid(case)
    found = await _responses(robot, "SET {Type RFIDReleaser} {Name Gun} {Opcode Release}", 1.2)
    if not found:
        case.skip(f"{robot.class_name} has no RFIDReleaser called Gun")
    case.expect(
        found[0].raw.endswith(b"{status OK}\r\n"),
        f"RES ends with {found[0].raw[-20:]!r}, not with {{status OK}} and CR LF",
    )


@ut2004("set.rfid", "RFID memory is read and written", "6, no. 40 and 165", Severity.SHOULD)
async def rfid(case: Case) -> None:
    """What is written to a tag is read back, blanks within it included; an unknown tag gives
    `{status Failed}`."""
    robot = await _with_rfid(case)
    # A tag of its own, so that it does not depend on where others have dropped theirs.
    await robot.send("SET {Type RFIDReleaser} {Name Gun} {Opcode Release}")
    line = await robot.client.maybe(
        lambda line: line.head == "SEN" and line.type == "RFID" and "ID" in line.names, 2.0
    )
    reader = None
    for conf in [await robot.client.ask("GETCONF {Type RFID}", "CONF {Type RFID")]:
        reader = conf.get("Name")
    failed = await _responses(
        robot, f"SET {{Type RFID}} {{Name {reader}}} {{Opcode Read}} {{Params 99999}}"
    )
    case.expect(
        len(failed) == 1, f"reading an unknown tag is answered by {len(failed)} RES lines, not by 1"
    )
    case.expect(
        failed[0].get("status") == "Failed",
        f"status of RES is {failed[0].get('status')} for an unknown tag, not Failed: {failed[0]}",
    )
    if line is None:
        case.skip("no tag is near")
    assert line is not None
    tag, memory = line.get("ID"), "two words"
    command = f"SET {{Type RFID}} {{Name {reader}}} {{Opcode "
    written = await _responses(robot, f"{command}Write}} {{Params {tag} {memory}}}")
    case.expect(
        [one.get("status") for one in written] == ["OK"],
        f"status of RES after Write is {[one.get('status') for one in written]}, not one OK",
    )
    read = await _responses(robot, f"{command}Read}} {{Params {tag}}}")
    case.expect(
        [one.get("Mem") for one in read] == [memory],
        f"Mem of RES after Read is {[one.get('Mem') for one in read]}, not {memory!r}, as written",
    )


async def _with_rfid(case: Case) -> Robot:
    """A robot with an RFID reader."""
    for class_name in _RESCUE:
        client = await case.connect()
        place = await case.place()
        await client.send(case.init(place, case.new_name(), class_name))
        first = await client.maybe(lambda line: line.head == "STA", PATIENCE)
        if first is None:
            continue
        await client.send("GETCONF {Type RFID}")
        if await client.maybe("CONF {Type RFID}", 2.0) is not None:
            return Robot(client, "", class_name, place, first)
    raise NotApplicable(f"none of {', '.join(_RESCUE)} with an RFID reader could be spawned")
