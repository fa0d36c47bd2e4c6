"""Ears and gas sensors: loudness of UT2004, acoustic array of UDK, the breath of people (robots
reference 2.9).

Both ears hear the calling victims and the sounds of the world file. A level falls by 20 log10(d / 1
m); a source that cannot be seen sounds as if it were twice as far away.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.base.fields import field
from usarsim_server.protocol.numbers import fixed, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.base import Sensor, SensorContext, register
from usarsim_server.sensors.people import in_sight, relative, sight_lines
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState
from usarsim_server.worlds.surroundings import Sound

SPEED_OF_SOUND = 343.0
"""m/s."""

MUFFLED = 2.0
"""Factor on the distance of sources that cannot be seen. Source: AcousticArraySensor.uc."""

MAX_SOUNDS = 10
"""Most sounds of one line, which stays below 1024 bytes (protocol reference 6.7 number 107)."""


class _Ear(Sensor):
    """What both have in common: sounds and whether something is in between."""

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._life = context.life
        self._sounds: list[Sound] = []

    def audible(self, robot: RobotState) -> list[Sound]:
        """The sounds of this reading."""
        raise NotImplementedError

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray to each source."""
        self._sounds = self.audible(robot)
        return sight_lines(self.world_pose(robot), [sound.position for sound in self._sounds])

    def hidden(self, robot: RobotState, hits: Sequence[RayHits]) -> list[bool]:
        """Which of the sounds cannot be seen."""
        points = [sound.position for sound in self._sounds]
        victims = [sound.victim for sound in self._sounds]
        return [not seen for seen in in_sight(self.world_pose(robot), points, hits, victims)]

    def distance(self, sound: Sound, robot: RobotState) -> float:
        """True distance of a source, m."""
        return math.dist(sound.position, self.world_pose(robot).position)


@register("Sound", "SoundSensor")
class SoundSensor(_Ear):
    """Level of the loudest sound at this moment, dB, and how long it lasts; zeros for silence."""

    wire_type: ClassVar[str] = "Sound"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    threshold: float = field(default=0.0, low=0.0, unit="dB", help="of what is heard")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self.loudness = 0.0
        self.duration = 0.0

    def audible(self, robot: RobotState) -> list[Sound]:
        """What sounds now."""
        return self._life.sounding(robot.time)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the loudest sound."""
        heard = [
            (level(sound, self.distance(sound, robot), hidden), sound.noise.duration)
            for sound, hidden in zip(self._sounds, self.hidden(robot, hits), strict=True)
        ]
        loud = [entry for entry in heard if entry[0] > self.threshold]
        self.loudness, self.duration = max(loud, default=(0.0, 0.0))
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Loudness and Duration, two digits."""
        return (("Loudness", fixed(self.loudness, 2)), ("Duration", fixed(self.duration, 2)))


@register("Acoustic", "AcousticArraySensor", "ExampleAcousticArray")
class AcousticArray(_Ear):
    """Every sound that began since the last report: where from, how loud, how long, how late.

    The direction is a unit vector in the sensor's frame with z up, as UDK sent it, unlike every
    other vector. UDK muffled the sources in plain sight instead of the hidden ones. Its lines bore
    an internal object name; here it is the item's own.
    """

    wire_type: ClassVar[str] = "Acoustic"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 1.0, Dialect.UDK: 1.0}

    max_range: float = field(
        default=4000.0, above=0.0, unit="m", help="beyond it a sound is only known to be far"
    )
    literal: bool = field(default=False, help="muffles what is in plain sight, as UDK")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._since: float | None = None
        self._report: list[tuple[float, tuple[Segment, ...]]] = []

    def audible(self, robot: RobotState) -> list[Sound]:
        """What began since the last reading; nothing at the first."""
        since = robot.time if self._since is None else self._since
        return self._life.sounds(since, robot.time)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the new sounds."""
        self._since = robot.time
        found = [
            self._describe(sound, hidden is not self.literal, robot)
            for sound, hidden in zip(self._sounds, self.hidden(robot, hits), strict=True)
        ]
        # The loudest are kept, in the order in which they began.
        limit = sorted((loudness for loudness, _ in found), reverse=True)[:MAX_SOUNDS]
        self._report = [entry for entry in found if entry[0] >= limit[-1]][:MAX_SOUNDS]
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """None; or for each sound Far, or Direction, Volume, Duration and Delay."""
        if not self._report:
            return (("None", ""),)
        return tuple(segment for _, segments in self._report for segment in segments)

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """SCAN asks for one report now."""
        return SetResult.SCAN if opcode == "SCAN" else SetResult.UNKNOWN

    def _describe(
        self, sound: Sound, muffled: bool, robot: RobotState
    ) -> tuple[float, tuple[Segment, ...]]:
        pose = self.world_pose(robot)
        distance = self.distance(sound, robot)
        volume = level(sound, distance, muffled)
        if distance * (MUFFLED if muffled else 1.0) > self.max_range or volume < 0.0:
            return -math.inf, (("Far", ""),)
        x, y, z = relative(pose, sound.position)
        length = max(distance, 1e-9)
        direction = vector((x / length, y / length, -z / length), 2)
        delay = max(0.0, distance / SPEED_OF_SOUND + sound.start - robot.time)
        return volume, (
            ("Direction", direction),
            ("Volume", fixed(volume, 4)),
            ("Duration", fixed(sound.noise.duration, 4)),
            ("Delay", fixed(delay, 4)),
        )


def level(sound: Sound, distance: float, muffled: bool) -> float:
    """Level (dB) of a sound at a distance (m), the source's own within 1 m."""
    felt = distance * (MUFFLED if muffled else 1.0)
    return sound.noise.loudness - 20.0 * math.log10(max(felt, 1.0))


NEAREST = 0.2
"""m: nearer than this to a mouth the air is mixed."""


@register("CO2Sensor", "CO2")
class Co2Sensor(Sensor):
    """Carbon dioxide above the ambient air, percent by volume.

    The contributions of all who breathe, victims and avatars, add up, each falling with the
    square of the distance; walls do not matter.
    """

    wire_type: ClassVar[str] = "CO2Sensor"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    noise: float = field(default=0.0, low=0.0, unit="percent", help="standard deviation")
    ambient: float = field(default=0.0, low=0.0, high=100.0, unit="percent", help="everywhere")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._rng = context.rng
        self._life = context.life
        self._victims = [victim for victim in self._life.victims if victim.traits.co2 > 0.0]
        self.density = 0.0

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the density at the sensor."""
        here = self.world_pose(robot).position
        mouths = [(one.traits.co2, one.head(robot.time)) for one in self._victims]
        mouths += [(one.co2, one.head) for one in self._life.passers(robot.snapshot)]
        density = self.ambient + sum(
            co2 / max(math.dist(head, here), NEAREST) ** 2 for co2, head in mouths
        )
        if self.noise > 0.0:
            density += self.noise * self._rng.standard_normal()
        self.density = min(max(density, 0.0), 100.0)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Gas and Density, four digits: with two a person would be nothing beyond 2.75 m."""
        return (("Gas", "CO2"), ("Density", fixed(self.density, 4)))
