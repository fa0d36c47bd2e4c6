"""Faults of wheels, tracks and cars, and of what CONF, GEO and STA tell of them."""

from usarsim_conformance.planted.faults import plant

_DRIVE = "usarsim_server/robots/families/wheeled.py"
_CARS = "usarsim_server/robots/families/ackerman.py"
_TOLD = "usarsim_server/protocol/messages/vehicles.py"
_OMNI = "usarsim_server/robots/families/omni.py"
_JOINTS = "usarsim_server/actuators/articulation.py"

plant(
    "driving.sides-exchanged",
    _DRIVE,
    "self._targets[self._left] = left",
    "self._targets[~self._left] = left",
    also=[(_DRIVE, "self._targets[~self._left] = right", "self._targets[self._left] = right")],
    notices="control.motion.sides",
    field="Left and Right",
)
plant(
    "driving.backwards",
    _DRIVE,
    "if self._percent else value\n",
    "if self._percent else -value\n",
    notices=("control.motion.radius", "control.ackerman.speed"),
    field="WheelRadius",
)
plant(
    "driving.tenth-faster",
    _DRIVE,
    "if self._percent else value\n",
    "if self._percent else 1.12 * value\n",
    notices="control.motion.radius",
    field="WheelRadius",
)
plant(
    "driving.percent-halved",
    _DRIVE,
    "/ 100.0 if self._percent",
    "/ 200.0 if self._percent",
    notices=("control.motion.max-speed", "control.ackerman.percent"),
    field="MaxSpeed",
)
plant(
    "driving.not-clamped",
    _DRIVE,
    "return max(-self._limit, min(self._limit, speed))",
    "return max(-1.5 * self._limit, min(1.5 * self._limit, speed))",
    notices="control.motion.max-speed",
    field="MaxSpeed",
)
plant(
    "driving.wheels-from-behind",
    _DRIVE,
    "self._targets[wheel.number] = speed",
    "self._targets[-1 - wheel.number] = speed",
    notices="control.omni.sides",
    field="WheelNumber",
)
plant(
    "driving.conf.mass",
    _TOLD,
    'number("Mass", mass, _DIGITS)',
    'number("Mass", 2.0 * mass, _DIGITS)',
    notices="control.conf.mass",
    field="Mass",
)
plant(
    "driving.conf.max-speed",
    _TOLD,
    'number("MaxSpeed", max_speed, _DIGITS)',
    'number("MaxSpeed", max_speed / 2.0, _DIGITS)',
    notices=("control.motion.max-speed", "control.ackerman.percent"),
    field="MaxSpeed",
)
plant(
    "driving.geo.radius",
    _TOLD,
    'number("WheelRadius", radius, _DIGITS)',
    'number("WheelRadius", 1.2 * radius, _DIGITS)',
    notices=("control.motion.radius", "control.ackerman.speed"),
    field="WheelRadius",
)
plant(
    "driving.geo.separation-halved",
    _TOLD,
    'number("WheelSeparation", separation, _DIGITS)',
    'number("WheelSeparation", separation / 2.0, _DIGITS)',
    notices=("control.motion.separation", "control.geo.size"),
    field="WheelSeparation",
)
plant(
    "driving.geo.separation-doubled",
    _TOLD,
    'number("WheelSeparation", separation, _DIGITS)',
    'number("WheelSeparation", 2.0 * separation, _DIGITS)',
    notices=("control.motion.separation", "control.geo.size"),
    field="WheelSeparation",
)
plant(
    "driving.geo.base-doubled",
    _TOLD,
    'number("WheelBase", base, _DIGITS)',
    'number("WheelBase", 2.0 * base, _DIGITS)',
    notices=("control.geo.size", "control.ackerman.radius"),
    field="WheelBase",
)
plant(
    "driving.geo.base-halved",
    _TOLD,
    'number("WheelBase", base, _DIGITS)',
    'number("WheelBase", base / 2.0, _DIGITS)',
    notices="control.ackerman.radius",
    field="WheelBase",
)
plant(
    "driving.geo.dimensions",
    _TOLD,
    'triple("Dimensions", dimensions, _DIGITS),\n        triple("COG"',
    'triple("Dimensions", [one / 2.0 for one in dimensions], _DIGITS),\n        triple("COG"',
    notices="control.geo.size",
    field="Dimensions",
)
plant(
    "driving.geo.cog",
    _TOLD,
    'triple("COG", cog, _DIGITS)',
    'triple("COG", (cog[0], cog[1] + 1.0, cog[2]), _DIGITS)',
    notices="control.geo.size",
    field="COG",
)

