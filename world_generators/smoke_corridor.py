"""A corridor with everything that light and wheels dislike: smoke, a fire, sand, mud.

y= 2.7 +--------+
       |        +----------------------------------------+--------+  y= 1.2
       | starts    sand     ~~~~ smoke ~~~~   mud   fire    room   |
       |        +----------------------------------------+--------+  y=-1.2
y=-2.7 +--------+
     x=-5.4     0   2.5  5    6.7     13.3  14  16.5  18 20       24
"""

from __future__ import annotations

from usarsim_exploration.worlds import furniture
from usarsim_exploration.worlds.mjcf import Scene
from usarsim_exploration.worlds.sheet import GeneratedWorld
from world_generators.walls import WallSize, door, wall

LENGTH, HALF = 20.0, 1.2
"""Length and half width of the corridor, m."""
LOBBY, LOBBY_HALF = 5.4, 2.7
ROOM, ROOM_HALF = 4.0, 2.2
WALLS = WallSize(0.12, 2.1)

SMOKE = (LENGTH / 3, 2 * LENGTH / 3)
SAND, MUD = (2.5, 5.0), (14.0, 16.5)
FIRE = (18.0, -0.75)
SMOKE_DENSITY = 0.4
"""1/m: through the whole of it 7 % of the light get, and one sees about 10 m."""


def build() -> GeneratedWorld:
    """The corridor with its facts."""
    scene = Scene("smoke_corridor", center=(9.3, 0.0, 0.5), extent=16.0)
    world = GeneratedWorld(
        name="smoke_corridor",
        title="Smoke corridor",
        description=(
            "A corridor of 20 x 2.4 m between a lobby and a room: smoke in its middle third, a "
            "fire whose particles no laser gets through, a patch of sand and one of mud. Two "
            "victims, one of them in the smoke."
        ),
        scene=scene,
        lower=(-LOBBY, -LOBBY_HALF, -2.0),
        upper=(LENGTH + ROOM, LOBBY_HALF, 30.0),
    )
    _materials(scene)
    furniture.daylight(scene)
    scene.camera("overview", (8.0, -11.5, 27.0), (9.1, 0.3, 0.0), 37.5)
    scene.section("floor")
    scene.floor("concrete")
    _walls(scene)
    world.start_grid(
        xs=[-4.7 + 1.25 * n for n in range(4)], ys=[-1.875 + 1.25 * n for n in range(4)]
    )
    _victims(world)
    _media(world)
    _facts(world)
    return world


def _materials(scene: Scene) -> None:
    furniture.checkered_floor(scene, "concrete", (0.62, 0.63, 0.64), (0.68, 0.69, 0.70))
    scene.material("brick", (0.78, 0.72, 0.64))
    scene.material("metal", (0.45, 0.47, 0.50), shine=0.6)
    scene.material("mud", (0.36, 0.27, 0.19), shine=0.4)
    scene.material("sand", (0.84, 0.74, 0.52), shine=0.0)


def _walls(scene: Scene) -> None:
    scene.section("lobby")
    for side in (-1, 1):
        wall(scene, "wall", "x", side * LOBBY_HALF, (-LOBBY, 0.0), "brick", WALLS)
    wall(scene, "wall", "y", -LOBBY, (-LOBBY_HALF, LOBBY_HALF), "brick", WALLS)
    opening = door(0.0, 2 * HALF)
    wall(scene, "wall", "y", 0.0, (-LOBBY_HALF, LOBBY_HALF), "brick", WALLS, openings=[opening])
    scene.section("corridor")
    for side in (-1, 1):
        wall(scene, "corridor", "x", side * (HALF + 0.06), (0.0, LENGTH), "brick", WALLS)
    scene.section("room")
    wall(scene, "wall", "y", LENGTH, (-ROOM_HALF, ROOM_HALF), "brick", WALLS, openings=[opening])
    for side in (-1, 1):
        wall(scene, "wall", "x", side * ROOM_HALF, (LENGTH, LENGTH + ROOM), "brick", WALLS)
    wall(scene, "wall", "y", LENGTH + ROOM, (-ROOM_HALF, ROOM_HALF), "brick", WALLS)
    scene.section("fire: in a tray")
    scene.box("tray", (*FIRE, 0.04), (0.5, 0.5, 0.08), "metal")


def _victims(world: GeneratedWorld) -> None:
    world.victim((10.0, 0.75, 0.0), 180.0, "sitting", "Injured", figure="female")
    world.victim((22.6, -0.9, 0.0), 60.0, "lying", "Unconscious", figure="male")


def _media(world: GeneratedWorld) -> None:
    width, height = 2 * HALF, WALLS.height
    world.smoke += [
        {
            "name": "corridor smoke",
            "kind": "regional",
            "shape": "box",
            "position": (LENGTH / 2, 0.0, height / 2),
            "size": (SMOKE[1] - SMOKE[0], width, height),
            "density": SMOKE_DENSITY,
        },
        {
            "name": "fire",
            "kind": "local",
            "position": (*FIRE, height / 2),
            "size": (0.9, 0.9, height),
            "particles": 200,
            "seed": 1,
            "lifetime": 10.0,
        },
    ]
    for kind, reach in (("sand", SAND), ("mud", MUD)):
        world.surfaces.append(
            {"name": f"{kind} patch", "kind": kind, "x": reach, "y": (-HALF, HALF)}
        )


def _facts(world: GeneratedWorld) -> None:
    across = (-HALF, HALF)
    world.zones += [
        ("lobby", "flat", (-LOBBY, 0.0), (-LOBBY_HALF, LOBBY_HALF)),
        ("sand", "sand", SAND, across),
        ("smoke", "smoke", SMOKE, across),
        ("mud", "mud", MUD, across),
        ("room", "flat", (LENGTH, LENGTH + ROOM), (-ROOM_HALF, ROOM_HALF)),
    ]
    places = {"Lobby": -0.6, "Sand": 3.75, "Smoke": 10.0, "Mud": 15.25, "Room": 21.5}
    tags = list(places)
    for n, (tag, x) in enumerate(places.items()):
        beside = tuple(tags[m] for m in (n - 1, n + 1) if 0 <= m < len(tags))
        world.nodes.append((tag, (x, -0.2, 0.0), beside))
