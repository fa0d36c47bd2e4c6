"""Sensors of people and tags against where these are (robots reference 2.9)."""

from __future__ import annotations

import math
from statistics import fmean, linear_regression

from usarsim_conformance.case import Case
from usarsim_conformance.excursions import Track, bearer, equipment, spawn_far
from usarsim_conformance.lines import Line, numbers
from usarsim_conformance.ranging import CHANCE, spread_bounds
from usarsim_conformance.registry import UNREAL, UT2004, Severity, checks_of
from usarsim_conformance.visits import View, Visit, visit, watch_walker

measured = checks_of("control", reference="robots reference", dialects=UNREAL)

_NOISE = 0.05
"""Of VictSensor, as a part of the distance, on each axis."""


async def _visit(case: Case, type: str) -> Visit:
    return await visit(case, await bearer(case, type, "GroundTruth", fixed=type))


def _parts(line: Line) -> list[tuple[str, tuple[float, ...]]]:
    """Body parts that a line tells, with their places."""
    names = [value for name, value in line.segments if name == "PartName"]
    places = [numbers(value) for name, value in line.segments if name == "Location"]
    return list(zip(names, places, strict=False))


def _seen(view: View) -> list[list[tuple[str, tuple[float, ...]]]]:
    return [_parts(line) for _, line in view.track.of("VictSensor") if _parts(line)]


@measured("values.victim-location", "A victim is where it is seen", "2.9; protocol reference 4.6")
async def victim_location(case: Case) -> None:
    """Location of a part is relative to the sensor: x ahead, y to the right, z down, m."""
    found = await _visit(case, "VictSensor")
    _, mount = found.mount("VictSensor")
    for name in ("ahead", "right", "left", "far"):
        view = found.views[name]
        places = [place for parts in _seen(view) for _, place in parts]
        case.expect(
            places, f"Location of a part is missing: nobody is seen {view.distance:g} m ahead"
        )
        true = view.seen_from(mount, found.person.location)
        slack = CHANCE * _NOISE * view.distance * 1.2 / math.sqrt(len(places)) + 0.15
        for axis, what in enumerate("xy"):
            mean = fmean(place[axis] for place in places)
            case.expect(
                abs(mean - true[axis]) < slack,
                f"{what} of Location is {mean:.2f} m on average, not {true[axis]:.2f} m, where "
                "the victim is",
            )
        heights: dict[str, list[float]] = {}
        for parts in _seen(view):
            for part, place in parts:
                heights.setdefault(part, []).append(place[2])
        low = [z for part in ("Foot", "Leg") for z in heights.get(part, [])]
        high = [z for part in ("Chest", "Pelvis") for z in heights.get(part, [])]
        if len(low) > 2 and len(high) > 2:
            case.expect(
                fmean(low) > fmean(high) + 0.1,
                f"z of Location of legs is {fmean(low):.2f} m, not below that of chest and "
                f"pelvis, {fmean(high):.2f} m (z down)",
            )
        pelvis = heights.get("Pelvis", [])
        if pelvis:
            slack = CHANCE * _NOISE * view.distance * 1.2 / math.sqrt(len(pelvis)) + 0.15
            case.expect(
                abs(fmean(pelvis) - true[2]) < slack,
                f"z of Location of the Pelvis is {fmean(pelvis):.2f} m, in truth {true[2]:.2f} m",
            )


@measured(
    "values.victim-noise", "A victim is seen as inexactly as it should", "2.9", Severity.SHOULD
)
async def victim_noise(case: Case) -> None:
    """Location of a part scatters from report to report by 0.05 of the distance, on each axis."""
    found = await _visit(case, "VictSensor")
    view = found.views["far"]
    by_part: dict[tuple[str, int], list[tuple[float, ...]]] = {}
    for parts in _seen(view):
        if [name for name, _ in parts] == [name for name, _ in _seen(view)[0]]:
            for number, (part, place) in enumerate(parts):
                by_part.setdefault((part, number), []).append(place)
    squares: list[float] = []
    samples = 0
    for places in by_part.values():
        if len(places) < 3:
            continue
        means = [fmean(place[axis] for place in places) for axis in range(3)]
        sigma = _NOISE * math.hypot(*means)
        for axis in range(3):
            squares += [((place[axis] - means[axis]) / sigma) ** 2 for place in places]
            samples += len(places) - 1
    if samples < 40:
        case.skip(f"only {samples} Locations of parts that are always seen")
    ratio, (low, high) = sum(squares) / samples, spread_bounds(samples)
    case.expect(
        low < ratio < high,
        f"noise of Location is {math.sqrt(ratio) * _NOISE:.4f} of the distance, not {_NOISE:g}, "
        f"over {samples} numbers",
    )


