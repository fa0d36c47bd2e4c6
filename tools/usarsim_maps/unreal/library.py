"""Meshes and pictures that a level only names: found in asset folders and packages, read once."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from usarsim_maps.files import AssetIndex, read_bytes
from usarsim_maps.meshes.mesh_files import PICTURES
from usarsim_maps.meshes.polygons import merge_meshes
from usarsim_maps.reader import Context, mesh_extensions, read_scene
from usarsim_maps.scene import Material, Mesh
from usarsim_maps.units import UU_PER_METRE
from usarsim_maps.unreal.archive import PackageError
from usarsim_maps.unreal.meshes import read_mesh
from usarsim_maps.unreal.package import AGAIN, MAX_PACKAGE, Export, Package, open_package
from usarsim_server.base.errors import MapImportError, at

EXTENSIONS = (".upk", ".udk", ".u")
"""Of packages that may hold meshes."""

IN_MAP_UNITS = (".t3d", ".ase", ".fbx", ".obj", ".stl", ".ply", ".off", ".psk", ".pskx")
"""Mesh files that hold lengths in the units of the map they belong to, whatever they say: those of
FBX say centimetres and mean Unreal units."""


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
    """The static meshes of one package, by the paths that maps name them with."""

    package: Package  # that holds them
    name: str  # the package's own, the first part of the paths of its materials
    scale: float  # Unreal units per metre
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
        return replace(mesh, materials=names)


@dataclass(slots=True)
class AssetLibrary:
    """What a map's asset folders hold; every file is read once."""

    source: Path  # the map; its own folder is searched too
    context: Context  # of the import
    scale: float | None = None
    """Units of the map per metre, for mesh files without units of their own."""
    materials: dict[str, Material] = field(default_factory=dict)
    """Of the meshes found so far, by name; the reader adds them to its scene."""
    files: list[Path] = field(default_factory=list)  # everything that was read
    _index: AssetIndex | None = None
    _meshes: dict[str, Mesh | None] = field(default_factory=dict)
    _packages: dict[str, MeshPackage | None] = field(default_factory=dict)

    @property
    def index(self) -> AssetIndex:
        """Finds files by name."""
        if self._index is None:
            self._index = self.context.index(self.source)
        return self._index

    def picture(self, name: str) -> Path | None:
        """The picture of a material or texture, `Package.Group.Name` or a path."""
        found = self.index.find(name, PICTURES)
        if found is None or found.suffix.lower() not in PICTURES:
            found = self.index.find(name.rpartition(".")[2], PICTURES)
        if found is not None and found.suffix.lower() in PICTURES:
            self.files.append(found)
            return found
        return None

    def mesh(self, name: str) -> Mesh | None:
        """The mesh `Package.Group.Name`, or a path; None, and a finding, if there is none."""
        key = name.lower()
        if key not in self._meshes:
            self._meshes[key] = self._load(name)
        if self._meshes[key] is None:
            self.context.findings.missing("mesh", name)
        return self._meshes[key]

    def _load(self, name: str) -> Mesh | None:
        extensions = mesh_extensions()
        for candidate in (name, name.rpartition(".")[2]):
            path = self.index.find(candidate, extensions)
            if path is None or path.suffix.lower() not in extensions or path == self.source:
                continue
            mesh = self._read(path, name)
            if mesh is not None:
                return mesh
        return self._from_package(name)

    def _from_package(self, name: str) -> Mesh | None:
        """The mesh `Group.Name` of a UDK package, which is a file with the name in front."""
        word, _, inner = name.partition(".")
        if not inner or word.lower() == self.source.stem.lower():
            return None
        if word.lower() not in self._packages:
            self._packages[word.lower()] = self._open(word)
        package = self._packages[word.lower()]
        found = None if package is None else package.find(inner)
        if package is None or found is None:
            return None
        mesh = package.read(found, name)
        if isinstance(mesh, Mesh):
            return mesh
        self.context.findings.warn(name, f"cannot be read from its package: {mesh}")
        return None

    def _open(self, word: str) -> MeshPackage | None:
        path = self.index.find(word, EXTENSIONS)
        if path is None or path.suffix.lower() not in EXTENSIONS:
            return None
        try:
            package = MeshPackage(load_package(path), path.stem, self.scale or UU_PER_METRE)
        except MapImportError as error:
            self.context.findings.warn(path.name, str(error))
            return None
        self.files.append(path)
        return package

    def _read(self, path: Path, name: str) -> Mesh | None:
        options = self.context.options
        own = path.suffix.lower() not in IN_MAP_UNITS
        options = replace(options, scale=None if own else self.scale, mirror=False, up=None)
        try:
            scene = read_scene(path, replace(self.context, options=options))
        except MapImportError as error:
            self.context.findings.warn(path.name, str(error))
            return None
        self.files.append(path)
        self.files.extend(scene.source.files)
        for material in scene.materials.values():
            self.materials.setdefault(material.name, material)
        return merge_meshes(scene, name)
