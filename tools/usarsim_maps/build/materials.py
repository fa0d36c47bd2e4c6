"""Pictures of materials: whatever Pillow reads becomes PNG, of bounded size."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from usarsim_maps.build.sheet import NameBook
from usarsim_maps.files import open_picture
from usarsim_maps.findings import Findings
from usarsim_maps.scene import NEUTRAL, Color, Material
from usarsim_server.errors import MapImportError
from usarsim_server.files import is_regular

LARGEST = 2048
"""Pixels along the longer side of a picture."""


@dataclass(frozen=True, slots=True)
class Finish:
    """A material as it goes into the scene."""

    name: str  # unique and safe
    color: Color  # multiplies the picture
    picture: str | None  # file name below `textures/`, None without one


def finish_materials(
    materials: Mapping[str, Material], used: list[str], folder: Path, findings: Findings
) -> dict[str, Finish]:
    """Write the pictures of all used materials into a folder, each different picture once.

    Names that are used and unknown become neutral grey. The folder is made if there is something
    to put into it.
    """
    book = NameBook()
    written: dict[str, str] = {}
    answer: dict[str, Finish] = {}
    for name in used:
        material = materials.get(name)
        if material is None:
            material = Material(name, NEUTRAL)
        image = _open(material, findings)
        picture = None if image is None else _write(image, folder, written)
        r, g, b, a = (min(1.0, max(0.0, c)) for c in material.color)
        answer[name] = Finish(book.take(name or "plain"), (r, g, b, a), picture)
    return answer


def _open(material: Material, findings: Findings) -> Image.Image | None:
    source = material.image if material.image is not None else material.texture
    if source is None:
        return None
    if isinstance(source, Path) and not is_regular(source):
        findings.missing("texture", source.name)
        return None
    try:
        with open_picture(source, material.name) as image:
            image.draft("RGB", (LARGEST, LARGEST))
            image.thumbnail((LARGEST, LARGEST))
            return image.convert("RGB")
    except MapImportError as error:
        findings.warn(str(material.texture or material.name), f"{error}; left out")
        return None


def _write(image: Image.Image, folder: Path, written: dict[str, str]) -> str:
    pixels = image.tobytes()
    digest = hashlib.sha256(str(image.size).encode() + pixels).hexdigest()[:16]
    if digest not in written:
        folder.mkdir(parents=True, exist_ok=True)
        written[digest] = f"{digest}.png"
        image.save(folder / written[digest], optimize=False, compress_level=4)
    return written[digest]
