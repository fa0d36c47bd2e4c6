"""Attacks on the port of robot control."""

from __future__ import annotations

import random
from collections.abc import Sequence
from functools import partial
from typing import Any

from hostile.attack import MIB, Answers, Attack, Links, holding
from hostile.links import First, Link, Site

EVERYBODY = ("groundtruth", "wireless", "truth", "images")
LONG_NAME = b"N" * 65_000
GROWING = (
    *("Kenaf", "TeleMax", "Nao", "ERS", "QRIO", "Hummer", "Lisa", "Talon"),
    *("Soryu", "KR60", "Submarine", "AirRobot", "Sedan", "Rugbot", "PR2", "Matilda"),
)
"""Classes that the model has no room for before somebody asks."""


def robot(name: bytes, robot_class: str = "P3AT", where: bytes = b"") -> bytes:
    """An INIT line."""
    return b"INIT {ClassName USARBot.%s} {Name %s}%s\r\n" % (robot_class.encode(), name, where)


def _robots(
    count: int, name: bytes, again: bytes = b"", robot_class: str = "P3AT", **how: Any
) -> Links:
    """Robots that say something again and again; see `Link` for how."""
    hellos = [robot(b"%s%d" % (name, number), robot_class) for number in range(count)]
    return lambda site: [Link(site.ports["control"], one, again, **how) for one in hellos]


def _asking(reads: bool) -> Links:
    poses = b"GETSTARTPOSES\r\n"
    questions = b"GETCONF {Type Robot}\r\nGETGEO {Type Robot}\r\n" + poses
    robots = _robots(4, b"Asks", questions, reads=reads)
    return lambda site: [
        *robots(site),
        *(Link(site.ports["control"], again=poses, reads=reads) for _ in range(8)),
    ]


def _long_names(site: Site) -> Sequence[Link]:
    ports = site.ports
    name = LONG_NAME
    twin = b"GETOBS {From %s} {To %s}\r\n" % (name[:30_000], name[:30_000])
    return [
        *_robots(6, name)(site),
        *(
            Link(ports["control"], b"", b"GETCONF {Type Robot} {Name %s}\r\n" % name)
            for _ in range(4)
        ),
        *(Link(ports[one], again=b"GETPOS\r\n") for one in ("groundtruth", "wireless") * 8),
        *(Link(ports[one], again=twin) for one in ("groundtruth", "wireless") * 4),
        *(Link(ports["truth"], again=b"\r\n") for _ in range(8)),
        *(
            Link(ports["wireless"], b"INIT {Robot %s} {Port 1}\r\n" % name, b"GETSS {Robot x}\r\n")
            for _ in range(4)
        ),
        *(Link(ports["comserver"], again=b"REGISTER %s 127.0.0.1;" % name) for _ in range(4)),
    ]


def _garbage(site: Site) -> Sequence[Link]:
    dice = random.Random(0)
    port = site.ports["control"]
    return [
        *(Link(port, again=dice.randbytes(65_536).replace(b"\n", b"")) for _ in range(4)),
        *(Link(port, again=b"{" * 65_536) for _ in range(4)),
        *(Link(port, again=dice.randbytes(65_536)) for _ in range(4)),
        *(Link(port, again=b"X\n" * 1000) for _ in range(4)),
    ]


def _long_lines(site: Site) -> Sequence[Link]:
    port = site.ports["control"]
    fitting = b"DRIVE " + b"{Left 1} " * 7000 + b"\r\n"
    endless = b"DRIVE {Left " + b"1" * 200_000 + b"}\r\n"
    return [
        *_robots(6, b"Long", fitting, reads=True)(site),
        *(Link(port, again=endless) for _ in range(6)),
    ]


def _drip(site: Site) -> Sequence[Link]:
    return [Link(port, again=b"D", every=1.0) for port in site.ports.values() for _ in range(4)]


def _reconnect(site: Site) -> Sequence[Link]:
    return [Link(site.ports["control"], b"GETSTARTPOSES\r\n", lives=0.09) for _ in range(5)]


def _spawn(site: Site) -> Sequence[Link]:
    port = site.ports["control"]

    def next_name(number: int) -> First:
        return lambda count: robot(b"Storm%dx%d" % (number, count))

    return [Link(port, next_name(number), lives=0.5, reads=True) for number in range(16)]


def _failing_spawn(site: Site) -> Sequence[Link]:
    port = site.ports["control"]
    wrong = (
        robot(b"Wrong", "NoSuchClass"),
        robot(b"Wrong", where=b" {Location 9e9,nan,0}"),
        robot(b"Wrong", where=b" {Start Nowhere}"),
        robot(b"R1"),
        b"INIT {ClassName}\r\n",
        robot(b"Wrong", where=b" {Location 500,500,500}"),
    )
    return [Link(port, again=one, reads=True) for one in wrong for _ in range(2)]


def _growing(site: Site) -> Sequence[Link]:
    port = site.ports["control"]

    def next_class(start: int) -> First:
        return lambda number: robot(b"Grow%d" % start, GROWING[(start + 4 * number) % len(GROWING)])

    return [Link(port, next_class(start), lives=2.5, reads=True) for start in range(4)]


