"""Puts a world back to how it began, as far as it can be, while simulated time goes on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from usarsim_server.base.errors import SpawnError
from usarsim_server.sessions.roles import Roles
from usarsim_server.sessions.session import Session
from usarsim_server.worlds.surroundings import Surroundings

PASSES = 3
"""Times that everybody is sent home: one may stand where another belongs."""

PUT_BACK = ("doors", "lifts", "obstacles", "victims", "crates", "conveyors", "tags", "batteries")
NO_WAY_BACK = (
    "simulated time",
    "what sensors have counted, such as odometry",
    "what was created, removed, renamed, or sent along a path meanwhile",
    "smoke",
)


def put_back(
    roles: Roles, surroundings: Surroundings, sessions: Iterable[Session]
) -> Mapping[str, object]:
    """Put everything back to its beginning; blocks, and simulated time stands still meanwhile.

    Robots and avatars return to where they came in, objects of world controllers to where they were
    created, at rest; everything else of the scene to where the world file has it.

    Returns:
        Names: `reset`, who is back or as near as there was room; `scene`, what else is;
        `blocked`, who is not, and why; `not_reset`, what has no way back.
    """
    simulation, done = roles.simulation, list[str]()
    with simulation.standing():
        simulation.restart_scene()
        surroundings.restart(simulation.now)
        left = roles.robots.ways_home() + roles.objects.ways_home() + roles.avatars.ways_home()
        blocked: dict[str, str] = {}
        for last in (number == PASSES for number in range(1, PASSES + 1)):
            waiting, left, blocked = left, [], {}
            for name, go in waiting:
                try:
                    there = go()
                except SpawnError as error:
                    there, blocked[name] = False, f"{name}: {error}"
                if there or (last and name not in blocked):
                    done.append(name)
                else:
                    left.append((name, go))
        for session in sessions:
            session.intervene(lambda role: role.restart(simulation.now))
    return {
        "reset": done,
        "scene": list(PUT_BACK),
        "blocked": list(blocked.values()),
        "not_reset": list(NO_WAY_BACK),
    }
