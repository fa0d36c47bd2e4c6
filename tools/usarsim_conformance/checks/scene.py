"""What cameras see of objects whose places are known (side channels reference 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.grounds import open_floor
from usarsim_conformance.lines import numbers
from usarsim_conformance.places import Place
from usarsim_conformance.registry import NotApplicable, Severity, checks_of
from usarsim_conformance.side_images import (
    ImageClient,
    Pixels,
    Tile,
    ask_conf,
    camera_robot,
    tiles_of,
)
from usarsim_conformance.walls import controller, create

images = checks_of("images")

_AHEAD, _ASIDE, _HIGH, _LOW = 7.0, 2.0, 1.7, 0.6
"""m from the robot: a red cube stands to the right and high, a blue one to the left and low."""
_SIDE = 1.0
"""m, of a cube."""
_EYE = 0.15
"""m; how far ahead of the reference point cameras are, roughly: 7 m make up for that."""
_NEAR, _STRAIGHT = 0.3, 0.1
"""m and rad; cameras beyond look past the cubes, or over an engine hood."""
_FRESH = 15.0
"""s of simulated time until a picture shows what has changed; slow machines draw seldom."""
_TRIES = 10
"""Pictures at least, where simulated time runs faster than they are drawn."""
_ZOOMED = 0.8
"""rad."""
_TURNED = 0.25
"""rad that the links of a camera's mount turn."""


@dataclass
class _Scene:
    """Pictures of a red cube to the right, high, and a blue one to the left, low."""

    tile: Tile  # of the camera, as CONF told it at first
    above: float  # m from the robot's reference point up to the camera, by GEO
    narrow: float = math.nan  # field of view that CONF told after SET, degrees
    pictures: dict[str, Pixels] = field(default_factory=dict)
    """By name: full, zoomed, again, link 1, link 2."""
    looks: list[tuple[float, float]] = field(default_factory=list)
    """Where each link of the camera's mount, if it has one, turns the camera to when its value
    grows, by GEO: right and down."""


async def _scene(case: Case) -> _Scene:
    found = await case.shared("a scene with two cubes", _make, dialect="")
    if isinstance(found, NotApplicable):
        raise found
    return found


async def _make(case: Case) -> _Scene | NotApplicable:
    try:
        async with open_floor(case) as lot:
            return await _look(case, lot)
    except NotApplicable as error:
        return error


async def _look(case: Case, lot: Place) -> _Scene:
    world = await controller(case)
    watcher = await camera_robot(case, place=lot)
    robot, tile = watcher.robot, watcher.tile
    above = await _looks_ahead(case, robot, tile.name)
    await robot.run(1.5)
    pose = await robot.pose()
    here = Place(None, pose.location, (0.0, 0.0, pose.yaw))
    client = await ImageClient.open(case)
    empty = (await client.ask(tile.request)).pixels
    for right, up, colour in ((_ASIDE, _HIGH, "Red"), (-_ASIDE, _LOW, "Blue")):
        place = here.moved(_AHEAD + _SIDE / 2.0, right, -up)
        await create(case, world, place, (_SIDE,) * 3, f" {{Material {colour}}}")
    await robot.run(0.6)
    scene = _Scene(tile, above)

    async def shoot(name: str, unlike: Pixels) -> None:
        """A picture of both cubes that has changed and does not any more: frames may be old."""
        latest, before, tries = case.clock.after(_FRESH), unlike, 0
        while True:
            tries += 1
            picture = (await client.ask(tile.request)).pixels
            new = _difference(picture, unlike) > 0.5 and _difference(picture, before) < 0.3
            seen = not any(math.isnan(_spot(picture, channel)[0]) for channel in (0, 2))
            if (new and seen) or (case.clock.now > latest and tries >= _TRIES):
                break
            before = picture
            await case.clock.sleep(0.4)
        scene.pictures[name] = picture

    await shoot("full", empty)
    opcode = f"SET {{Type Camera}} {{Name {tile.name}}} {{Opcode FOV}} {{Params"
    await robot.send(f"{opcode} {_ZOOMED}}}")
    await robot.run(0.6)
    scene.narrow = tiles_of(await ask_conf(robot))[0].fov
    await shoot("zoomed", scene.pictures["full"])
    await robot.send(f"{opcode} 0}}")
    await shoot("again", scene.pictures["zoomed"])
    mount, scene.looks = await _mount(robot, tile.name)
    for number in range(1, len(scene.looks) + 1):
        await robot.send(
            f"MISPKG {{Name {mount}}}"
            + "".join(
                f" {{Link {link}}} {{Value {_TURNED if link == number else 0.0}}} {{Order 0}}"
                for link in range(1, len(scene.looks) + 1)
            )
        )
        await robot.run(2.0)
        await shoot(f"link {number}", list(scene.pictures.values())[-1])
    return scene


