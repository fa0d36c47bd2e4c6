"""Embree itself, behind the package `embreex`, which offers only part of it.

Where the library cannot be reached or is another one than expected, there is none (`library` is
None), and callers do with what `embreex` offers. All threads may ask; a scene does not change once
it is there.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from ctypes import c_int, c_size_t, c_ssize_t, c_uint, c_void_p
from functools import cache

import numpy as np
from embreex import rtcore, rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

_SIGNATURES = {
    "rtcGetDeviceProperty": (c_ssize_t, c_void_p, c_int),
    "rtcNewGeometry": (c_void_p, c_void_p, c_int),
    "rtcSetNewGeometryBuffer": (c_void_p, c_void_p, c_int, c_uint, c_int, c_size_t, c_size_t),
    "rtcSetGeometryMask": (None, c_void_p, c_uint),
    "rtcCommitGeometry": (None, c_void_p),
    "rtcAttachGeometryByID": (None, c_void_p, c_void_p, c_uint),
    "rtcReleaseGeometry": (None, c_void_p),
    "rtcCommitScene": (None, c_void_p),
    "rtcIntersect1": (None, c_void_p, c_void_p, c_void_p),
}
"""Result and arguments of what is called of Embree 4."""
_VERSION, _TRIANGLES, _EVERY_BIT = 0, 0, 0xFFFFFFFF
_CORNERS, _CORNERS_OF_FACES = (1, 0, 0x9003), (0, 0, 0x5003)
"""Kind, slot and format of a mesh's arrays: three floats each, three numbers of corners each."""


@cache
def device() -> rtcore.EmbreeDevice:
    """That of all scenes of the server."""
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
    return embree if version // 10000 == 4 else None


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
    _commit(embree)(handle(scene))


@cache
def _commit(embree: ctypes.PyDLL) -> Callable[[int | None], None]:
    """What builds the tree of a scene and leaves the interpreter to others meanwhile: one shape of
    a robot takes up to 40 ms."""
    return ctypes.CFUNCTYPE(None, c_void_p)(("rtcCommitScene", embree))
