"""Range scanners (protocol reference 6.7), and rows of ranges, depth pictures, points and objects
against walls (robots reference 2.3, 2.9)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median

from usarsim_conformance.case import Case
from usarsim_conformance.ranging import (
    EDGE,
    SLACK,
    Beam,
    floor_below,
    judge_beam,
    limit,
    ray,
    walls_for,
)
from usarsim_conformance.recordings import senses, standing, told
from usarsim_conformance.registry import UNREAL, checks_of, control, gazebo, unreal
from usarsim_conformance.walls import Scene, Vector, turned_by

measured = checks_of("control", reference="robots reference", dialects=UNREAL)


@unreal("values.scan-3d-range", "A scan in rows measures a wall", "4.6")
async def scan_3d_range(case: Case) -> None:
    """Range of a RangeScanner3D is row by row from up to down, each from right to left, by the two
    angles of Resolution and FOV."""
    type = "RangeScanner3D"
    found = await walls_for(case, type)
    beams: list[Beam] = []
    for scene in found.scenes:
        for name, mount in found.mounts(type).items():
            lines = [line for _, line in scene.track.of(type) if line.get("Name") == name]
            if not lines:
                continue
            line = lines[-1]
            (row, beam), (high, wide) = line.numbers("Resolution"), line.numbers("FOV")
            ranges = line.numbers("Range")
            columns, rows = round(wide / beam) + 1, round(high / row) + 1
            case.expect(
                len(ranges) == columns * rows,
                f"{len(ranges)} values of Range, not {columns} x {rows}",
            )
            for number, value in enumerate(ranges):
                down, left = divmod(number, columns)
                start, way = ray(mount, wide / 2.0 - left * beam, high / 2.0 - down * row)
                what = f"{name}, row {down + 1}, beam {left + 1}"
                beams.append(Beam(scene, name, what, start, way, value))
    case.need(
        len(beams) > 10,
        f"only {len(beams)} ranges of {type} that can be judged, more than 10 are needed",
    )
    floor = floor_below(beams, limit(found, type, beams[0].item, "MaxRange"))
    for one in beams:
        judge_beam(case, found, type, "Range", one, False, floor)


@measured("values.image-range", "A depth picture measures a wall", "2.3; protocol reference 4.6")
async def image_range(case: Case) -> None:
    """Range of a RangeImager is the depth along its axis, row by row from up to down, each from
    left to right, from -FOV/2 on by FOV over the number of pixels."""
    type = "RangeImager"
    found = await walls_for(case, type)
    seen = 0
    for scene in found.of("ahead", "half", "low"):
        for name, mount in found.mounts(type).items():
            lines = [
                line
                for _, line in scene.track.of(type)
                if line.get("Name") == name and line.number("Frames") > 0
            ]
            if not lines:
                continue
            conf = found.equipment.configured(type)[name]
            wide = float(conf["Fov"].split(",")[0])
            frames = round(lines[0].number("Frames"))
            pixels = {
                round(line.number("Frame")): (line.get("Range") or "").rstrip(",").split(",")
                for line in lines[-frames:]
            }
            if len(pixels) < frames:
                continue
            if case.dialect == "udk":
                columns = round(float(conf["Resolution"].split(",")[0]))
                tall = float(conf["Fov"].split(",")[1])
            else:
                columns = round(wide / float(conf["Resolution"]))
                tall = math.nan  # not told
            values = [float(text) for frame in range(frames) for text in pixels[frame]]
            rows = len(values) // columns
            case.expect(
                rows * columns == len(values),
                f"Range has {len(values)} values, not a multiple of {columns}, those of a row",
            )
            for number, value in enumerate(values):
                down, right = divmod(number, columns)
                yaw = wide * (right / columns - 0.5)
                pitch = 0.0 if math.isnan(tall) else tall * (0.5 - down / rows)
                if math.isnan(tall) and scene.name == "low":
                    continue
                start, way = ray(mount, yaw, pitch)
                depth = math.cos(yaw) * math.cos(pitch)
                assert scene.wall is not None
                length, margin = scene.wall.along(start, way)
                high = float(conf["MaxRange"])
                if length == math.inf and way[2] > 0.0:
                    continue  # it looks at the floor
                if margin < EDGE or (math.isnan(tall) and margin < 0.3):
                    continue
                wanted = min(length * depth, high)
                seen += 1
                case.expect(
                    abs(value - wanted) < SLACK + 0.005 * wanted,
                    f"Range of {name}, row {down + 1}, pixel {right + 1}, is {value:.3f} m, not "
                    f"{wanted:.3f} m (scene {scene.name!r})",
                )
    case.need(
        seen > 10, f"only {seen} pixels of {type} that can be judged, more than 10 are needed"
    )


def _judge_points(
    case: Case,
    scene: Scene,
    name: str,
    start: Vector,
    points: list[Vector],
    high: float,
) -> int:
    """Points in the robot's frame: on the wall, or at the end of the range where there is none."""
    on_wall = 0
    for number, point in enumerate(points):
        length = math.dist(start, point)
        way = tuple((b - a) / max(length, 1e-9) for a, b in zip(start, point, strict=True))
        wall = scene.wall
        meets, margin = wall.along(start, way) if wall else (math.inf, math.inf)  # type: ignore[arg-type]
        if margin < EDGE or abs(meets - high) < 0.02 * high + SLACK:
            continue
        wanted = min(meets, high)
        on_wall += meets < high
        shown = ",".join(f"{value:.2f}" for value in point)
        case.expect(
            abs(length - wanted) < SLACK + 0.005 * wanted,
            f"point {number + 1} of {name} is at {shown} from the robot, {length:.3f} m away, not "
            f"{wanted:.3f} m (scene {scene.name!r})",
        )
    return on_wall


