"""Faults of sensors that measure distances or count turns of wheels."""

from usarsim_conformance.planted.faults import plant

_SONAR = "usarsim_server/sensors/ranges.py"
_RANGING = "usarsim_server/sensors/ranges.py"
_SCANNER = "usarsim_server/sensors/scanners.py"
_SINGLE = "usarsim_server/sensors/ranges.py"
_ROWS = "usarsim_server/sensors/scanners.py"
_IMAGER = "usarsim_server/sensors/depth.py"
_CLOUD = "usarsim_server/sensors/depth.py"
_LASER = "usarsim_server/sensors/ranges.py"
_OBJECT = "usarsim_server/sensors/objects.py"
_ASSEMBLY = "usarsim_server/sensors/report.py"

plant(
    "sensors.sonar.range-ninety-percent",
    _SONAR,
    "return max(float(self.echoes(nearest)[0]), self.min_range)",
    "return max(0.9 * float(self.echoes(nearest)[0]), self.min_range)",
    notices="control.values.sonar-range",
    field="Range of F",
)
plant(
    "sensors.sonar.range-limit",
    _RANGING,
    '(("MaxRange", fixed(self.max_range, 4)), ("MinRange"',
    '(("MaxRange", fixed(1.2 * self.max_range, 4)), ("MinRange"',
    notices=("control.values.sonar-range", "control.values.scan-range"),
    field="MaxRange",
)
for _name, _factor in (("wide", "4.0"), ("narrow", "0.25")):
    plant(
        f"sensors.sonar.cone-{_name}",
        _SONAR,
        "cone_directions(self.beam_angle / 2, cones",
        f"cone_directions({_factor} * self.beam_angle / 2, cones",
        notices="control.values.sonar-cone",
        field="BeamAngle",
    )