plant(
    "driving.conf.torque",
    _TOLD,
    'number("MaxTorque", max_torque, _DIGITS)',
    'number("MaxTorque", max_torque / 2.0, _DIGITS)',
    notices="control.conf.torque",
    field="MaxTorque",
)
plant(
    "driving.conf.steering-type",
    _TOLD,
    'segment("SteeringType", steering_type)',
    'segment("SteeringType", "Unknown")',
    notices=(
        "control.conf.steering-type",
        "control.ackerman.steering-type",
        "control.omni.steering-type",
    ),
    field="SteeringType",
)
plant(
    "driving.conf.one-dialect",
    _TOLD,
    'number("Mass", mass, _DIGITS)',
    'number("Mass", mass if dialect is Dialect.UT2004 else 2.0 * mass, _DIGITS)',
    notices="control.conf.dialects-agree",
    field="Mass",
    dialect=None,
)
plant(
    "driving.status.light",
    _TOLD,
    'flag("LightToggle", status.light),\n        count(',
    'flag("LightToggle", not status.light),\n        count(',
    notices="control.status.light",
    field="LightToggle",
)
plant(
    "driving.status.light-intensity",
    "usarsim_server/robots/families/base.py",
    "return LIGHT_INTENSITY if self.light or",
    "return LIGHT_INTENSITY if not self.light or",
    notices="control.status.light-intensity",
    field="LightIntensity",
)

# Cars.

plant(
    "cars.steer-sign",
    _CARS,
    "front, rear = (-angle for angle in self._angles)",
    "front, rear = (+angle for angle in self._angles)",
    notices=("control.ackerman.front-steer", "control.ackerman.rear-steer"),
    field="FrontSteer|RearSteer",
)
plant(
    "cars.front-steer-sign",
    _CARS,
    "front, rear = (-angle for angle in self._angles)",
    "front, rear = self._angles[0], -self._angles[1]",
    notices="control.ackerman.front-steer",
    field="FrontSteer",
)
plant(
    "cars.rear-steer-sign",
    _CARS,
    "front, rear = (-angle for angle in self._angles)",
    "front, rear = -self._angles[0], self._angles[1]",
    notices="control.ackerman.rear-steer",
    field="RearSteer",
)
plant(
    "cars.steers-too-little",
    _CARS,
    "self._angles[axle] = max(low, min(high, angle))",
    "self._angles[axle] = 0.75 * max(low, min(high, angle))",
    notices=("control.ackerman.radius", "control.ackerman.status"),
    field="FrontSteer",
)
plant(
    "cars.axles-exchanged",
    _CARS,
    "front, rear = (-angle for angle in self._angles)",
    "rear, front = (-angle for angle in self._angles)",
    notices="control.ackerman.front-steer",
    field="FrontSteer",
)
plant(
    "cars.slow",
    _CARS,
    "min(highest, self._speed)",
    "min(highest, 0.85 * self._speed)",
    notices="control.ackerman.speed",
    field="Speed",
)
plant(
    "cars.status.front-steer-sign",
    _CARS,
    "return self._measured(facts, True), self._measured(facts, False)",
    "return -self._measured(facts, True), self._measured(facts, False)",
    notices="control.ackerman.status",
    field="FrontSteer of STA",
)
plant(
    "cars.status.rear-steer-sign",
    _CARS,
    "return self._measured(facts, True), self._measured(facts, False)",
    "return self._measured(facts, True), -self._measured(facts, False)",
    notices="control.ackerman.status",
    field="RearSteer of STA",
)
plant(
    "cars.status.udk-sign",
    _CARS,
    "return self._angles[0], self._angles[1]",
    "return -self._angles[0], -self._angles[1]",
    notices="control.ackerman.status",
    field="Steer of STA",
    dialect="udk",
)
plant(
    "cars.conf.max-front-steer",
    _TOLD,
    '_steer_limit("MaxFrontSteer", max_front, limits)',
    '_steer_limit("MaxFrontSteer", max_front / 2.0, limits)',
    notices="control.ackerman.limits",
    field="MaxFrontSteer",
)
plant(
    "cars.conf.max-rear-steer",
    _TOLD,
    '_steer_limit("MaxRearSteer", max_rear, limits)',
    '_steer_limit("MaxRearSteer", 2.0 * max_rear, limits)',
    notices="control.ackerman.limits",
    field="MaxRearSteer",
)