def _triples(text: str) -> list[Vector]:
    found = []
    for part in text.replace("][", ";").strip("[] ").replace(" ", ";").split(";"):
        x, y, z = map(float, part.split(","))
        found.append((x, y, z))
    return found


@unreal("values.line-laser-points", "Points of a line laser lie on the wall", "4.6")
async def line_laser_points(case: Case) -> None:
    """Location and Orientation of a LineLaser are where it is in the world, and Points where its
    beams end there, from left to right over FOV: on a wall, or MaxRange away."""
    type = "LineLaser"
    found = await walls_for(case, type)
    met = {"ahead": 0, "half": 0}
    for scene in found.of("open", "ahead", "half"):
        for name, mount in found.mounts(type).items():
            lines = [line for _, line in scene.track.of(type) if line.get("Name") == name]
            if not lines:
                continue
            start = found.inside(lines[-1].numbers("Location"))
            case.expect(
                math.dist(start, mount.location) < 0.05,
                f"Location of {name} is {start} from the robot, not {mount.location}, its mount",
            )
            yaw = lines[-1].numbers("Orientation")[2] - found.place.rotation[2]
            case.expect(
                abs(math.remainder(yaw - mount.orientation[2], math.tau)) < 0.02,
                f"Orientation of {name} is {yaw:.3f} from the robot's, not "
                f"{mount.orientation[2]:.3f}, its mount",
            )
            points = [found.inside(point) for point in _triples(lines[-1].get("Points") or "")]
            high = limit(found, type, name, "MaxRange")
            count = _judge_points(case, scene, f"Points of {name}", start, points, high)
            met[scene.name] = met.get(scene.name, 0) + count
            bearings = [math.atan2(p[1] - start[1], p[0] - start[0]) for p in points]
            wide = float(found.equipment.configured(type)[name]["FOV"])
            case.expect(
                abs(bearings[-1] - bearings[0] - wide) < 0.03,
                f"Points of {name} go over {bearings[-1] - bearings[0]:.2f} rad, from "
                f"{bearings[0]:.2f} to {bearings[-1]:.2f}, not over {wide:g} rad, FOV",
            )
    case.expect(
        met["ahead"] > met["half"] > 0,
        f"Points on a wall and on half of it are {met}, not fewer on the half, and some on both",
    )


