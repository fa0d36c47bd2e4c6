"""Answering ray queries: many robots' fans as one batch, against what stands and what moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from usarsim_server.simulation.frames import Numbers
from usarsim_server.simulation.rays.compiled import NOTHING_MOVES, ray_code
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
    if not fans:
        return []
    batch, code = join(fans), ray_code()
    if code is None:
        met = _meet(batch, viewers, snapshot, static, dynamic)
    elif dynamic is None or snapshot is None:
        met = code.cast(batch, static.record, *NOTHING_MOVES)
    else:
        met = code.cast(batch, static.record, *dynamic.at(snapshot, viewers))
    begins = batch.begins.tolist()
    answers = []
    for fan, begin, end in zip(fans, begins, begins[1:], strict=False):
        facing = met.normals[begin:end] if fan.normals and met.normals is not None else None
        called = _names(met.geoms[begin:end], static, dynamic) if fan.identify else None
        answers.append(RayHits(met.distances[begin:end], facing, called))
    return answers


def _meet(
    batch: RayBatch,
    viewers: list[int | None],
    snapshot: Snapshot | None,
    static: StaticGeometry,
    dynamic: DynamicGeometry | None,
) -> Surfaces:
    """What all rays meet first within their ranges, by numpy; of what moves -2 - geom."""
    normals = bool(batch.facing.any())
    full = np.flatnonzero(np.diff(batch.begins)).tolist()
    if not full:
        return Surfaces(np.zeros(0), np.zeros(0, dtype=np.intp), np.zeros((0, 3)))
    if len(full) < len(batch.fans):  # fans without rays have no cones
        batch, viewers = join([batch.fans[fan] for fan in full]), [viewers[fan] for fan in full]
    met = static.cast(
        batch.origins,
        batch.directions,
        normals=normals,
        through_glass=batch.through_glass,
        reach=batch.ranges,
    )
    if dynamic is not None and snapshot is not None:
        reach = np.minimum(met.distances, batch.ranges)
        moving = dynamic.cast(batch, snapshot, viewers, reach, normals=normals)
        if moving is not None:
            nearer = np.flatnonzero(moving.distances < met.distances)
            met.distances[nearer] = moving.distances[nearer]
            met.geoms[nearer] = -2 - moving.geoms[nearer]
            if met.normals is not None and moving.normals is not None:
                met.normals[nearer] = moving.normals[nearer]
    missed = met.distances > batch.ranges
    met.distances[missed], met.geoms[missed] = np.inf, -1
    if met.normals is not None:
        away = products(met.normals, batch.directions) > 0.0
        sign = np.where(missed, 0.0, np.where(away, -1.0, 1.0))
        np.multiply(met.normals, sign[:, None], out=met.normals)
    return met


def _names(
    met: Numbers, static: StaticGeometry, dynamic: DynamicGeometry | None
) -> tuple[str | None, ...]:
    """Names of what was met."""
    names = static.names[np.maximum(met, -1)]
    if dynamic is not None:
        moving = met < -1
        names[moving] = dynamic.objects.names[-2 - met[moving]]
    return tuple(names.tolist())
