"""Which dialect a connection speaks, and what the dialects differ in (protocol reference 5.3).

The addendum of that page wins over its section: under `auto` the robot class decides the default,
and only then do the client's own habits switch `ut2004` to `udk`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from usarsim_server.protocol.requests import Act, GetConf, GetGeo, Init, Request
from usarsim_server.protocol.values import Dialect


class DialectMode(Enum):
    """How a listening port chooses the dialect of its connections."""

    AUTO = "auto"
    UT2004 = "ut2004"
    UDK = "udk"


@dataclass(frozen=True, slots=True, kw_only=True)
class Facets:
    """Everything the output and the few dialect dependent inputs differ in; defaults: `ut2004`."""

    sta_period: float = 0.2  # s of simulated time between STA lines (row "STA period")
    time_digits: int = 2  # of Time in STA, MISSTA, ASTA, EFF and RES (protocol table 2.2)
    range_digits: int = 4  # of RangeScanner ranges (row "RangeScanner digits")
    geometry_digits: int = 4  # of sensor GEO (protocol table 2.2)
    batched_geometry: bool = True
    """Sensor GEO has one multi-pair segment per item (row "sensor GEO")."""
    type_before_name: bool = True  # order of the vehicle CONF (row "vehicle CONF")
    multi_pair: bool = True  # multi-pair SEN segments exist (row "Sonar, IR, Encoder, Touch")
    results: bool = True  # SET is answered by RES (row "SET replies")
    partial_drive: bool = True
    """An absent member of a DRIVE pair keeps its value; otherwise an incomplete pair is ignored
    (row "DRIVE partial pairs")."""
    sticky_normalized: bool = False  # ground vehicles remember Normalized (row "Normalized")
    rotational_velocity_unit: float = 1.0
    """rad/s of one unit of DRIVE RotationalVelocity (row of the name)."""
    mission_package_head: str = "MISSTA"  # head of the periodic actuator line (row "actuators")
    camera_in_degrees: bool = False
    """Camera CONF is in degrees with texture fields (row "Camera CONF")."""
    ground_truth_signed: bool = False
    """Angles in (-pi, pi], otherwise in [0, 2 pi) (row "GroundTruth")."""
    ground_truth_digits: int = 2  # row "GroundTruth angles, digits"
    encoder_wraps: bool = False  # ticks are modulo one turn and items are named Wk (row "Encoder")
    panning_key: str = "Paning"  # spelling in RangeScanner CONF (protocol 5.2 no. 11).
    flip: bool = True  # DRIVE Flip sets an overturned robot back on its wheels (protocol 3.4)
    limb_period: float | None = None
    """s of simulated time between two ASTA and two EFF lines (protocol 4.9); None: actuators report
    as often as STA, effectors on request only."""
    lamp_always_full: bool = False  # LightIntensity is 100 while the lamp is off (protocol 4.3)
    steering_as_commanded: bool = False
    """STA tells commanded steering angles, otherwise measured ones (protocol 4.3)."""
    tilt_commands: bool = False  # aircraft obey PitchAngle and RollAngle (protocol 3.4.4)
    flight_in_degrees: bool = False  # in CONF of aircraft (protocol 5.2 no. 16).
    link_mounts: bool = True
    """GEO names the link that carries an item, otherwise the actuator or the vehicle
    (protocol 4.7)."""
    package_type: str = "MisPkg"  # type by which clients ask for actuators (protocol 4.8)
    odometry_resolution: bool = True  # Odometry CONF tells EncoderResolution (protocol 4.8)
    acceleration_orientation: bool = True
    """The acceleration sensor tells Orientation (protocol 4.6, addendum)."""
    infrared_limits: int = 1  # how often IR CONF tells both limits (protocol 4.8)
    sonar_cone: bool = False  # Sonar CONF tells how the cone is sampled (protocol 4.8)
    image_pairs: bool = False
    """The range imager tells both axes of its image, otherwise those of a scanner (protocol 4.6,
    4.8)."""


FACETS: Mapping[Dialect, Facets] = {
    Dialect.UT2004: Facets(),
    Dialect.UDK: Facets(
        sta_period=0.1,
        time_digits=4,
        range_digits=2,
        geometry_digits=2,
        batched_geometry=False,
        type_before_name=False,
        multi_pair=False,
        results=False,
        partial_drive=False,
        sticky_normalized=True,
        rotational_velocity_unit=math.radians(1.0),
        mission_package_head="ASTA",
        camera_in_degrees=True,
        ground_truth_signed=True,
        ground_truth_digits=3,
        encoder_wraps=True,
        panning_key="Panning",
        flip=False,
        limb_period=0.1,
        lamp_always_full=True,
        steering_as_commanded=True,
        tilt_commands=True,
        flight_in_degrees=True,
        link_mounts=False,
        package_type="Actuator",
        odometry_resolution=False,
        acceleration_orientation=False,
        infrared_limits=2,
        sonar_cone=True,
        image_pairs=True,
    ),
}
"""The table of protocol reference 5.3, one column per dialect."""

ANGLE_UNIT = math.tau / 65536
"""Smallest angle of the UDK engine, rad (protocol reference 2.4)."""

_MAX_FOUR_DIGIT_BEAMS = 240
"""More beams than this print with two digits in every dialect (protocol 5.2 no. 14): RDK's line
buffer holds 2048 characters, and 240 ranges such as `19.9999,` fill 1920 of them."""


def limb_periods(dialect: Dialect, status: float) -> tuple[float, float]:
    """Simulated s between two lines of an actuator and of an effector; 0: on request only.

    Args:
        dialect: of the client.
        status: s between two STA lines of the robot.
    """
    period = FACETS[dialect].limb_period
    return (status, 0.0) if period is None else (period, period)


def range_digits(dialect: Dialect, beams: int) -> int:
    """Digits after the point of the ranges of a scan with this many beams."""
    return 2 if beams > _MAX_FOUR_DIGIT_BEAMS else FACETS[dialect].range_digits


def announced_angle(angle: float, dialect: Dialect) -> float:
    """A configured angle (rad) as a dialect announces it.

    UDK kept configured angles as whole angle units and so printed slightly less: pi as 3.1414
    (protocol reference 2.1).
    """
    return int(angle / ANGLE_UNIT) * ANGLE_UNIT if dialect is Dialect.UDK else angle


def sends_results(dialect: Dialect) -> bool:
    """Whether SET is answered by a RES line."""
    return FACETS[dialect].results


UDK_ONLY_CLASSES = frozenset(
    [
        "kr3",
        "kr5",
        "kr6",
        "kr60",
        "kuka_lwr_bot",
        "fanuc_m16ib20",
        "fanuc_robot_and_rail",
        "forklift",
        "gripperbase",
        "handbot",
        "kinectbot",
        "twolink",
        "kiva4wheel",
        "basicskidrobot",
        "basicackermanrobot",
        "casterskidrobot",
        "frontackerman",
    ]
)
"""Robot classes, lower case, that no UT2004 server had (protocol 5.3 signal 4)."""

_UDK_PACKAGES = frozenset({"usarbotapi", "usaravatar"})
_UDK_TYPES = frozenset({"actuator", "gripper", "toolchanger", "rangeimager", "objectsensor"})


def _is_udk_signal(request: Request) -> bool:
    """Whether only a client of the UDK generation sends this (the four signals of protocol 5.3)."""
    match request:
        case Init():
            return (
                request.spelled_classname_exactly
                or request.package.lower() in _UDK_PACKAGES
                or request.class_name.lower() in UDK_ONLY_CLASSES
            )
        case GetConf() | GetGeo():
            return request.type.lower() in _UDK_TYPES
        case _:
            return isinstance(request, Act)


class DialectSelector:
    """Chooses the dialect of one connection. Rules, the first that applies wins:

    1. A port with a fixed dialect never changes.
    2. `{Dialect x}` in INIT forces a dialect and ends automatic change.
    3. A signal of a UDK client switches to `udk`, once and for good.
    4. The class of the spawned robot decides.
    5. Before all that: `ut2004`.

    Call `observe` with every request, before its effects, and `initialised` once a robot exists.
    Format each line with the `current` dialect of that moment.
    """

    __slots__ = ("_decided", "_fixed", "current")

    def __init__(self, mode: DialectMode = DialectMode.AUTO) -> None:
        self.current: Dialect = Dialect.UDK if mode is DialectMode.UDK else Dialect.UT2004
        """The dialect of the next line."""
        self._fixed = mode is not DialectMode.AUTO
        self._decided = False

    def observe(self, request: Request) -> None:
        """Take notice of any request."""
        if self._fixed:
            return
        if isinstance(request, Init) and request.dialect is not None:
            self.current, self._decided = request.dialect, True
        elif not self._decided and _is_udk_signal(request):
            self.current, self._decided = Dialect.UDK, True

    def initialised(self, class_default: Dialect, init: Init) -> None:
        """Take notice of a robot that was spawned.

        Args:
            class_default: dialect of the era that the robot class comes from.
            init: the request that spawned it; it need not have been observed before.
        """
        self.observe(init)
        if not (self._fixed or self._decided):
            self.current = class_default