@unreal("values.cloud-points", "Points of a cloud lie on the wall", "4.6")
async def cloud_points(case: Case) -> None:
    """Points of a PCL sensor are in its own frame, x ahead, y to the right, z down: those of a wall
    lie on it."""
    type = "PCL"
    found = await walls_for(case, type)
    met: dict[tuple[str, str], int] = {}
    for scene in found.of("ahead", "half", "low"):
        for name, mount in found.mounts(type).items():
            lines = [line for _, line in scene.track.of(type) if line.get("Name") == name]
            for line in lines:
                body = line.text.rpartition("{")[2].rstrip("} ")
                points = []
                start = (mount.location[0], mount.location[1], mount.location[2])
                for point in _triples(body):
                    x, y, z = turned_by(mount.orientation, point)
                    points.append((x + start[0], y + start[1], z + start[2]))
                count = 0
                for number, point in enumerate(points):
                    # Parallel beams begin beside the sensor, so only walls are judged.
                    assert scene.wall is not None
                    off, margin = scene.wall.off(point), scene.wall.margin(point)
                    shown = ",".join(f"{value:.2f}" for value in point)
                    case.expect(
                        not (margin > EDGE and off > SLACK),
                        f"point {number + 1} of {name} is {off:.2f} m behind the wall, not on it: "
                        f"{shown} from the robot",
                    )
                    count += abs(off) < SLACK and margin > -SLACK
                    case.expect(
                        off > -SLACK,
                        f"point {number + 1} of {name} is {-off:.2f} m before the wall, not on "
                        f"it: {shown} from the robot",
                    )
                    case.expect(
                        abs(off) > SLACK or margin > -SLACK,
                        f"point {number + 1} of {name} is {-margin:.2f} m beside the wall, not on "
                        f"it: {shown} from the robot",
                    )
                key = (name, scene.name)
                met[key] = met.get(key, 0) + count
    for (name, scene_name), count in met.items():
        case.expect(count > 0, f"no point of {name} is on the wall (scene {scene_name!r})")
        if scene_name != "ahead":
            whole = met.get((name, "ahead"), count + 1)
            case.expect(
                count < whole,
                f"{count} points of {name} are on a part of the wall (scene {scene_name!r}), not "
                f"fewer than {whole}, as on the whole wall",
            )


@measured(
    "values.object-sensor", "An object sensor tells what is ahead", "2.9; protocol reference 4.6"
)
async def object_sensor(case: Case) -> None:
    """Location and Orientation of an ObjectSensor's Object are those of the object in the world,
    and HitLoc is on its face."""
    type = "ObjectSensor"
    found = await walls_for(case, type)
    seen = 0
    for scene in found.of("ahead", "half", "right"):
        for name in found.mounts(type):
            lines = [line for _, line in scene.track.of(type) if line.get("Name") == name]
            if not lines:
                continue
            line, wall = lines[-1], scene.wall
            assert wall is not None
            if scene.name == "right":
                case.expect(
                    line.get("Object") is None,
                    f"Object is {line.get('Object')} with a wall beside the robot only, not "
                    f"absent: {line}",
                )
                continue
            case.expect(line.get("Object"), f"Object of {name} is missing before a wall: {line}")
            place, turn, point = (
                line.numbers(key) for key in ("Location", "Orientation", "HitLoc")
            )
            case.expect(
                math.dist(place, scene.place[:3]) < 0.05,
                f"Location of the Object is {place}, not {scene.place[:3]}, as in truth",
            )
            case.expect(
                abs(math.remainder(turn[2] - scene.place[3], math.tau)) < 0.03,
                f"Orientation of the Object is {turn}, not {scene.place[3]:.3f} in yaw, as in "
                "truth",
            )
            hit = found.inside(point)
            case.expect(
                abs(wall.off(hit)) < SLACK and wall.margin(hit) > -SLACK,
                f"HitLoc is {wall.off(hit):.3f} m beyond the wall and {wall.margin(hit):.3f} m "
                "inside its edges, not on its face",
            )
            seen += 1
    case.need(seen > 1, f"only {seen} ObjectSensor lines before a wall, more than 1 are needed")


@unreal("sensors.scan-order", "Segments of a scan", "6, no. 102")
async def scan_order(case: Case) -> None:
    """RangeScanner segments are Name, Resolution, FOV, Range in this order, Range last, with
    exactly this spelling."""
    for line in (await senses(case, "RangeScanner"))[1]:
        names = line.names[line.names.index("Name") :]
        case.expect_names(line, ("Name", "Resolution", "FOV", "Range"), names)


@control("sensors.scan-numbers", "A scan is numbers with commas", "4.6")
async def scan_numbers(case: Case) -> None:
    """Ranges are plain numbers joined by single commas, none missing, none at the end."""
    for line in (await senses(case, "RangeScanner"))[1]:
        values = line.numbers("Range")
        case.expect(
            values and not any(map(math.isnan, values)), f"Range has no plain numbers: {line}"
        )


@control("sensors.scan-count", "Number of ranges", "6, no. 103")
async def scan_count(case: Case) -> None:
    """The number of ranges is floor(FOV / Resolution) + 1 and never exceeds
    round(printed FOV / printed Resolution) + 1, beyond which one client crashes."""
    for line in (await senses(case, "RangeScanner"))[1]:
        beams = line.number("FOV") / line.number("Resolution")
        count = len(line.numbers("Range"))
        case.expect(
            count <= round(beams) + 1,
            f"Range of {line.get('Name')} has {count} numbers, not at most {round(beams) + 1} "
            f"(FOV / Resolution + 1): {line}",
        )
        case.expect(
            count >= math.floor(beams),
            f"Range of {line.get('Name')} has {count} numbers, not at least {math.floor(beams)} "
            f"(FOV / Resolution): {line}",
        )


