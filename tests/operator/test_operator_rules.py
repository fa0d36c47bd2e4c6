"""The rules of the gateway without sockets: locks, alarms, limits, texts of pages, maps."""

from __future__ import annotations

import json
import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_client import readings
from usarsim_operator import messages, packets
from usarsim_operator.alarms import SHOWN, Alarms, StuckWatch
from usarsim_operator.messages import FIELDS, PageError
from usarsim_operator.motion import by_class
from usarsim_operator.occupancy import OccupancyMap
from usarsim_operator.roles import REFUSALS, Limits, Role, Tokens
from usarsim_operator.telemetry import Telemetry
from usarsim_operator.watchdog import DRIVE_TIME, Watchdog
from usarsim_report.serving import foreign, hosts_of

Log = list[tuple[str, dict[str, object]]]


def test_watchdog_tells_each_robot_once() -> None:
    """O-19: no drive for so long, or its page gone."""
    watchdog = Watchdog()
    watchdog.drove("R", 1, False, 0.0)
    watchdog.drove("S", 1, True, 0.0)
    assert not watchdog.overdue(DRIVE_TIME - 0.01)
    assert watchdog.overdue(DRIVE_TIME) == ["R"]
    assert not watchdog.overdue(DRIVE_TIME)
    watchdog.drove("R", 1, False, 1.0)
    assert watchdog.gone(1) == ["R"]
    assert not watchdog.overdue(9.0)


def test_alarm_comes_once_for_a_cause_and_again_after_calm() -> None:
    """CON-17."""
    log: Log = []
    alarms = Alarms(lambda what, facts: log.append((what, facts)))
    for step in range(50):
        alarms.see("R", "battery", True, "low", step * 0.1)
    assert len(log) == 1
    (row,), _ = alarms.shown()
    assert row["count"] == 1
    alarms.see("R", "battery", False, "low", 5.0)  # a flicker
    alarms.see("R", "battery", True, "low", 5.1)
    assert len(log) == 1
    alarms.see("R", "battery", False, "low", 8.0)
    alarms.see("R", "battery", True, "low", 8.1)
    assert [what for what, _ in log] == ["alarm", "alarm again"]
    assert alarms.acknowledge(int(str(row["id"])))
    alarms.see("R", "battery", False, "low", 20.0)
    assert alarms.shown() == ([], 0)


def test_flood_of_alarms_shows_the_worst() -> None:
    """CON-18: five lines, the worst first, all in the log."""
    log: Log = []
    alarms = Alarms(lambda what, facts: log.append((what, facts)))
    kinds = ["stale", "battery", "tipped", "stuck", "link"]
    for number in range(100):
        alarms.see(f"R{number}", kinds[number % 5], True, "x", number * 0.1)
    rows, hidden = alarms.shown()
    assert (len(rows), hidden, len(log)) == (SHOWN, 95, 100)
    assert [row["severity"] for row in rows] == [3] * SHOWN


def test_stuck_needs_power_and_three_seconds() -> None:
    watch = StuckWatch()
    assert not watch.stuck(0.5, (0.0, 0.0), 0.0)
    assert not watch.stuck(0.5, (0.01, 0.0), 2.9)
    assert watch.stuck(0.5, (0.01, 0.0), 3.0)
    assert not watch.stuck(0.5, (0.5, 0.0), 3.1)
    assert not watch.stuck(0.0, (0.5, 0.0), 9.0)


def test_tokens_and_roles() -> None:
    """CON-28: one token per role; a viewer may do nothing, an operator not what needs an
    instructor."""
    tokens = Tokens()
    assert len({tokens[role] for role in Role}) == 3
    for role in Role:
        assert tokens.of_header(f"Bearer {tokens[role]}") is role
    for wrong in (None, "", "Bearer", "Bearer x", f"Basic {tokens[Role.VIEWER]}"):
        assert tokens.of_header(wrong) is None
    assert not any(Role.VIEWER.may(kind) for kind in ("drive", "estop", "take", "mark", "pace"))
    assert Role.OPERATOR.may("estop")
    assert not Role.OPERATOR.may("pace")
    hosts = hosts_of("127.0.0.1", 8080)
    good = {"Host": "localhost:8080", "Origin": "http://localhost:8080"}
    assert foreign(good, hosts, origin=True) == ""
    for bad in (
        {"Host": "localhost:8081"},
        {"Origin": "http://localhost:8081"},
        {"Origin": "null"},
        {"Origin": "http://[bad"},
        {"Host": "rebound.example:8080", "Origin": "http://rebound.example:8080"},
    ):
        assert foreign({**good, **bad}, hosts, origin=True)


def test_limits() -> None:
    """CON-29: 200 texts a second, 60 that drive; in the end the page is shut out."""
    limits = Limits(0.0)
    assert sum(limits.hears(0.5) for _ in range(1000)) == 200
    assert limits.exhausted == (REFUSALS < 800)
    limits = Limits(0.0)
    assert sum(limits.drives(step / 20.0) for step in range(200)) == 200
    assert sum(limits.drives(20.0) for _ in range(100)) == 60


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=50),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=8,
)
_NAMES = sorted({name.rstrip("?") for known in FIELDS.values() for name in known})
_LIKELY = st.dictionaries(st.sampled_from([*_NAMES, "id"]), _JSON, max_size=6)


_KINDS = (*FIELDS, "no", "")