@measured(
    "values.victim-view",
    "A victim sensor sees what is in its field of view",
    "2.9; protocol reference 4.8",
)
async def victim_view(case: Case) -> None:
    """Somebody within HorizontalFOV and MaxRange of CONF is seen, beyond either nobody; parts
    beyond VerticalFOV are not."""
    found = await _visit(case, "VictSensor")
    item, _ = found.mount("VictSensor")
    conf = found.equipment.configured("VictSensor")[item]
    wide, tall, reach = (float(conf[key]) for key in ("HorizontalFOV", "VerticalFOV", "MaxRange"))
    for view in found.views.values():
        lines = [line for _, line in view.track.of("VictSensor")]
        case.need(lines, "no VictSensor line comes")
        seen = bool(_seen(view))
        spot = f"{view.distance:g} m away, {view.bearing:.2f} rad off the axis"
        if view.distance > reach + 0.6:
            case.expect(
                not seen, f"somebody is seen {spot}, and should not be: MaxRange is {reach:g}"
            )
        elif abs(view.bearing) > wide / 2.0 + 0.35:
            case.expect(
                not seen, f"somebody is seen {spot}, and should not be: HorizontalFOV is {wide:g}"
            )
        elif view.distance < reach - 0.6 and abs(view.bearing) < wide / 2.0 - 0.05:
            case.expect(
                seen,
                f"no part of somebody is seen {spot}: HorizontalFOV is {wide:g}, MaxRange "
                f"{reach:g}",
            )
    for parts in _seen(found.views["near"]):
        for part, (x, _, z) in parts:
            case.expect(
                abs(math.atan2(-z, x)) < tall / 2.0 + 0.3,
                f"{part} is seen {math.atan2(-z, x):.2f} rad up, not within half of VerticalFOV, "
                f"{tall:g} rad",
            )


@measured(
    "values.victim-tag", "A victim's tag is where the victim is", "2.9; protocol reference 4.6"
)
async def victim_tag(case: Case) -> None:
    """Location of VictRFID is relative to the reader, VictimName stays."""
    found = await _visit(case, "VictRFID")
    _, mount = found.mount("VictRFID")
    names = set()
    for name in ("ahead", "right", "left", "beside"):
        view = found.views[name]
        lines = [line for _, line in view.track.of("VictRFID")]
        if not lines:
            case.skip("the victim that stands bears no tag")
        true = view.seen_from(mount, found.person.location)
        for axis, what in ((0, "x"), (1, "y")):
            place = lines[-1].numbers("Location")[axis]
            case.expect(
                abs(place - true[axis]) < 0.25,
                f"{what} of Location is {place:.2f} m, not {true[axis]:.2f} m, where the victim is",
            )
        z = lines[-1].numbers("Location")[2]
        case.expect(
            abs(z - true[2]) < 0.6,
            f"z of Location is {z:.2f} m, not {true[2]:.2f} m, where the pelvis is",
        )
        names.add(lines[-1].get("VictimName"))
    case.expect(len(names) == 1, f"VictimName of one victim is {names}, not always the same")


@measured("values.co2", "CO2 thins with the square of the distance", "2.9", Severity.SHOULD)
async def co2(case: Case) -> None:
    """Density near somebody who breathes falls with the square of the distance."""
    found = await _visit(case, "CO2Sensor")
    told = []
    for name in ("near", "ahead", "far"):
        view = found.views[name]
        values = [line.number("Density") for _, line in view.track.of("CO2Sensor")]
        case.need(values, "no CO2Sensor line comes")
        told.append((found.head_distance(view, "CO2Sensor"), values[-1]))
    if told[0][1] < 0.1:
        case.skip("nobody breathes out enough to measure it")
    near, density = told[0]
    for away, value in told[1:]:
        wanted = density * (near / away) ** 2
        case.expect(
            abs(value - wanted) < 0.25 * wanted + 0.011,
            f"Density is {density:g} at {near:.2f} m, {value:g} at {away:.2f} m, not {wanted:.3f}",
        )


