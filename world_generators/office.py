"""One floor of an office building without its ceiling, so that cameras can look in.

y=10  +---------+-------+-------+-------+-------+
      | meeting |  N1   |  N2   |  N3   |  N4   |
y=4   +--glass--+       |       |       |       |
      | lobby   +--  ---+--  ---+--  ---+--  ---+  y=1.1
      | starts           corridor               |
      |         +-  --+-  --+-  --+-  --+-  ----+  y=-1.1
y=-4  +---  ----+ S1  | S2  | S3  | S4  |  S5   |
      | kitchen |     |     |     |     |  S6   |
y=-10 +---------+-----+-----+-----+-----+-------+
      x=-15    -7                              15
"""

from __future__ import annotations

from usarsim_exploration.worlds import furniture
from usarsim_exploration.worlds.mjcf import Movable, Scene, turned
from usarsim_exploration.worlds.sheet import GeneratedWorld
from world_generators.walls import WallSize, door, wall, window

HALF_X, HALF_Y = 15.0, 10.0
LOBBY_EDGE, LOBBY_HALF, CORRIDOR_HALF = -7.0, 4.0, 1.1
HEIGHT, OUTER, INNER = 2.5, 0.3, 0.12

NORTH = (-7.0, -1.5, 4.0, 9.5, 15.0)
SOUTH = (-7.0, -2.6, 1.8, 6.2, 10.6, 15.0)

Range = tuple[float, float]

ROOMS: dict[str, tuple[str, Range, Range]] = {
    "lobby": ("lobby", (-15.0, -7.0), (-4.0, 4.0)),
    "corridor": ("corridor", (-7.0, 15.0), (-1.1, 1.1)),
    "meeting": ("meeting room", (-15.0, -7.0), (4.0, 10.0)),
    "kitchen": ("kitchen", (-15.0, -7.0), (-10.0, -4.0)),
    "north1": ("open plan office", (-7.0, -1.5), (1.1, 10.0)),
    "north2": ("open plan office", (-1.5, 4.0), (1.1, 10.0)),
    "north3": ("open plan office", (4.0, 9.5), (1.1, 10.0)),
    "north4": ("library", (9.5, 15.0), (1.1, 10.0)),
    "south1": ("office", (-7.0, -2.6), (-10.0, -1.1)),
    "south2": ("office", (-2.6, 1.8), (-10.0, -1.1)),
    "south3": ("lounge", (1.8, 6.2), (-10.0, -1.1)),
    "south4": ("store", (6.2, 10.6), (-10.0, -1.1)),
    "south5": ("server room", (10.6, 15.0), (-5.0, -1.1)),
    "south6": ("workshop", (10.6, 15.0), (-10.0, -5.0)),
}

WAYS: tuple[tuple[str, tuple[float, float], tuple[str, ...]], ...] = (
    ("Lobby", (-9.0, 0.0), ("West", "MeetingDoor", "KitchenDoor")),
    ("West", (-5.9, 0.0), ("Lobby", "North1", "South1Door")),
    ("South1Door", (-3.7, 0.0), ("West", "South1", "North2Door")),
    ("North2Door", (-0.4, 0.0), ("South1Door", "North2", "Centre")),
    ("Centre", (0.2, 0.0), ("North2Door", "South2Door")),
    ("South2Door", (0.7, 0.0), ("Centre", "South2", "East")),
    ("East", (5.1, 0.0), ("South2Door", "North3", "Lounge", "StoreDoor")),
    ("StoreDoor", (7.3, 0.0), ("East", "Store", "LibraryDoor")),
    ("LibraryDoor", (10.6, 0.0), ("StoreDoor", "Library", "End")),
    ("End", (11.2, 0.0), ("LibraryDoor", "ServersDoor")),
    ("ServersDoor", (11.7, 0.0), ("End", "Servers")),
    ("MeetingDoor", (-8.4, 3.4), ("Lobby", "Meeting")),
    ("Meeting", (-8.4, 5.0), ("MeetingDoor",)),
    ("KitchenDoor", (-9.5, -3.3), ("Lobby", "Kitchen")),
    ("Kitchen", (-10.6, -6.4), ("KitchenDoor",)),
    ("North1", (-5.9, 1.9), ("West",)),
    ("North2", (-0.4, 1.9), ("North2Door",)),
    ("North3", (5.1, 1.9), ("East",)),
    ("Library", (10.6, 2.2), ("LibraryDoor",)),
    ("South1", (-3.7, -2.4), ("South1Door",)),
    ("South2", (0.7, -2.4), ("South2Door",)),
    ("Lounge", (5.1, -2.6), ("East",)),
    ("Store", (7.3, -2.4), ("StoreDoor",)),
    ("Servers", (11.7, -2.2), ("ServersDoor",)),
)
"""Path nodes: tag, place on the floor, neighbours. A corridor node stands before every door."""


