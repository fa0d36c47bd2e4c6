"""Meshes and pictures that a map only names: found in asset folders, read, merged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from usarsim_maps.files import AssetIndex
from usarsim_maps.placing import matrix_of_pose
from usarsim_maps.reader import Context, read_scene, readers
from usarsim_maps.scene import Material, Mesh, Scene
from usarsim_maps.units import UU_PER_METRE
from usarsim_maps.unreal.library import EXTENSIONS, MeshPackage, load_package
from usarsim_server.errors import MapImportError

PICTURES = (".png", ".tga", ".dds", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff")
"""Extensions of pictures, in the order of preference."""

IN_MAP_UNITS = (".t3d", ".ase", ".obj", ".stl", ".ply", ".off", ".psk", ".pskx")
"""Mesh files that hold lengths in the units of the map they belong to."""


@dataclass(slots=True)
class AssetLibrary:
    """What a map's asset folders hold; every file is read once.

    Attributes:
        source: the map; its own folder is searched too.
        context: of the import.
        scale: units of the map per metre, for mesh files without units of their own.
        materials: of the meshes found so far, by name; the reader adds them to its scene.
        files: everything that was read.
    """

    source: Path
    context: Context
    scale: float | None = None
    materials: dict[str, Material] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)
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
        extensions = tuple(
            dict.fromkeys(
                ext for reader in readers().values() if reader.meshes for ext in reader.extensions
            )
        )
        candidates = [name, name.rpartition(".")[2]]
        for candidate in candidates:
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


def merge_meshes(scene: Scene, name: str) -> Mesh | None:
    """One mesh out of everything visible in a scene, hulls of the artist included.

    Parts that are solid and not visible become hulls. None if there is no mesh at all.
    """
    vertices, triangles, uvs, slots, hulls = [], [], [], [], []
    materials: dict[str, int] = {}
    count, textured = 0, False
    for thing in scene.objects:
        for part in thing.parts:
            mesh = part.shape
            if not isinstance(mesh, Mesh):
                continue
            matrix = matrix_of_pose(thing.pose) @ part.matrix
            linear, offset = matrix[:3, :3], matrix[:3, 3]
            if not part.visible:
                hulls.append(mesh.vertices @ linear.T + offset)
                continue
            hulls += [np.asarray(hull) @ linear.T + offset for hull in mesh.hulls]
            turned = -1 if np.linalg.det(linear) < 0.0 else 1
            vertices.append(mesh.vertices @ linear.T + offset)
            triangles.append(mesh.triangles[:, ::turned] + count)
            count += len(mesh.vertices)
            own = np.zeros((len(mesh.triangles), 3, 2)) if mesh.uvs is None else mesh.uvs
            textured |= mesh.uvs is not None
            uvs.append(own[:, ::turned])
            slots.append(_slots(mesh, part.materials, materials))
    if not vertices:
        return None
    return Mesh(
        name=name,
        vertices=np.concatenate(vertices),
        triangles=np.concatenate(triangles).astype(np.int32),
        uvs=np.concatenate(uvs) if textured else None,
        slots=np.concatenate(slots).astype(np.int32),
        materials=tuple(materials),
        hulls=tuple(hulls),
    )


def _slots(
    mesh: Mesh, other: Mapping[int, str], materials: dict[str, int]
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Slots of a mesh's triangles in a common list of materials."""
    names: Sequence[str] = mesh.materials or ("",)
    own = np.zeros(len(mesh.triangles), np.int64) if mesh.slots is None else mesh.slots
    renamed = [other.get(slot, name) for slot, name in enumerate(names)]
    table = np.array([materials.setdefault(name, len(materials)) for name in renamed])
    answer: np.ndarray[tuple[int], np.dtype[np.int64]] = table[np.clip(own, 0, len(table) - 1)]
    return answer
