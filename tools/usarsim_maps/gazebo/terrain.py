"""Height maps of SDF: a grey picture whose brightest point is as high as the size says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.gazebo.files import GazeboFiles
from usarsim_maps.gazebo.frames import matrix_from
from usarsim_maps.gazebo.looks import Looks
from usarsim_maps.gazebo.models import Link
from usarsim_maps.meshes.mesh_files import Pictures
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.scene import Heightfield, Material
from usarsim_maps.textures import open_picture
from usarsim_maps.units import pose_of_matrix
from usarsim_server.errors import MapImportError

Array = NDArray[np.float64]

LARGEST = 1025
"""Rows and columns; larger pictures are reduced."""


@dataclass(slots=True)
class Terrain:
    """Reads height maps.

    Attributes:
        files: finds pictures.
        looks: takes materials.
        unit: metres per unit of the world.
    """

    files: GazeboFiles
    looks: Looks
    unit: float

    def fields(self, link: Link, matrix: Array, name: str) -> list[Heightfield]:
        """The terrain of a link, once even if it is seen and felt.

        Args:
            link: perhaps with a height map.
            matrix: (4, 4) of the link in the world.
            name: of the model.
        """
        for owner in (*link.node.all("collision"), *link.node.all("visual")):
            node = owner.child("geometry", "heightmap")
            if node is not None:
                placed = matrix @ matrix_from(link.document, owner.child("pose"), self.unit)
                field = self._field(link.document, node, placed, name)
                return [] if field is None else [field]
        return []

    def _field(
        self, document: Document, node: Node, matrix: Array, name: str
    ) -> Heightfield | None:
        findings = self.files.context.findings
        uri = node.word("uri")
        path = self.files.file(uri, document.path)
        if path is None:
            findings.missing("file", uri[:200])
            return None
        rows = self._rows(path)
        if rows is None:
            return None
        size = self._numbers(document, node.child("size"), 1.0)
        middle = self._numbers(document, node.child("pos"), 0.0)
        if not (size[:2] > 0.0).all():
            document.note(node, f"a height map of {size[0]:g} by {size[1]:g} m was left out")
            return None
        corner = np.eye(4)
        corner[:3, 3] = middle - [size[0] / 2.0, size[1] / 2.0, 0.0]
        return Heightfield(
            name=name,
            heights=rows * size[2],
            spacing=(float(size[0] / (rows.shape[1] - 1)), float(size[1] / (rows.shape[0] - 1))),
            pose=pose_of_matrix(matrix @ corner),
            material=self._material(document, node),
        )

    def _numbers(self, document: Document, node: Node | None, default: float) -> Array:
        values = document.vector(node, 3)
        answer: Array = (np.full(3, default) if values is None else values) * self.unit
        return answer

    def _rows(self, path: Path) -> Array | None:
        """Heights from 0 to 1; the first row is at the lowest y, the lower edge of the picture."""
        findings = self.files.context.findings
        try:
            with open_picture(path, path.name) as image:
                deep = image.mode.startswith(("I", "F"))
                grey = image.convert("F") if deep else image.convert("L").convert("F")
                if max(grey.size) > LARGEST:
                    findings.warn(path.name, f"the terrain was reduced to {LARGEST} points a side")
                    grey.thumbnail((LARGEST, LARGEST))
                rows = np.array(grey, dtype=float)[::-1]
        except MapImportError as error:
            findings.warn(path.name, str(error))
            return None
        if min(rows.shape) < 2:
            findings.warn(path.name, "a height map needs two pixels each way")
            return None
        answer: Array = np.nan_to_num(rows) / max(float(np.nan_to_num(rows).max()), 1e-9)
        return answer

    def _material(self, document: Document, node: Node) -> str:
        picture = node.word("texture", "diffuse")
        if not picture:
            return ""
        found = self.files.file(picture, document.path)
        if found is None:
            found = Pictures(document.path, self.files.context).find(picture)
        return self.looks.add(Material(Path(picture).stem, (1.0, 1.0, 1.0, 1.0), found))
