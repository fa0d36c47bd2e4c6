"""Faults of aircraft, submarines, arms, mission packages and legs."""

from usarsim_conformance.planted.faults import plant

_AIR = "usarsim_server/robots/families/aerial.py"
_SEA = "usarsim_server/robots/families/underwater.py"
_MOVES = "flip_point((self._linear, self._lateral, -self._vertical))"
_TURNS = "flip_point((self._roll, self._pitch, self._yaw))"

for _name, _new in (
    ("altitude", "flip_point((self._linear, self._lateral, self._vertical))"),
    ("linear", "flip_point((-self._linear, self._lateral, -self._vertical))"),
    ("lateral", "flip_point((self._linear, -self._lateral, -self._vertical))"),
):
    plant(
        f"aloft.{_name}-velocity-sign",
        _AIR,
        _MOVES,
        _new,
        notices=f"control.aerial.{_name}-velocity",
        field=f"{_name.title()}Velocity",
    )
plant(
    "aloft.linear-and-lateral-exchanged",
    _AIR,
    _MOVES,
    "flip_point((self._lateral, self._linear, -self._vertical))",
    notices=("control.aerial.linear-velocity", "control.aerial.lateral-velocity"),
    field="LinearVelocity|LateralVelocity",
)
plant(
    "aloft.rotational-velocity-sign",
    _AIR,
    _TURNS,
    "flip_point((self._roll, self._pitch, -self._yaw))",
    notices="control.aerial.rotational-velocity",
    field="RotationalVelocity",
)
plant(
    "aloft.fifth-slower",
    _AIR,
    "setattr(self, key, max(-FASTEST, min(FASTEST, speed)))",
    "setattr(self, key, max(-FASTEST, min(FASTEST, 0.8 * speed)))",
    notices=("control.aerial.linear-velocity", "control.aerial.altitude-velocity"),
    field="LinearVelocity|AltitudeVelocity",
)
plant(
    "aloft.pitch-sign",
    _AIR,
    "self._pitch = -flight.tilt * _sign(self._linear)",
    "self._pitch = flight.tilt * _sign(self._linear)",
    notices="control.aerial.pitches",
    field="pitch",
)
plant(
    "aloft.roll-sign",
    _AIR,
    "self._roll = flight.tilt * _sign(self._lateral)",
    "self._roll = -flight.tilt * _sign(self._lateral)",
    notices="control.aerial.rolls",
    field="roll",
)
plant(
    "aloft.radians-in-udk",
    _AIR,
    "value * (1.0 if angular is None else FACETS[angular].rotational_velocity_unit)",
    "value",
    notices="control.aerial.rotational-velocity",
    field="RotationalVelocity",
    dialect="udk",
)
plant(
    "aloft.degrees-in-ut2004",
    _AIR,
    "value * (1.0 if angular is None else FACETS[angular].rotational_velocity_unit)",
    "value * (1.0 if angular is None else math.radians(1.0))",
    notices="control.aerial.rotational-velocity",
    field="RotationalVelocity",
)
plant(
    "aloft.percent-doubled",
    _AIR,
    "* full / 100.0",
    "* full / 50.0",
    notices="control.aerial.percent",
    field="MaxAltitudeVelocity",
)
for _name, _old in (
    ("MaxLinearVelocity", "self.max_linear_velocity)"),
    ("MaxLateralVelocity", "self.max_lateral_velocity)"),
    ("MaxAltitudeVelocity", "self.max_altitude_velocity)"),
    ("MaxRotationalVelocity", "_yaw_unit(self.max_rotational_velocity, dialect))"),
):
    plant(
        f"aloft.conf.{_name.removeprefix('Max').lower()}",
        _AIR,
        f'("{_name}", {_old}',
        f'("{_name}", 1.5 * {_old}',
        notices="control.aerial.percent",
        field=_name,
    )
