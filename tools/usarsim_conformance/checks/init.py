"""INIT, start poses and path nodes (protocol reference 6.5)."""

from __future__ import annotations

import math
import re

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import Pose, turned
from usarsim_conformance.places import Place
from usarsim_conformance.recordings import standing
from usarsim_conformance.registry import Severity, control, once, udk, unreal

_QUIET = 0.22
"""s; a little less than the 0.25 s that are demanded, for times that are rounded."""
_PROMPT = 2.25
"""s; a little more than the 2 s that are demanded: how long ago the time was told is not known."""


@control("init.spawns", "INIT brings a robot into the world", "1.2")
async def spawns(case: Case) -> None:
    """After a valid INIT the server sends STA and SEN lines of the robot."""
    client = await case.connect()
    place = await case.place()
    robot_class = case.survey.robot or case.target.robot or "P2AT"
    await client.send(case.init(place, case.new_name(), robot_class))
    within = PATIENCE if case.survey.robot is not None else 2.0  # none came once already
    await client.wait(lambda line: line.head == "STA", within, "STA")
    if await client.maybe(lambda line: line.head == "SEN") is None:
        # Whether it has a sensor at all is asked last: not all servers answer in silence.
        asked = [f"GETCONF {{Type {type}}}" for type in ("GroundTruth", "INS", "Odometry", "Sonar")]
        if not any(line.head == "CONF" for line in await client.outcome(*asked)):
            case.skip(f"{robot_class} has no sensors")
        case.fail(f"STA of {robot_class} comes, but no SEN")


@control("init.silent", "INIT has no direct reply", "6, no. 69")
async def silent(case: Case) -> None:
    """A valid INIT produces no direct reply: what follows is the robot's own report."""
    client = await case.connect()
    place = await case.place()
    await client.send(case.init(place, case.new_name()))
    line = await client.wait(lambda line: True, PATIENCE, "line")
    if line.head == "CONF" and line.type == "Camera":
        return  # sent unasked to whoever has a camera (side channels reference 11, no. 38)
    case.expect(
        line.head not in ("RES", "CONF", "GEO"), f"INIT is answered by {line}, not by STA or SEN"
    )
    case.expect(
        line.head != "NFO" or "Status" in line.names,
        f"INIT is answered by {line}, not by STA or SEN",
    )


@control("init.quiet-period", "A quiet time follows INIT", "6, no. 70 and 1.8")
async def quiet_period(case: Case) -> None:
    """The first STA or SEN comes not before 0.25 s of simulated time after INIT, so that replies to
    requests sent with it go out first."""
    waited = await _waited(case)
    case.expect(
        waited >= _QUIET,
        f"the first line comes {waited:.3f} s after INIT, not {_QUIET:g} s at least",
    )


@control("init.prompt", "The first STA comes in time", "6, no. 70", Severity.INFORMATIVE)
async def prompt(case: Case) -> None:
    """The first STA comes not later than 2 s of simulated time after INIT. Servers build a robot
    while the world goes on, which takes wall time: informative."""
    waited = await _waited(case)
    case.expect(
        waited <= _PROMPT,
        f"the first line comes {waited:.2f} s after INIT, not {_PROMPT:g} s at most",
    )


async def _waited(case: Case) -> float:
    waited = (await standing(case)).waited
    case.need(not math.isnan(waited), "there is no robot that tells the time of an INIT")
    return waited


@once("init.unknown-class", "An unknown class is no end", "6, no. 71")
async def unknown_class(case: Case) -> None:
    """INIT with an unknown class produces no output, and a valid INIT on the same connection
    works."""
    client = await case.connect()
    await client.send("INIT {ClassName USARBot.NoSuchRobotAtAll} {Name x} {Location 0,0,0}")
    lines = await client.listen(1.2)
    case.expect_silence(lines, "INIT with an unknown class")
    await case.spawn(client=client)


async def _class_spelled(case: Case, spell: str) -> None:
    place = await case.place()
    init = (
        f"INIT {{ClassName {spell}}} {{Name {case.new_name()}}} {place.segments}"
        f"{case.dialect_segment}"
    )
    await case.appears(init)


@once("init.package", "Class with its package", "6, no. 72")
async def package(case: Case) -> None:
    """The class may be written with its package: `USARBot.P2AT`."""
    await _class_spelled(case, f"USARBot.{case.robot_class}")


@once("init.no-package", "Class without package", "6, no. 72")
async def no_package(case: Case) -> None:
    """The class may be written without its package: `P2AT`."""
    await _class_spelled(case, case.robot_class)


@once("init.class-case", "Class in any case", "6, no. 72")
async def class_case(case: Case) -> None:
    """The class is matched without regard to case."""
    await _class_spelled(case, f"usarBOT.{case.robot_class.swapcase()}")


@once("init.case", "INIT in any case", "1.6")
async def init_case(case: Case) -> None:
    """`Init {CLASSNAME ..}` works as `INIT {ClassName ..}` does."""
    place = await case.place()
    init = case.init(place, case.new_name())
    await case.appears(init.replace("INIT", "Init").replace("ClassName", "CLASSNAME"))


