"""A world that is put back begins anew: everything does again what it did at first."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_server.sessions.reset import put_back
from usarsim_server.testing import Rehearsal, RehearsedClient

MOMENTS = (1.0, 1.5, 2.5)
"""s between looks."""
PLACES = {"Gate": "-4.3,-2", "Flap": "-4.2,3.2", "Lift": "4.7,-2", "Parcel": "-4.6,-5.3"}
"""Before the doors, on the lift, before a parcel."""


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """A hall with doors, a lift, belts, vehicles and things that lie about."""
    with Rehearsal(world="plant") as stage:
        yield stage


def reset(stage: Rehearsal) -> dict[str, object]:
    """Put everything back."""
    assembly = stage.assembly
    told = put_back(assembly.roles, assembly.surroundings, tuple(assembly.sessions))
    stage.settle()
    return dict(told)


def scene(stage: Rehearsal) -> dict[str, NDArray[np.float64]]:
    """Places (m) and quaternions (7,) of all bodies of the scene that can move, by name."""
    snapshot = stage.assembly.simulation.look()
    assert snapshot.world is not None
    model = snapshot.world.model
    slots = {body for layout in snapshot.world.layouts for body in layout.bodies}
    moving = [
        body
        for body in range(1, model.nbody)
        if body not in slots and (model.body_mocapid[body] >= 0 or model.body_weldid[body])
    ]
    return {
        model.body(body).name: np.concatenate((snapshot.xpos[body], snapshot.xquat[body]))
        for body in moving
    }


def play(
    stage: Rehearsal, clients: dict[str, RehearsedClient]
) -> list[dict[str, NDArray[np.float64]]]:
    """Drive ahead, through the doors and against the parcel; what is where meanwhile."""
    looks = [scene(stage)]
    for name, client in clients.items():
        speed = 0 if name == "Lift" else 6
        client.send(f"DRIVE {{Left {speed}}} {{Right {speed}}}")
    for seconds in MOMENTS:
        stage.run(seconds)
        looks.append(scene(stage))
    return looks


def test_all_of_the_scene_begins_anew(stage: Rehearsal) -> None:
    """Doors, lift, vehicles, belts and what lies on them take the same ways again."""
    clients = {name: stage.connect() for name in PLACES}
    for name, client in clients.items():
        client.send(
            f"INIT {{ClassName P3AT_real}} {{Name {name}}} {{Location {PLACES[name]},-0.3}}"
        )
    first = play(stage, clients)
    went = [name for name in first[0] if math.dist(first[0][name], first[-1][name]) > 0.05]
    moved = {"parcel_3", "gate_left", "gate_right", "flap", "lift", "cart", "sweeper"}
    assert moved <= set(went), went
    told = reset(stage)
    assert told["reset"] == list(PLACES)
    assert told["blocked"] == []
    begun = scene(stage)
    assert all(math.dist(begun[name], place) < 0.01 for name, place in first[0].items())
    again = play(stage, clients)
    for before, after in zip(first[1:], again[1:], strict=True):
        away = {name: math.dist(before[name], after[name]) for name in before}
        assert max(away.values()) < 0.08, sorted(away.items(), key=lambda one: -one[1])[:4]
    for client in clients.values():
        client.close()
    stage.run(0.2)


def test_machines_forget_what_they_were_about(stage: Rehearsal) -> None:
    """A door that was open and a lift that was up stay as they were at first when nobody comes."""
    reset(stage)
    names = ("gate_left", "gate_right", "lift")
    closed = scene(stage)
    clients = [stage.connect() for _ in range(2)]
    for name, client in zip(("Gate", "Lift"), clients, strict=True):
        client.send(
            f"INIT {{ClassName P3AT_real}} {{Name {name}}} {{Location {PLACES[name]},-0.3}}"
        )
    stage.run(5.0)
    opened = scene(stage)
    assert all(math.dist(opened[name], closed[name]) > 0.5 for name in names)
    for client in clients:
        client.close()
    stage.run(0.1)
    reset(stage)
    for _ in range(8):
        now = scene(stage)
        away = {name: math.dist(now[name], closed[name]) for name in names}
        assert max(away.values()) < 0.01, away
        stage.run(0.25)


def test_who_swapped_places_swaps_back(stage: Rehearsal) -> None:
    """Nobody blocks another who is on the way home, too."""
    clients = [stage.connect(), stage.connect()]
    for name, client, x in zip("AB", clients, (-8.0, -6.5), strict=True):
        client.send(f"INIT {{ClassName P3AT}} {{Name {name}}} {{Location {x},4,-0.3}}")
    homes = [stage.robot_state(name).pose for name in "AB"]
    controller = stage.connect()
    controller.send("INIT {ClassName USARBot.WorldController}")
    for name, place in (("A", "-8,0"), ("B", "-8,4"), ("A", "-6.5,4")):
        controller.send(f"CONTROL {{Type AbsMove}} {{Name {name}}} {{Location {place},-0.3}}")
    controller.send(
        "CONTROL {Type Create} {ClassName USARObject.Box} {Name Crate} {Location -8,2,-1}"
    )
    controller.send("CONTROL {Type AbsMove} {Name Crate} {Location -4,4,-1}")
    told = reset(stage)
    assert sorted(told["reset"]) == ["A", "B", "Crate"]  # type: ignore[call-overload]
    for name, home in zip("AB", homes, strict=True):
        assert math.dist(stage.robot_state(name).pose.position, home.position) < 0.02
    for client in (*clients, controller):
        client.close()
    stage.run(0.2)


def test_batteries_are_full_again(stage: Rehearsal) -> None:
    """A robot whose battery was empty obeys and reports again."""
    client = stage.connect()
    client.send("INIT {ClassName P3AT} {Name R} {Location -8,4,-0.3} {Battery 2}")
    stage.run(3.0)
    client.take()
    client.send("DRIVE {Left 2} {Right 2}")
    stage.run(1.0)
    assert not client.take("SEN")
    reset(stage)
    client.send("DRIVE {Left 2} {Right 2}")
    stage.run(1.0)
    assert client.take("SEN")
    assert stage.robot_state("R").pose.position[0] > -7.95
    client.close()
    stage.run(0.2)


def test_avatars_walk_again_from_where_they_came_in(stage: Rehearsal) -> None:
    """Who was on the way stands where he stood, and can be sent again."""
    client = stage.connect()
    client.send("INIT {ClassName USARAvatar.Male} {Name M} {Location -9,-3,0}")
    avatars = stage.assembly.roles.avatars

    def place() -> tuple[float, ...]:
        ((_, pose),) = avatars.present()
        return pose.position

    home = place()
    client.send("MOVE {Location -6,-3}")
    stage.run(1.5)
    assert math.dist(place(), home) > 0.5
    assert "M" in reset(stage)["reset"]  # type: ignore[operator]
    stage.run(1.0)
    assert math.dist(place(), home) < 0.02
    client.send("MOVE {Location -9,-5}")
    stage.run(1.0)
    assert place()[1] - home[1] > 0.5
    client.close()


def test_victims_do_again_what_they_did() -> None:
    """They move as in the beginning, for the eye and for sensors, and call at the same moments."""
    with Rehearsal(world="arena") as stage:
        life = stage.assembly.surroundings
        moving = [victim for victim in life.victims if victim.moves]
        assert moving
        first = [victim.parts(1.3) for victim in moving]
        calls = [sound.start for sound in life.sounds(0.0, 30.0)]
        body = moving[0].movers[0].body

        def seen() -> NDArray[np.float64]:
            snapshot = stage.assembly.simulation.look()
            assert snapshot.world is not None
            return np.array(snapshot.xpos[snapshot.world.model.body(body).id])

        client = stage.connect()
        client.send("INIT {ClassName P3AT} {Location 0,0,-0.3}")
        stage.run(1.3)
        before = seen()
        stage.run(0.9)
        reset(stage)
        now = stage.time
        stage.run(1.3)
        assert np.abs(seen() - before).max() < 1e-4
        assert all(
            math.dist(one.position, other.position) < 1e-9
            for parts, victim in zip(first, moving, strict=True)
            for one, other in zip(parts, victim.parts(now + 1.3), strict=True)
        )
        assert [sound.start for sound in life.sounds(now, now + 30.0)] == pytest.approx(
            [start + now for start in calls]
        )
