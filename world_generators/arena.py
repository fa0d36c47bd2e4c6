"""The default world: a RoboCup Rescue style hall with yellow, orange and red zones.

y=10  +---------+-------------------------+--------------+
      | staging |  yellow: maze of panels | red: rubble  |
y=1   |  16     +-------------------------+--------------+
      | starts  |  orange: ramps, step field, stairs,    |
y=-10 +---------+----------------------------------------+
      x=-12    -8                        4.4            12
"""

from __future__ import annotations

from usarsim_exploration.worlds import furniture
from usarsim_exploration.worlds.mjcf import Scene, turned
from usarsim_exploration.worlds.sheet import GeneratedWorld
from world_generators import terrain
from world_generators.walls import Maze, panel

HALF_X, HALF_Y = 12.0, 10.0
STAGING_EDGE, RED_EDGE, ORANGE_EDGE = -8.0, 4.4, 1.0
LINE = 0.1
"""Width of the blue lines between zones, m."""

MAZE = Maze(
    rows=(
        "+  +  +  +  +  +  +  +  +  +",
        "|     |           |     |  |",
        "+  +  +--+  +--+  +  +  +oo+",
        "|  |        |     |  |      ",
        "+  +--+  +  +  +--+  +--+--+",
        "|  |     |  |  |           |",
        "+  +  +--+  +--+  +--+  +  +",
        "         |        |     |  |",
        "+--+--+  +--+--+  +  +--+  +",
        "|           |     |     |  |",
        "+  +  +--+  +--+--+--+  +  +",
        "|  |     |        |     |  |",
        "+  +--+  +--+--+  +  +--+  +",
        "      |  |  o     |        |",
        "+--+--+  +--+--+--+--+  +--+",
    ),
    left=-6.6,
    top=HALF_Y,
)


def build() -> GeneratedWorld:
    """The arena with its facts."""
    scene = Scene("arena", center=(0.0, 0.0, 0.5), extent=15.0)
    world = GeneratedWorld(
        name="arena",
        title="RoboCup Rescue style arena",
        description=(
            "A hall of 24 x 20 m. Yellow: a maze of 1.2 m cells. Orange: crossing and continuous "
            "pitch/roll ramps of 15 degrees, a step field, an inclined plane with landing and "
            "stairs. Red: rubble and a cubic step field. Ten victims, eight crates to push."
        ),
        scene=scene,
        lower=(-HALF_X, -HALF_Y, -2.0),
        upper=(HALF_X, HALF_Y, 30.0),
    )
    shades = _materials(scene)
    furniture.daylight(scene)
    scene.camera("overview", (-2.6, -17.6, 21.0), (-0.1, -0.85, 0.0), 39.0)
    _hall(scene)
    _floors(scene)
    _yellow(scene, world)
    _orange(scene, world, shades)
    _red(scene, world, shades)
    _crates(scene)
    world.start_grid(xs=(-10.6, -9.2), ys=[-7.0 + 2.0 * row for row in range(8)])
    _facts(world)
    return world


def _materials(scene: Scene) -> tuple[str, ...]:
    furniture.floor_tiles(scene, "floor_grey", (0.62, 0.63, 0.64), (0.54, 0.55, 0.56))
    furniture.floor_tiles(scene, "floor_yellow", (0.90, 0.80, 0.42), (0.80, 0.70, 0.34))
    furniture.floor_tiles(scene, "floor_orange", (0.90, 0.63, 0.38), (0.80, 0.54, 0.30))
    furniture.floor_tiles(scene, "floor_red", (0.80, 0.43, 0.38), (0.68, 0.34, 0.30))
    scene.material("line_blue", (0.10, 0.28, 0.78))
    scene.material("asphalt", (0.44, 0.45, 0.47), shine=0.0)
    scene.material("concrete", (0.72, 0.72, 0.70))
    scene.material("concrete_broken", (0.60, 0.59, 0.56))
    scene.material("brick", (0.66, 0.34, 0.26))
    scene.material("wood", (0.80, 0.64, 0.43))
    scene.material("wood_white", (0.91, 0.90, 0.87))
    scene.material("wood_post", (0.55, 0.41, 0.26))
    scene.material("wood_ramp_light", (0.86, 0.71, 0.49))
    scene.material("wood_ramp_dark", (0.74, 0.57, 0.36))
    scene.material("wood_pallet", (0.70, 0.55, 0.34))
    scene.material("cardboard", (0.76, 0.58, 0.38), shine=0.0)
    scene.material("cardboard_tape", (0.86, 0.74, 0.56))
    scene.material("plastic_blue", (0.20, 0.40, 0.62), shine=0.4)
    scene.material("plastic_white", (0.92, 0.92, 0.92), shine=0.4)
    scene.material("metal", (0.52, 0.55, 0.58), shine=0.6)
    scene.material("metal_yellow", (0.93, 0.76, 0.14), shine=0.5)
    return furniture.woods(scene, "wood_post", (0.50, 0.34, 0.20), (0.94, 0.80, 0.56), 4)