@unreal("sensors.scan-miss", "A beam without echo reads MaxRange", "6, no. 105")
async def scan_miss(case: Case) -> None:
    """No range is larger than the MaxRange of CONF."""
    recording, lines = await senses(case, "RangeScanner")
    conf = recording.replies.get(("GETCONF", "RangeScanner", ""))
    case.need(conf is not None, "GETCONF {Type RangeScanner} was not answered")
    assert conf is not None
    limits = {item["Name"]: float(item["MaxRange"]) for item in conf.items()}
    for line in lines:
        most, limit = max(line.numbers("Range")), limits[line.get("Name") or ""]
        case.expect(
            most <= limit + 1e-3,
            f"Range of {line.get('Name')} is up to {most} m, not at most {limit} m, MaxRange of "
            "CONF",
        )


@unreal("sensors.scan-right-first", "Scans begin on the right", "6, no. 104", exclusive=True)
async def scan_right_first(case: Case) -> None:
    """An obstacle to the right of the robot, another robot or a wall, appears in the first half of
    the range list."""
    change = await _shadow(case, right=0.9)
    case.expect(
        change < 0.5,
        f"what is on the right shortens Range at {change:.0%} of its list, not in the first half",
    )


@gazebo(
    "sensors.scan-left-first",
    "Scans begin on the left in the Gazebo prototype",
    "4.15",
    exclusive=True,
)
async def scan_left_first(case: Case) -> None:
    """In the prototype's form an obstacle on the right appears in the second half."""
    change = await _shadow(case, right=-0.9)
    case.expect(
        change > 0.5,
        f"what is on the right shortens Range at {change:.0%} of its list, not in the second half",
    )


async def _shadow(case: Case, right: float) -> float:
    """Where in the scan a robot beside the first one shortens the ranges: 0 first, 1 last."""
    if not (await standing(case)).of("SEN", "RangeScanner"):
        case.skip("the robot has no RangeScanner")
    base = await case.place()
    case.need(base.tag is None or any(base.location), "the server lists no start poses")
    watcher = await case.spawn(place=base)
    size = (await told(case, "GETGEO", "Robot")).numbers("Dimensions")[:2]
    if len(size) == 2:  # large robots get room
        right = math.copysign(max(abs(right), 0.5 * size[1] + 0.5 * max(size) + 0.2), right)
    await watcher.run(0.6)
    alone = (await watcher.sensor("RangeScanner")).numbers("Range")
    # Tall enough to be seen by a scanner on the deck of a robot like itself: tipped on its side.
    beside = base.moved(right=right, forward=0.15, down=-0.35 if right > 0 else 0.35)
    tipped = (1.57, 0.0, beside.rotation[2])
    await case.spawn(place=type(beside)(None, beside.location, tipped))
    await watcher.run(0.8)
    together = (await watcher.sensor("RangeScanner")).numbers("Range")
    # A scanner may look over a robot like its own, but over no wall.
    nearer = _shortened(alone, together)
    if not nearer and right > 0:
        nearer = await _beside_a_wall(case)
    case.need(nearer, "the scanner saw neither a robot nor a wall beside it")
    return median(nearer)


async def _beside_a_wall(case: Case) -> list[float]:
    """Where in the scan a wall on the right shortens the ranges."""
    found = await walls_for(case, "RangeScanner")
    scans = {
        scene.name: line.numbers("Range")
        for scene in found.of("open", "right")
        for _, line in scene.track.of("RangeScanner")
    }
    return _shortened(scans.get("open", ()), scans.get("right", ()))


def _shortened(before: Sequence[float], after: Sequence[float]) -> list[float]:
    """Where in a scan, 0 first and 1 last, ranges have become shorter."""
    return [
        index / max(1, len(before) - 1)
        for index, (one, other) in enumerate(zip(before, after, strict=False))
        if other < one - 0.1
    ]


@control("sensors.scan-length", "A scan of 181 beams fits 2000 bytes", "6, no. 106")
async def scan_length(case: Case) -> None:
    """A RangeScanner line of at most 181 beams is shorter than 2000 bytes."""
    for line in (await senses(case, "RangeScanner"))[1]:
        if len(line.numbers("Range")) <= 181:
            case.expect(
                len(line.raw) < 2000,
                f"a line of {len(line.numbers('Range'))} ranges has {len(line.raw)} bytes, not "
                f"less than 2000: {line}",
            )
