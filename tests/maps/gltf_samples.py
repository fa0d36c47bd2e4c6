"""The wedge as glTF, as text and as bytes."""

from __future__ import annotations

import base64
import copy
import io
import json
import struct
from typing import Any

import numpy as np
from mesh_samples import FACES, WEDGE, upright
from PIL import Image

GLTF_POINTS = upright(WEDGE).astype("<f4").tobytes()
GLTF_UVS = np.array([[0, 0], [1, 0], [0, 1], [0.25, 0.5]]).astype("<f4").tobytes()
GLTF_INDICES = FACES.astype("<u2").tobytes()
GLTF_BLOB = GLTF_POINTS + GLTF_UVS + GLTF_INDICES


def png() -> bytes:
    """A red PNG."""
    stream = io.BytesIO()
    Image.new("RGB", (2, 2), (255, 0, 0)).save(stream, "PNG")
    return stream.getvalue()


def gltf(**changes: Any) -> dict[str, Any]:
    """The wedge as glTF; keywords replace or add members of the outermost object."""
    base = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "Wedge", "mesh": 0}],
        "meshes": [{"name": "wedge", "primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 48, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 80},
            {"buffer": 0, "byteOffset": 80, "byteLength": 24},
        ],
        "buffers": [{"byteLength": len(GLTF_BLOB),
            "uri": "data:application/octet-stream;base64," + base64.b64encode(GLTF_BLOB).decode()}],
    }  # fmt: skip
    return copy.deepcopy(base) | changes


def glb(value: dict[str, Any], blob: bytes = GLTF_BLOB) -> bytes:
    """The binary form."""
    value = copy.deepcopy(value)
    value["buffers"] = [{"byteLength": len(blob)}]
    text = json.dumps(value).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    body += struct.pack("<II", len(blob), 0x004E4942) + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