@once("init.classname", "ClassName spelled Classname", "6, no. 73")
async def classname(case: Case) -> None:
    """`Classname`, as the ROS and MOAST family writes it, is accepted for ClassName."""
    place = await case.place()
    init = case.init(place, case.new_name())
    await case.appears(init.replace("ClassName", "Classname"))


@once("init.glued", "INIT without blanks", "3.2")
async def glued(case: Case) -> None:
    """INIT works without blanks between its segments."""
    place = await case.place()
    init = case.init(place, case.new_name()).replace("} {", "}{").replace("INIT {", "INIT{")
    await case.appears(init)


@once("init.order", "Segments of INIT in any order", "3.2")
async def order(case: Case) -> None:
    """The segments of INIT may stand in any order."""
    place = await case.place()
    init = (
        f"INIT {place.segments} {{Name {case.new_name()}}} "
        f"{{ClassName USARBot.{case.robot_class}}}{case.dialect_segment}"
    )
    await case.appears(init)


@once("init.no-name", "INIT without Name", "6, no. 74")
async def no_name(case: Case) -> None:
    """INIT without Name works, also for two robots at a time."""
    for _ in range(2):
        place = await case.place()
        await case.appears(case.init(place))


@once("init.same-name", "Two robots of one name", "3.2", Severity.SHOULD)
async def same_name(case: Case) -> None:
    """Two clients that give their robots the same name both get one."""
    name = case.new_name()
    for _ in range(2):
        place = await case.place()
        await case.appears(case.init(place, name))


@once("init.name-with-blanks", "A name with blanks", "3.2")
async def name_with_blanks(case: Case) -> None:
    """A robot name may contain blanks."""
    place = await case.place()
    await case.appears(case.init(place, f"{case.new_name()} the first"))


@once("init.no-place", "INIT without a place", "6, no. 75", exclusive=True)
async def no_place(case: Case) -> None:
    """INIT without Location and Start spawns a robot, at 0,0,0 or at a start position."""
    await case.appears(f"INIT {{ClassName USARBot.{case.robot_class}}} {{Name {case.new_name()}}}")


_YAW = 0.6
"""rad; neither an axis nor its own mirror image."""


def _judge_yaw(case: Case, pose: Pose, wanted: float, after: str) -> None:
    found = turned(0.0, pose.yaw)
    case.expect(
        abs(turned(wanted, found)) < 0.025,
        f"yaw of Orientation is {found:.3f} after {after} of {wanted:.3f} rad, not that",
    )


@control("init.location", "Spawns at the Location", "6, no. 63")
async def location(case: Case) -> None:
    """The first reported pose agrees with Location and Rotation, a yaw of 0.6 rad, within 5 cm and
    0.02 rad in x, y and yaw on flat ground."""
    base = await case.place()
    case.need(base.tag is None or any(base.location), "the server lists no start poses")
    place = Place(None, base.moved(right=0.4).location, (0.0, 0.0, _YAW))
    pose = await (await case.spawn(place=place)).pose()
    away = math.dist(pose.location[:2], place.location[:2])
    case.expect(
        away < 0.05,
        f"Location is {pose.location} after INIT with {place.location}, {away:.2f} m off, not "
        "within 0.05 m",
    )
    _judge_yaw(case, pose, _YAW, "INIT with Rotation")


@once("init.extras", "Unknown segments of INIT", "6, no. 78")
async def extras(case: Case) -> None:
    """INIT with segments of other eras (Team, Skin, unknown ones) works."""
    place = await case.place()
    init = case.init(
        place, case.new_name(), extra=" {Team 255} {Skin Default.Red} {Colour blue} {Mood}"
    )
    await case.appears(init)


@once("init.battery", "Battery sets the battery", "6, no. 78", Severity.SHOULD)
async def battery(case: Case) -> None:
    """`{Battery 300}` of INIT sets the battery that STA shows."""
    robot = await case.spawn(extra=" {Battery 300}")
    value = robot.first.number("Battery")
    if value == 99999 or math.isnan(value):
        case.skip("the robot has no battery")
    case.expect(
        280 <= value <= 300, f"Battery of STA is {value:g} after INIT with 300, not 280 to 300"
    )


@once("init.second", "A second INIT is no second robot", "6, no. 79")
async def second(case: Case) -> None:
    """A second INIT after success does not create a second robot: the connection goes on
    reporting one, at one place."""
    robot = await case.spawn()
    other = await case.place()
    await robot.run(0.5)
    before = await robot.pose()
    await robot.send(case.init(other, case.new_name()))
    lines = await robot.run(1.0)
    after = await robot.pose()
    case.expect(
        math.dist(before.location, after.location) < 0.3,
        f"Location is {after.location} after a second INIT, not {before.location}, as before it",
    )
    times = [line.time for line in lines if line.head == "STA"]
    case.expect(
        len(set(times)) == len(times),
        f"{len(times)} STA lines have {len(set(times))} values of Time, not one each: two lines "
        "for one moment",
    )