def _world_control(site: Site) -> Sequence[Link]:
    port = site.ports["control"]
    hello = b"INIT {ClassName USARBot.WorldController} {Name %s} {Location 0,0,0}\r\n"
    box = (
        b"CONTROL {Type Create} {ClassName Box} {Name Toy} {Location 3,3,-5}\r\n"
        b"CONTROL {Type AbsMove} {Name Toy} {Location 3,3,-6}\r\n"
        b"CONTROL {Type GetSTA}\r\n"
        b"CONTROL {Type Kill} {Name Toy}\r\n"
    )
    nothing = (
        b"CONTROL {Type Kill} {Name Nobody}\r\nCONTROL {Type GetSTA}\r\nCONTROL {Type Fly}\r\n"
    )
    return [
        *(Link(port, hello % b"Boss1", box, reads=True) for _ in range(2)),
        *(Link(port, hello % b"Boss2", nothing, reads=True) for _ in range(2)),
        *(Link(port, hello % b"Boss3", nothing) for _ in range(2)),
    ]


def _odd_sizes(site: Site) -> Sequence[Link]:
    """More orders than are read, each of which needs a larger model; then they hang up."""
    boss = b"INIT {ClassName USARBot.WorldController} {Name Odd} {Location 0,0,0}\r\n"
    order = b"CONTROL {Type Create} {ClassName Cube} {Name B%d} {Location 3,3,-9} {Scale %s}\r\n"
    gone = b"CONTROL {Type Kill} {Name B%d}\r\n"

    def first(number: int, count: int) -> bytes:
        sizes = (0.1 + 1e-4 * (500 * number + 50 * count + turn) for turn in range(5000))
        return boss + b"".join(
            order % (turn, b"%g,%g,%g" % (size, size, size)) + gone % turn
            for turn, size in enumerate(sizes)
        )

    port = site.ports["control"]
    return [Link(port, partial(first, number), lives=3.0) for number in range(8)]


def _half_closed(site: Site) -> Sequence[Link]:
    others = [Link(port, b"GETPOS\r\n", half_closed=True) for port in site.ports.values()]
    return [*_robots(8, b"Half", half_closed=True)(site), *others]


def _orders(site: Site) -> Sequence[Link]:
    """Everything that a robot with an arm and a camera can be told."""
    orders = (
        b"SET {Type Joint} {Name Pan} {Opcode Angle} {Params 0.5}\r\n"
        b"MISPKG {Name CameraPanTilt} {Rotation 0,0.2,0.3}\r\n"
        b"ACT {Name Arm} {Link 1} {Value 0.5}\r\n"
        b"MULTIDRIVE {FRFlipper 0.5} {FLFlipper 0.5}\r\n"
        b"SET {Type Camera} {Robot x} {Name Camera} {Client 10.0.0.1}\r\n"
        b"TRACE {On True}\r\nSET {Type Viewports} {Config QuadView}\r\n"
    )
    classes = ("P2AT", "P3AT_arm", "Kenaf", "KR60")
    return [
        Link(site.ports["control"], robot(b"Told%d" % n, name), orders, reads=True)
        for n, name in enumerate(classes)
    ]


ODD = (b"nan", b"-inf", b"1e308", b"-1e308", b"5e-324", b"0x1F", b"", b"9" * 400, b"1e-310")
"""Numbers that are none, are too large, too small, written otherwise, or very long."""


def _odd_numbers(site: Site) -> Sequence[Link]:
    classes = ("P3AT", "P2AT", "Kenaf", "AirRobot", "P3AT_arm", "Sedan")
    orders = b"".join(
        b"DRIVE {Left %s} {Right %s}\r\nDRIVE {Name Wheel1} {Steer %s}\r\n"
        b"SET {Type Joint} {Name CameraPan} {Opcode Angle} {Params %s}\r\n"
        b"MISPKG {Name CameraPanTilt} {Rotation %s,%s,0}\r\n" % ((odd,) * 6)
        for odd in ODD
    )

    def hello(number: int) -> bytes:
        name, kind = b"Odd%d" % number, classes[number % len(classes)]
        nowhere = b" {Location 0,%s,0}" % ODD[number % len(ODD)]
        return robot(name, kind, nowhere) + robot(name, kind)

    port = site.ports["control"]
    return [Link(port, hello(number), orders, every=0.1, reads=True) for number in range(34)]


def _avatars(site: Site) -> Sequence[Link]:
    hello = b"INIT {ClassName USARAvatar.USARAvatarNewMale} {Name Person%d} {Location %d,3,-1}\r\n"
    walk = (
        b"MOVE {Type Run} {Action New} {Location 4,3}\r\n"
        b"MOVE {Type Run} {Action Append} {Location 9,9}\r\nGETPATHNODES\r\n"
    )
    return [Link(site.ports["control"], hello % (n, n), walk, reads=True) for n in range(6)]


