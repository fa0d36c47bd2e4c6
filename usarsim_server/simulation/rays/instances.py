"""Which body a ray meets first, answered by one Embree scene of everything that moves.

Embree can place a scene in another one by a matrix, so a body's triangles are in memory once and an
instant costs one small tree. The package `embreex` does not offer this; the library behind it does,
and is called here directly. Where that library cannot be reached or is another one than expected,
there is none (`library` is None), and callers find out without it.

Positions are carried into bodies in single precision here, so a distance is good to some
micrometres and a ray that grazes an edge may be told wrongly: callers measure with the body's own
scene (`triangles.py`). All threads may ask; a scene does not change once it is there.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Sequence
from ctypes import c_int, c_size_t, c_ssize_t, c_uint, c_void_p
from functools import cache

import numpy as np
from embreex import rtcore, rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Numbers

SLACK = 1e-3
"""m that rays go further than asked: round shapes are a little larger than their facets."""
ROBOTS = 32
"""In one scene: as many as a ray has bits to tell what it does not see."""
_SIGNATURES = {
    "rtcGetDeviceProperty": (c_ssize_t, c_void_p, c_int),
    "rtcNewScene": (c_void_p, c_void_p),
    "rtcNewGeometry": (c_void_p, c_void_p, c_int),
    "rtcSetNewGeometryBuffer": (c_void_p, c_void_p, c_int, c_uint, c_int, c_size_t, c_size_t),
    "rtcSetGeometryInstancedScene": (None, c_void_p, c_void_p),
    "rtcSetGeometryTransform": (None, c_void_p, c_uint, c_int, c_void_p),
    "rtcSetGeometryMask": (None, c_void_p, c_uint),
    "rtcCommitGeometry": (None, c_void_p),
    "rtcAttachGeometryByID": (None, c_void_p, c_void_p, c_uint),
    "rtcReleaseGeometry": (None, c_void_p),
    "rtcCommitScene": (None, c_void_p),
    "rtcReleaseScene": (None, c_void_p),
    "rtcIntersect1": (None, c_void_p, c_void_p, c_void_p),
    "rtcIntersect16": (None, c_void_p, c_void_p, c_void_p, c_void_p),
}
"""Result and arguments of what is called of Embree 4."""
_VERSION, _MASKS_SUPPORTED = 0, 64
_TRIANGLES, _INSTANCE, _COLUMNS_OF_FLOATS, _EVERY_BIT = 0, 121, 0x9234, 0xFFFFFFFF
_CORNERS, _CORNERS_OF_FACES = (1, 0, 0x9003), (0, 0, 0x5003)
"""Kind, slot and format of a mesh's arrays: three floats each, three numbers of corners each."""
_WIDTH, _ROWS = 16, 24
"""Rays in one call, and 4-byte words of each: the 21 of `RTCRayHit16`, which must be aligned."""
_ORIGIN, _DIRECTION = slice(0, 3), slice(4, 7)
_TFAR, _MASK, _GEOMETRY, _INSTANCE_ID = 8, 9, 18, 19
"""Rows of `RTCRayHit16`."""


@cache
def device() -> rtcore.EmbreeDevice:
    """That of all scenes of the server: only scenes of one device can be placed in one another."""
    return rtcore.EmbreeDevice()


@cache
def library() -> ctypes.PyDLL | None:
    """Embree behind `embreex`, called with the interpreter's lock held; None where it is not as
    expected, and on Windows, where a module does not pass on the symbols of what it is linked to.
    """
    try:
        embree = ctypes.PyDLL(rtcore_scene.__file__)
        for name, (result, *arguments) in _SIGNATURES.items():
            function = getattr(embree, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError):
        return None
    # Objects are as the files `.pxd` of `embreex` declare them for others to build on: the scene's
    # handle, an int and the device; the device's handle.
    scene, head = rtcore_scene.EmbreeScene(device()), object.__basicsize__
    sizes = type(scene).__basicsize__ - head, type(device()).__basicsize__ - head
    if ctypes.sizeof(c_void_p) != 8 or sizes != (24, 8):
        return None
    if c_size_t.from_address(id(scene) + head + 16).value != id(device()):
        return None
    version = embree.rtcGetDeviceProperty(handle(device()), _VERSION)
    masks = embree.rtcGetDeviceProperty(handle(device()), _MASKS_SUPPORTED)
    return embree if version // 10000 == 4 and masks else None