@control("init.start", "Spawns at a start position", "6, no. 76 and 83")
async def start(case: Case) -> None:
    """INIT with Start of a listed tag spawns at the pose listed for it, whatever the case of the
    tag and whether or not a Location is given, too."""
    place = await case.place()
    case.need(place.tag is not None and any(place.location), "the server lists no start poses")
    tag = (place.tag or "").swapcase()
    init = case.init(Place(tag), case.new_name(), extra=" {Location 0.5,0.5,-3}")
    robot = await case.spawn(place=place, init=init)
    pose = await robot.pose()
    away = math.dist(pose.location[:2], place.location[:2])
    case.expect(
        away < 0.1, f"Location is {pose.location} after INIT with Start {tag}, not {place.location}"
    )
    _judge_yaw(case, pose, place.rotation[2], f"INIT with Start {tag}")


@control("init.start-yaw", "Start poses face where they are said to", "4.2; 6, no. 76 and 83")
async def start_yaw(case: Case) -> None:
    """A robot at a listed start pose that does not face along x has the listed yaw, in radians and
    clockwise, within 0.025. Not applicable if all face along x."""
    turned_ones = [
        place
        for place in (*case.survey.tilted, *case.run.places.all)
        if abs(math.remainder(place.rotation[2], math.pi)) > _SHOWS
    ]
    if not turned_ones:
        case.skip("all start poses face along x")
    await case.place()  # so many robots at a time and no more
    for place in turned_ones[:2]:
        robot = await case.spawn(place=place)
        _judge_yaw(case, await robot.pose(), place.rotation[2], f"INIT with Start {place.tag}")
        robot.close()


_SHOWS = 0.2
"""rad from the x axis, ahead or back; a yaw that is mirrored is another one then."""


@once("init.unknown-start", "An unknown Start spawns anyway", "6, no. 77", exclusive=True)
async def unknown_start(case: Case) -> None:
    """INIT with an unknown Start still spawns the robot."""
    await case.appears(case.init(Place("NoSuchStart"), case.new_name()))


@once("init.start-poses", "GETSTARTPOSES before and after INIT", "6, no. 80")
async def start_poses(case: Case) -> None:
    """GETSTARTPOSES is answered before INIT and after it."""
    client = await case.connect()
    await case.expect_alive(client, "connecting, before INIT")
    robot = await case.spawn(client=client)
    await case.expect_alive(robot.client, "INIT")


@once("init.start-poses-count", "StartPoses counts what follows", "6, no. 81")
async def start_poses_count(case: Case) -> None:
    """The reply to GETSTARTPOSES begins `NFO {StartPoses n}` and n groups follow; with n = 0 no
    second segment exists."""
    line = await (await case.connect()).ask("GETSTARTPOSES", "NFO {StartPoses")
    count = line.get("StartPoses") or ""
    case.expect(re.fullmatch(r"\d+", count), f"StartPoses is {count!r}, not an integer")
    words = " ".join(f"{name} {value}" for name, value in line.segments[1:]).split()
    case.expect(
        len(words) == 3 * int(count),
        f"StartPoses is {count}, not {len(words) / 3:g}, as many groups as follow: {line}",
    )


@unreal("init.start-poses-form", "Start poses in the flat form", "6, no. 82")
async def start_poses_form(case: Case) -> None:
    """The second segment holds groups `tag x,y,z r,p,y`, all separated by single blanks."""
    line = await (await case.connect()).ask("GETSTARTPOSES", "NFO {StartPoses")
    number = r"-?\d+(\.\d+)?"
    vector = rf"{number},{number},{number}"
    group = rf"[^ {{}}]+ {vector} {vector}"
    pattern = rf"NFO \{{StartPoses \d+\}}( \{{{group}( {group})*\}})?"
    case.expect(
        re.fullmatch(pattern, line.text),
        "StartPoses has another form, not groups of tag x,y,z r,p,y with single blanks between: "
        f"{line}",
    )


@udk("init.path-nodes", "GETPATHNODES lists path nodes", "6, no. 84", Severity.SHOULD)
async def path_nodes(case: Case) -> None:
    """GETPATHNODES is answered by `NFO {PathNodes n}` with n groups in a second segment."""
    line = await (await case.connect()).ask("GETPATHNODES", "NFO {PathNodes")
    count = line.get("PathNodes") or ""
    case.expect(re.fullmatch(r"\d+", count), f"PathNodes is {count!r}, not an integer")
    words = " ".join(f"{name} {value}" for name, value in line.segments[1:]).split()
    case.expect(
        len(words) == 3 * int(count),
        f"PathNodes is {count}, not {len(words) / 3:g}, as many groups as follow: {line}",
    )


@udk("init.closest-node", "GETCLOSESTPATHNODE needs a Location", "6, no. 84", Severity.SHOULD)
async def closest_node(case: Case) -> None:
    """GETCLOSESTPATHNODE without Location is not answered."""
    client = await case.connect()
    lines = await client.outcome("GETCLOSESTPATHNODE")
    case.expect_silence(lines, "GETCLOSESTPATHNODE without Location")
