"""Meshes, textures and numbers as the messages of the scene port have them (docs/scene-port.md)."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable

import mujoco
import numpy as np
from numpy.typing import NDArray

Message = dict[str, object]

DIGITS = 5
"""Decimals of numbers: 10 micrometres."""
LARGEST_TEXTURE = 1024
"""Pixels of a side; larger pictures are made smaller."""
PNG_BYTES = 32 * 1024
"""A picture that takes more as PNG is sent as JPEG."""
TEXTURE_BYTES = 8 * 1024 * 1024
"""Of all pictures of one scene or kind; what is beyond is sent as its mean colour only."""
_JPEG_QUALITY = 85


def mesh(model: mujoco.MjModel, number: int) -> tuple[str, Message]:
    """Id and `mesh` message of a mesh, with one list of corners, as graphics cards want it."""
    faces = slice(
        model.mesh_faceadr[number], model.mesh_faceadr[number] + model.mesh_facenum[number]
    )
    corners = model.mesh_face[faces].ravel().astype(np.int64)
    turned = model.mesh_facenormal[faces].ravel().astype(np.int64)
    coords = int(model.mesh_texcoordadr[number])
    placed = model.mesh_facetexcoord[faces].ravel().astype(np.int64) if coords >= 0 else 0 * corners
    spans = int(turned.max()) + 1, int(placed.max()) + 1
    keys, chosen = np.unique((corners * spans[0] + turned) * spans[1] + placed, return_inverse=True)
    rest, place = np.divmod(keys, spans[1])
    corner, normal = np.divmod(rest, spans[0])
    vertices = model.mesh_vert[model.mesh_vertadr[number] + corner]
    normals = model.mesh_normal[model.mesh_normaladr[number] + normal]
    found = {
        "vertices": _packed(vertices, "<f4"),
        "faces": _packed(chosen, "<u2" if len(keys) <= 1 << 16 else "<u4"),
        "normals": _packed(np.round(127.0 * normals), "i1"),
    }
    if coords >= 0:
        found["uv"] = _packed(model.mesh_texcoord[coords + place], "<f4")
    return _named(found)


def hfield(model: mujoco.MjModel, number: int) -> tuple[str, Message]:
    """The same of ground of heights; what is below its surface is left out."""
    rows, columns = int(model.hfield_nrow[number]), int(model.hfield_ncol[number])
    start = int(model.hfield_adr[number])
    x, y, top, _ = model.hfield_size[number].tolist()
    height = model.hfield_data[start : start + rows * columns] * top
    across = np.tile(np.linspace(-x, x, columns), rows)
    along = np.repeat(np.linspace(-y, y, rows), columns)
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, up = first + 1, first + columns
    faces = np.stack([first, right, up + 1, first, up + 1, up], axis=1)
    return _named(
        {
            "vertices": _packed(np.stack([across, along, height], axis=1), "<f4"),
            "faces": _packed(faces, "<u2" if rows * columns <= 1 << 16 else "<u4"),
        }
    )


def texture(model: mujoco.MjModel, number: int, room: int) -> tuple[str, Message, int]:
    """Id and `texture` message of a texture, and the bytes of its picture.

    Args:
        model: with the texture.
        number: of the texture.
        room: bytes that the picture may have; a larger one is left out.
    """
    height, width = int(model.tex_height[number]), int(model.tex_width[number])
    channels, start = int(model.tex_nchannel[number]), int(model.tex_adr[number])
    raw = model.tex_data[start : start + height * width * channels]
    image = np.asarray(raw).reshape(height, width, channels)
    cube = bool(model.tex_type[number] != mujoco.mjtTexture.mjTEXTURE_2D)
    name = "t:" + hashlib.blake2b(image.tobytes(), digest_size=8).hexdigest()
    data, kind, size = _picture(image, cube=cube)
    mean = image.reshape(-1, channels).mean(axis=0)[:3] / 255.0
    message: Message = {
        "type": "texture",
        "id": name,
        "shape": "cube" if cube else "2d",
        "width": size[0],
        "height": size[1],
        "mean": vector(np.resize(mean, 3), 3),
    }
    if len(data) > room:
        return name, message, 0
    return name, message | {"format": kind, "data": base64.b64encode(data).decode()}, len(data)


def _picture(image: NDArray[np.uint8], *, cube: bool) -> tuple[bytes, str, tuple[int, int]]:
    """An encoded picture, its format, and its width and height."""
    import cv2  # 16 MiB, for servers whose textures somebody takes

    largest = max(image.shape[1], 0 if cube else image.shape[0])
    if largest > LARGEST_TEXTURE:
        shrink = LARGEST_TEXTURE / largest
        size = max(1, round(image.shape[1] * shrink)), max(1, round(image.shape[0] * shrink))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
        image = image.reshape(size[1], size[0], -1)
    channels = image.shape[2]
    # OpenCV has blue first.
    pixels = np.ascontiguousarray(image[..., [2, 1, 0, 3][:channels]] if channels > 2 else image)
    data, kind = cv2.imencode(".png", pixels)[1].tobytes(), "png"
    if len(data) > PNG_BYTES and channels != 4:
        quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        data, kind = cv2.imencode(".jpg", pixels, quality)[1].tobytes(), "jpeg"
    return data, kind, (image.shape[1], image.shape[0])


def scalar(value: float, digits: int = DIGITS) -> float:
    """A number, rounded; whole ones as such, which are shorter."""
    rounded = round(float(value), digits)
    return int(rounded) if rounded.is_integer() else rounded


def vector(values: Iterable[float], digits: int = DIGITS) -> list[float]:
    """Numbers, rounded."""
    return [scalar(value, digits) for value in values]


def _packed(values: NDArray[np.generic], kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode()


def _named(arrays: dict[str, str]) -> tuple[str, Message]:
    digest = hashlib.blake2b(digest_size=8)
    for key, value in arrays.items():
        digest.update(f"{key}={value};".encode())
    name = f"m:{digest.hexdigest()}"
    return name, {"type": "mesh", "id": name, **arrays}
