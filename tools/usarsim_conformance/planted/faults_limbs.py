"""Faults of arms, mission packages and legs."""

from usarsim_conformance.planted.faults import plant

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
