"""Pictures of materials: whatever Pillow reads becomes PNG, of bounded size; holes in them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from PIL import Image

from usarsim_maps.build.cut_outs import Finish, Stencil, glass, opacities, stencil_of
from usarsim_maps.build.sheet import NameBook
from usarsim_maps.files import open_picture
from usarsim_maps.findings import Findings
from usarsim_maps.scene import NEUTRAL, Material
from usarsim_server.base.errors import MapImportError
from usarsim_server.base.files import is_regular

LARGEST = 2048
"""Pixels along the longer side of a picture."""


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
        source = material.image if material.image is not None else material.texture
        image = _open(material, source, findings)
        picture = None if image is None else _write(image.convert("RGB"), folder, written)
        stencil, clear = _holes(material, image, findings)
        r, g, b, a = (min(1.0, max(0.0, c)) for c in material.color)
        answer[name] = Finish(book.take(name or "plain"), (r, g, b, a * clear), picture, stencil)
    return answer


def _open(
    material: Material, source: Path | bytes | None, findings: Findings
) -> Image.Image | None:
    """A picture of a material, made small; None, and a finding, if it cannot be had."""
    if source is None:
        return None
    if isinstance(source, Path) and not is_regular(source):
        findings.missing("texture", source.name)
        return None
    try:
        with open_picture(source, material.name) as image:
            image.draft("RGB", (LARGEST, LARGEST))
            image.thumbnail((LARGEST, LARGEST))
            return image.copy()
    except MapImportError as error:
        findings.warn(str(material.texture or material.name), f"{error}; left out")
        return None


def _holes(
    material: Material, own: Image.Image | None, findings: Findings
) -> tuple[Stencil | None, float]:
    """Where a material has holes, and a factor for its opacity elsewhere."""
    opacity = material.opacity
    if opacity is None:
        return None, 1.0
    picture = own if opacity.picture is None else _open(material, opacity.picture, findings)
    values = None if picture is None else opacities(picture, opacity)
    if values is None:
        return None, 1.0
    clear = glass(values) if opacity.blend else None
    if clear is not None:
        return None, clear
    there = values >= opacity.cutoff
    if there.all() or not there.any():
        if not there.any():
            findings.warn(material.name, "its picture is wholly clear: it was left opaque")
        return None, 1.0
    found = stencil_of(there, material.repeat)
    if found is None:
        share = 100.0 * (1.0 - float(there.mean()))
        text = f"holes of its picture ({share:.0f} %) are too fine to be cut: cameras and lasers "
        findings.warn(material.name, text + "see no hole")
    return found, 1.0


def _write(image: Image.Image, folder: Path, written: dict[str, str]) -> str:
    pixels = image.tobytes()
    digest = hashlib.sha256(str(image.size).encode() + pixels).hexdigest()[:16]
    if digest not in written:
        folder.mkdir(parents=True, exist_ok=True)
        written[digest] = f"{digest}.png"
        image.save(folder / written[digest], optimize=False, compress_level=4)
    return written[digest]
