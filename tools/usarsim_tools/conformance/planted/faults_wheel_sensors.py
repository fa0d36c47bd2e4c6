"""Faults of the sensors that count turns of wheels."""

from usarsim_tools.conformance.planted.faults import plant

_ODOMETRY = "usarsim_server/sensors/odometry.py"

plant(
    "sensors.odometry.x-sign",
    _ODOMETRY,
    "x + way * math.cos(theta)",
    "x - way * math.cos(theta)",
    notices="control.sensors.odometry-forward",
    field=r"\bx\b",
)
plant(
    "sensors.odometry.theta-sign",
    _ODOMETRY,
    "theta + (left - right) / self._track",
    "theta - (left - right) / self._track",
    notices="control.sensors.odometry-clockwise",
    field="theta",
)
