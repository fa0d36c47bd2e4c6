"""Packages of meshes, opened when a map names one of theirs."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from usarsim_maps.files import read_bytes
from usarsim_maps.scene import Mesh
from usarsim_maps.unreal.archive import PackageError
from usarsim_maps.unreal.meshes import read_mesh
from usarsim_maps.unreal.package import AGAIN, MAX_PACKAGE, Export, Package, open_package
from usarsim_server.errors import MapImportError, at

EXTENSIONS = (".upk", ".udk", ".u")
"""Of packages that may hold meshes."""


def as_error(source: Path, error: PackageError, where: str = "") -> MapImportError:
    """The error for a user."""
    place = where if error.offset is None else f"{where} byte {error.offset}".strip()
    return MapImportError(at(source, str(error), error.cure or AGAIN, where=place))


def load_package(source: Path) -> Package:
    """Open a package file.

    Raises:
        MapImportError: it cannot be used.
    """
    try:
        return open_package(read_bytes(source, MAX_PACKAGE))
    except PackageError as error:
        raise as_error(source, error) from None


@dataclass(slots=True)
class MeshPackage:
    """The static meshes of one package, by the paths that maps name them with.

    Attributes:
        package: that holds them.
        name: the package's own, the first part of the paths of its materials.
        scale: Unreal units per metre.
    """

    package: Package
    name: str
    scale: float
    _meshes: dict[int, Mesh | str] = field(default_factory=dict)

    def find(self, path: str) -> Export | None:
        """A mesh by `Group.Name`, or by its last part if only one has it."""
        wanted = path.lower()
        meshes = list(self.package.of_class("StaticMesh"))
        for export in meshes:
            if self.package.path(export.number + 1).lower() == wanted:
                return export
        last = wanted.rpartition(".")[2]
        same = [export for export in meshes if export.name.lower() == last]
        return same[0] if len(same) == 1 else None

    def read(self, export: Export, name: str) -> Mesh | str:
        """A mesh, the same one every time, or why it cannot be read."""
        known = self._meshes.get(export.number)
        if known is None:
            try:
                known = self._with_paths(read_mesh(self.package, export, name, self.scale))
            except PackageError as error:
                known = str(error)
            self._meshes[export.number] = known
        return known

    def _with_paths(self, mesh: Mesh) -> Mesh:
        """Materials of this package get its name in front, as other packages know them."""
        own = {self.package.path(e.number + 1) for e in self.package.exports}
        names = tuple(f"{self.name}.{m}" if m in own and m else m for m in mesh.materials)
        return Mesh(
            mesh.name, mesh.vertices, mesh.triangles, mesh.uvs, mesh.slots, names, mesh.hulls
        )
