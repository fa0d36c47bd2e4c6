"""Faults of the sensors that count turns of wheels."""

from usarsim_conformance.planted.faults import plant

_ODOMETRY = "usarsim_server/sensors/wheels.py"
_ENCODER = "usarsim_server/sensors/wheels.py"
_TACHOMETER = "usarsim_server/sensors/wheels.py"
_DISTANCE = "control.values.odometry-distance"
_HEADING = "control.values.odometry-heading"
_PATH = "control.values.odometry-path"
_TICKS = "control.values.encoder-ticks"

plant(
    "sensors.odometry.x-sign",
    _ODOMETRY,
    "x + way * math.cos(theta)",
    "x - way * math.cos(theta)",
    notices=("control.sensors.odometry-forward", _DISTANCE),
    field=r"\bx\b",
)
plant(
    "sensors.odometry.y-sign",
    _ODOMETRY,
    "y + way * math.sin(theta)",
    "y - way * math.sin(theta)",
    notices=_PATH,
    field=r"\by of Pose",
)
plant(
    "sensors.odometry.y-missing",
    _ODOMETRY,
    "y + way * math.sin(theta)",
    "y",
    notices=_PATH,
    field=r"\by of Pose",
)
plant(
    "sensors.odometry.theta-sign",
    _ODOMETRY,
    "theta + (left - right) / self._track",
    "theta - (left - right) / self._track",
    notices=("control.sensors.odometry-clockwise", _HEADING),
    field="theta",
)
plant(
    "sensors.odometry.theta-scale",
    _ODOMETRY,
    "theta + (left - right) / self._track",
    "theta + (left - right) / self._track * 1.2",
    notices=_HEADING,
    field="theta",
)
plant(
    "sensors.odometry.way-scale",
    _ODOMETRY,
    "way = (left + right) / 2",
    "way = (left + right) / 2 * 0.85",
    notices=_DISTANCE,
    field="Pose x,y",
)
plant(
    "sensors.odometry.one-wheel",
    _ODOMETRY,
    "way = (left + right) / 2",
    "way = left",
    notices=_DISTANCE,
    field="Pose x,y",
)
plant(
    "sensors.odometry.sides-swapped",
    _ODOMETRY,
    "return left, right",
    "return right, left",
    notices=_HEADING,
    field="theta",
)
plant(
    "sensors.encoder.ticks-halved",
    _ENCODER,
    "str(int(angle / self.resolution))",
    "str(int(angle / self.resolution / 2))",
    notices=_TICKS,
    field="Tick of EC",
)
plant(
    "sensors.encoder.ticks-sign",
    _ENCODER,
    "turned = angle - (angle if self._last is None else self._last)",
    "turned = (angle if self._last is None else self._last) - angle",
    notices=(_TICKS, "control.sensors.encoder-forward"),
    field="EC",
)
plant(
    "sensors.encoder.resolution",
    _ENCODER,
    '(("Resolution", fixed(self.resolution, 4)),)',
    '(("Resolution", fixed(self.resolution * 1.15, 4)),)',
    notices=_TICKS,
    field="Tick of EC",
)
plant(
    "sensors.encoder.sides-swapped",
    _ENCODER,
    "return float(robot.wheel_angles[self.wheel])",
    "return float(robot.wheel_angles[self.wheel ^ 1])",
    notices=_TICKS,
    field="Tick of EC",
)
plant(
    "sensors.encoder.udk-wheel",
    _ENCODER,
    "return float(robot.wheel_angles[self.wheel])",
    "return float(robot.wheel_angles[self.wheel ^ 1])",
    notices=_TICKS,
    field="Tick of W",
    robot="P3AT",
    dialect="udk",
)
plant(
    "sensors.encoder.udk-wrap",
    _ENCODER,
    "angle = math.fmod(angle, math.tau)",
    "angle = math.fmod(angle, 5.0)",
    notices=_TICKS,
    field="Tick of W",
    dialect="udk",
)
plant(
    "sensors.tachometer.vel-scale",
    _TACHOMETER,
    "self._vel = (angles - self._angles) / (robot.time - self._time)",
    "self._vel = 1.1 * (angles - self._angles) / (robot.time - self._time)",
    notices="control.values.tachometer",
    field="Vel",
    robot="P3AT",
    dialect="udk",
)
plant(
    "sensors.tachometer.vel-sign",
    _TACHOMETER,
    "self._vel = (angles - self._angles) / (robot.time - self._time)",
    "self._vel = (self._angles - angles) / (robot.time - self._time)",
    notices="control.values.tachometer",
    field="Vel",
    robot="P3AT",
    dialect="udk",
)
plant(
    "sensors.tachometer.pos-scale",
    _TACHOMETER,
    "self._turned = self._turned + (angles - self._angles)",
    "self._turned = self._turned + (angles - self._angles) * 0.5",
    notices="control.values.tachometer",
    field="Pos",
)
