"""What light meets on its way through the smoke of a world; sensors decide what it does to them.

Three kinds, as USARSim had them (robots reference 1.12): regional smoke fills a volume and weakens
light along the way, global smoke does so everywhere below a height, local smoke is made of
particles that nothing gets through. All functions are pure: particles that rise are where they are
by simulated time alone, so readings repeat. The tables `[[smoke]]` of a world are read here, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from usarsim_server.base.tables import Table
from usarsim_server.simulation.frames import Array
from usarsim_server.worlds.description import Haze, Smoke, SmokePuff, SmokeVolume

NOZZLE = 0.25
"""Width of a rising plume at its foot, as a part of its width at the top."""
GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
"""rad by which a particle's place turns every time it starts again from the foot."""


class SmokeField:
    """The smoke of one world; immutable, safe to use from any thread.

    Rays are given as in `RayFan`: start points (3,) or (n, 3) and unit directions (n, 3), in the
    world frame. Lengths and distances are in metres.
    """

    def __init__(self, smoke: Smoke) -> None:
        self._volumes = _Volumes(smoke)
        self._puffs = tuple(_Puff(puff) for puff in smoke.puffs)

    def particles(self, time: float) -> tuple[Array, Array]:
        """Centres (k, 3) and radii (k,) of all opaque particles at a simulated time (s)."""
        centres = [puff.particles(time) for puff in self._puffs]
        radii = [np.full(puff.count, puff.radius) for puff in self._puffs]
        return np.concatenate([np.zeros((0, 3)), *centres]), np.concatenate([[], *radii])

    def balls(self) -> list[dict[str, Array]]:
        """What tells where the particles of each cloud are (docs/scene-port.md): `places` (k, 3)
        of those that stand still, `angle` and `aside` (k,) of those that rise."""
        return [puff.balls for puff in self._puffs]

    def blocked_at(self, origin: Array, directions: Array, time: float) -> Array:
        """Distance (n,) at which each ray meets the first particle; inf: it meets none."""
        nearest = np.full(len(directions), np.inf)
        for puff in self._puffs:
            np.minimum(nearest, puff.blocked_at(origin, directions, time), out=nearest)
        return nearest

    def optical_depth(self, origin: Array, directions: Array, lengths: Array) -> Array:
        """Density times metres (n,) along rays of the given lengths (n,), particles left out.

        The transmittance of the way is exp(-optical depth).
        """
        entries, exits = self._volumes.crossings(origin, directions, lengths)
        depth: Array = (exits - entries) @ self._volumes.densities
        return depth

    def distance_at(self, origin: Array, directions: Array, lengths: Array, depths: Array) -> Array:
        """Distance (n,) at which each ray has an optical depth (n,) > 0 behind it.

        Infinity where the ray's length (n,) does not suffice.
        """
        entries, exits = self._volumes.crossings(origin, directions, lengths)
        change = np.broadcast_to(self._volumes.densities, entries.shape)
        places = np.concatenate((entries, exits), axis=1)
        order = places.argsort(axis=1)
        places = np.take_along_axis(places, order, axis=1)
        change = np.take_along_axis(np.concatenate((change, -change), axis=1), order, axis=1)
        density = change.cumsum(axis=1)[:, :-1]
        gained = np.cumsum(density * np.diff(places, axis=1), axis=1)
        reached = gained >= depths[:, None]
        piece = reached.argmax(axis=1)[:, None]
        # From the end of the piece backwards, where the density is surely above zero.
        surplus = np.take_along_axis(gained, piece, axis=1)[:, 0] - depths
        end = np.take_along_axis(places, piece + 1, axis=1)[:, 0]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            distance = end - surplus / np.take_along_axis(density, piece, axis=1)[:, 0]
        return np.where(reached.any(axis=1), distance, np.inf)


def smoke_field(smoke: Smoke) -> SmokeField | None:
    """The field of a world's smoke; None in clear air, so that nobody spends time on it."""
    return None if smoke.clear else SmokeField(smoke)


class _Volumes:
    """Everything that weakens light: the boxes, the ellipsoids and, last, the haze."""

    def __init__(self, smoke: Smoke) -> None:
        volumes = sorted(smoke.volumes, key=lambda volume: volume.shape)
        self._boxes = sum(volume.shape == "box" for volume in volumes)
        self._centres = np.array([volume.pose.position for volume in volumes]).reshape(-1, 3)
        self._to_unit = np.array([_to_unit(volume) for volume in volumes]).reshape(-1, 3, 3)
        self._top = smoke.haze_top
        self.densities = np.array([*(volume.density for volume in volumes), smoke.haze])

    def crossings(self, origin: Array, directions: Array, lengths: Array) -> tuple[Array, Array]:
        """Where each ray enters and leaves each volume (n, v): equal if it does not cross it."""
        origin = np.broadcast_to(origin, directions.shape)
        # In its own frame every volume reaches from -1 to 1 along each axis.
        start = np.einsum("vij,nvj->nvi", self._to_unit, origin[:, None] - self._centres)
        way = np.einsum("vij,nj->nvi", self._to_unit, directions)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            parts = (
                _through_box(start[:, : self._boxes], way[:, : self._boxes]),
                _through_ball(start[:, self._boxes :], way[:, self._boxes :]),
                _below(self._top, origin[:, 2:], directions[:, 2:]),
            )
        entries = np.maximum(np.concatenate([part[0] for part in parts], axis=1), 0.0)
        exits = np.minimum(np.concatenate([part[1] for part in parts], axis=1), lengths[:, None])
        missed = ~(entries < exits)
        entries[missed] = exits[missed] = 0.0
        return entries, exits