plant(
    "sensors.sonar.mount-mirrored",
    _ASSEMBLY,
    "location, rotation = wire_from_pose(pose)",
    "(x, y, z), (r, p, w) = wire_from_pose(pose)\n"
    "        location, rotation = (x, -y, z), (r, p, -w)",
    notices=("control.values.sonar-cone", "control.values.sonar-range"),
    field="Range of",
)
plant(
    "sensors.sonar.mount-forward",
    _ASSEMBLY,
    "location, rotation = wire_from_pose(pose)",
    "(x, y, z), rotation = wire_from_pose(pose)\n        location = (x + 0.1, y, z)",
    notices=("control.values.scan-range", "control.values.sonar-range"),
    field="Range of",
)
plant(
    "sensors.scan.range-scale",
    _SCANNER,
    "self._ranges = self._sight.blank(self.echoes(distances))",
    "self._ranges = self._sight.blank(self.echoes(0.95 * distances))",
    notices="control.values.scan-range",
    field="Range of Scanner1",
)
plant(
    "sensors.scan.left-first",
    _SCANNER,
    "self.fov / 2 - self.resolution * np.arange(self.beams, dtype=np.float64)",
    "self.resolution * np.arange(self.beams, dtype=np.float64) - self.fov / 2",
    notices=("control.values.scan-range", "control.sensors.scan-right-first"),
    field="Range of Scanner1|on the right",
)
plant(
    "sensors.scan.resolution",
    _SCANNER,
    "self.fov / 2 - self.resolution * np.arange(self.beams, dtype=np.float64)",
    "self.fov / 2 - 0.9 * self.resolution * np.arange(self.beams, dtype=np.float64)",
    notices="control.values.scan-range",
    field="Range of Scanner1",
)
plant(
    "sensors.scan.conf-fov",
    _SCANNER,
    '("Fov", fov),',
    '("Fov", fixed(0.8 * float(fov), 4)),',
    notices=("control.values.scan-head", "control.values.scan-range"),
    field="Fov|Range of Scanner1",
)
plant(
    "sensors.scan.conf-resolution",
    _SCANNER,
    '            resolution,\n            ("Fov"',
    '            ("Resolution", fixed(0.5 * float(resolution[1]), 4)),\n            ("Fov"',
    notices="control.values.scan-head",
    field="Resolution",
)
plant(
    "sensors.scan.head-fov",
    _SCANNER,
    '("FOV", fixed(announced_angle(self.fov, dialect), 4)),',
    '("FOV", fixed(announced_angle(0.9 * self.fov, dialect), 4)),',
    notices="control.values.scan-range",
    field="Range of Scanner1",
)
plant(
    "sensors.ir.range-scale",
    _SINGLE,
    "return max(super().distance(hits), self.min_range)",
    "return max(1.1 * super().distance(hits), self.min_range)",
    notices="control.values.ir-range",
    field="Range of IR",
)
plant(
    "sensors.ir.min-range",
    _SINGLE,
    "return max(super().distance(hits), self.min_range)",
    "return max(super().distance(hits), 0.1)",
    notices="control.values.ir-range",
    field="MinRange",
)
plant(
    "sensors.range.range-centimetres",
    _SINGLE,
    "return float(self._sight.blank(self.echoes(distances))[0])",
    "return 100.0 * float(self._sight.blank(self.echoes(distances))[0])",
    notices="control.values.range-range",
    field="Range of Range",
)
plant(
    "sensors.ir-scan.range-scale",
    _SCANNER,
    "self._ranges = np.maximum(self._ranges, self.min_range)",
    "self._ranges = np.maximum(0.9 * self._ranges, self.min_range)",
    notices="control.values.ir-scan-range",
    field="Range of IRScan",
)
plant(
    "sensors.scan-3d.rows-upside-down",
    _ROWS,
    "pitch = self.vertical_fov / 2 - self.vertical_resolution * np.arange(self.rows)",
    "pitch = self.vertical_resolution * np.arange(self.rows) - self.vertical_fov / 2",
    notices="control.values.scan-3d-range",
    field="Range of Scan3D",
)
plant(
    "sensors.scan-3d.columns-mirrored",
    _ROWS,
    "yaw = self.fov / 2 - self.resolution * np.arange(self.columns)",
    "yaw = self.resolution * np.arange(self.columns) - self.fov / 2",
    notices="control.values.scan-3d-range",
    field="Range of Scan3D",
)
plant(
    "sensors.image.mirrored",
    _IMAGER,
    "self._yaw = self.fov * (np.arange(self.width) / self.width - 0.5)",
    "self._yaw = self.fov * (0.5 - np.arange(self.width) / self.width)",
    notices="control.values.image-range",
    field="Range of Kinect",
)
plant(
    "sensors.image.upside-down",
    _IMAGER,
    "self._pitch = self.vertical_fov * (0.5 - np.arange(self.height) / self.height)",
    "self._pitch = self.vertical_fov * (np.arange(self.height) / self.height - 0.5)",
    notices="control.values.image-range",
    field="Range of Kinect",
    dialect="udk",
)
plant(
    "sensors.image.along-rays",
    _IMAGER,
    "depths = self.echoes(distances) * self._directions(self._frame)[:, 0]",
    "depths = self.echoes(distances)",
    notices="control.values.image-range",
    field="Range of Kinect",
)
plant(
    "sensors.cloud.mirrored",
    "usarsim_server/sensors/ranges.py",
    "turned: Array = points * _FLIP",
    "turned: Array = points * (1.0, 1.0, -1.0)",
    notices=("control.values.cloud-points", "control.values.line-laser-points"),
    field="[Pp]oint",
)
plant(
    "sensors.cloud.scale",
    _CLOUD,
    "self._points = starts + directions * ranges[:, None]",
    "self._points = starts + 0.9 * directions * ranges[:, None]",
    notices="control.values.cloud-points",
    field="point",
)
plant(
    "sensors.line-laser.fov",
    _LASER,
    "np.linspace(-self.fov / 2, self.fov / 2, self.beams)",
    "np.linspace(-self.fov / 3, self.fov / 3, self.beams)",
    notices="control.values.line-laser-points",
    field="FOV",
)
plant(
    "sensors.line-laser.location",
    _LASER,
    "location, orientation = wire_from_pose(self._pose)",
    "location, orientation = wire_from_pose(IDENTITY)",
    notices="control.values.line-laser-points",
    field="Location of Line",
)
plant(
    "sensors.line-laser.orientation-sign",
    _LASER,
    '("Orientation", vector(orientation, 4))',
    '("Orientation", vector(tuple(-angle for angle in orientation), 4))',
    notices="control.values.line-laser-points",
    field="Orientation of Line",
)
plant(
    "sensors.object.hit-sign",
    _OBJECT,
    '("HitLoc", vector(flip_point(sighting.point), 2))',
    '("HitLoc", vector(sighting.point, 2))',
    notices="control.values.object-sensor",
    field="HitLoc",
)
plant(
    "sensors.object.location-axes",
    _OBJECT,
    '("Location", vector(location, 2))',
    '("Location", vector((location[1], location[0], location[2]), 2))',
    notices="control.values.object-sensor",
    field="Location of the Object",
)
plant(
    "sensors.object.orientation-sign",
    _OBJECT,
    '("Orientation", vector(orientation, 2))',
    '("Orientation", vector(tuple(-angle for angle in orientation), 2))',
    notices="control.values.object-sensor",
    field="Orientation of the Object",
)


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