def _hall(scene: Scene) -> None:
    scene.section("hall walls and their posts")
    height, thick = 2.0, 0.2
    x, y = HALF_X + thick, HALF_Y + thick
    scene.block("wall", (-x, HALF_Y, 0), (x, y, height), "concrete")
    scene.block("wall", (-x, -y, 0), (x, -HALF_Y, height), "concrete")
    scene.block("wall", (-x, -HALF_Y, 0), (-HALF_X, HALF_Y, height), "concrete")
    scene.block("wall", (HALF_X, -HALF_Y, 0), (x, HALF_Y, height), "concrete")


def _floors(scene: Scene) -> None:
    scene.section("floor: one endless plane to stand on, painted zones, blue lines between them")
    half = (STAGING_EDGE + HALF_X) / 2
    scene.floor("floor_grey", half - LINE / 4, HALF_Y, x=-HALF_X + half - LINE / 4)
    west, east = STAGING_EDGE + LINE / 2, RED_EDGE - LINE / 2
    south, north = ORANGE_EDGE - LINE / 2, ORANGE_EDGE + LINE / 2
    scene.paint("yellow", (west, east), (north, HALF_Y), "floor_yellow")
    scene.paint("red", (east + LINE, HALF_X), (north, HALF_Y), "floor_red")
    scene.paint("orange", (west, HALF_X), (-HALF_Y, south), "floor_orange")
    scene.paint("line", (west - LINE, west), (-HALF_Y, HALF_Y), "line_blue")
    scene.paint("line", (west, HALF_X), (south, north), "line_blue")
    scene.paint("line", (east, east + LINE), (north, HALF_Y), "line_blue")
    apron = 8.0
    x, y = HALF_X + 0.2, HALF_Y + 0.2
    scene.paint("apron", (-x - apron, x + apron), (y, y + apron), "asphalt")
    scene.paint("apron", (-x - apron, x + apron), (-y - apron, -y), "asphalt")
    scene.paint("apron", (-x - apron, -x), (-y, y), "asphalt")
    scene.paint("apron", (x, x + apron), (-y, y), "asphalt")


def _yellow(scene: Scene, world: GeneratedWorld) -> None:
    scene.section("yellow zone: maze of panels")
    MAZE.build(scene, "panel", ("wood", "wood_white", "wood"), "wood_post")
    behind_hole = MAZE.centre(0, 8)
    world.victim((*behind_hole, 0.0), -90.0, "standing", "Alive", figure="male", sound=True)
    nook = MAZE.centre(6, 3)
    world.victim((nook[0] - 0.2, nook[1], 0.0), 0.0, "sitting", "Injured", figure="female")
    dead_end = MAZE.centre(2, 4)
    world.victim((*dead_end, 0.0), 90.0, "sitting", "Alive", figure="male", sound=True)
    x, y = MAZE.centre(4, 0)
    world.victim((x + 0.75, y, 0.0), 0.0, "lying", "Unconscious", figure="female", co2=0.04, rfid=3)


def _orange(scene: Scene, world: GeneratedWorld, shades: tuple[str, ...]) -> None:
    _crossing(scene)
    _continuous(scene)
    _step_lane(scene, shades)
    _landing(scene)
    _yard(scene)
    world.victim(
        (-2.0, -9.72, 1.08),
        180.0,
        "sitting",
        "Injured",
        figure="female",
        sound=True,
        motion="wave",
    )
    walk = {"kind": "walk", "to": [9.4, -0.8, 0.93], "speed": 0.4, "pause": 3.0}
    world.victim((10.9, -1.2, 0.0), 180.0, "standing", "Alive", figure="male", motion=walk)
    world.victim((9.9, -8.1, 0.0), 180.0, "lying", "Unconscious", figure="female", co2=0.05, rfid=6)
    world.false_alarm("Chest", (3.65, -8.55, 0.2), (4.35, -7.85, 0.95))


def _crossing(scene: Scene) -> None:
    scene.section("orange zone: crossing pitch/roll ramps, 15 degrees")
    ramps = ("wood_ramp_light", "wood_ramp_dark")
    terrain.crossing_ramps(scene, "crossing_ramp", (-6.6, -3.9), (4, 6), ramps)
    for y in (-3.93, -0.27):
        panel(scene, "lane", (-4.2, y), "wood_white", along_x=True, length=4.8, height=0.6)


