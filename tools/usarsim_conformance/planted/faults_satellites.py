"""Faults of GPS, intervals and batteries."""

from usarsim_conformance.planted.faults import plant

_GPS = "usarsim_server/sensors/gps.py"
_SCALE = "control.values.gps-scale"

plant(
    "sensors.gps.north-scale",
    _GPS,
    "METRES_PER_DEGREE_NORTH = 111_200.0",
    "METRES_PER_DEGREE_NORTH = 113_000.0",
    notices=_SCALE,
    field="Latitude",
)
plant(
    "sensors.gps.east-scale",
    _GPS,
    "METRES_PER_DEGREE_EAST = 71_670.0",
    "METRES_PER_DEGREE_EAST = 111_200.0",
    notices=_SCALE,
    field="Longitude",
)
plant(
    "sensors.gps.east-sign",
    _GPS,
    "self._origin.longitude + (east + error[1])",
    "self._origin.longitude - (east + error[1])",
    notices=_SCALE,
    field="Longitude",
)
plant(
    "sensors.gps.north-sign",
    _GPS,
    "self._origin.latitude + (north + error[0])",
    "self._origin.latitude - (north + error[0])",
    notices=_SCALE,
    field="Latitude",
)
plant(
    "sensors.gps.axes-swapped",
    _GPS,
    "north, east = float(place @ self._north), float(place @ self._east)",
    "east, north = float(place @ self._north), float(place @ self._east)",
    notices=_SCALE,
    field="Latitude|Longitude",
)
plant(
    "sensors.gps.east-letter",
    _GPS,
    '_degrees_minutes(_wrap_longitude(longitude), "E", "W")',
    '_degrees_minutes(_wrap_longitude(longitude), "W", "E")',
    notices=_SCALE,
    field="Longitude",
)
plant(
    "sensors.gps.minutes-decimal",
    _GPS,
    "whole, rest = divmod(units, 600_000)",
    "whole, rest = divmod(int(units / 0.6), 1_000_000)",
    notices=_SCALE,
    field="Latitude|Longitude",
)
for _name, _new in (
    ("none", "0.0 * self._rng.standard_normal(2)"),
    ("double", "2.0 * deviation * self._rng.standard_normal(2)"),
    ("one-axis", "deviation * self._rng.standard_normal(2) * np.array([1.0, 0.0])"),
):
    plant(
        f"sensors.gps.noise-{_name}",
        _GPS,
        "deviation * self._rng.standard_normal(2)",
        _new,
        notices="control.values.gps-noise",
        field="Latitude|Longitude",
    )
plant(
    "sensors.gps.satellites-count",
    _GPS,
    "self.satellites = int(np.count_nonzero(np.isinf(hits[0].distances)))",
    "self.satellites = 4 + int(np.count_nonzero(np.isinf(hits[0].distances)))",
    notices="control.values.gps-satellites",
    field="Satellites",
)
plant(
    "sensors.scan-interval.milliseconds",
    "usarsim_server/sensors/wheels.py",
    'interval = ("ScanInterval", fixed(self.interval(dialect), 4))',
    'interval = ("ScanInterval", fixed(1000.0 * self.interval(dialect), 4))',
    notices="control.values.scan-interval",
    field="ScanInterval of Odometry",
)
for _type, _file in (("ins", "inertial"), ("gps", "gps"), ("ground-truth", "pose")):
    plant(
        f"sensors.scan-interval.{_type}-doubled",
        f"usarsim_server/sensors/{_file}.py",
        '"ScanInterval", fixed(self.interval(dialect), 4)',
        '"ScanInterval", fixed(2.0 * self.interval(dialect), 4)',
        notices="control.values.scan-interval",
        field="ScanInterval of",
    )
plant(
    "sensors.battery.drain-double",
    "usarsim_server/sessions/power.py",
    "return max(self._life - max(elapsed, 0.0), 0.0)",
    "return max(self._life - max(2.0 * elapsed, 0.0), 0.0)",
    notices="control.values.battery-drain",
    field="Battery",
)
plant(
    "sensors.battery.drain-none",
    "usarsim_server/sessions/power.py",
    "return max(self._life - max(elapsed, 0.0), 0.0)",
    "return self._life",
    notices="control.values.battery-drain",
    field="Battery",
)
