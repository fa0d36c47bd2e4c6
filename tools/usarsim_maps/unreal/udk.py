"""Reads maps and mesh packages of UDK as its editor saves them (worlds reference 5).

What the properties and components of the actors of a level say becomes a scene.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Brush, BrushOperation, Mesh, Part, Polygon, Scene
from usarsim_maps.units import (
    affine,
    matrix_of_pose,
    pose_of_matrix,
    unreal_matrix,
    unreal_points,
)
from usarsim_maps.unreal.archive import TAG, PackageError
from usarsim_maps.unreal.brushes import (
    Face,
    agreement,
    faces_of_model,
    read_built_level,
)
from usarsim_maps.unreal.level import (
    OPERATIONS,
    PLACEHOLDER,
    TEXTURE_SIZE,
    Actor,
    UnrealLevel,
    collision_of,
    component_matrix,
    draw_scale,
    light,
    solidity_of,
    world_polygon,
)
from usarsim_maps.unreal.library import MeshPackage, as_error, load_package
from usarsim_maps.unreal.names import ActorKind, kind_of
from usarsim_maps.unreal.package import Export, Package
from usarsim_maps.unreal.properties import Properties, read_object
from usarsim_server.base.errors import MapImportError, at

ESSENTIAL = {ActorKind.BRUSH, ActorKind.START}
"""A map whose walls or starts cannot be read is refused; without a lamp it can be used."""

MAX_SUBLEVELS = 100

MAPS = (".udk", ".ut3", ".umap")
"""Extensions of maps, in the order in which sublevels are searched."""

ENOUGH = 0.98
"""Part of the points that brushes and the built level have to agree about."""

MESH_COMPONENTS = {"staticmeshcomponent", "instancedstaticmeshcomponent"}
MAX_COMPONENTS = 1_000


@register("udk")
class UdkReader(Reader):
    """Levels; packages of static meshes, which are laid out side by side.

    Files of other generations of the engine are taken, too, to say what helps with them.
    """

    title = "Unreal UDK package"
    extensions = (".udk", ".upk", ".ut3", ".umap", ".uasset", ".ut2", ".unr", ".usx")
    meshes = False  # they are found by package and name, not by the name of the file

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """It begins with the tag of packages, in either order of bytes."""
        return head[:4] in (TAG.to_bytes(4, "little"), TAG.to_bytes(4, "big"))

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`; an error names the byte (worlds 72)."""
        package = load_package(source)
        main = level_of(package)
        level = _Level(source, context, self.title)
        try:
            return level.catalogue(package) if main is None else level.whole(package, main)
        except PackageError as error:
            raise as_error(source, error) from None


class _Level(UnrealLevel):
    """A level with those that it loads, or what stands for one."""

    def catalogue(self, package: Package) -> Scene:
        """The meshes of a package without a level."""
        count = LevelReader(package, self.source, self).add_catalogue()
        if not count:
            cure = "import a map; folders of packages go to --assets"
            problem = "a package without a level and without static meshes"
            raise MapImportError(at(self.source, problem, cure))
        text = f"no level: its {count} meshes stand side by side; --assets is for these"
        self.findings.warn(self.source.name, text)
        return self.scene()

    def whole(self, package: Package, main: Export) -> Scene:
        """A level, its sublevels, and whether its brushes give what the editor has built."""
        self.whole_map = True
        reader = LevelReader(package, self.source, self)
        reader.add_all(main)
        own = len(self.brushes)
        self._add_sublevels(reader.sublevels)
        try:
            built = read_built_level(package, main)
        except PackageError as error:
            self.findings.warn("level", f"what the editor built cannot be read: {error}")
            built = None
        if built is None:
            return self.scene()
        same, asked = agreement(self.brushes[:own], built, self.scale)
        if asked:
            self.findings.fact("brushes and built level", f"agree at {same} of {asked} points")
        if same < ENOUGH * asked:
            self.findings.warn(
                "level",
                f"brushes and the geometry that was built from them agree at {same} of "
                f"{asked} points only; rebuild the geometry in the editor and look again",
            )
        return replace(self.scene(), filled=not built.outside)

    def _add_sublevels(self, names: list[str]) -> None:
        """Levels that the map loads at run time, and those that they load."""
        seen = {self.source.stem.lower()}
        todo = list(names)
        while todo and len(seen) <= MAX_SUBLEVELS:
            name = todo.pop(0)
            if name.lower() in seen:
                continue
            seen.add(name.lower())
            path = self.library.index.find(name, MAPS)
            if path is None or path.suffix.lower() not in MAPS:
                self.findings.missing("sublevel", name)
                continue
            try:
                package = load_package(path)
                inner = level_of(package)
                if inner is not None:
                    reader = LevelReader(package, path, self, main=False)
                    reader.add_all(inner)
                    self.files.append(path)
                    todo += reader.sublevels
            except (MapImportError, PackageError) as error:
                self.findings.warn(name, f"the sublevel was left out: {error}")