def build() -> GeneratedWorld:
    """The office with its facts."""
    scene = Scene("office", center=(0.0, 0.0, 0.5), extent=17.0)
    world = GeneratedWorld(
        name="office",
        title="Office floor",
        description=(
            "One floor of an office building of 30 x 20 m: lobby, corridor and twelve rooms with "
            "doorways of 1 m, furniture, glass walls, concrete and brick. Six victims; chairs, "
            "bins and boxes can be pushed."
        ),
        scene=scene,
        lower=(-HALF_X, -HALF_Y, -2.0),
        upper=(HALF_X, HALF_Y, 30.0),
    )
    _materials(scene)
    furniture.daylight(scene)
    scene.camera("overview", (-4.5, -20.0, 24.0), (0.0, -1.0, 0.0), 42.5)
    _floors(scene)
    _outer_walls(scene)
    _inner_walls(scene)
    _lobby_and_meeting(scene)
    _kitchen(scene)
    _open_plan(scene)
    _library(scene)
    _offices(scene)
    _lounge(scene)
    _store_and_servers(scene)
    _workshop(scene)
    _movables(scene)
    world.start_grid(xs=[-13.5 + 1.5 * n for n in range(4)], ys=[-2.25 + 1.5 * n for n in range(4)])
    _victims(world)
    _facts(world)
    return world


def _materials(scene: Scene) -> None:
    tiles = furniture.floor_tiles
    tiles(scene, "floor_stone", (0.74, 0.73, 0.70), (0.62, 0.61, 0.58))
    tiles(scene, "floor_kitchen", (0.78, 0.80, 0.78), (0.60, 0.63, 0.62), per_metre=2.0)
    tiles(scene, "floor_parquet", (0.66, 0.50, 0.33), (0.56, 0.41, 0.26), per_metre=2.0)
    tiles(scene, "floor_rubber", (0.42, 0.45, 0.46), (0.36, 0.39, 0.40))
    scene.material("carpet_blue", (0.38, 0.47, 0.56), shine=0.0)
    scene.material("carpet_green", (0.45, 0.54, 0.45), shine=0.0)
    scene.material("carpet_sand", (0.70, 0.63, 0.51), shine=0.0)
    scene.material("carpet_red", (0.58, 0.36, 0.32), shine=0.0)
    scene.material("grass", (0.53, 0.60, 0.45), shine=0.0)
    scene.material("concrete", (0.70, 0.70, 0.68))
    scene.material("brick", (0.87, 0.83, 0.76))
    scene.material("brick_red", (0.68, 0.40, 0.31))
    scene.material("glass", (0.60, 0.80, 0.88, 0.30), shine=0.9)
    scene.material("wood", (0.76, 0.60, 0.40))
    scene.material("wood_light", (0.88, 0.78, 0.62))
    scene.material("wood_dark", (0.45, 0.32, 0.21))
    scene.material("wood_white", (0.92, 0.92, 0.90))
    scene.material("metal", (0.55, 0.58, 0.60), shine=0.6)
    scene.material("metal_dark", (0.22, 0.23, 0.25), shine=0.6)
    scene.material("plastic_black", (0.13, 0.13, 0.14), shine=0.4)
    scene.material("plastic_grey", (0.60, 0.62, 0.64), shine=0.3)
    scene.material("fabric_blue", (0.18, 0.33, 0.55), shine=0.0)
    scene.material("fabric_orange", (0.85, 0.44, 0.18), shine=0.0)
    scene.material("fabric_grey", (0.40, 0.41, 0.43), shine=0.0)
    scene.material("paper_red", (0.70, 0.22, 0.20), shine=0.0)
    scene.material("paper_blue", (0.22, 0.36, 0.60), shine=0.0)
    scene.material("paper_green", (0.27, 0.48, 0.34), shine=0.0)
    scene.material("cardboard", (0.76, 0.58, 0.38), shine=0.0)
    scene.material("cardboard_tape", (0.86, 0.74, 0.56), shine=0.0)
    scene.material("leaf", (0.24, 0.45, 0.22), shine=0.0)