@measured("values.loudness", "Sound fades by 6 dB with every doubling", "2.9", Severity.SHOULD)
async def loudness(case: Case) -> None:
    """Loudness of somebody who calls falls by 20 log10 of the distance, and Duration stays."""
    found = await _visit(case, "Sound")
    told = []
    for name in ("near", "ahead", "far", "away"):
        view = found.views[name]
        lines = [line for _, line in view.track.of("Sound") if line.number("Loudness") > 0.0]
        if not lines:
            case.skip("nobody calls all the time")
        told.append((found.head_distance(view, "Sound"), lines[-1]))
    near, first = told[0]
    for away, line in told[1:]:
        wanted = first.number("Loudness") - 20.0 * math.log10(away / near)
        case.expect(
            abs(line.number("Loudness") - wanted) < 1.0,
            f"Loudness is {first.get('Loudness')} at {near:.2f} m and {line.get('Loudness')} at "
            f"{away:.2f} m, not {wanted:.2f}",
        )
        case.expect(
            line.get("Duration") == first.get("Duration"),
            f"Duration is {line.get('Duration')} at {away:.2f} m, not {first.get('Duration')}, as "
            f"at {near:.2f} m",
        )


@measured(
    "values.acoustic",
    "An acoustic array hears where a call comes from",
    "2.9; protocol reference 4.6",
)
async def acoustic(case: Case) -> None:
    """Direction is a unit vector in the sensor's frame, z up, towards who calls; Volume falls by 20
    log10 of the distance and, with Duration, is what a Sound sensor there says; Delay is the time
    that sound takes, at most."""
    found = await _visit(case, "Acoustic")
    _, mount = found.mount("Acoustic")
    x, y, z = found.person.location
    told = []
    for name in ("near", "right", "left", "beside", "far"):
        view = found.views[name]
        lines = [line for _, line in view.track.of("Acoustic") if line.get("Direction")]
        if not lines:
            continue
        line = lines[-1]
        true = view.seen_from(mount, (x, y, z - 0.65))
        away = math.hypot(*true)
        direction = line.numbers("Direction")
        for axis, wanted in enumerate((true[0] / away, true[1] / away, -true[2] / away)):
            case.expect(
                abs(direction[axis] - wanted) < 0.12,
                f"{'xyz'[axis]} of Direction is {direction[axis]:.2f}, not {wanted:.2f}",
            )
        told.append((away, line.number("Volume")))
        delay = line.number("Delay")
        case.expect(
            0.0 <= delay < away / 300.0 + 0.01,
            f"Delay is {delay:g} s at {away:.1f} m, not at least 0 and at most "
            f"{away / 300.0 + 0.01:.3f} s",
        )
        heard = [one for _, one in view.track.of("Sound") if one.number("Loudness") > 0.0]
        if heard:
            for key, other in (("Volume", "Loudness"), ("Duration", "Duration")):
                a, b = line.number(key), heard[-1].number(other)
                case.expect(
                    abs(a - b) < 0.3, f"{key} is {a:g}, not {b:g}, {other} of a Sound sensor there"
                )
    if not told:
        case.skip("nobody calls all the time")
    near, first = told[0]
    for away, volume in told[1:]:
        wanted = first - 20.0 * math.log10(away / near)
        case.expect(
            abs(volume - wanted) < 1.0,
            f"Volume is {volume:.1f} at {away:.2f} m, not {wanted:.1f}, for it is {first:.1f} at "
            f"{near:.2f} m",
        )


