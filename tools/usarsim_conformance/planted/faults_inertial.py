"""Faults of inertial sensors, compass, altimeter, GPS, clocks, intervals and batteries."""

from usarsim_conformance.planted.faults import plant

_INS = "usarsim_server/sensors/inertial.py"
_IMU = "usarsim_server/sensors/inertial.py"
_ACCELERATION = "usarsim_server/sensors/inertial.py"
_HEADING = "usarsim_server/sensors/pose.py"
_MOTION = "usarsim_server/sensors/inertial.py"

for _name, _factor in (("none", "0.0"), ("tenfold", "10.0"), ("thrice", "3.0")):
    plant(
        f"sensors.ins.location-noise-{_name}",
        _INS,
        "axis_error = self._axis_means + self.sigma *",
        f"axis_error = self._axis_means + {_factor} * self.sigma *",
        notices="control.values.ins-noise",
        field="noise of Location",
    )
    plant(
        f"sensors.ins.orientation-noise-{_name}",
        _INS,
        "angle_error = self._angle_means + self.sigma *",
        f"angle_error = self._angle_means + {_factor} * self.sigma *",
        notices="control.values.ins-orientation-noise",
        field="noise of Orientation",
    )
for _axis, _signs in (("x", "-1, 1, 1"), ("y", "1, -1, 1"), ("z", "1, 1, -1")):
    plant(
        f"sensors.ins.{_axis}-sign",
        _INS,
        "step = location - self._last_location",
        f"step = (location - self._last_location) * np.array([{_signs}])",
        notices="control.values.ins-location",
        field=f"{_axis} of Location",
    )
plant(
    "sensors.ins.location-scale",
    _INS,
    "step = location - self._last_location",
    "step = (location - self._last_location) * 0.8",
    notices="control.values.ins-location",
    field="of Location",
)
for _axis, _signs in (("roll", "-1, 1, 1"), ("pitch", "1, -1, 1"), ("yaw", "1, 1, -1")):
    plant(
        f"sensors.ins.{_axis}-sign",
        _INS,
        "+ turn * (1.0 + angle_error)",
        f"+ turn * np.array([{_signs}]) * (1.0 + angle_error)",
        notices="control.values.ins-orientation",
        field=f"{_axis} of Orientation",
    )
plant(
    "sensors.ins.yaw-scale",
    _INS,
    "+ turn * (1.0 + angle_error)",
    "+ 0.8 * turn * (1.0 + angle_error)",
    notices="control.values.ins-orientation",
    field="of Orientation",
)
plant(
    "sensors.inu.yaw-sign",
    _INS,
    "+ turn * (1.0 + angle_error)",
    "- turn * (1.0 + angle_error)",
    notices="control.values.inu-orientation",
    field="of Orientation",
)
plant(
    "sensors.imu.rate-sign",
    _IMU,
    "rates = angle_difference(rotation, self._rotation) / elapsed",
    "rates = angle_difference(self._rotation, rotation) / elapsed",
    notices="control.values.imu-rotation",
    field="of AngularVel",
)
plant(
    "sensors.imu.rate-degrees",
    _IMU,
    '("AngularVel", vector(rates.tolist(), 4))',
    '("AngularVel", vector(np.degrees(rates).tolist(), 4))',
    notices="control.values.imu-rotation",
    field="of AngularVel",
)
plant(
    "sensors.imu.rate-axes-swapped",
    _IMU,
    '("AngularVel", vector(rates.tolist(), 4))',
    '("AngularVel", vector(rates.tolist()[::-1], 4))',
    notices="control.values.imu-rotation",
    field="of AngularVel",
)
plant(
    "sensors.imu.angular-acceleration-sign",
    _IMU,
    "self._rate_changes = (rates - self._rates) / elapsed",
    "self._rate_changes = (self._rates - rates) / elapsed",
    notices="control.values.imu-rotation",
    field="of AngularAccel",
)
plant(
    "sensors.imu.rotation-sign",
    _IMU,
    '("Rotation", vector(self._rotation, 4))',
    '("Rotation", vector(tuple(-angle for angle in self._rotation), 4))',
    notices="control.values.imu-rotation",
    field="of Rotation",
)
for _axis, _new in (
    ("x", "-forward, right, z"),
    ("y", "forward, -right, z"),
    ("z", "forward, right, -z"),
):
    plant(
        f"sensors.imu.acceleration-{_axis}-sign",
        _IMU,
        "return forward, right, z",
        f"return {_new}",
        notices="control.values.imu-acceleration",
        field="of XYZAcceleration",
    )
