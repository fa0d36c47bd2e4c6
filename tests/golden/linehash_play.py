"""Plays robot classes and sessions in rehearsals and keeps all lines that clients get, to the byte.

The server runs in this process, through `usarsim_server.testing`: only there does time pass without
a clock.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from linehash_script import BEFORE, DIALECTS, STEPS, init
from linehash_yard import APART, write_robots, write_yard
from sharing import shared_parts

from usarsim_server.testing import Rehearsal, RehearsedClient

Lines = dict[str, list[bytes]]
"""All lines of the clients of a session, by client, in order, with their ends."""

WORLDS = ("arena", "office", "plant", "proving_ground", "smoke_corridor")
WATCH = 2.0
"""Simulated s in each of these worlds."""


class Grounds:
    """The world and the robot files that classes are played with.

    Attributes:
        world: folder of the yard.
        robots: folder of the class that has every sensor.
    """

    def __init__(self, folder: Path) -> None:
        """Write both into a folder."""
        self.world = write_yard(folder)
        self.robots = write_robots(folder)

    def rehearsal(self, **settings: object) -> Rehearsal:
        """A rehearsal in the yard, or in another world."""
        values = {"world": str(self.world), "robots": (self.robots,), **settings}
        return Rehearsal(**values)


@contextlib.contextmanager
def grounds() -> Iterator[Grounds]:
    """Grounds in a temporary folder; inside, servers of this process share what is dear to make."""
    with tempfile.TemporaryDirectory() as folder, shared_parts(own_robots=True):
        yield Grounds(Path(folder))


class Listener(RehearsedClient):
    """A client that keeps what it is sent to the byte."""

    def __init__(self, rehearsal: Rehearsal, name: str) -> None:
        self.heard: list[bytes] = []
        super().__init__(rehearsal, name)

    def hear(self, line: bytes) -> None:
        self.heard.append(line)
        super().hear(line)

    def say(self, *commands: str) -> None:
        """Send commands, each when the one before has been executed."""
        for command in commands:
            self.send(command)


def play(name: str, place: Grounds) -> Lines:
    """Play a robot class, or one of `SESSIONS`."""
    session = SESSIONS.get(name)
    return _play_class(name, place) if session is None else session(place)


def _play_class(robot: str, place: Grounds) -> Lines:
    """Play a class in both dialects at once: one robot at each place of the yard."""
    with place.rehearsal(max_robots=4) as rehearsal:
        clients = [Listener(rehearsal, f"{dialect}:1") for dialect in DIALECTS]
        for number, (client, dialect) in enumerate(zip(clients, DIALECTS, strict=True)):
            client.say(*BEFORE, init(robot, number, dialect, APART))
        for words, seconds in STEPS:
            if words is not None:
                for client, dialect in zip(clients, DIALECTS, strict=True):
                    client.say(*words(client.lines, dialect))
            rehearsal.run(seconds)
        return _heard(zip(DIALECTS, clients, strict=True))


def _heard(clients: Iterable[tuple[str, Listener]]) -> Lines:
    return {name: list(client.heard) for name, client in clients}


# -- sessions ------------------------------------------------------------------------------------


def _control(place: Grounds) -> Lines:
    """World controllers of both dialects, avatars that walk, and robots that see and feel them."""
    with place.rehearsal(max_robots=8, max_objects=32) as rehearsal:
        names = ("controller", "controller-udk", "watcher", "pusher", "walker", "runner", "flat")
        clients = {name: Listener(rehearsal, f"{name}:1") for name in names}
        old, new, watcher, pusher, walker, runner, flat = clients.values()
        old.say("CONTROL {Type GetSTA}", "INIT {ClassName USARBot.WorldController} {Name WC}")
        new.say("INIT {ClassName USARBotAPI.WorldController} {Name WC2} {Location 0,0,0}")
        watcher.say("INIT {ClassName USARBot.EverySensor} {Name Watcher} {Start Place0}")
        pusher.say("INIT {ClassName USARBot.P3AT} {Name Pusher} {Location -2,5,-0.4}")
        flat.say("INIT {ClassName USARBot.P2AT} {Name Flat} {Location -8,0,-0.4} {Battery 2.5}")
        walker.say("INIT {ClassName USARAvatar.USARAvatarNewMale} {Name Walker} {Location 3,3,-1}")
        runner.say(
            "INIT {ClassName USARAvatar.USARAvatarNewFemale} {Name Runner} {Location 1,-4,-1} "
            "{Rotation 0,0,1} {Dialect udk}"
        )
        rehearsal.run(0.4)
        _control_create(old, new)
        pusher.say("DRIVE {Left 1.2} {Right 1.2}")
        flat.say("DRIVE {Left 2} {Right 1}")
        walker.say("MOVE {Type Walk_Forward} {Action New} {Location 2,2}")
        walker.say("MOVE {Type Run} {Action Append} {Location 4,3.5}")
        runner.say("MOVE {Type Run} {Action New} {Pathnode Near0}", "GETPATHNODES")
        rehearsal.run(1.0)
        _control_move(old, new)
        watcher.say("DRIVE {Left 1.5} {Right 1.5}")
        walker.say("MOVE {Action Pause}")
        runner.say("GOTO {Name Far0}")
        rehearsal.run(1.0)
        old.say("CONTROL {Type GetSTA}", "CONTROL {Type Conveyor} {Name line} {Speed -2}")
        new.say("CONTROL {Type GetSTA} {ClassName Box}", "CONTROL {Type GetSTA} {Name b}")
        walker.say("MOVE {Action Resume}")
        runner.say("MOVE {Type Walk_Backward} {Action New} {Location 2.0, -3.0}")
        flat.say("GETCONF {Type Robot}", "DRIVE {Left 1} {Right 1}", "SET {Type Camera} {FOV 1}")
        rehearsal.run(1.3)
        old.say(
            "CONTROL {Type ClearWP} {Name b}",
            "CONTROL {Type Rotate} {Name a} {Speed 0,0,0}",
            "CONTROL {Type Kill} {Name C}",
            "CONTROL {Type KillAll} {MinPos -20,-20,-3} {MaxPos 2,20,3}",
            "CONTROL {Type GetSTA}",
        )
        rehearsal.run(0.5)
        old.close()
        rehearsal.settle()
        rehearsal.run(0.4)
        new.say("CONTROL {Type GetSTA}", "CONTROL {Type KillAll}", "CONTROL {Type GetSTA}")
        pusher.close()
        rehearsal.run(0.4)
        return _heard(clients.items())


def _control_create(old: Listener, new: Listener) -> None:
    """Objects of all kinds of Physics, scaled, coloured, refused."""
    create = "CONTROL {Type Create}"
    old.say(
        f"{create} {{ClassName WCCrate}} {{Name a}} {{Location -1,5,-0.25}} {{Physics RigidBody}}",
        f"{create} {{ClassName Box}} {{Name b}} {{Location 2,0.5,-0.15}} {{Memory red}}",
        f"{create} {{ClassName Box}} {{Name B}} {{Location 5,0.5,-0.15}}",
        f"{create} {{ClassName Box}} {{Name in}} {{Location 2,0.5,-0.15}}",
        f"{create} {{ClassName USARPhysObj.Barrel}} {{Name c}} {{Location 3,0,-2}} "
        "{Physics Falling} {Rotation 0.3,0,0.5}",
        f"{create} {{ClassName Cube}} {{Name d}} {{Location 6,1,-0.5}} {{Scale 0.3,0.5,1}} "
        "{Material Glass} {Permanent true}",
        f"{create} {{ClassName Ball}} {{Name e}} {{Location 1,-1,-1}} {{Physics RigidBody}}",
        f"{create} {{ClassName Ramp}} {{Start Place1}} {{Physics Ground}}",
        f"{create} {{ClassName Nonsense}} {{Name f}} {{Location 1,1,-1}}",
    )
    new.say(
        f"{create} {{ClassName TrafficCone}} {{Name cone}} {{Location 3, -1, -0.5}} "
        "{Physics Falling} {Memory two words}",
        f"{create} {{ClassName parta}} {{Name part}} {{Location -5,0,-0.5}} {{Physics RigidBody}}",
        "CONTROL {Type GetSTA}",
    )


def _control_move(old: Listener, new: Listener) -> None:
    """Every way to move objects and robots."""
    old.say(
        "CONTROL {Type GetSTA}",
        "CONTROL {Type RelMove} {Name d} {Location -1,0.2,0} {Rotation 0,0,0.4}",
        "CONTROL {Type AbsMove} {Name e} {Location 1.5,-1,-1.5}",
        "CONTROL {Type AbsMove} {Name Flat} {Location -8,3,-0.3} {Rotation 0,0,1}",
        "CONTROL {Type Rotate} {Name a} {Speed 0,0,0.8}",
        "CONTROL {Type SetWP} {Name b} {Speed 0.7} {Loop true} {ResetOnClear true}",
        "CONTROL {Type AddWP} {Name b} {WP 2,1,-0.15;3,1,-0.15;2,0,-0.15}",
        "CONTROL {Type SetWP} {Name b} {Time 0.5}",
        "CONTROL {Type Explode} {Name b}",
    )
    new.say("CONTROL {Type RelMove} {Name cone} {Location 0,0,-1}", "CONTROL {Type GetSTA}")


def _grip(place: Grounds) -> Lines:
    """In both dialects an arm takes a parcel off a table, and a cup on a tool changer holds a case.

    The parcel stands where the fingers of P3AT_arm get, the case where the cup of KR60 does.
    """
    with place.rehearsal(max_robots=8) as rehearsal:
        clients = {"controller": Listener(rehearsal, "controller:1")}
        controller = clients["controller"]
        controller.say("INIT {ClassName USARBot.WorldController} {Name WC}")
        for number, dialect in enumerate(DIALECTS):
            y = -APART * number
            things = (
                ("Cube", "table", f"0.5,{y + 0.0437:g},-0.275", "{Scale 0.12,0.4,0.55}"),
                ("partc", "parcel", f"0.5,{y + 0.0437:g},-0.6", "{Physics RigidBody}"),
                ("Cube", "case", f"-8.2,{y:g},-0.2", "{Scale 0.4,0.4,0.4} {Physics RigidBody}"),
            )
            for kind, name, where, more in things:
                controller.say(
                    f"CONTROL {{Type Create}} {{ClassName {kind}}} {{Name {name}{number}}} "
                    f"{{Location {where}}} {more}"
                )
            for robot, where in (("P3AT_arm", f"0,{y:g},-0.146"), ("KR60", f"-10,{y:g},0")):
                clients[f"{dialect}-{robot}"] = Listener(rehearsal, f"{dialect}:1")
                clients[f"{dialect}-{robot}"].say(
                    f"INIT {{ClassName {robot}}} {{Name {robot}{number}}} {{Location {where}}} "
                    f"{{Dialect {dialect}}}"
                )
        rehearsal.run(0.5)
        for arm, cup, seconds in GRIP:
            for dialect in DIALECTS:
                clients[f"{dialect}-P3AT_arm"].say(*arm)
                clients[f"{dialect}-KR60"].say(*cup)
            rehearsal.run(seconds)
            controller.say("CONTROL {Type GetSTA}")
        return _heard(clients.items())


def _reach(shoulder: float, elbow: float, wrist: float) -> str:
    """An order to the arm of P3AT_arm; MISPKG is understood in both dialects."""
    groups = ((2, shoulder), (3, elbow), (5, wrist))
    links = " ".join(f"{{Link {link}}} {{Value {value:g}}} {{Order 0}}" for link, value in groups)
    return f"MISPKG {{Name P3ATArm}} {links}"


_CLOSE = "SET {Type Gripper} {Opcode CLOSE}"
_OPEN = "SET {Type Gripper} {Opcode OPEN}"

GRIP: tuple[tuple[tuple[str, ...], tuple[str, ...], float], ...] = (
    (
        (_reach(1.2289, -1.9618, 0.7329),),
        (
            "MISPKG {Name KR60Arm} {Link 2} {Value -0.638} {Order 0} {Link 3} {Value -0.315} "
            "{Order 0} {Link 5} {Value 0.618} {Order 0}",
        ),
        1.8,
    ),
    ((_reach(1.0286, -1.6579, 0.6293),), (), 0.4),
    ((_reach(0.8152, -1.3016, 0.4864),), (), 0.4),
    ((_reach(0.5491, -0.8261, 0.2771),), (), 0.7),
    ((_CLOSE,), (_CLOSE,), 0.8),
    (
        (_reach(1.0394, -0.9271, -0.1124),),
        ("MISPKG {Name KR60Arm} {Link 2} {Value 0.2} {Order 1}",),
        0.8,
    ),
    ((_OPEN,), (_OPEN, "SET {Type ToolChanger} {Opcode OPEN}"), 0.6),
    ((), ("SET {Type ToolChanger} {Opcode CLOSE}", "GETCONF {Type Gripper}"), 0.4),
)
"""What the arm and the cup are told, and the simulated s that pass then."""


def _worlds(place: Grounds) -> Lines:
    """A rover with every sensor, a tracked robot and a walker in every shipped world."""
    lines: Lines = {}
    for world in WORLDS:
        with place.rehearsal(world=world, max_robots=4, seed=7) as rehearsal:
            rover = Listener(rehearsal, "rover:1")
            tracks = Listener(rehearsal, "tracks:1")
            rover.say("GETSTARTPOSES", "GETPATHNODES")
            starts = [
                name
                for name in rover.lines[0].replace("{", " ").replace("}", " ").split()
                if name[0].isalpha()
            ][2:]
            rover.say(f"INIT {{ClassName EverySensor}} {{Name R}} {{Start {starts[0]}}}")
            tracks.say(f"INIT {{ClassName Kenaf}} {{Name T}} {{Start {starts[-1]}}}")
            rehearsal.run(0.3)
            rover.say("DRIVE {Left 3} {Right 3}")
            tracks.say("DRIVE {Left 4} {Right 4}", "MULTIDRIVE {FRFlipper 0.5} {FLFlipper 0.5}")
            rehearsal.run(WATCH - 0.3)
            lines |= _heard(((f"{world}.rover", rover), (f"{world}.tracks", tracks)))
    return lines


def _places(place: Grounds) -> Lines:
    """Robots that start where they cannot stay, and one that falls out of the world."""
    with place.rehearsal(max_robots=8, max_objects=4) as rehearsal:
        wishes = {
            "wall": "INIT {ClassName P3AT} {Name Wall} {Location 8,0.5,-0.3}",
            "same": "INIT {ClassName P3AT} {Name Wall} {Location 8,0.5,-0.3} {Dialect udk}",
            "outside": "INIT {ClassName P2AT} {Name Out} {Location 4000,0,-0.3}",
            "sunk": "INIT {ClassName TeleMax} {Name Sunk} {Location -6,6,0.5} {Rotation 0,0.4,0}",
            "tag": "INIT {Classname USARBot.P2DX} {Name Tag} {Start Nowhere}",
            "nobody": "INIT {ClassName Nobody} {Location 1,1,1}",
        }
        clients = {name: Listener(rehearsal, f"{name}:1") for name in wishes}
        for name, wish in wishes.items():
            clients[name].say(wish)
        rehearsal.run(0.6)
        controller = Listener(rehearsal, "controller:1")
        controller.say("INIT {ClassName USARBot.WorldController} {Name WC}")
        for name in wishes:
            clients[name].say("DRIVE {Left 2} {Right 2}", "INIT {ClassName Zerg} {Name Second}")
        rehearsal.run(0.6)
        controller.say(
            "CONTROL {Type AbsMove} {Name Tag} {Location -8,-8,40}",
            "CONTROL {Type AbsMove} {Name Out} {Location 8,0.5,-0.3}",
            "CONTROL {Type RelMove} {Name Sunk} {Location 0,0,-1} {Rotation 3.1,0,0}",
        )
        clients["same"].close()
        rehearsal.run(1.2)
        clients["tag"].say("INIT {ClassName P2DX} {Name Again} {Location -8,-8,-0.3}")
        clients["sunk"].say("DRIVE {Flip True}")
        rehearsal.run(0.8)
        return _heard(clients.items())


def _plant(place: Grounds) -> Lines:
    """Robots before a door and a flap, on a lift and on a belt of the world `plant`."""
    with place.rehearsal(world="plant", max_robots=8) as rehearsal:
        places = {
            "gate": "-4.4,-2.0,-0.3",
            "flap": "-4.4,3.2,-0.3",
            "lift": "4.9,-2.0,-0.4",
            "belt": "1.0,4.4,-0.4",
        }
        clients = {name: Listener(rehearsal, f"{name}:1") for name in places}
        for name, where in places.items():
            clients[name].say(f"INIT {{ClassName P3AT_real}} {{Name {name}}} {{Location {where}}}")
        rehearsal.run(0.4)
        for name in ("gate", "flap"):
            clients[name].say("DRIVE {Left 100} {Right 100} {Normalized True}")
        rehearsal.run(4.6)
        return _heard(clients.items())


def _lockstep(place: Grounds) -> Lines:
    """Ticks and their SYNC, for a robot of each dialect."""
    with place.rehearsal(lockstep=True, tick=0.1, max_robots=4, second_init="replace") as rehearsal:
        clients = [Listener(rehearsal, f"{dialect}:1") for dialect in DIALECTS]
        for number, (client, dialect) in enumerate(zip(clients, DIALECTS, strict=True)):
            client.say(init("P3AT", number, dialect, APART))
        for tick in range(10):
            for client in clients:
                client.say(f"DRIVE {{Left {tick}}} {{Right 1}}", "SYNC")
            rehearsal.run(0.1)
        for number, (client, dialect) in enumerate(zip(clients, DIALECTS, strict=True)):
            client.say(init("AirRobot", number, dialect, APART), "SYNC {Ticks 3}", "DRIVE {Flip 1}")
        rehearsal.run(0.3)
        return _heard(zip(DIALECTS, clients, strict=True))


SESSIONS: dict[str, Callable[[Grounds], Lines]] = {
    "Worlds": _worlds,
    "Plant": _plant,
    "Places": _places,
    "Grip": _grip,
    "Lockstep": _lockstep,
    "Control": _control,
}
"""Sessions of several clients by name; world controllers and avatars last."""
