"""A small plant: doors, conveyor belts, a lift to a mezzanine, and machines that drive about.

y= 6  +-----------+-------------------------------------+
      |           |   ====== line ======> ==> [bin]     |
      |  starts  door                     +------------+|
      |           |                [lift] | mezzanine  ||
      |           |    <-- sweeper -->    +------------+|
      |          flap  <---- cart ---->                 |
      |           |     ==== walkway ====>              |
y=-6  +-----------+-------------------------------------+
    x=-10        -3                               10
"""

from __future__ import annotations

from usarsim_exploration.worlds import furniture
from usarsim_exploration.worlds.mjcf import Scene
from usarsim_exploration.worlds.sheet import GeneratedWorld
from world_generators.walls import WallSize, door, wall

WEST, EAST, HALF = -10.0, 10.0, 6.0
"""Outer walls, m."""
PARTITION = -3.0
WALLS = WallSize(0.12, 2.2)
LEAF_HEIGHT = 2.08

GATE, GATE_WIDTH = 2.0, 1.5
FLAP, FLAP_WIDTH = -3.2, 1.1
"""Middles (y) and widths of the two doorways, m."""

FLOOR_ABOVE = 1.2
MEZZANINE = ((5.82, -0.5), (EAST, 3.8))
"""Height of the mezzanine and two corners of it, m."""
LIFT, LIFT_SIZE = (4.9, 2.0), 1.8

WALKWAY = (2.5, -4.4)
WALKWAY_SIZE = (6.0, 1.6, 0.1)
LINE_HEIGHT = 0.6
LINE = 5.2
"""y of the conveyor line, m."""


def build() -> GeneratedWorld:
    """The plant with its facts."""
    scene = Scene("plant", center=(0.0, 0.0, 0.5), extent=14.0)
    world = GeneratedWorld(
        name="plant",
        title="Plant",
        description=(
            "A yard and a hall of 13 x 12 m: a sliding door that opens for whoever comes, a flap "
            "that is pushed open, conveyor belts, a lift to a mezzanine, a cart and a sweeper "
            "that wait for whoever is before them. Two victims, one of them on the mezzanine."
        ),
        scene=scene,
        lower=(WEST, -HALF, -2.0),
        upper=(EAST, HALF, 30.0),
    )
    _materials(scene)
    furniture.daylight(scene)
    scene.camera("overview", (-9.0, -13.5, 20.0), (-0.3, -0.2, 0.0), 41.0)
    scene.section("floor")
    scene.floor("concrete")
    _walls(scene)
    _mezzanine(scene)
    _furniture(scene)
    world.start_grid(xs=[-9.1 + 1.4 * n for n in range(4)], ys=[-4.2 + 2.8 * n for n in range(4)])
    world.victim((9.2, 0.2, FLOOR_ABOVE), 135.0, "sitting", "Injured", figure="female", sound=True)
    world.victim((9.0, -5.0, 0.0), 200.0, "lying", "Unconscious", figure="male")
    _doors(world)
    _belts(world)
    _movers(world)
    _facts(world)
    return world


def _materials(scene: Scene) -> None:
    furniture.checkered_floor(scene, "concrete", (0.60, 0.62, 0.63), (0.66, 0.68, 0.69))
    scene.material("brick", (0.75, 0.70, 0.64))
    scene.material("metal", (0.48, 0.51, 0.55), shine=0.6)
    scene.material("metal_floor", (0.58, 0.60, 0.56), shine=0.3)
    scene.material("wood", (0.76, 0.58, 0.38))
    scene.material("cardboard", (0.76, 0.58, 0.38), shine=0.0)
    scene.material("cardboard_tape", (0.86, 0.74, 0.56))


def _walls(scene: Scene) -> None:
    scene.section("walls")
    for side in (-1, 1):
        wall(scene, "wall", "x", side * (HALF + 0.06), (WEST, EAST), "brick", WALLS)
    for x in (WEST - 0.06, EAST + 0.06):
        wall(scene, "wall", "y", x, (-HALF - 0.12, HALF + 0.12), "brick", WALLS)
    openings = [door(GATE, GATE_WIDTH), door(FLAP, FLAP_WIDTH)]
    wall(scene, "wall", "y", PARTITION, (-HALF, HALF), "brick", WALLS, openings=openings)


def _mezzanine(scene: Scene) -> None:
    scene.section("mezzanine with rails")
    (x, low), (far, high) = MEZZANINE
    scene.block("platform", (x, low, 0.0), (far, high, FLOOR_ABOVE), "metal_floor", role="ground")
    rail = (FLOOR_ABOVE + 0.35, FLOOR_ABOVE + 0.4)
    for y in (low + 0.04, high - 0.04):
        scene.block("rail", (x, y - 0.03, rail[0]), (far, y + 0.03, rail[1]), "metal")
        for n in range(5):
            at = x + 0.05 + (far - x - 0.1) * n / 4
            foot = (at - 0.03, y - 0.03, FLOOR_ABOVE)
            scene.block("rail_post", foot, (at + 0.03, y + 0.03, rail[0]), "metal")
    gap = LIFT_SIZE / 2
    for start, end in ((low, LIFT[1] - gap), (LIFT[1] + gap, high)):
        scene.block("rail", (x, start, rail[0]), (x + 0.06, end, rail[1]), "metal")


