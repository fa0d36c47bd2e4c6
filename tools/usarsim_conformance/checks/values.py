"""Numbers, vectors and truths of what clients send (protocol reference 6.3)."""

from __future__ import annotations

import math
from collections.abc import Callable

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.recordings import wheels_of
from usarsim_conformance.registry import Inconclusive, Severity, control, once, unreal, ut2004


@control("grammar.booleans", "Booleans in every spelling", "6, no. 46")
async def booleans(case: Case) -> None:
    """`true`, `True`, `TRUE` and `1` are true; `false`, `0` and anything else are false."""
    robot = await lit(case)
    for word, expected in (
        ("true", "True"), ("false", "False"), ("True", "True"), ("0", "False"),
        ("TRUE", "True"), ("False", "False"), ("1", "True"), ("maybe", "False"),
    ):  # fmt: skip
        await robot.send(f"DRIVE {{Light {word}}}")
        line = await robot.client.maybe(_light(expected), 2.0)
        case.expect(line is not None, f"LightToggle is not {expected} after Light {word}")


async def lit(case: Case) -> Robot:
    """A robot with a light.

    Raises:
        NotApplicable: if STA tells of none.
    """
    robot = await case.spawn()
    if robot.first.get("LightToggle") is None:
        case.skip("STA has no LightToggle")
    return robot


def _light(state: str) -> Callable[[Line], bool]:
    return lambda line: line.head == "STA" and line.get("LightToggle") == state


async def _speed(robot: Robot, left: str, right: str) -> float:
    """Forward speed, m/s, after a DRIVE with these values."""
    await robot.under("DRIVE {Left 0} {Right 0}", seconds=0.4)
    await robot.under(f"DRIVE {{Left {left}}} {{Right {right}}}", seconds=0.4)
    before, start = await robot.pose(), robot.now
    await robot.run(0.8)
    after, end = await robot.pose(), robot.now
    if end <= start:
        raise Inconclusive("simulated time does not pass")
    return before.ahead(after)[0] / (end - start)


@unreal("grammar.numbers", "Numbers in every spelling", "6, no. 43")
async def number_spellings(case: Case) -> None:
    """`0.5`, `.5`, `+0.5`, `5e-1` and, with a decimal comma, `0,5` are the same number."""
    robot = await case.spawn()
    radius, _, limit = await wheels_of(robot)
    # A fraction that matters, within what the wheels can do and the room allows.
    most = min(0.9 * limit, 0.25 / radius)
    value = next((nice for nice in (1.9, 0.9) if nice <= most), most)
    text = f"{value:.4f}"
    # To and fro, so that the robot stays where it is.
    for spelling, sign in (
        (text, 1.0),
        (f"-{text}", -1.0),
        (f"+{text}", 1.0),
        (f"-{value * 10:.4f}e-1", -1.0),
        (text.replace(".", ","), 1.0),
        (f"-00{text}", -1.0),
    ):
        speed, wanted = await _speed(robot, spelling, spelling), sign * value * radius
        case.expect(
            abs(speed - wanted) < 0.35 * abs(wanted),
            f"{spelling!r} gives {speed:.3f} m/s, not {wanted:.3f} m/s",
        )


@unreal("grammar.short-numbers", "A number without its leading zero", "6, no. 43")
async def short_numbers(case: Case) -> None:
    """`.9` is read as 0.9."""
    robot = await case.spawn()
    radius, _, _ = await wheels_of(robot)
    speed = await _speed(robot, ".9", ".9")
    wanted = 0.9 * radius
    case.expect(
        abs(speed - wanted) < 0.35 * wanted, f".9 gives {speed:.3f} m/s, not {wanted:.3f} m/s"
    )


@unreal("grammar.number-junk", "Junk behind a number", "6, no. 44")
async def number_junk(case: Case) -> None:
    """`1.5abc` is 1.5, and `abc` is 0."""
    robot = await case.spawn()
    radius, _, limit = await wheels_of(robot)
    value = min(1.5, 0.9 * limit)
    speed = await _speed(robot, f"{value}abc", f"{value}abc")
    wanted = value * radius
    case.expect(
        abs(speed - wanted) < 0.35 * wanted,
        f"{value}abc gives {speed:.3f} m/s, not {wanted:.3f} m/s",
    )
    speed = await _speed(robot, "abc", "abc")
    case.expect(abs(speed) < 0.02, f"abc gives {speed:.3f} m/s, not 0 m/s")


@once("grammar.not-finite", "NaN and infinity do no harm", "6, no. 45")
async def not_finite(case: Case) -> None:
    """`nan`, `inf` and `1e999` leave everything that the robot reports finite."""
    robot = await case.spawn()
    for word in ("nan", "inf", "-inf", "1e999", "NaN(7)", "Infinity"):
        await robot.send(f"DRIVE {{Left {word}}} {{Right {word}}}", "DRIVE {Left 0} {Right 0}")
    for line in await robot.run(1.0):
        values = [value for _, value in line.segments]
        bad = [v for v in values if "nan" in v.lower().split() or "inf" in v.lower().split()]
        case.expect(not bad, f"a value is {', '.join(bad)}, not a number: {line}")
    pose = await robot.pose()
    case.expect(
        all(map(math.isfinite, pose.location + pose.orientation)),
        f"the pose is {pose}, not of numbers",
    )