async def _looks_ahead(case: Case, robot: Robot, camera: str) -> float:
    """The cubes are where a camera near the reference point sees them that looks straight ahead.

    Returns:
        m from the reference point up to the camera.

    Raises:
        NotApplicable: for any other camera.
    """
    if robot.first.type.startswith("Legged"):
        case.skip("a camera in a head that moves")
    geo = await robot.client.ask(f"GETGEO {{Type Camera}} {{Name {camera}}}", "GEO {Type Camera")
    item = geo.items()[0]
    away = math.hypot(*numbers(item.get("Location"))[:2])
    turned = max(abs(math.remainder(angle, math.tau)) for angle in numbers(item["Orientation"]))
    if away > _NEAR or turned > _STRAIGHT:
        case.skip(f"{camera} is {away:.2f} m from the middle, turned by {turned:.2f} rad")
    return -numbers(item.get("Location"))[2]


def _difference(one: Pixels, other: Pixels) -> float:
    """Mean over all pixels, of 255; pictures of other sizes are others."""
    if one.shape != other.shape:
        return 255.0
    return float(np.abs(one.astype(float) - other).mean())


async def _mount(robot: Robot, camera: str) -> tuple[str, list[tuple[float, float]]]:
    """The package that carries a camera, and where its links turn it, right and down, by GEO."""
    geo = await robot.client.ask(f"GETGEO {{Type Camera}} {{Name {camera}}}", "GEO {Type Camera")
    moving = await robot.client.maybe(lambda line: line.head in ("MISSTA", "ASTA"), 1.0)
    name = moving.get("Name") if moving is not None else None
    if not name or name not in (geo.items()[0].get("Mount") or ""):
        return "", []
    chain = await robot.client.ask(f"GETGEO {{Type MisPkg}} {{Name {name}}}", "GEO {Type MisPkg")
    turned, found = np.eye(3), []
    for key, value in chain.segments:
        angles = numbers(value)
        if key != "Orientation" or len(angles) != 3:
            continue
        turned = turned @ _rotation(*angles)
        # A link turns about its own z; the camera looks along x.
        _, right, down = np.cross(turned[:, 2], (1.0, 0.0, 0.0))
        found.append((float(right), float(down)))
    return name, found