def _furniture(scene: Scene) -> None:
    scene.section("legs of the line, a table at its end")
    for x in (-1.4, 1.0, 3.2):
        for side in (-0.25, 0.25):
            y = LINE + side
            top = LINE_HEIGHT - 0.1
            scene.block("leg", (x - 0.04, y - 0.04, 0.0), (x + 0.04, y + 0.04, top), "metal")
    scene.block("bin", (5.1, LINE - 0.4, 0.0), (6.3, LINE + 0.4, 0.3), "metal", role="ground")
    scene.section("loose things")
    for n, (x, y) in enumerate(((8.6, 5.2), (9.2, 5.0), (-3.6, 5.3))):
        furniture.crate(
            scene,
            f"parcel_{n + 1}",
            (x, y, 0.0),
            (0.4, 0.35, 0.3),
            2.0,
            "cardboard",
            trim="cardboard_tape",
        )


def _doors(world: GeneratedWorld) -> None:
    world.machines += [
        (
            "door",
            {
                "name": "gate",
                "kind": "sliding",
                "position": (PARTITION, GATE, 0.0),
                "width": GATE_WIDTH,
                "height": LEAF_HEIGHT,
                "leaves": 2,
                "range": 1.3,
                "material": "glass",
            },
        ),
        (
            "door",
            {
                "name": "flap",
                "kind": "hinged",
                "opens": "push",
                "both_ways": True,
                "position": (PARTITION, FLAP, 0.0),
                "width": FLAP_WIDTH,
                "height": LEAF_HEIGHT,
                "mass": 8.0,
                "spring": 2.0,
                "material": "wood",
            },
        ),
    ]


def _belts(world: GeneratedWorld) -> None:
    line = {"tag": "line", "material": "rubber", "speed": 0.3}
    world.machines += [
        (
            "belt",
            {
                "name": "walkway",
                "position": (*WALKWAY, 0.03),
                "size": WALKWAY_SIZE,
                "speed": 0.4,
                "material": "rubber",
            },
        ),
        (
            "belt",
            {
                "name": "line_1",
                "position": (0.3, LINE, LINE_HEIGHT),
                "size": (4.0, 0.6, 0.1),
                **line,
            },
        ),
        (
            "belt",
            {
                "name": "line_2",
                "position": (3.6, LINE, LINE_HEIGHT - 0.02),
                "size": (2.6, 0.6, 0.1),
                "slope_degrees": -5.0,
                **line,
            },
        ),
    ]


def _movers(world: GeneratedWorld) -> None:
    world.machines += [
        (
            "lift",
            {
                "name": "lift",
                "size": (LIFT_SIZE, LIFT_SIZE, 0.1),
                "stops": ((*LIFT, 0.02), (*LIFT, FLOOR_ABOVE)),
                "runs": "load",
                "speed": 0.3,
                "material": "metal",
            },
        ),
        (
            "obstacle",
            {
                "name": "cart",
                "shape": "box",
                "size": (0.9, 0.6, 0.45),
                "points": ((-1.6, -2.2, 0.0), (8.6, -2.2, 0.0)),
                "speed": 0.6,
                "pause": 3.0,
                "faces_ahead": True,
                "distance": 0.6,
                "material": "plastic",
            },
        ),
        (
            "obstacle",
            {
                "name": "sweeper",
                "shape": "cylinder",
                "size": (0.6, 0.6, 0.35),
                "points": ((-1.2, -0.9, 0.0), (4.6, -0.9, 0.0), (4.6, 0.2, 0.0), (-1.2, 0.2, 0.0)),
                "way": "ring",
                "speed": 0.4,
                "pause": 1.0,
                "distance": 0.5,
                "material": "plastic",
            },
        ),
    ]


def _facts(world: GeneratedWorld) -> None:
    (x, low), (far, high) = MEZZANINE
    (belt_x, belt_y), (length, width, _) = WALKWAY, WALKWAY_SIZE
    world.zones += [
        ("yard", "flat", (WEST, PARTITION), (-HALF, HALF)),
        ("hall", "flat", (PARTITION, EAST), (-HALF, HALF)),
        ("mezzanine", "raised", (x, far), (low, high)),
        (
            "walkway",
            "belt",
            (belt_x - length / 2, belt_x + length / 2),
            (belt_y - width / 2, belt_y + width / 2),
        ),
    ]
    places = {"Yard": (-4.2, 2.0), "Gate": (-1.9, 2.0), "Hall": (0.6, 2.0), "Lift": (3.4, 2.0)}
    tags = list(places)
    for n, (tag, place) in enumerate(places.items()):
        beside = tuple(tags[m] for m in (n - 1, n + 1) if 0 <= m < len(tags))
        world.nodes.append((tag, (*place, 0.0), beside))
    world.tag((LIFT[0] - 1.2, LIFT[1] + 1.1, 0.01), "lift")
    world.tag((WALKWAY[0] - 3.4, WALKWAY[1], 0.01), "walkway")