_FLOOR_OF = {
    "corridor": "floor_stone",
    "meeting": "carpet_red",
    "kitchen": "floor_kitchen",
    "north1": "carpet_blue",
    "north2": "carpet_green",
    "north3": "carpet_blue",
    "north4": "floor_parquet",
    "south1": "carpet_sand",
    "south2": "carpet_sand",
    "south3": "floor_parquet",
    "south4": "floor_rubber",
    "south5": "floor_rubber",
    "south6": "floor_stone",
}


def _floors(scene: Scene) -> None:
    scene.section("floor: one endless plane to stand on, the rest is painted")
    scene.floor("floor_stone", (HALF_X + LOBBY_EDGE) / 2, LOBBY_HALF, x=(LOBBY_EDGE - HALF_X) / 2)
    for room, material in _FLOOR_OF.items():
        _, across, along = ROOMS[room]
        scene.paint(f"floor_{room}", across, along, material)
    x, y, apron = HALF_X, HALF_Y, 9.0
    scene.paint("lawn", (-x - apron, x + apron), (y, y + apron), "grass")
    scene.paint("lawn", (-x - apron, x + apron), (-y - apron, -y), "grass")
    scene.paint("lawn", (-x - apron, -x), (-y, y), "grass")
    scene.paint("lawn", (x, x + apron), (-y, y), "grass")


def _outer_walls(scene: Scene) -> None:
    scene.section("outer walls")
    x, y = HALF_X + OUTER / 2, HALF_Y + OUTER / 2
    long, short = (-HALF_X - OUTER, HALF_X + OUTER), (-HALF_Y, HALF_Y)
    size = WallSize(OUTER, HEIGHT)
    north = [window(middle, 2.6) for middle in (-11.0, -4.25, 1.25, 6.75, 12.25)]
    south = [window(middle, 2.0) for middle in (-11.0, -4.8, -0.4, 4.0, 8.4, 12.8)]
    wall(scene, "outer", "x", y, long, "concrete", size, openings=north)
    wall(scene, "outer", "x", -y, long, "concrete", size, openings=south)
    front = [window(0.0, 5.0, 0.2, 2.2)]
    wall(scene, "outer", "y", -x, short, "concrete", size, openings=front)
    wall(scene, "outer", "y", x, short, "concrete", size, openings=[window(0.0, 1.2)])


def _inner_walls(scene: Scene) -> None:
    scene.section("walls of the corridor")
    size = WallSize(INNER, HEIGHT)
    north_doors = [door(-5.9), door(-0.4), door(5.1), door(10.6)]
    south_doors = [door(-3.7), door(0.7), door(5.1), door(7.3), door(11.7)]
    span = (LOBBY_EDGE + INNER / 2, HALF_X)
    wall(scene, "corridor", "x", CORRIDOR_HALF, span, "brick", size, openings=north_doors)
    wall(scene, "corridor", "x", -CORRIDOR_HALF, span, "brick", size, openings=south_doors)
    scene.section("walls between rooms")
    for x in NORTH[1:-1]:
        openings = [door(7.5)] if x == NORTH[1] else []
        span = (CORRIDOR_HALF + INNER / 2, HALF_Y)
        wall(scene, "north", "y", x, span, "brick", size, openings=openings)
    for x in SOUTH[1:-1]:
        openings = [door(-8.0)] if x == SOUTH[3] else []
        span = (-HALF_Y, -CORRIDOR_HALF - INNER / 2)
        wall(scene, "south", "y", x, span, "brick", size, openings=openings)
    span = (SOUTH[4] + INNER / 2, HALF_X)
    wall(scene, "south", "x", -5.0, span, "brick", size, openings=[door(13.2)])
    scene.section("walls of the lobby; the meeting room's is glass")
    for low, high in ((-HALF_Y, -CORRIDOR_HALF), (CORRIDOR_HALF, HALF_Y)):
        wall(scene, "lobby", "y", LOBBY_EDGE, (low, high), "brick_red", size)
    span = (-HALF_X, LOBBY_EDGE - INNER / 2)
    panes = [door(-8.4, 1.2), *(window(x, 1.7, 0.1, 2.3) for x in (-14.0, -12.1, -10.2))]
    wall(scene, "meeting", "x", LOBBY_HALF, span, "wood_white", size, openings=panes)
    kitchen = [door(-9.5, 1.2)]
    wall(scene, "kitchen", "x", -LOBBY_HALF, span, "brick_red", size, openings=kitchen)