def _continuous(scene: Scene) -> None:
    scene.section("orange zone: continuous pitch/roll ramps, 15 degrees")
    ramps = ("wood_ramp_light", "wood_ramp_dark")
    terrain.continuous_ramps(scene, "pitch_ramp", (-0.4, -3.3), 2, 2.4, ramps)
    terrain.valley(scene, "roll_ramp", (4.4, -3.3), 2.4, ramps)
    for y in (-3.33, -0.87):
        panel(scene, "lane", (3.2, y), "wood_white", along_x=True, length=7.2, height=0.6)


def _step_lane(scene: Scene, shades: tuple[str, ...]) -> None:
    scene.section("orange zone: lane with a symmetric step field of 0 to 6 cm, hurdles, a ridge")
    south, north = -6.6, -5.4
    heights = terrain.symmetric_heights("arena orange", [n / 100 for n in range(7)])
    terrain.step_field(scene, "step_post", (-5.4, south), heights, shades)
    for x in (-2.4, -1.6, -0.8):
        scene.pipe("hurdle", ((x, south, 0.03), (x, north, 0.03)), 0.05, "plastic_white")
    terrain.continuous_ramps(
        scene, "ridge", (0.6, south), 1, 1.2, ("wood_ramp_light", "wood_ramp_dark")
    )
    for y in (south - 0.03, north + 0.03):
        for x in (-4.8, -1.2, 2.4):
            panel(scene, "lane", (x, y), "wood", along_x=True, length=3.6, height=0.6)


def _landing(scene: Scene) -> None:
    scene.section("orange zone: inclined plane of 15 degrees, landing, stairs of 18 x 28 cm")
    rise, steps = 0.18, 6
    top = rise * steps
    length = top / terrain.ramp_rise(1.0)
    foot, y, width = -7.2, -9.4, 1.2
    edge = foot + length
    scene.ramp("plane", (foot, y), (length, width), top, "wood_ramp_light")
    scene.block(
        "landing", (edge, y - 0.6, 0), (edge + 1.8, y + 0.6, top), "wood_ramp_dark", role="ground"
    )
    end = edge + 1.8 + 0.28 * (steps - 1)
    terrain.stairs(scene, "stair", (end, y), steps - 1, (0.28, width, rise), "wood", climb=-1.0)
    rail_y, rail = y + 0.57, top + 0.5
    scene.pipe("rail", ((edge, rail_y, rail), (edge + 1.8, rail_y, rail)), 0.02, "metal_yellow")
    scene.pipe(
        "rail",
        ((edge + 1.8, rail_y, rail), (end, rail_y, rail - rise * (steps - 1))),
        0.02,
        "metal_yellow",
    )
    scene.pipe("rail", ((foot + 0.9, rail_y, 0.74), (edge, rail_y, rail)), 0.02, "metal_yellow")
    for x, low in ((foot + 0.9, 0.2), (foot + 2.4, 0.6), (edge, top), (edge + 1.8, top)):
        high = rail if x >= edge else 0.74 + (x - foot - 0.9) * (rail - 0.74) / (edge - foot - 0.9)
        scene.pipe("rail", ((x, rail_y, low), (x, rail_y, high)), 0.02, "metal_yellow")


def _yard(scene: Scene) -> None:
    scene.section("orange zone: yard with barrels, pallets and a big box")
    for x, y in ((9.2, -2.2), (9.9, -2.4), (9.5, -3.0), (4.0, -8.2)):
        scene.pipe("barrel", ((x, y, 0.0), (x, y, 0.88)), 0.29, "plastic_blue")
    furniture.pallet(scene, (5.4, -6.4), 20.0, "wood_pallet")
    furniture.pallet(scene, (6.9, -8.8), -75.0, "wood_pallet")
    furniture.open_box(scene, "big_box", (9.9, -8.1), 180.0, (2.0, 1.0, 0.8), "cardboard")
    for x, y, along_x in ((8.4, -5.4, False), (8.4, -6.6, False), (9.0, -4.8, True)):
        panel(scene, "panel", (x, y), "wood_white", along_x=along_x)