plant(
    "sensors.imu.acceleration-frame",
    _IMU,
    "self._meter.value @ self.world_pose(robot).matrix()",
    "self._meter.value",
    notices="control.values.imu-acceleration",
    field="of XYZAcceleration",
)
plant(
    "sensors.accel.scale",
    _MOTION,
    "self.value = (velocity - self._velocity) / elapsed",
    "self.value = (velocity - self._velocity) / elapsed / 9.81",
    notices="control.values.accel",
    field="of Acceleration",
)
plant(
    "sensors.accel.sign",
    _ACCELERATION,
    "self._reading = flip_point((x, y, z))",
    "self._reading = flip_point((-x, y, z))",
    notices="control.values.accel",
    field="of Acceleration",
)
plant(
    "sensors.accel.z-up",
    _ACCELERATION,
    "self._reading = flip_point((x, y, z))",
    "self._reading = (x, -y, z)",
    notices="control.values.accel",
    field="z of Acceleration",
)
plant(
    "sensors.accelerometer.gravity-sign",
    _ACCELERATION,
    "np.array([0.0, 0.0, -self.gravity])",
    "np.array([0.0, 0.0, self.gravity])",
    notices="control.values.accelerometer",
    field="of ProperAcceleration",
)
plant(
    "sensors.accelerometer.gravity-missing",
    _ACCELERATION,
    "gravity: ClassVar[float] = GRAVITY",
    "gravity: ClassVar[float] = 0.0",
    notices="control.values.accelerometer",
    field="of ProperAcceleration",
)
plant(
    "sensors.compass.sign",
    _HEADING,
    "wrap_signed(yaw - self._north)",
    "wrap_signed(self._north - yaw)",
    notices="control.values.compass",
    field="MagneticAngle",
)
plant(
    "sensors.compass.degrees",
    _HEADING,
    '("MagneticAngle", fixed(self._heading, 4))',
    '("MagneticAngle", fixed(self._heading * 57.29578, 4))',
    notices="control.values.compass",
    field="MagneticAngle",
)
plant(
    "sensors.altitude.sign",
    _HEADING,
    "self._relative = height - self._start",
    "self._relative = self._start - height",
    notices=("control.values.altitude", "control.sensors.climb"),
    field="relativeAltitude|climbing",
)
plant(
    "sensors.altitude.scale",
    _HEADING,
    "self._relative = height - self._start",
    "self._relative = 0.8 * (height - self._start)",
    notices="control.values.altitude",
    field="relativeAltitude",
)
plant(
    "sensors.altitude.absolute",
    _HEADING,
    "absolute = max(self._relative + self.sea_level, 0.0)",
    "absolute = max(self.sea_level - self._relative, 0.0)",
    notices="control.values.altitude",
    field="absoluteAltitude",
)
plant(
    "sensors.mission-time.seconds",
    _HEADING,
    "int((robot.time - self._start) // 60.0)",
    "int(robot.time - self._start)",
    notices="control.values.mission-time",
    field="Minutes",
)


_GPS = "usarsim_server/sensors/pose.py"
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
_HEAD = """

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        \"""ScanInterval.\"""
        return (("""
"""From the end of `data` of a sensor to what its CONF tells."""
for _type, _file, _before in (
    ("ins", "inertial", ""),
    ("gps", "pose", f"            satellites,\n        ){_HEAD}"),
    ("ground-truth", "pose", f"vector(orientation, digits))){_HEAD}"),
):
    plant(
        f"sensors.scan-interval.{_type}-doubled",
        f"usarsim_server/sensors/{_file}.py",
        f'{_before}"ScanInterval", fixed(self.interval(dialect), 4)',
        f'{_before}"ScanInterval", fixed(2.0 * self.interval(dialect), 4)',
        notices="control.values.scan-interval",
        field="ScanInterval of",
    )
plant(
    "sensors.battery.drain-double",
    "usarsim_server/sessions/robots.py",
    "return max(self._life - max(elapsed, 0.0), 0.0)",
    "return max(self._life - max(2.0 * elapsed, 0.0), 0.0)",
    notices="control.values.battery-drain",
    field="Battery",
)
plant(
    "sensors.battery.drain-none",
    "usarsim_server/sessions/robots.py",
    "return max(self._life - max(elapsed, 0.0), 0.0)",
    "return self._life",
    notices="control.values.battery-drain",
    field="Battery",
)
