"""The client's reader of the scene port, without sockets."""

from __future__ import annotations

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_client import Poses, Present, ProtocolError, Scene, SceneReader
from usarsim_server.protocol.scene import message, pose_frame

THING = {
    "id": 4,
    "what": "robot",
    "name": "R1",
    "class": "P3AT",
    "kind": "P3AT",
    "first": 1,
    "stuck": True,
}
STREAM = b"".join(
    [
        message({"type": "mesh", "id": "m:1", "vertices": "", "faces": ""}),
        message({"type": "scene", "world": "yard", "still": [], "bodies": [{"name": "door"}]}),
        message({"type": "kind", "id": "P3AT", "bodies": []}),
        message({"type": "present", "generation": 2, "time": 1.0, "count": 2, "things": [THING]}),
        pose_frame(1.5, 2, np.arange(14, dtype=np.float32).reshape(2, 7)),
        struct.pack(">IB", 3, ord("Z")) + b"??",
        message({"type": "reply", "id": 7, "ok": True}),
    ]
)


@given(st.sets(st.integers(0, len(STREAM))))
def test_values_come_out_however_the_bytes_are_cut(cuts: set[int]) -> None:
    """Typed values in order; frames of unknown kinds are skipped; what is referred to is kept."""
    reader, found, begun = SceneReader(), [], 0
    for cut in (*sorted(cuts), len(STREAM)):
        found += reader.feed(STREAM[begun:cut])
        begun = cut
    mesh, scene, kind, present, poses, reply = found
    assert isinstance(scene, Scene)
    assert isinstance(present, Present)
    assert isinstance(poses, Poses)
    assert (scene.world, scene.bodies[0]["name"]) == ("yard", "door")
    assert (mesh, kind) == (reader.meshes["m:1"], reader.kinds["P3AT"])
    assert reply == {"type": "reply", "id": 7, "ok": True}
    robot = present.find("r1")
    assert robot is not None
    assert (robot.id, robot.class_name, robot.lit, robot.stuck) == (4, "P3AT", False, True)
    assert (poses.time, poses.generation) == (1.5, 2)
    row = poses.of(robot)
    assert row is not None
    assert row.tolist() == list(range(7, 14))
    assert poses.of(present.find("R2")) is None


@given(st.binary(max_size=200), st.integers(0, 60), st.sampled_from([b"J", b"P", b"?"]))
def test_any_bytes_are_read_or_refused(payload: bytes, length: int, kind: bytes) -> None:
    """CON-29: nothing but `ProtocolError`."""
    with contextlib.suppress(ProtocolError):
        SceneReader().feed(struct.pack(">Ic", length, kind) + payload)


@pytest.mark.parametrize(
    "data",
    [
        b"NFO {Gametype BotDeathMatch}\r\n",
        struct.pack(">Ic", 0, b"J"),
        struct.pack(">Ic", 3, b"J") + b"{}",
        struct.pack(">Ic", 3, b"J") + b"[]",
        message({"type": "present", "generation": 1}),
        struct.pack(">Ic", 17, b"P") + struct.pack("<dII", 0.0, 0, 5),
    ],
)
def test_what_is_no_scene_port_is_told(data: bytes) -> None:
    """Another service, no type, keys that are missing, fewer poses than said."""
    with pytest.raises(ProtocolError, match="scene port"):
        SceneReader().feed(data)