@measured(
    "values.human-motion", "HumanMotion tells who moves", "2.9", Severity.SHOULD, dialects=UT2004
)
async def human_motion(case: Case) -> None:
    """Prob is 0 while nobody moves, and behind the robot's back, and falls in proportion to the
    distance of who walks, from 1 at the sensor."""
    found = await _visit(case, "HumanMotion")
    for _, line in found.views["ahead"].track.of("HumanMotion"):
        case.expect(
            line.number("Prob") == 0.0,
            f"Prob is {line.get('Prob')} before somebody who stands, not 0: {line}",
        )
    told = await watch_walker(case, found.equipment.class_name)
    case.need(
        len(told.behind) > 15,
        f"only {len(told.behind)} HumanMotion lines with somebody behind, more than 15 are needed",
    )
    case.expect(
        not any(told.behind),
        f"Prob is up to {max(told.behind):g}, not 0, while somebody walks behind the robot, which "
        "faces away (robots reference 2.9: within the field of view)",
    )
    walking = [(away, prob) for away, speed, prob in told.ahead if speed > 0.45]
    case.need(
        len(walking) > 15,
        f"only {len(walking)} HumanMotion lines with somebody who walks faster than 0.45 m/s, more "
        "than 15 are needed",
    )
    case.expect(
        all(0.0 <= prob <= 1.0 for _, prob in walking),
        f"Prob is {min(prob for _, prob in walking):g} to {max(prob for _, prob in walking):g}, "
        "not within 0 and 1",
    )
    case.expect(
        any(prob > 0.0 for _, prob in walking),
        f"Prob is 0 in all {len(walking)} reports before somebody who walks, not above 0",
    )
    seen = [(away, prob) for away, prob in walking if prob > 0.0]
    slope, start = linear_regression([away for away, _ in seen], [prob for _, prob in seen])
    case.expect(slope < 0.0, f"Prob changes by {slope:.3f} for a metre more, not by less than 0")
    case.expect(
        abs(start - 1.0) < 0.15,
        f"Prob is {start:.2f} at no distance, not 1, by its fall of {-slope:.3f} a metre",
    )


@measured("values.rfid-location", "A tag is where it was dropped", "2.9; protocol reference 4.6")
async def rfid_location(case: Case) -> None:
    """Location of RFID is relative to the reader, x ahead, y to the right, z down: that of the
    place where a releaser dropped the tag, while the robot drives about."""
    await _judge_tag(case, "RFID")


@measured(
    "values.rfid-tag-location",
    "A tag is where it was dropped, for a tag reader",
    "2.9; protocol reference 4.6",
)
async def rfid_tag_location(case: Case) -> None:
    """Location of RFIDTag is relative to the reader, as that of RFID."""
    await _judge_tag(case, "RFIDTag")


async def _judge_tag(case: Case, type: str) -> None:
    class_name = await bearer(case, type, "RFIDReleaser", "GroundTruth", fixed=type)
    worn = await equipment(case, class_name)

    async def drop(case: Case) -> tuple[View, Track]:
        robot = await spawn_far(case, class_name)
        before = await robot.pose()
        gun = next(iter(worn.mounts("RFIDReleaser")))
        await robot.send(f"SET {{Type RFIDReleaser}} {{Name {gun}}} {{Opcode Release}}")
        await robot.run(0.6)
        begun = len(robot.client.lines)
        for left, right, seconds in ((3, 3, 2.0), (3, -3, 1.5), (3, 2, 2.0), (-3, 3, 1.0)):
            await robot.under(f"DRIVE {{Left {left}}} {{Right {right}}}", seconds=seconds)
        return View("", 0.0, 0.0, before, Track(())), Track(robot.client.lines[begun:])

    start, track = await case.shared(f"{class_name} drops a tag", drop)
    gun = next(iter(worn.mounts("RFIDReleaser").values()))
    mount = next(iter(worn.mounts(type).values()))
    # The tag in the world: where the releaser was.
    x, y, z = gun.location
    cos, sin = math.cos(start.pose.yaw), math.sin(start.pose.yaw)
    base = start.pose.location
    tag = (base[0] + cos * x - sin * y, base[1] + sin * x + cos * y, base[2] + z)
    lines = track.of(type)
    case.expect(
        len(lines) > 5, f"{len(lines)} {type} lines tell of a tag that was dropped, not at least 6"
    )
    for time, line in lines:
        true = View("", 0.0, 0.0, track.truth(time), track).seen_from(mount, tag)
        for axis, place in enumerate(line.numbers("Location")):
            case.expect(
                abs(place - true[axis]) < 0.12,
                f"{'xyz'[axis]} of Location is {place:.2f} m, not {true[axis]:.2f} m, where the "
                "tag is",
            )
