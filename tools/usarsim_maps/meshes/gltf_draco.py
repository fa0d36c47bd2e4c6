"""Meshes that Draco has compressed (KHR_draco_mesh_compression), by the library DracoPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.meshes.gltf_data import GltfFile, Item
from usarsim_maps.reader import need

__all__ = ["EXTENSION", "DracoPrimitive"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

EXTENSION = "KHR_draco_mesh_compression"

NONE = 1 << 31
"""An attribute that no buffer has."""


class DracoPrimitive:
    """What is in the compressed buffer of a primitive.

    Attributes:
        chain: (3 n,) vertex numbers of its triangles.
    """

    def __init__(self, file: GltfFile, primitive: Item) -> None:
        """Decompress it.

        Raises:
            MapImportError: DracoPy is not installed, or the buffer is damaged.
        """
        draco = need("DracoPy", file.path, "meshes compressed by Draco")
        self._file = file
        self._item = primitive.item("extensions").item(EXTENSION)
        view = self._item.index("bufferView", file.items("bufferViews"))
        if view is None:
            raise self._item.error("no buffer view")
        try:
            self._mesh = draco.decode(file.view(view))
            faces = np.asarray(self._mesh.faces, np.int64)
        except Exception as error:  # a library of C++ behind several layers: it says what it likes
            raise self._item.error(f"Draco cannot decompress it: {error}"[:200]) from None
        self.chain: Integers = faces.reshape(-1)

    def attribute(self, name: str, accessor: int) -> Array:
        """Values (n, width) of `POSITION` or another attribute, in the types of its accessor.

        Raises:
            MapImportError: the buffer has no such attribute.
        """
        number = self._item.item("attributes").number_of(name, NONE)
        found = self._mesh.get_attribute_by_unique_id(number)
        if found is None:
            raise self._item.error(f"attribute {number} ({name}) is not in the compressed buffer")
        values = np.asarray(found["data"])
        return self._file.as_accessor(accessor, values)
