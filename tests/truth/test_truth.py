"""Ground truth: who is told where, and between whom obstacles are counted; actors under the
engine's names, as the scoring tools ask for them.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence

import pytest
from control_harness import controller, create

from usarsim_server.protocol.values import Vector
from usarsim_server.radio.network import Station
from usarsim_server.radio.obstacles import SceneryObstacles
from usarsim_server.simulation.frames import Pose
from usarsim_server.testing import Rehearsal, RehearsedClient
from usarsim_server.truth.ground_truth import Actors, GroundTruth
from usarsim_server.worlds.description import Victim
from usarsim_server.worlds.surroundings import LiveVictim

ROBOT = Station("Robot1", (1.0, -2.0, 0.5))
BASE = Station("base", (4.0, 0.0, 1.0), battery_empty=True)


class Counter:
    """Counts one obstacle per metre of the line's x, and remembers what it was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[Vector, Vector]] = []

    def count(self, start: Vector, end: Vector) -> int:
        """Any number will do."""
        self.asked.append((start, end))
        return round(abs(end[0] - start[0]))

    def counts(self, start: Vector, ends: Sequence[Vector]) -> list[int]:
        """The same from one place to many, remembered as one question."""
        self.asked.append((start, ends[0]))
        return [round(abs(end[0] - start[0])) for end in ends]


class Town:
    """Stations that can come and go, and how often they were looked at."""

    def __init__(self, *stations: Station) -> None:
        self.stations = list(stations)
        self.looks = 0

    def __call__(self) -> list[Station]:
        self.looks += 1
        return self.stations


def truth(*stations: Station) -> tuple[GroundTruth, Town, Counter]:
    """Ground truth about some stations."""
    town, counter = Town(*stations), Counter()
    return GroundTruth(town, counter), town, counter


def test_positions_are_in_the_wire_frame_and_live() -> None:
    """Side channels 48, 49, 51, 52, 64: everybody in order, y and z turned round, as they are at
    that moment."""
    ground_truth, town, _ = truth()
    assert ground_truth.answer("GETPOS") == "POSITIONS {Robots 0}"
    town.stations = [ROBOT, BASE]
    assert ground_truth.answer("getpos") == (
        "POSITIONS {Robots 2} {Name Robot1 Location 1.0000,2.0000,-0.5000 BatteryEmpty False} "
        "{Name base Location 4.0000,0.0000,-1.0000 BatteryEmpty True}"
    )
    town.stations = [BASE]
    assert "Robot1" not in (ground_truth.answer("GETPOS") or "")


def test_robots_are_found_in_any_case_and_echoed_as_sent() -> None:
    """Side channels 56, 63: the counter gets their places, the client its own spelling back."""
    ground_truth, _, counter = truth(ROBOT, BASE)
    line = ground_truth.answer("GETOBS {From ROBOT1} {To Base}")
    assert line == "NUMOBS {From ROBOT1} {To Base} {ObstCount 3.0000}"
    assert counter.asked == [(ROBOT.position, BASE.position)]


@pytest.mark.parametrize("pair", ["{From Nobody} {To base}", "{From base} {To Nobody}"])
def test_nobody_is_at_an_unknown_distance(pair: str) -> None:
    """Side channels 58: -1.0000, and nothing is counted."""
    ground_truth, _, counter = truth(ROBOT, BASE)
    assert ground_truth.answer(f"GETOBS {pair}") == f"NUMOBS {pair} {{ObstCount -1.0000}}"
    assert counter.asked == []


def test_points_are_counted_between_without_looking_at_robots() -> None:
    """Side channels 59: echoed verbatim, turned into the simulation's frame; robots are not
    needed."""
    ground_truth, town, counter = truth(ROBOT)
    line = ground_truth.answer("GETOBS {Start 0,1,-2} {End 10.0,0,0}")
    assert line == "NUMOBS {Start 0,1,-2} {End 10.0,0,0} {ObstCount 10.0000}"
    assert counter.asked == [((0.0, -1.0, 2.0), (10.0, 0.0, 0.0))]
    assert town.looks == 0


def test_half_a_question_gets_an_empty_line_and_none_gets_nothing() -> None:
    """Side channels 60, 61: an empty text is a reply, None is no reply."""
    ground_truth, _, _ = truth(ROBOT)
    assert ground_truth.answer("GETOBS {From Robot1}") == ""
    assert ground_truth.answer("GETALL") is None