def _rotation(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    about = []
    for axis, angle in ((2, yaw), (1, pitch), (0, roll)):
        cos, sin = math.cos(angle), math.sin(angle)
        one, other = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[one, one] = turn[other, other] = cos
        turn[one, other], turn[other, one] = -sin, sin
        about.append(turn)
    found: NDArray[np.float64] = about[0] @ about[1] @ about[2]
    return found


def _spot(picture: Pixels, channel: int) -> tuple[float, float]:
    """Middle of what is much more of a colour than of the others: column and row, pixels."""
    values = picture.astype(float)
    others = values[:, :, [one for one in range(3) if one != channel]].max(axis=2)
    rows, columns = np.nonzero(values[:, :, channel] - others > 30.0)
    if len(rows) < 12:
        return math.nan, math.nan
    return float(columns.mean()), float(rows.mean())


Spot = tuple[float, float]
"""Column and row, pixels."""


def _places(scene: _Scene, name: str = "full") -> tuple[Spot, Spot]:
    """Where the red and the blue cube belong in a picture, by CameraFov and GEO."""
    height, width = scene.pictures[name].shape[:2]
    fov = scene.narrow if name == "zoomed" else scene.tile.fov
    scale = width / 2.0 / math.tan(math.radians(fov) / 2.0) / (_AHEAD - _EYE)
    red, blue = (
        (width / 2.0 + scale * right, height / 2.0 - scale * (up - scene.above))
        for right, up in ((_ASIDE, _HIGH), (-_ASIDE, _LOW))
    )
    return red, blue


@dataclass(frozen=True, slots=True)
class Arrangement:
    """How a picture comes from the right one."""

    exchanged: bool  # red and blue
    mirrored: bool  # left and right
    inverted: bool  # top and bottom


def arrangement(
    seen: tuple[Spot, Spot], right: tuple[Spot, Spot], size: tuple[int, int]
) -> Arrangement:
    """The one of eight arrangements of a picture that explains best what is seen; the plainer one
    of two that explain it equally well.

    Args:
        seen: column and row of what is red, and of what is blue.
        right: where they belong.
        size: width and height of the picture, pixels.
    """

    def off(found: Arrangement) -> tuple[float, int]:
        spots = [
            (size[0] - x if found.mirrored else x, size[1] - y if found.inverted else y)
            for x, y in seen
        ]
        spots = spots[::-1] if found.exchanged else spots
        faults = found.exchanged + found.mirrored + found.inverted
        return sum(map(math.dist, spots, right)), faults

    flags = (False, True)
    return min((Arrangement(a, b, c) for a in flags for b in flags for c in flags), key=off)


async def _spots(case: Case, name: str = "full") -> tuple[_Scene, tuple[float, ...], Arrangement]:
    """The scene, column and row of the red and of the blue cube in a picture, and how the picture
    comes from the right one. Exchanged colours are put right: one check is about them."""
    scene = await _scene(case)
    found = *_spot(scene.pictures[name], 0), *_spot(scene.pictures[name], 2)
    case.need(
        not any(map(math.isnan, found)),
        f"the cubes before the camera cannot be told by their colours ({name}): {found}",
    )
    height, width = scene.pictures[name].shape[:2]
    how = arrangement((found[:2], found[2:]), _places(scene, name), (width, height))
    return scene, (*found[2:], *found[:2]) if how.exchanged else found, how


@images("content.colours", "Red is red and blue is blue", "11.15, 2.4")
async def colours(case: Case) -> None:
    """Of a red cube and a blue one before a camera, the higher one, to the right, is the red one in
    the picture, too: red and blue are not exchanged."""
    scene, (red_x, red_y, blue_x, blue_y), how = await _spots(case)
    (right, high), (left, low) = _places(scene)
    case.expect(
        not how.exchanged,
        f"what is red is at column {blue_x:.0f}, row {blue_y:.0f}, not near {right:.0f}, "
        f"{high:.0f}; what is blue at {red_x:.0f}, {red_y:.0f}, not near {left:.0f}, {low:.0f}: "
        "red and blue are exchanged",
    )


@images("content.left-right", "Right is right", "11.16, 2.4")
async def left_right(case: Case) -> None:
    """A cube to the right of the camera is in the right half of the picture, one to the left in the
    left half: it is not mirrored."""
    scene, (red, _, blue, _), how = await _spots(case)
    middle = scene.pictures["full"].shape[1] / 2.0
    (right, _), (left, _) = _places(scene)
    case.expect(
        red > middle > blue,
        f"the right cube is in column {red:.0f} of {2 * middle:.0f}, not near {right:.0f}; the "
        f"left one in {blue:.0f}, not near {left:.0f}" + ": the picture is mirrored" * how.mirrored,
    )


@images("content.top-bottom", "Up is up", "11.16, 2.4")
async def top_bottom(case: Case) -> None:
    """A cube above the camera is in the upper half of the picture, and above a lower one."""
    scene, (_, red, _, blue), how = await _spots(case)
    middle = scene.pictures["full"].shape[0] / 2.0
    (_, high), (_, low) = _places(scene)
    case.expect(
        red < middle and red < blue,
        f"the high cube is in row {red:.0f} of {2 * middle:.0f}, not near {high:.0f}; the low one "
        f"in {blue:.0f}, not near {low:.0f}" + ": the picture is upside down" * how.inverted,
    )


@images("content.fov", "CameraFov tells the angle of view", "2.10, 2.11", Severity.SHOULD)
async def angle_of_view(case: Case) -> None:
    """Two cubes at known places are as far apart in the picture as CameraFov of CONF, the
    horizontal angle of view, puts them, beside and above each other, within 8 percent of the width;
    and so they are at another one after SET FOV."""
    for name in ("zoomed", "full"):  # where the angle is too wide, a narrow one still shows cubes
        scene, (red_x, red_y, blue_x, blue_y), _ = await _spots(case, name)
        fov = scene.tile.fov if name == "full" else scene.narrow
        width = scene.pictures[name].shape[1]
        focal = width / 2.0 / math.tan(math.radians(fov) / 2.0)
        way = _AHEAD - _EYE
        for found, apart, words in (
            (abs(red_x - blue_x), 2.0 * _ASIDE, "columns"),
            (abs(red_y - blue_y), _HIGH - _LOW, "rows"),
        ):
            wanted = focal * apart / way
            case.expect(
                abs(found - wanted) < 0.08 * width,
                f"two cubes are {found:.0f} {words} apart{' after SET FOV' * (name != 'full')}, "
                f"not {wanted:.0f}, as with a CameraFov of {fov:g} degrees",
            )


@images("camera.mount", "The mount turns the camera as GEO says", "2.11", Severity.SHOULD)
async def mount(case: Case) -> None:
    """A link of the package that carries the camera, told to turn by 0.25 rad about its axis of
    GEO, shifts the picture so much and to that side, within a quarter."""
    scene, before, _ = await _spots(case)
    if not scene.looks:
        case.skip("no package that is told of carries the camera")
    width = scene.pictures["full"].shape[1]
    focal = width / 2.0 / math.tan(math.radians(scene.tile.fov) / 2.0)
    for number, (right, down) in enumerate(scene.looks, 1):
        _, after, _ = await _spots(case, f"link {number}")
        shift = ((after[0] + after[2] - before[0] - before[2]) / 2.0,
                 (after[1] + after[3] - before[1] - before[3]) / 2.0)  # fmt: skip
        far = focal * math.tan(_TURNED)
        for found, look, words in ((shift[0], right, "columns"), (shift[1], down, "rows")):
            case.expect(
                abs(found + look * far) < 0.3 * far,
                f"with link {number} at {_TURNED} rad the picture moves by {found:.0f} {words}, not"
                f" by {-look * far:.0f}: Link {number}, or Orientation of GEO",
            )
