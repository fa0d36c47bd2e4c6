"""Who is in the world, for those who show it."""

from __future__ import annotations

from usarsim_server.cameras.feed import Identity
from usarsim_server.sessions.robots import Robots
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.avatars.avatars import Avatars
from usarsim_server.worlds.objects.objects import WorldObjects


class Census:
    """Everybody by number in the simulation; may be called by any thread, returns at once."""

    def __init__(self, robots: Robots, avatars: Avatars, objects: WorldObjects) -> None:
        """Know where everybody is to be found."""
        self._robots, self._avatars, self._objects = robots, avatars, objects

    def __call__(self, snapshot: Snapshot) -> dict[int, Identity]:
        """Robots, avatars and objects of clients, those of the snapshot at least."""
        found = {
            one.robot: Identity("robot", one.name, one.description.name)
            for one in self._robots.vehicles
        }
        for avatar, _ in self._avatars.present(snapshot):
            found[avatar.body] = Identity("avatar", avatar.name, avatar.kind.name)
        for thing, _ in self._objects.present(snapshot):
            found[thing.body] = Identity("object", thing.name, thing.kind.name)
        return found