def level_of(package: Package) -> Export | None:
    """The level of a package; None if it is none of maps."""
    return next(package.of_class("Level"), None)


def actors_of(package: Package, level: Export) -> list[Export]:
    """Actors in the order of the level, which is that of the brushes, each once."""
    archive = read_object(package, level)[1]
    archive.skip(4)  # owner
    indices = archive.i32s(archive.count(4, "actors"))
    found = dict.fromkeys(index for index in indices if index > 0)
    return [export for export in map(package.export, found) if export is not None]


class LevelReader:
    """Takes the actors of one package into a level.

    Attributes:
        sublevels: packages that the level loads, as far as they have been met.
    """

    def __init__(
        self, package: Package, source: Path, level: UnrealLevel, *, main: bool = True
    ) -> None:
        """The file's name is that of the package; `main` is false for sublevels."""
        self.sublevels: list[str] = []
        self._main = main
        self._brushes: list[Brush] = []
        self._package = package
        self._level = level
        self._findings = level.findings
        self._own = MeshPackage(package, source.stem, level.scale)
        self._add: dict[ActorKind, Callable[[Export, Properties], None]] = {
            ActorKind.BRUSH: self._add_brush,
            ActorKind.MESH: self._add_object,
            ActorKind.MOVABLE: partial(self._add_object, movable=True),
            ActorKind.LIGHT: self._add_light,
            ActorKind.FOG: self._add_fog,
            ActorKind.LEVEL: self._add_level,
        }

    def add_all(self, level: Export) -> None:
        """All actors of the level.

        Raises:
            PackageError: the list of actors, a brush or a start cannot be read.
        """
        actors = actors_of(self._package, level)
        for number, export in enumerate(actors):
            if number % 200 == 0:
                self._level.context.progress("actors", number / len(actors))
            self._add_actor(export)
        if not self._main and any(b.operation is BrushOperation.SUBTRACT for b in self._brushes):
            text = "its brushes cut holes, which would reach into other levels; left out"
            self._findings.warn(self._own.name, f"{text}: import this sublevel on its own")
            return
        self._level.brushes += self._brushes

    def add_catalogue(self, gap: float = 0.5) -> int:
        """All meshes of a package without a level, side by side; their number."""
        place = 0.0
        count = 0
        for export in self._package.of_class("StaticMesh"):
            mesh = self._read_mesh(export)
            if mesh is None:
                continue
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            matrix = affine(offset=(-low[0], place - low[1], -low[2]))
            place += float(high[1] - low[1]) + gap
            pose = pose_of_matrix(matrix)
            actor = Actor(export.name, "StaticMesh", "", pose)
            self._level.add_object(actor, matrix, [Part(mesh, matrix)])
            self._findings.count("StaticMesh")
            count += 1
        return count

    def _add_actor(self, export: Export) -> None:
        actor_class = self._package.class_of(export)
        kind = kind_of(actor_class)
        if kind not in self._add and kind not in UnrealLevel.PLAIN:
            self._findings.skip(actor_class)
            return
        self._findings.count(actor_class)
        try:
            properties = read_object(self._package, export)[0]
            if kind in self._add:
                self._add[kind](export, properties)
            else:
                self._level.add_actor(kind, self._actor(export, properties))
        except PackageError as error:
            if kind in ESSENTIAL:
                problem = f"{export.name}: {error}"
                raise PackageError(problem, error.offset, error.cure) from None
            self._findings.warn(export.name, f"left out, for it cannot be read: {error}")

    def _actor(self, export: Export, properties: Properties) -> Actor:
        kind = self._package.class_of(export)
        return Actor.of(export.name, kind, properties, self._level.scale)

    # ---- solids ----------------------------------------------------------------------------

    def _add_brush(self, export: Export, properties: Properties) -> None:
        operation = OPERATIONS.get(properties.text("csgoper").lower())
        if operation is None:  # the builder brush, which is a tool (worlds 17)
            return
        model = self._package.export(properties.reference("brush"))
        if model is None:
            raise PackageError("a brush without a model", export.offset)
        faces, broken = faces_of_model(self._package, model)
        if broken:
            self._findings.warn(export.name, f"{broken} broken polygons were left out")
        if not faces:
            self._findings.warn(export.name, "a brush without polygons was left out")
            return
        flags = int(properties.number("polyflags", 0.0))
        common = -1
        for face in faces:
            common &= face.flags
        flags |= common
        solidity = solidity_of(flags, operation)
        if solidity is None:
            return
        matrix = self._matrix(properties)
        polygons = tuple(self._polygon(face, matrix) for face in faces)
        tag = properties.text("tag")
        self._brushes.append(Brush(export.name, polygons, operation, solidity, tag))

    def _polygon(self, face: Face, matrix: Array) -> Polygon:
        points = unreal_points(face.points, self._level.scale)
        axes = np.column_stack([face.u, face.v])
        with np.errstate(all="ignore"):
            uvs = (face.points - face.base) @ axes / TEXTURE_SIZE * [1.0, -1.0]
        return world_polygon(points, uvs, self._package.path(face.material), matrix)

    def _add_object(self, export: Export, properties: Properties, movable: bool = False) -> None:
        matrix = self._matrix(properties)
        hidden = properties.flag("bhidden", False)
        parts: list[Part] = []
        for component in self._components(export, properties):
            path = component.reference("staticmesh")
            if path == 0:
                continue
            mesh = self._mesh(path)
            if mesh is not None:
                parts.append(
                    Part(
                        mesh,
                        matrix @ component_matrix(component, self._level.scale),
                        visible=not hidden and not component.flag("hiddengame", False),
                        collision=collision_of(properties, component),
                        materials=self._overrides(component),
                    )
                )
            elif self._level.context.options.placeholders:
                parts.append(Part(PLACEHOLDER, matrix_of_pose(pose_of_matrix(matrix))))
        self._level.add_object(self._actor(export, properties), matrix, parts, movable)

    def _components(self, export: Export, properties: Properties) -> list[Properties]:
        """Mesh components of an actor: those it names, else those that lie in it."""
        indices = [properties.reference("staticmeshcomponent")]
        indices += properties.references("components")
        chosen = dict.fromkeys(index for index in indices if index > 0)
        if not chosen:
            chosen = dict.fromkeys(other.number + 1 for other in self._package.inside(export))
        answer = []
        for found in map(self._package.export, list(chosen)[:MAX_COMPONENTS]):
            if found and self._package.class_of(found).lower() in MESH_COMPONENTS:
                answer.append(read_object(self._package, found)[0])
        return answer

    def _mesh(self, index: int) -> Mesh | None:
        """A mesh of this package, or of others in the asset folders."""
        export = self._package.export(index)
        if export is not None:
            return self._read_mesh(export)
        return self._level.library.mesh(self._package.path(index))

    def _read_mesh(self, export: Export) -> Mesh | None:
        name = self._package.path(export.number + 1)
        found = self._own.read(export, name)
        if isinstance(found, Mesh):
            return found
        self._findings.warn(name, f"the mesh was left out: {found}")
        return None

    def _matrix(self, properties: Properties) -> Array:
        return unreal_matrix(
            properties.vector("location"),
            properties.rotator("rotation"),
            draw_scale(properties),
            properties.vector("prepivot"),
            self._level.scale,
        )

    def _overrides(self, component: Properties) -> dict[int, str]:
        paths = enumerate(map(self._package.path, component.references("materials")))
        return {slot: path for slot, path in paths if path and slot < 256}

    # ---- light, air, the level itself ------------------------------------------------------

    def _add_light(self, export: Export, properties: Properties) -> None:
        actor = self._actor(export, properties)
        component = self._component(properties, "lightcomponent")
        self._level.lights.append(
            light(
                actor.name,
                actor.kind.lower(),
                actor.pose,
                self._level.scale,
                radius=max(0.0, component.number("radius", 0.0)),
                brightness=component.number("brightness", 0.0),
                color=component.color("lightcolor") or (1.0, 1.0, 1.0),
                cone=component.number("outerconeangle", 0.0),
            )
        )

    def _add_fog(self, export: Export, properties: Properties) -> None:
        component = self._component(properties, "component")
        density = component.number("fogdensity", component.number("density", 0.0))
        self._level.add_fog(self._actor(export, properties), density)

    def _add_level(self, export: Export, properties: Properties) -> None:
        self._level.add_info(properties)
        for index in properties.references("streaminglevels"):
            streaming = self._package.export(index)
            if streaming is not None:
                name = read_object(self._package, streaming)[0].text("packagename")
                self.sublevels += [name] if name else []

    def _component(self, properties: Properties, name: str) -> Properties:
        export = self._package.export(properties.reference(name))
        if export is None:
            return Properties(self._package)
        return read_object(self._package, export)[0]