def _medley(site: Site) -> Sequence[Link]:
    port = site.ports["control"]
    dice = random.Random(0)
    garbage = (
        dice.randbytes(65_536)
        + b"{" * 16_384
        + b"".join(b"DRIVE {Left %d} {x\r\n" % number for number in range(800))
        + b"X\n" * 8192
    )
    return [
        Link(port, robot(b"Deaf")),
        Link(port, again=garbage),
        Link(port, again=b"D", every=1.0),
        Link(port, b"GETSTARTPOSES\r\n", lives=0.01),
    ]


# -- names ---------------------------------------------------------------------


def _names(site: Site) -> Sequence[Link]:
    port = site.ports["control"]
    names = (
        *(b"r1", b"R2 ", b"Evil Location 9,9,0", b"Evil} {Name R3", b"Bell\x07", b"Esc\x1b[2J"),
        *(b"Nul\x00l", b"Tab\tLocation 1,2,3", b"High\x85\xff"),
    )
    return [Link(port, robot(name), reads=True) for name in names] + [
        Link(port, b"INIT {ClassName USARBot.P3AT} {Name Two}\rlines}\r\n", reads=True),
        Link(port, robot(b"r3"), b"DRIVE {Left 1} {Right 1}\r\n", every=0.1, reads=True),
    ]


_POSITION_KEYS = [b"Name", b"Location", b"BatteryEmpty"]
_TRUTH_KEYS = [b"Name", b"Class", b"Time", b"Location", b"Rotation"]


def _forged(answers: Answers) -> Sequence[str]:
    """What is wrong with lists of robots (side channels reference 3.2, 6.1)."""
    faults = []
    for port in ("control", "groundtruth", "wireless", "truth"):
        answer = answers.get(port, b"").replace(b"\r\n", b"")
        if any(byte < 32 or 127 <= byte < 160 for byte in answer):
            faults.append(f"{port}: control characters")
    for port in ("groundtruth", "wireless"):
        groups = [
            group.rstrip(b"} \r\n").split(b" ") for group in answers.get(port, b"").split(b"{")
        ]
        if any(group[::2] != _POSITION_KEYS for group in groups[2:]):
            faults.append(f"{port}: forged fields")
        names = [group[1].lower() for group in groups[2:]]
        if len(set(names)) < len(names):
            faults.append(f"{port}: two robots of one name")
    for line in answers.get("truth", b"").split(b"\r\n")[:-2]:
        if [group.split(b" ")[0] for group in line.split(b"{")[1:]] != _TRUTH_KEYS:
            faults.append(f"truth: forged line {line[:60]!r}")
    return faults


CONTROL_ATTACKS = (
    Attack(
        "medley", "one deaf robot, garbage, a byte a second, reconnects", _medley, growth=50 * MIB
    ),
    Attack("deaf", "8 robots that never read their streams", _robots(8, b"Deaf")),
    Attack("unread-questions", "12 clients ask at full speed, never read", _asking(False)),
    Attack("questions", "12 clients ask at full speed and read", _asking(True)),
    Attack(
        "long-names",
        "names of 65,000 bytes, then questions about them on all ports, unread",
        _long_names,
        EVERYBODY,
    ),
    Attack(
        "drive",
        "10 robots send DRIVE as fast as it is taken",
        _robots(10, b"Fast", b"DRIVE {Left 0.5} {Right 0.4}\r\n", reads=True),
    ),
    Attack("garbage", "16 clients send bytes without lines, lines without sense", _garbage),
    Attack("long-lines", "lines of 63 kB and of 200 kB at full speed", _long_lines),
    Attack("drip", "a byte a second on every port", _drip, (*EVERYBODY, "comserver")),
    Attack("reconnect", "50 connections a second", _reconnect),
    Attack("spawn", "16 clients spawn and leave twice a second", _spawn, growth=128 * MIB),
    Attack("failing-spawn", "12 clients send INITs that fail, at full speed", _failing_spawn),
    Attack("growing", "4 robots of ever new classes", _growing, growth=256 * MIB),
    Attack("world-control", "6 world controllers send CONTROL at full speed", _world_control),
    Attack(
        "odd-sizes",
        "8 world controllers hang up on objects of ever new sizes",
        _odd_sizes,
        growth=128 * MIB,
    ),
    Attack("orders", "4 robots are sent orders for their every part at full speed", _orders),
    Attack(
        "odd-numbers",
        "34 robots of six classes are told numbers that are none",
        _odd_numbers,
        growth=128 * MIB,
        least=40.0,
    ),
    Attack("avatars", "6 avatars are sent about at full speed", _avatars),
    Attack("half-closed", "8 robots and clients of all ports that never send again", _half_closed),
    holding("held", "control"),
    holding("failed-held", "control", robot(b"Failed", "NoSuchClass")),
    Attack(
        "names",
        "case twins, forged fields, control characters",
        _names,
        EVERYBODY,
        faults=_forged,
    ),
    Attack("busy-machine", "six other programs take the processors", lambda _: (), busy_loops=6),
    Attack(
        "overload", "the world is to run 32 times as fast", lambda _: (), options=("--speed", "32")
    ),
)