def handle(of: rtcore_scene.EmbreeScene | rtcore.EmbreeDevice) -> int | None:
    """Embree's own scene or device behind that of `embreex`."""
    return c_void_p.from_address(id(of) + object.__basicsize__).value


def add_mesh(scene: rtcore_scene.EmbreeScene, faces: NDArray[np.float32]) -> None:
    """Put triangles (n, 3, 3), m, into an empty scene: its one mesh, met by rays of every mask.

    `embreex` copies number by number, which takes a third of a second for 300,000 triangles.

    Raises:
        MemoryError: there is no room for them.
    """
    embree = library()
    if embree is None:
        TriangleMesh(scene, faces)
        return
    corners = np.ascontiguousarray(faces, np.float32)
    numbers = np.arange(3 * len(corners), dtype=np.uint32)
    mesh = embree.rtcNewGeometry(handle(device()), _TRIANGLES)
    for kind, values, count in (
        (_CORNERS, corners, 3 * len(corners)),
        (_CORNERS_OF_FACES, numbers, len(corners)),
    ):
        room = embree.rtcSetNewGeometryBuffer(mesh, *kind, values.nbytes // count, count)
        if room is None:
            embree.rtcReleaseGeometry(mesh)
            raise MemoryError(f"no room for {len(corners)} triangles")
        ctypes.memmove(room, values.ctypes.data, values.nbytes)
    embree.rtcSetGeometryMask(mesh, _EVERY_BIT)
    embree.rtcCommitGeometry(mesh)
    embree.rtcAttachGeometryByID(handle(scene), mesh, 0)
    embree.rtcReleaseGeometry(mesh)


class PlacedBodies:
    """Bodies where they are at one instant, and once moved at another; one thread at a time."""

    def __init__(
        self,
        scenes: Sequence[rtcore_scene.EmbreeScene | None],
        bodies: Numbers,
        robots: Numbers,
        turns: Array,
        places: Array,
    ) -> None:
        """Place b bodies; there must be a `library`.

        Args:
            scenes: the scene of each body in its own frame, of the `device`; None if it has no
                surface.
            bodies: (b,) numbers of the bodies.
            robots: (b,) the robot that each is part of, any number from 0 on; -1 for none.
            turns: (b, 3, 3) rotation matrices. places: (b, 3) m.
        """
        embree = library()
        if embree is None:
            raise RuntimeError("Embree cannot be asked on this machine")
        self._embree = embree
        self._middle = places.mean(axis=0) if len(places) else np.zeros(3)
        self._columns = np.full((len(bodies), 4, 3), np.nan, np.float32)
        """Where each stands, as Embree was told last: axes of its frame, and its origin."""
        self._room = _aligned(0)
        owner = handle(device())
        team = np.unique(robots[robots >= 0])
        self._tops = [embree.rtcNewScene(owner) for _ in range(max(1, -(-len(team) // ROBOTS)))]
        # What rays see that do not see a robot, in each of these scenes; the last of all sees all.
        self._seen = np.full(
            (len(self._tops), int(team.max(initial=-1)) + 2), _EVERY_BIT, np.uint32
        )
        for place, robot in enumerate(team.tolist()):
            self._seen[place // ROBOTS, robot] ^= np.uint32(1 << place % ROBOTS)
        ranks = np.where(robots < 0, -1, np.searchsorted(team, robots)).tolist()
        weakref.finalize(self, _release, embree, self._tops).atexit = False
        self._instances: list[int | None] = []
        for scene, body, rank in zip(scenes, bodies.tolist(), ranks, strict=True):
            if scene is None:
                self._instances.append(None)
                continue
            top = self._tops[max(rank, 0) // ROBOTS]
            instance = embree.rtcNewGeometry(owner, _INSTANCE)
            embree.rtcSetGeometryInstancedScene(instance, handle(scene))
            embree.rtcSetGeometryMask(instance, _EVERY_BIT if rank < 0 else 1 << rank % ROBOTS)
            embree.rtcAttachGeometryByID(top, instance, body)
            embree.rtcReleaseGeometry(instance)  # from now on the scene keeps it
            self._instances.append(instance)
        self.move(turns, places)

    def move(self, turns: Array, places: Array) -> None:
        """Place the same bodies anew, see `__init__`; what stands still costs nothing."""
        shifted = (places - self._middle)[:, None]
        columns = np.concatenate([turns.transpose(0, 2, 1), shifted], axis=1)
        moved = np.flatnonzero((columns.astype(np.float32) != self._columns).any(axis=(1, 2)))
        self._columns[moved] = columns[moved]
        place, commit = self._embree.rtcSetGeometryTransform, self._embree.rtcCommitGeometry
        begin, step = self._columns.ctypes.data, self._columns.strides[0]
        for number in moved.tolist():
            if (instance := self._instances[number]) is not None:
                place(instance, 0, _COLUMNS_OF_FLOATS, begin + number * step)
                commit(instance)
        for top in self._tops:
            self._embree.rtcCommitScene(top)

    def first_met(
        self, origins: Array, directions: Array, reach: Array, hidden: Numbers
    ) -> Numbers:
        """The body (n,) that each ray meets first, -1 for none.

        Args:
            origins: (n, 3) m. directions: (n, 3) unit vectors.
            reach: (n,) how far the rays go, m.
            hidden: (n,) the robot, one of those placed, that each ray does not see; -1 for none.
        """
        intersect = self._embree.rtcIntersect16
        count = len(origins)
        packets = -(-count // _WIDTH)
        if len(self._room) < packets:  # the rows that stay zero are zero once and for all
            self._room = _aligned(packets)
        words = self._room[:packets]
        numbers = words.view(np.uint32)
        # Column by column: that is how Embree wants them. What fills up has a negative reach.
        rays = np.zeros((7, packets * _WIDTH), np.float32)
        np.subtract(origins.T, self._middle[:, None], out=rays[:3, :count], casting="same_kind")
        rays[3:6, :count] = directions.T
        rays[6] = -1.0
        np.add(reach, SLACK, out=rays[6, :count], casting="same_kind")
        lanes = rays.reshape(7, packets, _WIDTH).transpose(1, 0, 2)
        words[:, _ORIGIN], words[:, _DIRECTION] = lanes[:, :3], lanes[:, 3:6]
        words[:, _TFAR] = lanes[:, 6]
        numbers[:, _GEOMETRY : _INSTANCE_ID + 1] = _EVERY_BIT
        masks = np.zeros(packets * _WIDTH, np.uint32)
        begin, step, lanes_used = words.ctypes.data, words.strides[0], _ALL_LANES.ctypes.data
        for top, seen in zip(self._tops, self._seen, strict=True):
            masks[:count] = seen[hidden]
            numbers[:, _MASK] = masks.reshape(packets, _WIDTH)
            for packet in range(begin, begin + packets * step, step):
                intersect(lanes_used, top, packet, None)
        met = words.view(np.int32)[:, _INSTANCE_ID].reshape(-1)[:count]
        return met.astype(np.intp)


def _release(embree: ctypes.PyDLL, scenes: Sequence[int]) -> None:
    for scene in scenes:
        embree.rtcReleaseScene(scene)


def _aligned(packets: int) -> NDArray[np.float32]:
    """Room (p, rows, 16) of zeros for packets of rays that begins at a multiple of 64 bytes."""
    size = packets * _ROWS * _WIDTH * 4
    room = np.zeros(size + 64, np.uint8)
    begin = -room.ctypes.data % 64
    return room[begin : begin + size].view(np.float32).reshape(packets, _ROWS, _WIDTH)


_ALL_LANES = _aligned(1).view(np.int32)[0, 0]
_ALL_LANES[:] = -1