plant(
    "aloft.conf.tilt",
    _AIR,
    '("MaxTilt", _yaw_unit(self.tilt, dialect))',
    '("MaxTilt", 0.5 * _yaw_unit(self.tilt, dialect))',
    notices=("control.aerial.pitches", "control.aerial.rolls"),
    field="MaxTilt",
)
plant(
    "aloft.conf.radians-in-udk",
    _AIR,
    "return math.degrees(value) if FACETS[dialect].flight_in_degrees else value",
    "return value",
    notices="control.aerial.percent",
    field="MaxRotationalVelocity",
    dialect="udk",
)
plant(
    "aloft.forgets",
    _AIR,
    "percent = bool(drive.normalized)",
    "percent, self._linear = bool(drive.normalized), 0.0",
    notices="control.aerial.keeps",
    field="LinearVelocity",
)
plant(
    "aloft.lean-sign",
    _AIR,
    "setattr(self, key, math.radians(max(-80.0, min(80.0, degrees))))",
    "setattr(self, key, -math.radians(max(-80.0, min(80.0, degrees))))",
    notices="control.aerial.lean-angles",
    field="PitchAngle",
    dialect="udk",
)
plant(
    "aloft.leans-exchanged",
    _AIR,
    '(("_pitch", drive.pitch_angle), ("_roll", drive.roll_angle))',
    '(("_roll", drive.pitch_angle), ("_pitch", drive.roll_angle))',
    notices="control.aerial.lean-angles",
    field="PitchAngle",
    dialect="udk",
)

# Submarines.

plant(
    "diving.propeller-sign",
    "usarsim_server/simulation/diving.py",
    "return self._hull.thrust * WATER",
    "return -self._hull.thrust * WATER",
    notices="control.underwater.propeller",
    field="Propeller",
)
plant(
    "diving.rudder-sign",
    _SEA,
    "rudder = -vessel.rudder_sense * self._rudder",
    "rudder = vessel.rudder_sense * self._rudder",
    notices="control.underwater.rudder",
    field="Rudder",
)
plant(
    "diving.stern-plane-sign",
    _SEA,
    "vessel.stern_plane_sense * self._planes",
    "-vessel.stern_plane_sense * self._planes",
    notices="control.underwater.stern-plane",
    field="SternPlane",
)
plant(
    "diving.both-signs",
    _SEA,
    "rudder = -vessel.rudder_sense * self._rudder\n        planes = vessel",
    "rudder = vessel.rudder_sense * self._rudder\n        planes = -vessel",
    notices=("control.underwater.rudder", "control.underwater.stern-plane"),
    field="Rudder|SternPlane",
)
plant(
    "diving.percent-doubled",
    _SEA,
    "share = vessel.max_propeller / 100.0",
    "share = vessel.max_propeller / 50.0",
    notices="control.underwater.percent",
    field="Propeller",
)
plant(
    "diving.conf.max-propeller",
    _SEA,
    '("MaxPropeller", self.max_propeller)',
    '("MaxPropeller", 0.7 * self.max_propeller)',
    notices="control.underwater.percent",
    field="MaxPropeller",
)
plant(
    "diving.conf.max-rudder",
    _SEA,
    '("MaxRudder", self.max_rudder)',
    '("MaxRudder", 2.0 * self.max_rudder)',
    notices="control.underwater.status",
    field="RudderAngle",
)
plant(
    "diving.conf.max-stern-plane",
    _SEA,
    '("MaxSternPlane", self.max_stern_plane)',
    '("MaxSternPlane", 0.5 * self.max_stern_plane)',
    notices="control.underwater.status",
    field="SternPlaneAngle",
)
plant(
    "diving.status.rudder-sign",
    _SEA,
    "self._rudder, self._planes, dialect",
    "-self._rudder, self._planes, dialect",
    notices="control.underwater.status",
    field="RudderAngle",
)
plant(
    "diving.status.stern-plane-sign",
    _SEA,
    "self._rudder, self._planes, dialect",
    "self._rudder, -self._planes, dialect",
    notices="control.underwater.status",
    field="SternPlaneAngle",
)
plant(
    "diving.forgets",
    _SEA,
    "self._planes = _within(drive.stern_plane, 1.0, vessel.max_stern_plane, self._planes)",
    "self._planes = _within(drive.stern_plane, 1.0, vessel.max_stern_plane, 0.0)",
    notices="control.underwater.status",
    field="SternPlaneAngle",
)


