"""Runs that are shared: a folder with scenery, and what a shared file holds, read again."""

from __future__ import annotations

import base64
import gzip
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whole_run import begin, play

SCENE: dict[str, Any] = {
    "time": 0.0,
    "scene": {
        "type": "scene",
        "world": "rooms",
        "lower": [0, 0, 0],
        "upper": [30, 10, 3],
        "materials": [{"rgba": [0.5, 0.5, 0.5, 1], "texture": "t:1"}],
        "still": [
            {
                "what": "world",
                "name": "",
                "geoms": [{"shape": "plane", "size": [15, 5], "pos": [15, 5, 0], "material": 0}],
            }
        ],
        "bodies": [],
    },
    "kinds": {
        "P3AT": {
            "materials": [{"rgba": [0.8, 0.1, 0.1, 1]}],
            "bodies": [
                {
                    "body": "base",
                    "geoms": [{"shape": "box", "size": [0.25, 0.2, 0.1], "material": 0}],
                },
                {"body": "wheel", "geoms": [{"shape": "sphere", "size": [0.1], "material": 0}]},
            ],
        }
    },
    "meshes": {},
    "textures": {"t:1": {"type": "texture", "id": "t:1", "shape": "2d", "mean": [0.4, 0.4, 0.4]}},
    "things": [{"what": "robot", "name": "R1", "kind": "P3AT", "first": 0, "lit": False}],
    "poses": [1.0, 1.0, 0.1, 1.0, 0.0, 0.0, 0.0, 1.2, 0.8, 0.1, 1.0, 0.0, 0.0, 0.0],
}
"""Three rooms with a robot of two bodies, as `scene.json.gz` keeps them."""


def furnished(folder: Path, scene: dict[str, Any] | None = None) -> Path:
    """The folder of a whole run with scenery."""
    run = begin(folder)
    run.tell("session", 0.0, team="Red herrings", robots=[{"name": "R1", "class": "P3AT"}])
    run.tell("connect", 0.0, page=1, role="operator", name="Ms Secret", on=True)
    run.tell("input", 0.0, page=1, text={"type": "select", "robot": "R1", "device": "gamepad"})
    run.tell("select", 0.0, page=1, robot="R1")
    play(run)
    run.tell("connect", 25.0, page=1, role="operator", name="Ms Secret", on=False)
    run.close()
    (folder / "scene.json.gz").write_bytes(gzip.compress(json.dumps(scene or SCENE).encode()))
    return folder


def unpacked(file: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Contents and arrays of a shared file."""
    found = re.search(r'id="run">([^<]*)<', file.read_text())
    assert found is not None
    return read_packed(base64.b64decode(found[1]))


def read_packed(packed: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Contents and arrays as they are packed."""
    data = gzip.decompress(packed)
    length = int.from_bytes(data[:4], "little")
    contents = json.loads(data[4 : 4 + length])
    at, arrays = 4 + length, {}
    for name, kind, count in contents["arrays"]:
        width = {"u1": 1, "i4": 4}[kind]
        array = np.frombuffer(data, f"<{kind}", count, at)
        arrays[name] = array if width == 1 else np.cumsum(array)
        at += -(-width * count // 4) * 4
    assert at == len(data)
    return contents, arrays