class _Puff:
    """One cloud of particles."""

    def __init__(self, puff: SmokePuff) -> None:
        self.radius = puff.radius
        self.count = puff.particles
        self._centre = np.array(puff.position)
        self._half = np.array(puff.size) / 2.0
        self._reach = float(np.linalg.norm(self._half)) + puff.radius
        self._lifetime = puff.lifetime
        rng = np.random.default_rng(puff.seed)
        if puff.lifetime > 0.0:
            self._start = np.arange(puff.particles) / puff.particles
            self._angle = rng.uniform(0.0, math.tau, puff.particles)
            self._aside = np.sqrt(rng.uniform(size=puff.particles))
            self.balls = {"angle": self._angle, "aside": self._aside}
        else:
            way = rng.standard_normal((puff.particles, 3))
            way *= (np.cbrt(rng.uniform(size=puff.particles)) / np.linalg.norm(way, axis=1))[
                :, None
            ]
            self._still = self._centre + way * self._half
            self.balls = {"places": self._still}

    def particles(self, time: float) -> Array:
        """Centres (k, 3) at a simulated time."""
        if self._lifetime <= 0.0:
            return self._still
        round_, age = np.divmod(self._start + time / self._lifetime, 1.0)
        angle = self._angle + GOLDEN_ANGLE * round_
        aside = self._aside * (NOZZLE + (1.0 - NOZZLE) * age)
        place = np.stack((aside * np.cos(angle), aside * np.sin(angle), 2.0 * age - 1.0), axis=1)
        return self._centre + place * self._half

    def blocked_at(self, origin: Array, directions: Array, time: float) -> Array:
        nearest = np.full(len(directions), np.inf)
        offset = self._centre - np.broadcast_to(origin, directions.shape)
        along = np.einsum("ni,ni->n", directions, offset)
        aside = np.einsum("ni,ni->n", offset, offset) - along * along
        near = np.flatnonzero((aside < self._reach**2) & (along > -self._reach))
        if near.size == 0:
            return nearest
        away = self.particles(time) - np.broadcast_to(origin, directions.shape)[near, None]
        middle = np.einsum("nki,ni->nk", away, directions[near])
        beyond = np.einsum("nki,nki->nk", away, away) - self.radius**2
        root = middle * middle - beyond
        distance = np.where(
            (root >= 0.0) & (middle > 0.0), middle - np.sqrt(np.maximum(root, 0.0)), np.inf
        )
        distance[beyond <= 0.0] = 0.0
        nearest[near] = distance.min(axis=1)
        return nearest


def _to_unit(volume: SmokeVolume) -> Array:
    """Matrix (3, 3) from world directions to units of the volume's half extents."""
    return volume.pose.matrix().T / (np.array(volume.size)[:, None] / 2.0)


def _through_box(start: Array, way: Array) -> tuple[Array, Array]:
    """Crossings (n, v) with the cube from -1 to 1."""
    low, high = (-1.0 - start) / way, (1.0 - start) / way
    near = np.nan_to_num(np.minimum(low, high), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    far = np.nan_to_num(np.maximum(low, high), nan=np.inf, posinf=np.inf, neginf=-np.inf)
    return near.max(axis=2), far.min(axis=2)


def _through_ball(start: Array, way: Array) -> tuple[Array, Array]:
    """Crossings (n, v) with the unit ball."""
    square = np.einsum("nvi,nvi->nv", way, way)
    middle = -np.einsum("nvi,nvi->nv", start, way) / square
    half = np.sqrt(middle**2 - (np.einsum("nvi,nvi->nv", start, start) - 1.0) / square)
    return middle - half, middle + half


def _below(top: float, height: Array, climb: Array) -> tuple[Array, Array]:
    """Crossings (n, 1) with everything below a height."""
    at_top = (top - height) / climb
    level = climb == 0.0
    inside = height < top
    entry = np.where(climb < 0.0, at_top, np.where(level & ~inside, np.inf, -np.inf))
    return entry, np.where(climb > 0.0, at_top, np.inf)


SMOKE_KINDS = ("regional", "local", "global")


def read_smoke(tables: Sequence[Table]) -> Smoke:
    """All `[[smoke]]` tables of a world.

    Raises:
        WorldError: naming table, key, what is wrong and what to write instead.
    """
    volumes: list[SmokeVolume] = []
    puffs: list[SmokePuff] = []
    haze: Haze | None = None
    for number, table in enumerate(tables, start=1):
        match table.choice("kind", SMOKE_KINDS):
            case "regional":
                volumes.append(table.read(SmokeVolume))
            case "local":
                seed = table.count("seed", number, low=0, high=2**31)
                puffs.append(table.read(SmokePuff, seed=seed))
            case _:
                if haze is not None:
                    cure = "keep one; regional smoke has a place"
                    raise table.error("kind", "a second global smoke", cure)
                haze = table.read(Haze)
        table.finish()
    if haze is None:
        return Smoke(tuple(volumes), tuple(puffs))
    return Smoke(tuple(volumes), tuple(puffs), haze.density, haze.top)