def _lobby_and_meeting(scene: Scene) -> None:
    scene.section("lobby")
    scene.box("counter", (-14.4, 3.2, 0.55), (0.5, 1.2, 1.1), "wood_dark")
    furniture.sofa(scene, (-14.4, -3.0), 0.0, "fabric_orange")
    for x, y in ((-7.5, 3.5), (-7.5, -3.5)):
        _plant(scene, (x, y))
    scene.section("meeting room")
    furniture.table(scene, (-11.2, 7.2), 0.0, (3.6, 1.4), "wood", "metal")
    for x in (-12.5, -11.2, -9.9):
        furniture.chair(scene, (x, 6.2), 90.0, seat="fabric_grey", frame="metal")
        furniture.chair(scene, (x, 8.2), -90.0, seat="fabric_grey", frame="metal")
    scene.box("board", (-7.1, 7.2, 1.4), (0.05, 2.0, 1.2), "wood_white")


def _plant(scene: Scene, at: tuple[float, float]) -> None:
    x, y = at
    scene.pipe("pot", ((x, y, 0.0), (x, y, 0.4)), 0.2, "brick_red")
    scene.box("plant", (x, y, 0.8), (0.4, 0.4, 0.8), "leaf", quat=turned(yaw=20.0))
    scene.box("plant", (x, y, 0.85), (0.36, 0.36, 0.6), "leaf", quat=turned(12.0, 14.0, 65.0))


def _kitchen(scene: Scene) -> None:
    scene.section("kitchen")
    furniture.cabinet(scene, (-14.65, -7.0), 0.0, (0.6, 4.0, 0.9), "wood_white", "wood_light")
    scene.box("fridge", (-14.6, -9.5, 0.9), (0.7, 0.7, 1.8), "metal")
    for x in (-12.0, -9.4):
        furniture.table(scene, (x, -8.2), 0.0, (1.4, 0.9), "wood_light", "metal")
        for side in (-1, 1):
            furniture.chair(
                scene, (x, -8.2 + side * 0.85), -90.0 * side, seat="fabric_orange", frame="metal"
            )


def _open_plan(scene: Scene) -> None:
    scene.section("open plan offices")
    for left in NORTH[:3]:
        for x in (left + 1.5, left + 4.0):
            for y, yaw in ((4.2, 0.0), (5.05, 180.0), (8.9, 0.0)):
                desk = (x, y)
                furniture.desk(
                    scene, desk, yaw, top="wood_light", frame="metal", screen="plastic_black"
                )
        size = (0.45, 1.4, 1.3)
        at = (left + 5.15, 2.4)
        furniture.cabinet(scene, at, 180.0, size, "plastic_grey", "wood_white")


def _library(scene: Scene) -> None:
    scene.section("library")
    books = ("paper_red", "paper_blue", "paper_green")
    for row, x in enumerate((10.9, 12.7)):
        for part, y in enumerate((4.6, 6.7, 8.8)):
            seed = f"library {row} {part}"
            furniture.shelf(scene, (x, y), 0.0, (0.4, 1.9, 2.0), "wood_dark", books, seed)
    furniture.table(scene, (14.2, 3.0), 90.0, (1.6, 0.8), "wood", "wood_dark")


def _offices(scene: Scene) -> None:
    scene.section("offices")
    for left in SOUTH[:2]:
        furniture.desk(
            scene, (left + 2.2, -5.4), 180.0, top="wood", frame="wood_dark", screen="plastic_black"
        )
        furniture.chair(scene, (left + 2.2, -7.1), 90.0, seat="fabric_blue", frame="metal")
        furniture.cabinet(scene, (left + 0.36, -8.2), 0.0, (0.45, 1.8, 1.9), "wood", "wood_light")
        furniture.shelf(
            scene,
            (left + 3.95, -7.6),
            0.0,
            (0.35, 1.8, 1.8),
            "wood_dark",
            ("paper_blue", "paper_red"),
            f"office {left}",
        )


def _lounge(scene: Scene) -> None:
    scene.section("lounge")
    furniture.sofa(scene, (2.5, -7.0), 0.0, "fabric_blue")
    furniture.sofa(scene, (4.0, -9.3), 90.0, "fabric_blue")
    scene.box("low_table", (4.1, -7.0, 0.2), (0.9, 0.9, 0.4), "wood_dark")
    _plant(scene, (5.7, -9.4))