@settings(max_examples=-(-10_000 // len(_KINDS)))
@given(_LIKELY, st.text(max_size=20))
def test_any_text_is_read_or_refused(fields: dict[str, object], raw: str) -> None:
    """CON-29: 10^4 cases, drawn fields under every kind; what comes out has only known fields, and
    finite numbers."""
    texts = [json.dumps({**fields, "type": kind}) for kind in _KINDS]
    for text in (*texts, raw, "[" * 5000 if raw == "" else raw):
        try:
            request = messages.read(text)
        except PageError:
            continue
        known = {name.rstrip("?") for name in FIELDS[request.type]}
        assert set(request.fields) <= known
        for value in request.fields.values():
            assert not isinstance(value, float) or math.isfinite(value)


@given(st.lists(st.integers(0, 2), min_size=1, max_size=900), st.integers(1, 30))
def test_map_survives_packing(values: list[int], columns: int) -> None:
    rows = -(-len(values) // columns)
    cells = np.zeros(rows * columns, np.uint8)
    cells[: len(values)] = values
    data = packets.grid(0.1, (1.0, 2.0), cells.reshape(rows, columns))
    assert struct.unpack_from("<3fHH", data) == (pytest.approx(0.1), 1.0, 2.0, columns, rows)
    pairs = np.frombuffer(data, np.uint8, offset=16).reshape(-1, 2)
    assert np.array_equal(np.repeat(pairs[:, 1], pairs[:, 0]), cells)


def test_map_of_a_wall() -> None:
    """A wall 3 m to the right of a scanner is wall, what lies before it free, the rest unknown."""
    found = OccupancyMap()
    bearings = np.linspace(-math.pi / 2, math.pi / 2, 181)
    with np.errstate(divide="ignore"):
        ranges = np.where(bearings > 0.1, 3.0 / np.sin(bearings), 10.0)
    for _ in range(3):
        found.add((0.0, 0.0, 0.0), bearings, np.minimum(ranges, 10.0), 10.0)
    cells = found.cells()
    middle = len(cells) // 2

    def at(x: float, y: float) -> int:
        return int(cells[middle + math.floor(y / 0.1 + 1e-6), middle + math.floor(x / 0.1 + 1e-6)])

    assert at(0.5, 3.05) == 2 or at(0.5, 2.95) == 2
    assert at(0.55, 1.55) == 1
    assert at(-2.0, 0.0) == 0
    far = OccupancyMap()
    far.add((60.0, -90.0, 0.0), bearings, np.full(181, 5.0), 20.0)
    assert far.cells().any()


def test_bumpers_tell_ring_and_segment() -> None:
    """O-17: press and release, each once."""
    told = Telemetry()

    def touch(name: str, on: bool) -> list[object]:
        return [one.value for one in told.feed(readings.Touch(name, "Touch", 1.0, on), 1.0)]

    assert touch("RearBumper3", False) == []
    pressed = {"ring": "rear", "segment": 3, "pressed": True}
    assert touch("RearBumper3", True) == [pressed]
    assert touch("RearBumper3", True) == []
    assert touch("RearBumper3", False) == [{**pressed, "pressed": False}]


def test_frozen_input_grows_stale() -> None:
    """CON-19: ages grow by the gateway's clock, whatever the robot does not say."""
    told = Telemetry()
    for step in range(20):
        time = step / 10
        pose = readings.GroundTruth("G", "GroundTruth", time, (step, 0.0, 0.0), (0.0, 0.0, 0.0))
        told.feed(pose, time)
    assert told.link(2.0) == "good"
    assert not told.stale(2.0)
    assert told.stale(3.0) == ["G"]
    assert told.link(3.0) == "lost"
    assert told.pose_age(3.0) == pytest.approx(1.1)
    assert len(told.path) == 20


def test_a_way_begins_where_the_robot_is() -> None:
    """CON-10: odometry, heard before the true pose, counts from elsewhere and leaves no trace."""
    told = Telemetry()
    told.feed(readings.Odometry("O", "Odometry", 0.1, 0.0, 0.0, 0.0), 0.1)
    assert not told.places_scans(0.1)
    assert math.isnan(told.height)
    told.feed(
        readings.GroundTruth("G", "GroundTruth", 0.2, (-10.0, 7.0, -0.2), (0.0, 0.0, 0.0)), 0.2
    )
    assert told.height == 0.2
    told.feed(readings.Odometry("O", "Odometry", 0.3, 0.1, 0.0, 0.0), 0.3)
    assert told.path == [(-10.0, 7.0)]
    assert told.places_scans(0.3)


def test_who_lies_upside_down_maps_nothing() -> None:
    """Its scans are level, but left is right."""
    told = Telemetry()
    for roll, reach in ((0.0, math.inf), (0.1, 3.0), (math.pi, 0.0)):
        lies = readings.GroundTruth("G", "GroundTruth", 0.1, (0.0, 0.0, 0.0), (roll, 0.0, 0.0))
        told.feed(lies, 0.1)
        assert told.flat_reach(0.3) == pytest.approx(reach, abs=0.1)


def test_motion_by_kind() -> None:
    """Wheels, speed and steering, velocities."""
    assert b"{Left 50.0" in by_class("USARBot.P3AT").drive(0.5, -0.5)
    assert b"{Speed 50.0" in by_class("Hummer").turn(0.5, 1.0)
    assert b"{AltitudeVelocity" in by_class("AirRobot").stop
    assert b"{Left 100.0" in by_class("P3AT").turn(1.0, 1.0)