_JOINTS = "usarsim_server/actuators/articulation.py"
_ORDERS = "usarsim_server/actuators/base.py"
_TOLD = "usarsim_server/protocol/messages/actuators.py"

plant(
    "limbs.link-numbers",
    _JOINTS,
    "self._move(request.name, request.groups, 1)",
    "self._move(request.name, request.groups, 2)",
    notices="control.arm.each-link",
    field="Value of link",
)
plant(
    "limbs.command-sign",
    _ORDERS,
    "return JointOrder(Order(kind), value)",
    "return JointOrder(Order(kind), -value)",
    notices=("control.arm.each-link", "control.arm.order"),
    field="Value of link|Order 1",
)
plant(
    "limbs.value-sign",
    _TOLD,
    'number("Value", value, 4)',
    'number("Value", -value, 4)',
    notices="control.arm.each-link",
    field="Value of link",
)
plant(
    "limbs.value-scale",
    _TOLD,
    'number("Value", value, 4)',
    'number("Value", 0.7 * value, 4)',
    notices="control.arm.each-link",
    field="Value of link",
    dialect="udk",
)
plant(
    "limbs.conf.range",
    _TOLD,
    'body += _limits("MinRange", "MaxRange", link.limits)',
    "low, high = link.limits or (1.0, 0.0)\n"
    '            body += _limits("MinRange", "MaxRange", (low, 0.8 * high))',
    notices="control.arm.both-limits",
    field="MaxRange",
)
plant(
    "limbs.conf.low-range",
    _TOLD,
    'body += _limits("MinRange", "MaxRange", link.limits)',
    "low, high = link.limits or (1.0, 0.0)\n"
    '            body += _limits("MinRange", "MaxRange", (0.8 * low, high))',
    notices="control.arm.both-limits",
    field="MinRange",
)
plant(
    "limbs.conf.values",
    _TOLD,
    '*_limits("MinValue", "MaxValue", link.limits or ENDLESS)',
    '*_limits("MinValue", "MaxValue", tuple(0.8 * one for one in link.limits or ENDLESS))',
    notices="control.arm.both-limits",
    field="MaxValue",
    dialect="udk",
)
plant(
    "limbs.conf.speed",
    _TOLD,
    'number("MaxSpeed", link.max_speed, 2)',
    'number("MaxSpeed", 1.4 * link.max_speed, 2)',
    notices="control.arm.speed",
    field="MaxSpeed",
)
plant(
    "limbs.conf.rotation-speed",
    _TOLD,
    'number("MaxRotationSpeed", link.max_speed, 3)',
    'number("MaxRotationSpeed", 0.6 * link.max_speed, 3)',
    notices="control.arm.speed",
    field="MaxSpeed",
    dialect="udk",
)
plant(
    "limbs.conf.torque",
    _TOLD,
    'number("MaxTorque", link.max_torque, 2)',
    'number("MaxTorque", 0.001 * link.max_torque, 2)',
    notices="control.arm.torque",
    field="MaxTorque",
)
plant(
    "limbs.torque-scale",
    _TOLD,
    'number("Torque", torque, 2)',
    'number("Torque", 100.0 * torque, 2)',
    notices="control.arm.torque",
    field="Torque of link",
)
plant(
    "limbs.speed-order",
    _ORDERS,
    "return JointOrder(Order(kind), value)",
    "return JointOrder(Order(kind), value if kind == Order.POSITION else 0.5 * value)",
    notices="control.arm.order",
    field="Order 1",
)
plant(
    "legs.command-sign",
    _JOINTS,
    "JointOrder(Order.POSITION, value) for link in links",
    "JointOrder(Order.POSITION, -value) for link in links",
    notices="control.legged.each-joint",
    field="of STA",
)
plant(
    "legs.command-scale",
    _JOINTS,
    "JointOrder(Order.POSITION, value) for link in links",
    "JointOrder(Order.POSITION, 0.5 * value) for link in links",
    notices="control.legged.each-joint",
    field="of STA",
)
plant(
    "limbs.gripper-status",
    _TOLD,
    'segment("Status", "CLOSED" if closed else "OPEN")',
    'segment("Status", "OPEN" if closed else "CLOSED")',
    notices="control.arm.gripper",
    field="Status",
    dialect="udk",
)
