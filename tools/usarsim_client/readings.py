"""What sensors report, as frozen values: m, rad, s, frame of the wire (see `frames`)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from usarsim_client import frames
from usarsim_client.declared import NOWHERE, many, text, whole, wire
from usarsim_client.segments import (
    Array,
    Item,
    array,
    boolean,
    integer,
    number,
    numbers,
    points,
    vector,
)
from usarsim_client.sensing import Reading as Reading
from usarsim_client.sensing import Unknown as Unknown
from usarsim_client.sensing import tells
from usarsim_server.protocol.values import Vector

_NONE = np.zeros(0)
_NONE.setflags(write=False)


def _axis(place: int) -> Callable[[str], float]:
    return lambda value: vector(value)[place]


def _angles(value: str) -> Vector:
    roll, pitch, yaw = vector(value)
    return frames.signed(roll), frames.signed(pitch), frames.signed(yaw)


def _up_is_down(value: str) -> Vector:
    """The one vector of the wire with z up, in its frame."""
    x, y, z = vector(value)
    return x, y, -z


def _meridian(value: str) -> float:
    """Latitude or longitude `39,8.0341,N`, rad."""
    degrees, minutes, letter = value.split(",")
    angle = math.radians(number(degrees) + number(minutes) / 60.0)
    return -angle if letter.strip().upper() in ("S", "W") else angle


def _points(item: Item) -> Array:
    """Points of a segment, which has no key in PCL, and which blanks between them may have cut."""
    named = item.fields.get("points")
    return points(named or " ".join(f"{key} {value}" for key, value in item.segments))


@tells("RangeScanner", "IRScanner")
@dataclass(frozen=True, slots=True, eq=False)
class LaserScan(Reading):
    """A flat scan: RangeScanner, IRScanner.

    Attributes:
        ranges: (n,) m, from the right to the left; the scanner's greatest range where nothing is.
        fov: rad from the first beam to the last. resolution: rad between two beams.
    """

    ranges: Array = wire(array, "Range")
    fov: float = wire(number, "FOV", default=0.0)
    resolution: float = wire(number, "Resolution", default=0.0)

    @property
    def bearings(self) -> Array:
        """(n,) rad of each beam in the frame of the wire, right positive."""
        return frames.bearings(len(self.ranges), self.fov)

    @property
    def points(self) -> Array:
        """(n, 2) m, x forward and y to the right of the scanner."""
        return frames.on_circle(self.ranges, self.bearings)


@tells("RangeScanner3D", "3DRangeScanner")
@dataclass(frozen=True, slots=True, eq=False)
class Scan3D(Reading):
    """A scan of rows: RangeScanner3D.

    Attributes:
        ranges: (n,) m, row by row from up to down, each from the right to the left.
        fov, resolution: vertical and horizontal, rad.
    """

    ranges: Array = wire(array, "Range")
    fov: tuple[float, ...] = wire(numbers, "FOV")
    resolution: tuple[float, ...] = wire(numbers, "Resolution")

    @property
    def rows(self) -> Array:
        """(rows, columns) m; one row if the numbers do not fit what the line says of them."""
        if len(self.fov) == 2 and len(self.resolution) == 2:
            columns = self.fov[1] / (self.resolution[1] or math.nan) + 1.0 + 1e-6
            if 1.0 <= columns <= len(self.ranges):
                near = int(columns)  # printed numbers are cut off
                for width in (near, near + 1, near - 1):
                    if width and len(self.ranges) % width == 0:
                        return self.ranges.reshape(-1, width)
        return self.ranges.reshape(1, -1)


@tells("RangeImager")
@dataclass(frozen=True, slots=True, eq=False)
class DepthStrip(Reading):
    """Some rows of a depth picture: RangeImager. A picture comes as `frames` strips, from the top.

    Attributes:
        ranges: (n,) m along the axis of view, row by row, from the left to the right; empty while
            the sensor is idle.
        fov: horizontal and vertical, rad, or one number. resolution: pixels, or one angle.
        frame: number of the strip, from 0. frames: of a picture.
    """

    ranges: Array = wire(array, "Range", default=_NONE)
    fov: tuple[float, ...] = wire(numbers, "FOV")
    resolution: tuple[float, ...] = wire(numbers, "Resolution")
    frame: int = wire(integer, "Frame", default=0)
    frames: int = wire(integer, "Frames", default=0)

    @property
    def rows(self) -> Array:
        """(rows, width) m; one row if the line does not tell how wide the picture is."""
        count = len(self.ranges)
        if len(self.resolution) == 2 and 1.0 <= self.resolution[0] <= count:
            width = int(self.resolution[0])
            if count % width == 0:
                return self.ranges.reshape(-1, width)
        return self.ranges.reshape(1, -1)


@tells("Range")
@dataclass(frozen=True, slots=True)
class RangeReading(Reading):
    """One distance along the axis of a sensor, m."""

    range: float = wire(number, "Range")


@tells("Sonar")
class Sonar(RangeReading):
    """An ultrasonic sensor; its greatest range where it hears no echo."""

    __slots__ = ()


@tells("IR")
class IR(RangeReading):
    """An infrared sensor; its greatest range where nothing is."""

    __slots__ = ()


@tells("Odometry")
@dataclass(frozen=True, slots=True)
class Odometry(Reading):
    """Where the wheels say that the robot is, from its start or last RESET.

    Attributes:
        x: m forward. y: m to the right. theta: rad, clockwise; not wrapped in every generation.
    """

    x: float = wire(_axis(0), "Pose")
    y: float = wire(_axis(1), "Pose")
    theta: float = wire(_axis(2), "Pose")


@dataclass(frozen=True, slots=True)
class Pose(Reading):
    """A pose in the world.

    Attributes:
        location: m. orientation: roll, pitch, yaw, rad, each in [-pi, pi).
    """

    location: Vector = wire(vector, "Location")
    orientation: Vector = wire(_angles, "Orientation")


@tells("GroundTruth")
class GroundTruth(Pose):
    """Where the robot truly is."""

    __slots__ = ()


@tells("INS")
class INS(Pose):
    """Where inertial navigation thinks that the robot is; drifts."""

    __slots__ = ()


@tells("INU")
@dataclass(frozen=True, slots=True)
class Attitude(Reading):
    """INU: roll, pitch, yaw, rad, each in [-pi, pi)."""

    orientation: Vector = wire(_angles, "Orientation")


@tells("IMU")
@dataclass(frozen=True, slots=True)
class IMU(Reading):
    """An inertial unit.

    Attributes:
        acceleration: m/s2 without gravity in the frame of the sensor, z down as everywhere (the
            wire has it up in this one segment).
        angular_velocity: rad/s. angular_acceleration: rad/s2; of the Euler angles.
        orientation: roll, pitch, yaw, rad.
    """

    acceleration: Vector = wire(_up_is_down, "XYZAcceleration")
    angular_velocity: Vector = wire(vector, "AngularVel")
    angular_acceleration: Vector = wire(vector, "AngularAccel")
    orientation: Vector = wire(vector, "Rotation")


@tells("Accel", "AcceleroMeter")
@dataclass(frozen=True, slots=True)
class Acceleration(Reading):
    """Accel, without gravity, and AcceleroMeter, with it (+g on z at rest).

    Attributes:
        acceleration: m/s2 in the frame of the sensor.
        orientation: roll, pitch, yaw, rad; None where the dialect tells none.
    """

    acceleration: Vector = wire(vector, "Acceleration", "ProperAcceleration")
    orientation: Vector | None = wire(vector, "Orientation", default=None)


@tells("Encoder")
@dataclass(frozen=True, slots=True)
class Encoder(Reading):
    """Ticks since the start or RESET; modulo one turn in `udk`. Forward counts up."""

    ticks: int = wire(integer, "Tick")


@tells("Tachometer")
@dataclass(frozen=True, slots=True)
class Tachometer(Reading):
    """All driven wheels in the order of the model.

    Attributes:
        speeds: rad/s. angles: rad since the start or RESET.
    """

    speeds: tuple[float, ...] = wire(numbers, "Vel", default=())
    angles: tuple[float, ...] = wire(numbers, "Pos", default=())


@tells("GPS")
@dataclass(frozen=True, slots=True)
class GPS(Reading):
    """A satellite receiver.

    Attributes:
        latitude: rad, north positive. longitude: rad, east positive; NaN both without a fix.
        fix: whether there are enough satellites. satellites: in view.
    """

    latitude: float = wire(_meridian, "Latitude", default=math.nan)
    longitude: float = wire(_meridian, "Longitude", "Lonitude", default=math.nan)
    fix: bool = wire(boolean, "Fix", default=False)
    satellites: int = wire(integer, "Satellites", default=0)

    @property
    def degrees(self) -> tuple[float, float]:
        """Latitude and longitude in degrees."""
        return math.degrees(self.latitude), math.degrees(self.longitude)


@tells("Touch", "TouchArray")
@dataclass(frozen=True, slots=True)
class Touch(Reading):
    """A bumper: Touch, TouchArray."""

    touched: bool = wire(boolean, "Touch")


@dataclass(frozen=True, slots=True)
class Tag:
    """A radio tag. location: m, relative to the reader. written: holds a text."""

    id: int = wire(integer, "ID")
    location: Vector = wire(vector, "Location", default=NOWHERE)
    written: bool = wire(boolean, "Mem", default=False)


@tells("RFID", "RFIDTag")
@dataclass(frozen=True, slots=True)
class Tags(Reading):
    """All tags in range of an RFID reader: RFID, RFIDTag."""

    tags: tuple[Tag, ...] = many(Tag, "ID")


@dataclass(frozen=True, slots=True)
class BodyPart:
    """A visible part of a person. location: m, relative to the sensor."""

    part: str = wire(text, "PartName")
    location: Vector = wire(vector, "Location", default=NOWHERE)


@tells("VictSensor")
@dataclass(frozen=True, slots=True)
class Victims(Reading):
    """VictSensor: what it sees of people; empty if nobody is in sight."""

    parts: tuple[BodyPart, ...] = many(BodyPart, "PartName")


@tells("VictRFID")
@dataclass(frozen=True, slots=True)
class VictimTag(Reading):
    """VictRFID: a person's tag within reach.

    Attributes:
        id: as told, a number or a name. victim, status: of the person; empty if not told.
        location: m, relative to the sensor.
    """

    id: str = wire(text, "VictimId", "ID", default="")
    victim: str = wire(text, "VictimName", default="")
    status: str = wire(text, "VictimStatus", "Status", default="")
    location: Vector = wire(vector, "Location", default=NOWHERE)


@tells("HumanMotion")
@dataclass(frozen=True, slots=True)
class HumanMotion(Reading):
    """How likely somebody moves in front of the sensor, 0 to 1."""

    probability: float = wire(number, "Prob")


@tells("Sound")
@dataclass(frozen=True, slots=True)
class Sound(Reading):
    """A noise. loudness: dB. duration: s."""

    loudness: float = wire(number, "Loudness")
    duration: float = wire(number, "Duration")


@dataclass(frozen=True, slots=True)
class Heard:
    """A noise that an array heard.

    Attributes:
        direction: unit vector in the frame of the sensor; volume: dB; duration, delay: s. All are
            NaN for a noise that is too far away to be located.
    """

    direction: Vector = wire(vector, "Direction", default=NOWHERE)
    volume: float = wire(number, "Volume", default=math.nan)
    duration: float = wire(number, "Duration", default=math.nan)
    delay: float = wire(number, "Delay", default=math.nan)


@tells("Acoustic")
@dataclass(frozen=True, slots=True)
class Acoustic(Reading):
    """What a microphone array heard since its last report."""

    noises: tuple[Heard, ...] = many(Heard, "Direction", "Far")


@tells("CO2Sensor")
@dataclass(frozen=True, slots=True)
class Gas(Reading):
    """CO2Sensor: which gas, and its density as told."""

    gas: str = wire(text, "Gas", default="CO2")
    density: float = wire(number, "Density")


@tells("MagneticCompass")
@dataclass(frozen=True, slots=True)
class Compass(Reading):
    """MagneticCompass: angle to north, rad."""

    angle: float = wire(number, "MagneticAngle")


@tells("AltitudeSensor")
@dataclass(frozen=True, slots=True)
class Altitude(Reading):
    """AltitudeSensor, m, **up** positive, over the start and over the sea."""

    relative: float = wire(number, "relativeAltitude")
    absolute: float = wire(number, "absoluteAltitude")


@tells("MissionTime")
@dataclass(frozen=True, slots=True)
class MissionTime(Reading):
    """Minutes since the start of the mission."""

    minutes: int = wire(integer, "Minutes")


@dataclass(frozen=True, slots=True)
class SeenObject:
    """An object that an ObjectSensor saw; all in the frame of the world, m and rad."""

    name: str = wire(text, "Object")
    location: Vector = wire(vector, "Location", default=NOWHERE)
    orientation: Vector = wire(vector, "Orientation", default=NOWHERE)
    hit: Vector = wire(vector, "HitLoc", default=NOWHERE)
    material: str = wire(text, "Material", default="")


@tells("ObjectSensor")
@dataclass(frozen=True, slots=True)
class Objects(Reading):
    """ObjectSensor: what it sees."""

    objects: tuple[SeenObject, ...] = many(SeenObject, "Object")


@tells("PCL", "LineLaser")
@dataclass(frozen=True, slots=True, eq=False)
class PointCloud(Reading):
    """Points (n, 3), m, of PCL in the frame of the sensor, of LineLaser in that of the world."""

    points: Array = whole(_points)


@tells("Helper")
@dataclass(frozen=True, slots=True)
class Ball(Reading):
    """Helper: where the ball is, m, and whether it is in sight."""

    location: Vector = wire(vector, "Pos3D")
    visible: bool = wire(boolean, "Visible", default=False)