def test_questions_that_come_together_are_about_one_moment() -> None:
    """Side channels 54: many requests of one packet cost one look and keep their order."""
    ground_truth, town, _ = truth(ROBOT, BASE)
    lines = ["GETPOS", "WHAT", "GETOBS {From base} {To robot1}", "GETOBS", "GETPOS"]
    replies = ground_truth.answers(lines)
    assert [reply and reply.partition(" ")[0] for reply in replies] == [
        "POSITIONS",
        None,
        "NUMOBS",
        "",
        "POSITIONS",
    ]
    assert town.looks == 1


def test_two_robots_of_one_name_are_told_apart_by_order() -> None:
    """Side channels 3.3: the lookup takes the first."""
    twin = Station("ROBOT1", (2.0, 0.0, 0.0))
    ground_truth, _, counter = truth(ROBOT, twin, BASE)
    ground_truth.answer("GETOBS {From base} {To robot1}")
    assert counter.asked == [(BASE.position, ROBOT.position)]


# -- answers of one instant ----------------------------------------------------------------------

TEAM = [Station(f"R{number}", (float(number), 0.0, 0.5)) for number in range(16)]
PAIRS = [f"GETOBS {{From {a.name}}} {{To {b.name}}}" for a, b in itertools.permutations(TEAM, 2)]


class Instants:
    """Ground truth about the team whose looks hold for 20 ms; a test turns the clock."""

    def __init__(self) -> None:
        self.now = 5.0
        self.robots: tuple[int, ...] = (1, 2)
        self.town, self.counter = Town(*TEAM), Counter()
        self.truth = GroundTruth(
            self.town, self.counter, 0.02, lambda: self.robots, lambda: self.now
        )

    def ask(self, line: str) -> str:
        """The answer, without waiting if it is known."""
        return self.truth.at_once(line) or self.truth.answer(line) or ""


def test_all_questions_of_an_instant_take_one_look_and_one_cast_for_each_robot() -> None:
    """A wireless simulation asks for 240 pairs of 16 robots: 1 look and 16 casts, not 240 each."""
    world, apart = Instants(), truth(*TEAM)[0]
    assert [world.ask(line) for line in PAIRS] == [apart.answer(line) for line in PAIRS]
    assert world.ask("GETPOS") == apart.answer("GETPOS")
    assert world.town.looks == 1
    assert len(world.counter.asked) == len(TEAM)


def test_what_is_known_is_told_at_once_and_nothing_else() -> None:
    """Neither a look nor a cast is made for who shall not wait, and none is needed twice."""
    world = Instants()
    known = world.truth.at_once
    assert [known("GETPOS"), known(PAIRS[0])] == [None, None]
    world.truth.answer(PAIRS[0])
    assert known("GETPOS") == world.truth.answer("GETPOS")
    assert known(PAIRS[14]) == "NUMOBS {From R0} {To R15} {ObstCount 15.0000}"
    assert known(PAIRS[15]) is None, "from R1, which nothing was counted from"
    assert known("GETOBS {From R0} {To Nobody}") == (
        "NUMOBS {From R0} {To Nobody} {ObstCount -1.0000}"
    )
    assert [known("GETOBS {From R0}"), known("WHAT")] == [None, None]
    assert (world.town.looks, len(world.counter.asked)) == (1, 1)


def test_a_look_holds_for_an_instant_and_until_somebody_comes_or_goes() -> None:
    """So positions are never older than the span, and a newcomer is there at once."""
    world = Instants()
    first, version = world.ask("GETPOS"), world.truth.version()
    world.now += 0.019
    assert (world.ask("GETPOS"), world.truth.version()) == (first, version)
    world.now += 0.002
    world.town.stations = TEAM[:3]
    assert world.truth.at_once("GETPOS") is None
    assert world.ask("GETPOS").startswith("POSITIONS {Robots 3}")
    world.robots = (1, 2, 3)
    world.town.stations = TEAM[:4]
    assert world.truth.at_once("GETPOS") is None
    assert world.ask("GETPOS").startswith("POSITIONS {Robots 4}")
    assert world.town.looks == 3


def test_what_was_worked_out_too_late_is_not_kept() -> None:
    """The version of texts that were told of a look that has ended meanwhile equals no later one;
    where nobody looks at robots, it only changes with them."""
    world = Instants()
    assert world.truth.version() == world.truth.version()
    world.ask("GETPOS")
    world.now += 0.03
    assert world.truth.version() != world.truth.version()
    world.now += 0.02
    assert world.truth.version() == world.truth.version() == world.robots


