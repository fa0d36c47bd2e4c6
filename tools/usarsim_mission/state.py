"""`state.csv`: where every robot was and how it was driven, ten times a second, from the logs.

One row per robot and truth row, or per second, third, ... truth row of a long run of many robots;
what belongs to the team stands in each. An empty cell is not known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, TextIO

from usarsim_mission import records
from usarsim_mission.referee import Referee
from usarsim_server.base.csv_files import CsvWriter

STATE = "state.csv"
COLUMNS = {
    "t_sim": "s",
    "robot": "",
    "x": "m",
    "y": "m",
    "z": "m",
    "roll": "rad",
    "pitch": "rad",
    "yaw": "rad",
    "vx": "m/s",
    "vy": "m/s",
    "vz": "m/s",
    "yaw_rate": "rad/s",
    "mode": "",
    "zone": "",
    "signal": "dBm",
    "linked": "0 or 1",
    "battery": "0..1",
    "area_team": "0..1",
    "area_base": "0..1",
}
"""Names and units, in MuJoCo's frame."""


MOST = 100_000
"""Rows up to which all are written: 8 robots for 20 minutes."""


def thinned(instants: int, robots: int) -> int:
    """Every how manieth truth row is written, so that no run has much more than `MOST` rows."""
    return max(1, math.ceil(instants * robots / MOST))


class StateTable:
    """Writes the rows."""

    def __init__(self, file: TextIO, every: int = 1) -> None:
        """Write the names of the columns to a file that was opened with `newline=""`.

        Args:
            file: where. every: how manieth truth row is written.
        """
        self._writer = CsvWriter(file)
        self._writer.row(COLUMNS)
        self._every, self._count = every, 0

    def take(self, record: Mapping[str, Any], referee: Referee) -> None:
        """A record, which the referee has been told."""
        if record["kind"] == "truth":
            if self._count % self._every == 0:
                self._writer.rows(_rows(record, referee))
            self._count += 1


def _rows(record: Mapping[str, Any], referee: Referee) -> Iterator[list[object]]:
    area = [_cell(referee.area.share(source), 4) for source in ("team", "base")]
    for row in records.rows(record, "robots"):
        robot = referee.visits.robot(records.text(row, "name"))
        pos, linear, angular = (_three(row, key) for key in ("pos", "linear", "angular"))
        yield [
            _cell(record["t_sim"], 3),
            robot.name,
            *(_cell(one, 3) for one in pos),
            *(_cell(one, 4) for one in _angles(row)),
            *(_cell(one, 3) for one in linear),
            _cell(angular[2], 3),
            robot.mode,
            "" if robot.zone is None else robot.zone.name,
            _cell(robot.signal, 2),
            int(robot.linked),
            _cell(row.get("battery"), 4),
            *area,
        ]


def _three(row: Mapping[str, Any], key: str) -> tuple[float | None, ...]:
    value = row.get(key)
    good = isinstance(value, list) and len(value) == 3
    return tuple(value) if good and value else (None, None, None)


def _angles(row: Mapping[str, Any]) -> tuple[float | None, ...]:
    """Roll, pitch and yaw as they are applied: Rz(yaw) Ry(pitch) Rx(roll); rad."""
    quat = row.get("quat")
    if not isinstance(quat, list) or len(quat) != 4 or None in quat:
        return None, None, None
    w, x, y, z = quat
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0)),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def _cell(value: float | None, digits: int) -> object:
    return "" if value is None else round(value, digits) + 0.0