def _red(scene: Scene, world: GeneratedWorld, shades: tuple[str, ...]) -> None:
    scene.section("red zone: cubic step field, posts of 0, 5 and 10 cm")
    heights = terrain.symmetric_heights("arena red", [0.0, 0.05, 0.10])
    terrain.step_field(scene, "cube_post", (5.3, 3.0), heights, shades)
    scene.section("red zone: collapsed wall, slabs, pipes, rubble")
    scene.box(
        "slab", (10.2, 8.3, 0.52), (2.6, 1.8, 0.12), "concrete_broken", quat=turned(0, -24, 8)
    )
    scene.block("pier", (11.2, 7.6, 0.0), (11.6, 9.2, 0.8), "brick")
    scene.box("slab", (7.0, 7.6, 0.28), (1.9, 1.2, 0.1), "concrete_broken", quat=turned(14, 6, 40))
    scene.block("pier", (6.2, 9.0, 0.0), (8.6, 9.25, 0.9), "brick")
    scene.block("pier", (8.35, 8.1, 0.0), (8.6, 9.0, 0.5), "brick")
    scene.pipe("pipe", ((5.2, 6.2, 0.06), (8.4, 5.3, 0.06)), 0.06, "metal")
    scene.pipe("pipe", ((8.6, 3.1, 0.05), (11.4, 4.4, 0.30)), 0.05, "metal")
    furniture.pallet(scene, (10.8, 2.4), 35.0, "wood_pallet")
    stones = ("concrete_broken", "concrete_broken", "brick", "concrete")
    furniture.rubble(scene, (7.6, 11.4), (4.3, 7.0), 34, stones, "arena rubble east")
    furniture.rubble(scene, (5.2, 7.4), (7.9, 9.0), 12, stones, "arena rubble north")
    world.victim((10.6, 8.0, 0.0), -90.0, "lying", "Injured", figure="male", co2=0.05, sound=True)
    world.victim(
        (7.6, 8.75, 0.0), -90.0, "sitting", "Unconscious", figure="female", co2=0.04, rfid=8
    )
    world.victim(
        (9.2, 2.2, 0.0), 150.0, "lying", "Dead", figure="male", roll=180.0, temperature=24.0, rfid=9
    )
    world.sound((11.8, 9.7, 1.5), loudness=60.0, duration=0.3, period=5.0)


def _crates(scene: Scene) -> None:
    scene.section("movable crates")
    box, tape, wood = "cardboard", "cardboard_tape", "wood"
    furniture.crate(scene, "crate_1", (6.3, -5.0, 0), (0.40, 0.40, 0.40), 2.0, box, trim=tape)
    furniture.crate(
        scene, "crate_2", (7.0, -4.8, 0), (0.40, 0.30, 0.30), 1.5, box, trim=tape, yaw=25
    )
    furniture.crate(scene, "crate_3", (6.7, -5.6, 0), (0.50, 0.40, 0.35), 3.0, wood, yaw=70)
    furniture.crate(scene, "crate_4", (6.3, -5.0, 0.4), (0.30, 0.30, 0.25), 1.0, box, trim=tape)
    furniture.crate(scene, "crate_5", (-6.9, 0.2, 0), (0.40, 0.40, 0.40), 2.0, box, trim=tape)
    furniture.crate(scene, "crate_6", (2.9, -8.6, 0), (0.45, 0.45, 0.45), 4.0, wood, yaw=15)
    furniture.crate(
        scene, "crate_7", (7.6, 2.0, 0), (0.40, 0.40, 0.30), 2.5, box, trim=tape, yaw=-20
    )
    furniture.crate(
        scene, "crate_8", (*MAZE.centre(3, 4), 0), (0.35, 0.35, 0.35), 1.5, box, trim=tape
    )


def _facts(world: GeneratedWorld) -> None:
    world.zones += [
        ("staging", "start", (-HALF_X, STAGING_EDGE), (-HALF_Y, HALF_Y)),
        ("yellow", "yellow", (STAGING_EDGE, RED_EDGE), (ORANGE_EDGE, HALF_Y)),
        ("orange", "orange", (STAGING_EDGE, HALF_X), (-HALF_Y, ORANGE_EDGE)),
        ("red", "red", (RED_EDGE, HALF_X), (ORANGE_EDGE, HALF_Y)),
    ]
    world.nodes += [
        ("Staging", (-8.6, 0.0, 0.0), ("MazeWest", "RampsWest", "StairsWest")),
        ("MazeWest", (-7.2, 5.8, 0.0), ("Staging",)),
        ("RampsWest", (-7.2, -4.6, 0.0), ("Staging", "StairsWest", "Middle")),
        ("StairsWest", (-7.6, -8.0, 0.0), ("Staging", "RampsWest", "StairsEast")),
        ("StairsEast", (0.6, -8.0, 0.0), ("StairsWest", "Aisle")),
        ("Middle", (-1.0, -4.6, 0.0), ("RampsWest", "Yard")),
        ("Yard", (7.6, -4.2, 0.0), ("Middle", "YardSouth", "RedSouth")),
        ("RedSouth", (8.2, 1.6, 0.0), ("Yard",)),
    ]
    for tag, (x, y, _), _ in world.nodes:
        world.tag((x, y, 0.01), f"gate {tag}" if len(world.tags) % 2 == 0 else "")
    world.tag((*MAZE.centre(3, 4), 0.01), "middle of the maze")
    world.tag((9.2, 6.4, 0.4), single_shot=True)
    # Where nothing but the way turns there is no gate.
    world.nodes += [
        ("Aisle", (3.6, -7.3, 0.0), ("StairsEast", "YardSouth")),
        ("YardSouth", (7.4, -7.4, 0.0), ("Aisle", "Yard")),
    ]