def test_without_a_span_every_question_is_about_its_own_moment() -> None:
    """At `--speed max` and in lockstep: as it was before there were spans."""
    ground_truth, town, counter = truth(*TEAM)
    for line in PAIRS[:3]:
        ground_truth.answer(line)
        assert ground_truth.at_once(line) is None
    assert (town.looks, len(counter.asked)) == (3, 3)


# -- the robots of a world -----------------------------------------------------------------------


def positions(stage: Rehearsal) -> str:
    """The answer to GETPOS."""
    simulation = stage.assembly.simulation
    answer = GroundTruth(stage.assembly.robots.stations, SceneryObstacles(simulation)).answer(
        "GETPOS"
    )
    assert answer is not None
    return answer


def test_robots_of_a_world_are_stations_while_they_are_there() -> None:
    """Side channels 51, 52: robots in the order of spawning, by the names of INIT; controllers and
    avatars of the world are none; who hangs up is gone."""
    with Rehearsal(world="empty") as stage:
        clients = [stage.connect() for _ in range(4)]
        clients[0].send("INIT {ClassName USARBot.P2DX} {Name beTa} {Location 1,2,-0.3}")
        clients[1].send("INIT {ClassName USARBot.P3AT} {Name Alpha} {Location -1,0,-0.3}")
        clients[2].send("INIT {ClassName USARBot.WorldController} {Name WC} {Location 0,0,0}")
        clients[3].send("INIT {ClassName USARAvatar.NewMale} {Name Adam} {Location 5,5,-1}")
        stage.run(1.0)
        line = positions(stage)
        assert re.fullmatch(
            r"POSITIONS \{Robots 2\} "
            r"\{Name beTa Location (0\.99|1\.00)\d\d,(1\.99|2\.00)\d\d,-0\.\d{4} "
            r"BatteryEmpty False\} "
            r"\{Name Alpha Location -(0\.99|1\.00)\d\d,-?0\.00\d\d,-0\.\d{4} BatteryEmpty False\}",
            line,
        )
        clients[0].close()
        stage.settle()
        assert positions(stage).startswith("POSITIONS {Robots 1} {Name Alpha ")


def test_an_empty_battery_shows_from_its_last_second_on() -> None:
    """Side channels 64: True as soon as STA would print 0 seconds, robots without a battery
    never."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.P3AT} {Name Tired} {Location 1,2,-0.3} {Battery 3}")
        stage.run(1.5)
        assert "BatteryEmpty False" in positions(stage)
        stage.run(1.0)
        status = client.take("STA")[-1]
        assert "{Battery 0}" in status
        assert "BatteryEmpty True" in positions(stage)


def test_robots_move_in_ground_truth_as_they_move() -> None:
    """Side channels 3.2: the place is that of the moment, not of the last report."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send(
            "INIT {ClassName USARBot.P3AT} {Name R} {Location 0,0,-0.3}", "DRIVE {Left 1} {Right 1}"
        )
        stage.run(0.5)
        first = positions(stage)
        stage.run(0.004)
        assert positions(stage) != first


LINE = re.compile(
    r"\{Name (\S+)\} \{Class (\S+)\} \{Time \d+\.\d{4}\} \{Location (\S+)\} \{Rotation (\S+)\}"
)


class Scorer:
    """Asks one world."""

    def __init__(self, stage: Rehearsal) -> None:
        one = stage.assembly
        self._actors = Actors(
            one.simulation,
            one.robots.classes,
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
    """Side channels 88, 89, 94: robots under class and number, victims of either sex, avatars; no
    objects."""
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
    """Side channels 93, 98: a robot and a victim stand where INIT and the world file put them."""
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
    """Side channels 94: class and number, by figure, past the numbers that the world file uses
    itself."""
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
    """Side channels 94: tools key on names, so a newcomer never gets the name of one that has
    left."""
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
    """Side channels 90, 91, 6.1: by class and its ancestors, with or without package, by exact
    name, by both; objects under their own names and only if asked for."""
    assert yard.names(query) == names


def test_items_of_robots_go_by_their_own_names(yard: Scorer) -> None:
    """Side channels 6.1: sensors are listed where they are mounted, under the name of the item."""
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
