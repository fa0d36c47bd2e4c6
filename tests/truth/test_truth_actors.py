"""Actors under the engine's names, as the scoring tools ask for them."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from control_harness import controller, create

from usarsim_server.simulation.frames import Pose
from usarsim_server.testing import Rehearsal, RehearsedClient
from usarsim_server.truth.actors import Actors
from usarsim_server.worlds.description import Victim
from usarsim_server.worlds.surroundings import LiveVictim

LINE = re.compile(
    r"\{Name (\S+)\} \{Class (\S+)\} \{Time \d+\.\d{4}\} \{Location (\S+)\} \{Rotation (\S+)\}"
)


class Scorer:
    """Asks one world."""

    def __init__(self, stage: Rehearsal) -> None:
        one = stage.assembly
        self._actors = Actors(
            one.simulation,
            one.fleet.classes,
            one.surroundings.victims,
            one.roles.avatars,
            one.roles.objects,
        )

    def ask(self, query: str = "") -> list[tuple[str, str, list[float], list[float]]]:
        """Name, class, location and rotation of everybody in the listing."""
        *lines, end, rest = self._actors.answer(query).split("\r\n")
        assert (end, rest) == ("{End}", "")
        rows = []
        for line in lines:
            match = LINE.fullmatch(line)
            assert match is not None, line
            place, turn = ([float(part) for part in text.split(",")] for text in match.group(3, 4))
            rows.append((match[1], match[2], place, turn))
        return rows

    def names(self, query: str = "") -> list[str]:
        """Names of everybody in the listing."""
        return [row[0] for row in self.ask(query)]


@pytest.fixture(scope="module")
def arena() -> Iterator[Rehearsal]:
    """A world with victims."""
    with Rehearsal(world="arena", max_robots=8) as stage:
        yield stage


def robot(stage: Rehearsal, name: str, place: str, kind: str = "P3AT") -> RehearsedClient:
    """A connection with a robot."""
    client = stage.connect()
    client.send(f"INIT {{ClassName USARBot.{kind}}} {{Name {name}}} {{Location {place}}}")
    return client


def test_everybody_who_walks_or_drives_is_listed(arena: Rehearsal) -> None:
    """88, 89, 94: robots under class and number, victims of either sex, avatars; no objects."""
    scorer = Scorer(arena)
    robots = [robot(arena, "Anna", "1,0,-0.3"), robot(arena, "Otto", "-1,0,-0.3", "P2DX")]
    robots.append(robot(arena, "Bert", "3,0,-0.3"))
    boxes, person = controller(arena), arena.connect()
    create(boxes, "a_box", "3,3,-1")
    person.send("INIT {ClassName USARAvatar.Male} {Name Adam} {Location 0,3,-1}")
    names = scorer.names()
    assert names[:3] == ["P3AT_0", "P2DX_0", "P3AT_1"]
    assert names[-1] == "USARAvatarNewMale_0"
    victims = names[3:-1]
    assert victims == [one.name for one in arena.assembly.surroundings.victims]
    assert all(re.fullmatch(r"(Fem|M)aleVictim_\d+", name) for name in victims)
    assert len(set(names)) == len(names)
    assert scorer.names("{Actors}") == scorer.names("nonsense") == names
    assert "a_box" in scorer.names("{class Engine.Actor}")
    for client in (*robots, person):
        client.close()
    boxes.send("CONTROL {Type KillAll}")
    arena.settle()
    assert scorer.names() == victims


def test_poses_are_those_of_the_wire(arena: Rehearsal) -> None:
    """93, 98: a robot and a victim stand where INIT and the world file put them."""
    client = robot(arena, "R", "1,0.5,-0.3")
    arena.run(0.5)
    scorer = Scorer(arena)
    (row,) = scorer.ask("{class P3AT}")
    assert row[2] == pytest.approx([1.0, 0.5, -0.15], abs=0.02)
    assert row[3] == pytest.approx([0.0, 0.0, 0.0], abs=0.02)
    victim = arena.assembly.world.victims[0]
    (found,) = scorer.ask(f"{{class pawn}} {{name {victim.name}}}")
    x, y, z = victim.pose.position
    assert found[2] == pytest.approx([x, -y, -z], abs=0.006)
    client.close()
    arena.settle()


def test_victims_with_names_of_their_own_get_an_engines(arena: Rehearsal) -> None:
    """94: class and number, by figure, past the numbers that the world file uses itself."""
    names = {"Bob": None, "MaleVictim_2": None, "Eve": "female", "MaleVictim_x": "male"}
    people = [
        LiveVictim(
            Victim(name, Pose(), "lying", "Alive", {"figure": figure} if figure else {}), None
        )
        for name, figure in names.items()
    ]
    one = arena.assembly
    actors = Actors(one.simulation, lambda: (), people, one.roles.avatars, one.roles.objects)
    assert [(class_name, name) for _, class_name, name in actors._victims] == [
        ("MaleVictim", "MaleVictim_3"),
        ("MaleVictim", "MaleVictim_2"),
        ("FemaleVictim", "FemaleVictim_0"),
        ("MaleVictim", "MaleVictim_4"),
    ]


def test_names_are_never_used_twice(arena: Rehearsal) -> None:
    """94: tools key on names, so a newcomer never gets the name of one that has left."""
    scorer = Scorer(arena)
    first = robot(arena, "A", "1,0,-0.3")
    assert scorer.names("{class USARBot.P3AT}") == ["P3AT_0"]
    second = robot(arena, "A", "-1,0,-0.3")
    assert scorer.names("{class USARBot.P3AT}") == ["P3AT_0", "P3AT_1"]
    first.close()
    arena.settle()
    assert scorer.names("{class USARBot.P3AT}") == ["P3AT_1"]
    third = robot(arena, "A", "1,0,-0.3")
    assert scorer.names("{class USARBot.P3AT}") == ["P3AT_1", "P3AT_2"]
    for client in (second, third):
        client.close()
    arena.settle()


@pytest.fixture(scope="module")
def yard() -> Iterator[Scorer]:
    """An empty world with two robots and three objects that nobody changes."""
    with Rehearsal(world="empty") as stage:
        robot(stage, "One", "0,0,-0.3")
        robot(stage, "Two", "2,0,-0.3", "P2DX")
        boxes = controller(stage)
        create(boxes, "part_c_5", "5,5,-1", ClassName="USARPhysObj.partc")
        create(boxes, "part_c_6", "5,6,-1", ClassName="USARPhysObj.partc")
        create(boxes, "Crate", "5,8,-1", ClassName="USARPhysObj.WCCrate")
        yield Scorer(stage)


PARTS = ["part_c_5", "part_c_6"]
OBJECTS = [*PARTS, "Crate"]


@pytest.mark.parametrize(
    ("query", "names"),
    [
        ("{class USARBot.P3AT}", ["P3AT_0"]),
        ("{CLASS usarbot.p3at}", ["P3AT_0"]),
        ("{class USARBot.SkidSteeredVehicle}", ["P3AT_0", "P2DX_0"]),
        ("{class USARBot.USARVehicle}", ["P3AT_0", "P2DX_0"]),
        ("{class Engine.Pawn}", ["P3AT_0", "P2DX_0"]),
        ("{class USARBot.Zeppelin}", []),
        ("{class .}", []),
        ("{name P3AT_0}", ["P3AT_0"]),
        ("{NAME P3AT_0}", ["P3AT_0"]),
        ("{name p3at_0}", []),
        ("{name One}", []),
        ("{name Crate}", []),
        ("{class USARBot.P2DX} {name P3AT_0}", []),
        ("{class USARPhysObj.partc}", PARTS),
        ("{class partc}", PARTS),
        ("{class USARPhysObj.partc} {name part_c_6}", ["part_c_6"]),
        ("{class USARBotAPI.WCObject}", OBJECTS),
    ],
)
def test_queries_find_what_they_ask_for(yard: Scorer, query: str, names: list[str]) -> None:
    """90, 91, 6.1: by class and its ancestors, with or without package, by exact name, by both;
    objects under their own names and only if asked for."""
    assert yard.names(query) == names


def test_items_of_robots_go_by_their_own_names(yard: Scorer) -> None:
    """6.1: sensors are listed where they are mounted, under the name of the item."""
    lasers = yard.ask("{class USARSensor.SICK}")
    sonars = yard.ask("{class USARSensor.Sonar} {name F1}")
    assert [row[:2] for row in lasers] == [("lms200", "SICK")]
    assert [row[:2] for row in sonars] == [("F1", "Sonar")]  # P2DX has it, P3AT has none
    for (_, _, place, *_), name in ((lasers[0], "P3AT_0"), (sonars[0], "P2DX_0")):
        (body,) = [row[2] for row in yard.ask(f"{{name {name}}}")]
        assert place != body
        assert place == pytest.approx(body, abs=0.4)
    assert "F1" in yard.names("{class Item}")
    assert "F1" not in yard.names()