async def _lands(
    case: Case, spell: str, place: Place, *, axes: int = 2, rotate: bool = True
) -> None:
    """An INIT with a location spelled in some way leads to the place."""
    rotation = f" {{Rotation {','.join(f'{v:.4f}' for v in place.rotation)}}}" if rotate else ""
    init = (
        f"INIT {{ClassName USARBot.{case.robot_class}}} {{Name {case.new_name()}}} "
        f"{{Location {spell}}}{rotation}{case.dialect_segment}"
    )
    robot = await case.spawn(place=place, init=init)
    pose = await robot.pose()
    away = math.dist(pose.location[:2], place.location[:2])
    case.expect(
        away < 0.1,
        f"{{Location {spell}}} leads to {pose.location}, {away:.2f} m away, not to "
        f"{place.location}",
    )


async def _place(case: Case) -> Place:
    """A place away from the origin, to which misread numbers lead."""
    for _ in range(2):
        place = await case.place()
        if math.hypot(*place.location[:2]) > 0.5:
            return place
    raise Inconclusive("the server lists no start poses away from the origin")


@control("grammar.vector-commas", "Vectors with commas", "6, no. 47")
async def vector_commas(case: Case) -> None:
    """`1,2,3` is read as three numbers."""
    place = await _place(case)
    await _lands(case, ",".join(f"{v:.4f}" for v in place.location), place)


@control("grammar.vector-comma-blank", "Vectors with commas and blanks", "6, no. 47")
async def vector_comma_blank(case: Case) -> None:
    """`1, 2, 3` with blanks behind the commas and around is the same vector as `1,2,3`."""
    place = await _place(case)
    await _lands(case, " " + ", ".join(f"{v:.4f}" for v in place.location) + " ", place)


@unreal("grammar.vector-blanks", "Vectors with blanks only", "6, no. 47")
async def vector_blanks(case: Case) -> None:
    """`1.0 2.0 3.0` with blanks instead of commas is the same vector as `1,2,3`."""
    place = await _place(case)
    await _lands(case, " ".join(f"{v:.6f}" for v in place.location), place)


@unreal("grammar.vector-decimal-comma", "Vectors with decimal commas", "6, no. 50")
async def vector_decimal_comma(case: Case) -> None:
    """`0,5 1,0 1,8`, as a program in a decimal comma locale writes it, is (0.5, 1.0, 1.8)."""
    place = await _place(case)
    await _lands(case, " ".join(f"{v:.2f}" for v in place.location).replace(".", ","), place)


@control("grammar.vector-zeros", "Leading zeros are decimal", "6, no. 49")
async def vector_zeros(case: Case) -> None:
    """`-03.0` and `020` are decimal numbers, never octal."""
    place = await _place(case)

    def zeros(value: float) -> str:
        return ("-" if value < 0.0 else "") + f"0{abs(value):.4f}"

    await _lands(case, ", ".join(map(zeros, place.location)), place)


@ut2004("grammar.vector-two", "A vector of two numbers", "6, no. 51", Severity.SHOULD)
async def vector_two(case: Case) -> None:
    """`1,2` is (1, 2, 0)."""
    place = await _place(case)
    await _lands(case, ",".join(f"{v:.4f}" for v in place.location[:2]), place)


@unreal("grammar.vector-six", "A vector of six parts does not fail", "protocol reference, addendum")
async def vector_six(case: Case) -> None:
    """`0,0000, 0,0000, 0,0000` as location does not keep the robot from appearing."""
    place = await case.place()
    await case.appears(
        f"INIT {{ClassName USARBot.{case.robot_class}}} {{Name {case.new_name()}}} "
        f"{place.segments if place.tag else ''} {{Rotation 0,0000, 0,0000, 0,0000}}"
        f"{case.dialect_segment}"
    )


@once("grammar.non-ascii", "Bytes beyond ASCII", "6, no. 52")
async def non_ascii(case: Case) -> None:
    """Bytes beyond ASCII in a name do not break the parsing of later segments."""
    place = await case.place()
    await case.appears(case.init(place, case.new_name() + "\xe9\xff\x80"))


@once("grammar.nul", "NUL and control bytes", "1.7", Severity.SHOULD)
async def nul(case: Case) -> None:
    """NUL and other control bytes within a line do no harm to the connection."""
    client = await case.connect()
    await client.send_bytes(b"\x00\x01\x02DRIVE\x00 {Left\x00 1}\x1b{Right 1}\r\n")
    await case.expect_alive(client, "control bytes within a line")
