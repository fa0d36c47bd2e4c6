"""Answering ray queries: many robots' fans as one batch, against what stands and what moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from usarsim_server.simulation.objects import Names
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.query import PendingReport, RayBatch, RayFan, RayHits, join
from usarsim_server.simulation.rays.scenery import StaticGeometry
from usarsim_server.simulation.rays.triangles import Surfaces, products
from usarsim_server.simulation.snapshot import Snapshot


def cast(
    fans: Sequence[RayFan],
    snapshot: Snapshot,
    robot: int | None,
    static: StaticGeometry,
    dynamic: DynamicGeometry,
) -> list[RayHits]:
    """Answer fans against the whole world as it is in a snapshot, the robot itself left out."""
    return _answer(fans, [robot] * len(fans), snapshot, static, dynamic)


def cast_all(
    reports: Sequence[PendingReport], static: StaticGeometry, dynamic: DynamicGeometry
) -> list[list[RayHits]]:
    """Answer the fans of many reports about one instant, all rays as one batch.

    Returns:
        The answers for each report, in the order of its fans.
    """
    fans = [fan for report in reports for fan in report.fans]
    viewers = [report.robot for report in reports for _ in report.fans]
    answers = iter(_answer(fans, viewers, reports[0].snapshot, static, dynamic))
    return [[next(answers) for _ in report.fans] for report in reports]


def cast_scenery(fans: Sequence[RayFan], static: StaticGeometry) -> list[RayHits]:
    """Answer fans against what never moves."""
    return _answer(fans, [None] * len(fans), None, static, None)


def _answer(
    fans: Sequence[RayFan],
    viewers: list[int | None],
    snapshot: Snapshot | None,
    static: StaticGeometry,
    dynamic: DynamicGeometry | None,
) -> list[RayHits]:
    full = [number for number, fan in enumerate(fans) if len(fan.directions)]
    if not full:
        return [_nothing(fan) for fan in fans]
    if len(full) < len(fans):
        viewers = [viewers[number] for number in full]
    batch = join([fans[number] for number in full])
    found = iter(_cut(batch, *_meet(batch, viewers, snapshot, static, dynamic)))
    return [next(found) if len(fan.directions) else _nothing(fan) for fan in fans]


def _meet(
    batch: RayBatch,
    viewers: list[int | None],
    snapshot: Snapshot | None,
    static: StaticGeometry,
    dynamic: DynamicGeometry | None,
) -> tuple[Surfaces, Names | None]:
    """What all rays meet first, at any distance, and the names (n,) of it if any fan asks."""
    normals = any(fan.normals for fan in batch.fans)
    moving, reach = None, batch.ranges
    if dynamic is not None and snapshot is not None:
        moving = dynamic.cast_at_once(batch, snapshot, viewers, normals=normals)
    if moving is not None:
        reach = np.minimum(reach, moving.distances)
    fixed = static.cast(
        batch.origins,
        batch.directions,
        normals=normals,
        through_glass=batch.through_glass,
        reach=reach,
    )
    names = static.names[fixed.geoms] if any(fan.identify for fan in batch.fans) else None
    if dynamic is None or snapshot is None:
        return fixed, names
    if moving is None:
        reach = np.minimum(fixed.distances, reach)
        moving = dynamic.cast(batch, snapshot, viewers, reach, normals=normals)
    if moving is not None:
        nearer = np.flatnonzero(moving.distances < fixed.distances)
        fixed.distances[nearer] = moving.distances[nearer]
        if names is not None:
            names[nearer] = dynamic.objects.names[moving.geoms[nearer]]
        if fixed.normals is not None and moving.normals is not None:
            fixed.normals[nearer] = moving.normals[nearer]
    return fixed, names


def _cut(batch: RayBatch, surfaces: Surfaces, names: Names | None) -> list[RayHits]:
    """The answer to each fan: hits within its range, and of them what it asked for."""
    missed = surfaces.distances > batch.ranges
    distances = np.where(missed, np.inf, surfaces.distances)
    normals = surfaces.normals
    if normals is not None:
        away = products(normals, batch.directions) > 0.0
        sign = np.where(missed, 0.0, np.where(away, -1.0, 1.0))
        normals = normals * sign[:, None]
    begins = batch.begins.tolist()
    answers = []
    for fan, begin, end in zip(batch.fans, begins, begins[1:], strict=False):
        part = slice(begin, end)
        facing = normals[part] if fan.normals and normals is not None else None
        called = None
        if fan.identify and names is not None:
            names[part][missed[part]] = None
            called = tuple(names[part].tolist())
        answers.append(RayHits(distances[part], facing, called))
    return answers


def _nothing(fan: RayFan) -> RayHits:
    """The answer to a fan without rays."""
    return RayHits(
        np.zeros(0), np.zeros((0, 3)) if fan.normals else None, () if fan.identify else None
    )