# Wheels that are steered one by one.

plant(
    "omni.steer-sign",
    _OMNI,
    "min(high, -wheel.sense * steer)",
    "min(high, wheel.sense * steer)",
    notices="control.omni.steer",
    field="WheelSteer",
)
plant(
    "omni.speed-order",
    _OMNI,
    "self._speeds[target.number] = speed",
    "self._speeds[-1 - target.number] = speed",
    notices="control.omni.sides",
    field="WheelNumber",
)
plant(
    "omni.steer-order",
    _OMNI,
    "wheel = self._wheels[target.number]",
    "wheel = self._wheels[-1 - target.number]",
    notices="control.omni.steer",
    field="WheelSteer|WheelNumber",
)
plant(
    "omni.backwards",
    _OMNI,
    "self._speeds[target.number] = speed",
    "self._speeds[target.number] = -speed",
    notices="control.omni.speed",
    field="WheelSpeed",
)

# Flippers.

plant(
    "flippers.command-sign",
    _JOINTS,
    "JointOrder(Order.POSITION, value)\n                        for name",
    "JointOrder(Order.POSITION, -value)\n                        for name",
    notices=("control.flippers.each", "control.flippers.lift"),
    field="Flipper",
)
plant(
    "flippers.status-sign",
    _JOINTS,
    "(link.joint, state.joint_position(link.joint)) for link in self._loose",
    "(link.joint, -state.joint_position(link.joint)) for link in self._loose",
    notices=("control.flippers.each", "control.legged.each-joint"),
    field="of STA",
)
plant(
    "flippers.status-exchanged",
    _JOINTS,
    "(link.joint, state.joint_position(link.joint)) for link in self._loose)",
    "(link.joint, state.joint_position(other.joint))"
    " for link, other in zip(self._loose, list(self._loose)[::-1]))",
    notices="control.flippers.each",
    field="FRFlipper of STA",
)
plant(
    "flippers.single-doubled",
    _JOINTS,
    "joint_order(link, request.order, request.value,",
    "joint_order(link, request.order, 2.0 * request.value,",
    notices="control.flippers.each",
    field="FRFlipper of STA",
)
plant(
    "flippers.front-right-inverted",
    "robots/Kenaf.toml",
    'name = "FRFlipper"\nparent = 0\nposition = [0.225, 0.23, 0]\naxis = [0, -1, 0]',
    'name = "FRFlipper"\nparent = 0\nposition = [0.225, 0.23, 0]\naxis = [0, 1, 0]',
    notices="control.flippers.lift",
    field="FRFlipper",
)
plant(
    "flippers.rear-left-inverted",
    "robots/Kenaf.toml",
    'name = "RLFlipper"\nparent = 0\nposition = [-0.225, -0.23, 0]\naxis = [0, -1, 0]',
    'name = "RLFlipper"\nparent = 0\nposition = [-0.225, -0.23, 0]\naxis = [0, 1, 0]',
    notices="control.flippers.lift",
    field="RLFlipper",
)