def _store_and_servers(scene: Scene) -> None:
    scene.section("store, with a shelf that fell")
    goods = ("cardboard", "plastic_grey", "cardboard_tape")
    for part, y in enumerate((-3.4, -5.5)):
        seed = f"store {part}"
        furniture.shelf(scene, (10.2, y), 0.0, (0.5, 1.9, 2.1), "metal", goods, seed)
    furniture.shelf(scene, (8.4, -9.5), 90.0, (0.5, 2.4, 2.1), "metal", goods, "store back")
    fallen = turned(0.0, -62.0, 0.0)
    scene.box("fallen_shelf", (9.5, -7.4, 0.55), (0.5, 1.5, 1.9), "metal", quat=fallen)
    scene.section("server room")
    for x in (12.1, 13.1, 14.1):
        scene.box("rack", (x, -3.9, 1.0), (0.7, 1.0, 2.0), "metal_dark")
        scene.box("rack_door", (x, -3.39, 1.0), (0.62, 0.02, 1.86), "plastic_grey")


def _workshop(scene: Scene) -> None:
    scene.section("workshop")
    furniture.table(scene, (12.8, -9.5), 0.0, (3.4, 0.8), "wood", "metal")
    scene.box("machine", (14.4, -7.2, 0.6), (0.8, 1.2, 1.2), "paper_green")
    scene.box("machine", (14.4, -7.2, 1.35), (0.5, 0.7, 0.3), "metal_dark")
    furniture.pallet(scene, (11.4, -6.6), 90.0, "wood")


def _movables(scene: Scene) -> None:
    scene.section("movable chairs, bins and boxes")
    frame = "plastic_black"
    chairs = (
        ("chair_1", (-5.5, 3.3), 80.0, "fabric_blue"),
        ("chair_2", (-3.0, 6.0), -110.0, "fabric_blue"),
        ("chair_3", (2.5, 3.2), 100.0, "fabric_orange"),
        ("chair_4", (5.6, 7.9), 60.0, "fabric_blue"),
        ("chair_5", (-0.4, -4.5), -70.0, "fabric_grey"),
    )
    for name, at, yaw, seat in chairs:
        furniture.swivel_chair(scene, name, at, yaw, seat=seat, frame=frame)
    furniture.waste_bin(scene, "bin_1", (-6.6, 0.7), "metal")
    furniture.waste_bin(scene, "bin_2", (14.5, 0.7), "metal")
    furniture.waste_bin(scene, "bin_3", (-7.4, -9.6), "plastic_grey")
    for n, (x, y, z, yaw) in enumerate(
        ((7.0, -4.2, 0.0, 10.0), (7.1, -4.2, 0.35, -8.0), (7.0, -5.0, 0.0, 35.0)), start=1
    ):
        furniture.crate(
            scene,
            f"box_{n}",
            (x, y, z),
            (0.45, 0.35, 0.35),
            2.0,
            "cardboard",
            trim="cardboard_tape",
            yaw=yaw,
        )
    crate = Movable("stool_1", (11.6, -8.4, 0.22))
    crate.cylinder((0.0, 0.0, 0.0), 0.17, 0.44, "wood_dark", 3.0)
    scene.movable(crate)


def _victims(world: GeneratedWorld) -> None:
    world.victim((-10.6, 5.4, 0.0), 180.0, "lying", "Injured", figure="female", sound=True)
    world.victim((-2.2, 2.6, 0.0), 120.0, "lying", "Unconscious", figure="male", co2=0.04, rfid=1)
    world.victim((3.2, 6.6, 0.0), -120.0, "sitting", "Injured", figure="female", sound=True)
    world.victim((9.0, -7.5, 0.0), 180.0, "lying", "Unconscious", figure="male", co2=0.05)
    world.victim((12.4, -6.4, 0.0), 70.0, "standing", "Alive", figure="male", motion="wave")
    world.victim((14.2, 8.9, 0.0), -135.0, "sitting", "Alive", figure="female", sound=65.0, rfid=5)
    world.sound((-2.0, 8.0, 0.8), loudness=62.0, duration=1.0, period=4.0)


def _facts(world: GeneratedWorld) -> None:
    world.zones += [(name, kind, x, y) for name, (kind, x, y) in ROOMS.items()]
    for tag, (x, y), neighbours in WAYS:
        world.nodes.append((tag, (x, y, 0.0), neighbours))
