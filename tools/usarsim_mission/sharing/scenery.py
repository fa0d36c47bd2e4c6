"""The scenery of a run: shapes, looks and poses of all that is there when the trial begins.

The server tells it on its scene port (docs/scene-port.md); `scene.json.gz` of a run keeps it, so
that the run can be drawn later without a server. Truth rows then move robots and victims.
"""

from __future__ import annotations

import asyncio
import gzip
import json
import logging
import zlib
from pathlib import Path
from typing import Any

from usarsim_client import ProtocolError
from usarsim_client.scene import LiveScene, Poses, connect_scene
from usarsim_mission.errors import RunLogError
from usarsim_server.base.errors import at
from usarsim_server.base.files import read_regular, reason, write_bytes
from usarsim_server.protocol.json_text import parse_json

SCENERY = "scene.json.gz"
PATIENCE = 20.0
"""s of wall time that the server has to tell it."""
MOST = 256 << 20
"""Bytes of scenery that are believed."""
_TABLES = ("kinds", "meshes", "textures")
_log = logging.getLogger(__name__)


async def keep_scenery(folder: Path, time: float, host: str, port: int, token: str) -> None:
    """Write the scenery of a server into the folder of a run.

    A run is whole without it: if it cannot be had the log of the program says why, nothing else.

    Args:
        folder: of the run. time: simulated s from which on it counts: what the port tells first
            may be a little older. host, port, token: of the scene port.
    """
    try:
        async with asyncio.timeout(PATIENCE):
            live = await connect_scene(host, port, token=token)
            async with live:
                while (poses := await live.poses()).time < time - 1e-6:
                    pass
        write_bytes(folder / SCENERY, _packed(live, poses))
    except (OSError, ProtocolError, TimeoutError) as error:
        _log.warning("the scenery is not kept: %s", error)


def _packed(live: LiveScene, poses: Poses) -> bytes:
    """Equal scenery makes equal bytes: nothing of the connection is in it."""
    reader = live.reader
    assert reader.scene is not None
    assert reader.present is not None
    things = [
        {"what": one.what, "name": one.name, "kind": one.kind, "first": one.first, "lit": one.lit}
        for one in reader.present.things
    ]
    told = {
        "time": poses.time,
        "scene": reader.scene.message,
        "things": things,
        "poses": [round(float(one), 6) for one in poses.rows.reshape(-1)],
        **{name: dict(sorted(getattr(reader, name).items())) for name in _TABLES},
    }
    return gzip.compress(json.dumps(told, separators=(",", ":")).encode(), 6, mtime=0)


def read_scenery(folder: Path) -> dict[str, Any] | None:
    """The scenery of a run; None if none was kept.

    Returns:
        `time` (simulated s), `scene`, `kinds`, `meshes`, `textures` (messages of the scene port,
        the last three by id), `things` (robots, objects and avatars), `poses` (7 numbers a body).

    Raises:
        RunLogError: it is there, and cannot be read.
    """
    path = folder / SCENERY
    if not path.exists():
        return None
    cure = "take an unchanged copy, or remove the file: walls are then drawn from the map"
    try:
        unpacker = zlib.decompressobj(zlib.MAX_WBITS | 16)
        text = unpacker.decompress(read_regular(path, MOST), MOST)
        told = parse_json(text) if unpacker.eof else None
    except OSError as error:
        raise RunLogError(at(path, f"cannot be read: {reason(error)}", cure)) from error
    except (zlib.error, ValueError):
        told = None
    if not isinstance(told, dict) or not _is_whole(told):
        raise RunLogError(at(path, "is no scenery of a run", cure))
    return told


def _is_whole(told: dict[str, Any]) -> bool:
    tables = all(isinstance(told.get(key), dict) for key in ("scene", *_TABLES))
    lists = all(isinstance(told.get(key), list) for key in ("things", "poses"))
    return tables and lists and isinstance(told.get("time"), int | float)
