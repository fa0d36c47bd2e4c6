"""Reads COLLADA 1.4 and 1.5 (`.dae`), tolerantly (worlds reference 7; items 43 to 47).

A material leads through its effect to a colour or a picture.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from usarsim_maps.meshes.collada_figures import ColladaFigure
from usarsim_maps.meshes.collada_mesh import ELEMENTS, ColladaGeometry, read_geometry
from usarsim_maps.meshes.mesh_files import (
    Axes,
    Pictures,
    SceneBuilder,
    axes_of,
)
from usarsim_maps.meshes.vertex_colors import WHITE, shaded
from usarsim_maps.meshes.xml_text import Document, Node, read_xml
from usarsim_maps.numbers import read_number, read_numbers
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import (
    Array,
    Color,
    LightKind,
    Material,
    Mesh,
    Opacity,
    Part,
    Scene,
    SceneObject,
)
from usarsim_maps.support import Support, SupportTable
from usarsim_maps.units import affine, axis_turn
from usarsim_server.base.errors import MapImportError

MAX_NODES = 100_000
"""Nodes that a scene shows; nodes that contain others twice could make billions."""

MAX_DEPTH = 200

MAX_SKELETONS = 20
"""Nodes in which the joints of one figure are looked for."""

FAR = 1e12
"""Larger numbers in nodes have no meaning."""

STEPS = {"matrix": 16, "translate": 3, "scale": 3, "rotate": 4, "lookat": 9}
"""Transformations of a node, and how many numbers each has."""

SHADERS = ("phong", "lambert", "blinn", "constant")
GREY: Color = (0.7, 0.7, 0.7, 1.0)

LUMINANCE = (0.212671, 0.715160, 0.072169)
"""Parts of red, green and blue in the brightness of a colour, as the specification has them."""


def read_materials(
    document: Document, ids: Mapping[str, Node], pictures: Pictures
) -> tuple[dict[str, Material], dict[str, str]]:
    """All materials by their names, and these by the ids that geometry binds to.

    A material is called by its `name` where no other one is, else by its id. One that makes no
    sense becomes neutral grey.
    """
    found = [
        node
        for library in document.root.all("library_materials")
        for node in library.all("material")
        if node.get("id") or node.get("name")
    ]
    count = Counter(word for node in found for word in {node.get("id"), node.get("name")} if word)
    materials, names = {}, {}
    for node in found:
        own, given = node.get("id"), node.get("name")
        name = given if given and (count[given] == 1 or not own) else own
        names[own or given] = name
        materials[name] = _material(name, node, ids, pictures)
    return materials, names


def _material(name: str, node: Node, ids: Mapping[str, Node], pictures: Pictures) -> Material:
    instance = node.child("instance_effect")
    effect = None if instance is None else ids.get(instance.get("url").removeprefix("#"))
    profile = None if effect is None else effect.child("profile_COMMON")
    technique = None if profile is None else profile.child("technique")
    if effect is None or profile is None or technique is None:
        return Material(name)
    shader = next((child for child in technique.children if child.tag in SHADERS), None)
    if shader is None:
        return Material(name)
    for child in (*effect.children, *shader.children):
        if ELEMENTS.get(child.tag) is Support.LEFT_OUT:
            pictures.context.findings.skip(child.tag, name)
    color = GREY
    look = shader.child("diffuse") or shader.child("emission")
    opacity = _opacity(shader)
    if look is None:
        return Material(name, (*color[:3], opacity))
    plain, texture = look.child("color"), look.child("texture")
    if plain is not None:
        color = _color(plain) or GREY
    if texture is None:
        # The specification gives the fourth number of a diffuse colour no meaning; some write zero.
        return Material(name, (*color[:3], opacity * (color[3] or 1.0)))
    places = [technique, profile, effect]
    image = _image(texture.get("texture"), places, ids)
    found = pictures.find(image) if image else None
    if found is None:
        return Material(name)
    holes = _holes(shader.child("transparent"), image, places, ids, pictures)
    return Material(name, (1.0, 1.0, 1.0, opacity), found, opacity=holes)


def _holes(
    transparent: Node | None,
    image: str,
    places: list[Node],
    ids: Mapping[str, Node],
    pictures: Pictures,
) -> Opacity | None:
    """Opacity by a picture, which is the one of the surface or another; None without one."""
    texture = None if transparent is None else transparent.child("texture")
    if transparent is None or texture is None:
        return None
    name = _image(texture.get("texture"), places, ids)
    mode = transparent.get("opaque", "A_ONE")
    picture = pictures.find(name) if name and name != image else None
    return Opacity(
        picture, blend=True, bright=mode.startswith("RGB"), inverse=mode.endswith("ZERO")
    )


def _color(node: Node) -> Color | None:
    values = _numbers(node)
    if len(values) < 3:
        return None
    r, g, b = (min(1.0, max(0.0, value)) for value in values[:3])
    return r, g, b, min(1.0, max(0.0, values[3])) if len(values) > 3 else 1.0


def _numbers(node: Node) -> list[float]:
    try:
        values = read_numbers(node.text, 1, 3, 4)
    except ValueError:
        return []
    return values if np.isfinite(values).all() else []


def _opacity(shader: Node) -> float:
    """Opacity by `transparent` times `transparency`, as COLLADA 1.5 defines its four modes.

    Without `transparent` it is `transparency`, and a picture counts as white here. Exporters that
    mean opaque write what is wholly clear by these rules; that is mended where the world is built.
    """
    transparent, value = shader.child("transparent"), shader.child("transparency", "float")
    numbers = [] if value is None else _numbers(value)
    factor = min(1.0, max(0.0, numbers[0])) if len(numbers) == 1 else 1.0
    if transparent is None:
        return factor
    plain = transparent.child("color")
    r, g, b, a = (None if plain is None else _color(plain)) or (1.0, 1.0, 1.0, 1.0)
    mode = transparent.get("opaque", "A_ONE")
    clear = float(np.dot(LUMINANCE, (r, g, b))) if mode.startswith("RGB") else a
    if not mode.endswith("ZERO"):
        return clear * factor
    # Where a picture says how clear it is, its holes do.
    return 1.0 if plain is None else 1.0 - clear * factor


def _image(name: str, places: list[Node], ids: Mapping[str, Node]) -> str:
    """File behind a texture: sampler, surface, image; or the image at once."""
    parameters = {
        parameter.get("sid"): parameter
        for place in reversed(places)
        for parameter in place.all("newparam")
    }
    for _ in range(4):
        parameter = parameters.get(name)
        if parameter is None:
            break
        sampler = parameter.child("sampler2D")
        if sampler is not None:
            instance = sampler.child("instance_image")
            name = sampler.word("source") if instance is None else instance.get("url")
        else:
            name = parameter.word("surface", "init_from")
    image = ids.get(name.strip().removeprefix("#"))
    if image is None or image.tag != "image":
        return ""
    found = image.child("init_from")
    if found is None:
        return ""
    return found.word("ref") or found.text


@register("collada")
class ColladaReader(Reader):
    """One object for every geometry that a node shows."""

    title = "COLLADA"
    extensions = (".dae",)
    head = re.compile(rb"<COLLADA")
    support: ClassVar[Mapping[str, SupportTable]] = {"COLLADA elements": ELEMENTS}

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        document = read_xml(source, tolerant=True, findings=context.findings)
        if document.root.tag != "COLLADA":
            raise document.error(document.root, "this is no COLLADA file", "check the extension")
        return _ColladaScene(document, context, _axes(document, context)).filled()


def _axes(document: Document, context: Context) -> Axes:
    """Up axis and unit of the file; y and one metre where it says nothing."""
    asset = document.root.child("asset")
    up, unit = "Y", 1.0
    if asset is not None:
        word = asset.word("up_axis").upper()
        up = word[0] if word in ("X_UP", "Y_UP", "Z_UP") else up
        found = asset.child("unit")
        text = "1" if found is None else found.get("meter", "1")
        try:
            unit = read_number(text)
        except ValueError:
            unit = 0.0
        if not 1e-9 < unit < 1e9:
            context.findings.warn(
                document.path.name, f"a unit of {text!r:.30} m has no meaning; 1 m was taken"
            )
            unit = 1.0
    return axes_of(context.options, up, unit)


class _ColladaScene(SceneBuilder):
    """A scene being filled."""

    def __init__(self, document: Document, context: Context, axes: Axes) -> None:
        super().__init__(document.path, context, axes)
        self._document = document
        self._ids: dict[str, Node] = {}
        for node in document.root.walk():
            name = node.get("id")
            if name:
                self._ids.setdefault(name, node)
        self._materials, self._names = read_materials(document, self._ids, self.pictures)
        self._shown = 0
        self._shapes: dict[int, ColladaGeometry] = {}  # by the identity of their meshes
        self._places: dict[int, Array] = {}  # of nodes in the file's frame, by their identity
        self._joints: dict[int, dict[str, Array]] = {}  # by the identity of the node above

    def filled(self) -> Scene:
        """Everything that the file's scene shows."""
        top = self._visual_scene()
        for library in self._document.root.children:
            for entry in library.children if library.tag.startswith("library_") else ():
                if ELEMENTS.get(entry.tag) is Support.LEFT_OUT:
                    self.findings.skip(entry.tag, entry.get("name") or entry.get("id"))
        if top is None:
            self._show_all()
        else:
            for child in top.all("node"):
                self._node(child, np.eye(4), ())
        return self.scene("COLLADA", self._materials)

    def target(self, reference: str) -> Node | None:
        """The element that a URL refers to."""
        return self._ids.get(reference.removeprefix("#"))

    def _visual_scene(self) -> Node | None:
        root = self._document.root
        instance = root.child("scene", "instance_visual_scene")
        if instance is not None:
            found = self.target(instance.get("url"))
            if found is not None:
                return found
        return root.child("library_visual_scenes", "visual_scene")

    def _show_all(self) -> None:
        """Files without a scene hold geometry only."""
        for library in self._document.root.all("library_geometries"):
            for geometry in library.all("geometry"):
                name = geometry.get("name") or geometry.get("id") or "geometry"
                self._show(geometry, geometry, name, np.eye(4))

    # ---- nodes -----------------------------------------------------------------------------

    def _node(self, node: Node, parent: Array, above: tuple[int, ...]) -> None:
        if id(node) in above or len(above) > MAX_DEPTH:
            raise self._document.error(node, "nodes contain each other", "export the file again")
        self._shown += 1
        if self._shown > MAX_NODES:
            raise self._document.error(node, f"more than {MAX_NODES} nodes", "split the map")
        above = (*above, id(node))
        name = node.get("name") or node.get("id") or "node"
        own = self._matrix(node)
        if own is None:
            self._document.note(node, f"node {name[:60]!r} has no place; left out with all in it")
            return
        matrix = parent @ own
        shown = False
        for child in node.children:
            match child.tag:
                case "node":
                    self._node(child, matrix, above)
                    shown = True
                case "instance_node":
                    found = self.target(child.get("url"))
                    if found is not None and found.tag == "node":
                        self._node(found, matrix, above)
                    else:
                        self.findings.missing("file", child.get("url")[:200])
                    shown = True
                case "instance_geometry" | "instance_controller":
                    self._instance(child, name, matrix)
                    shown = True
                case "instance_light":
                    self._light(child, name, matrix)
                    shown = True
                case "instance_camera":
                    shown = True
                case "skew":
                    self.findings.skip("skew", name)
        if not shown:
            self.mark(name, matrix)

    def _instance(self, instance: Node, name: str, matrix: Array) -> None:
        """A geometry, or the geometry that controllers bend."""
        found = self.target(instance.get("url"))
        controllers: list[Node] = []
        for _ in range(8):  # morphs of skins of ...
            if found is None or found.tag != "controller":
                break
            controller = found.child("skin") or found.child("morph")
            if controller is None:
                return
            controllers.insert(0, controller)
            found = self.target(controller.get("source").strip())
        if found is None or found.tag != "geometry":
            self.findings.missing("mesh", instance.get("url")[:200])
            return
        if not controllers:
            self._show(found, instance, name, matrix)
            return
        try:
            self._show(found, instance, name, matrix, self._figure(instance, controllers))
        except MapImportError as error:
            # Without its joints a skin stands as it was modelled.
            self.findings.warn(self.path.name, f"{error}; {name} stands as it was modelled")
            skins = [node for node in controllers if node.tag == "skin"]
            plain = ColladaFigure(self._document, self._ids, skins, None)
            self._show(found, instance, name, matrix, plain)

    def _figure(self, instance: Node, controllers: list[Node]) -> ColladaFigure:
        """The controllers of a geometry, and the nodes that are their joints."""
        if not self._places:
            self._find_places()
        skeletons = list(instance.all("skeleton"))[:MAX_SKELETONS]
        roots = [*(self.target(node.text.strip()) for node in skeletons), self._visual_scene()]
        joints = [self._joints_below(root) for root in roots if root is not None]
        return ColladaFigure(self._document, self._ids, controllers, joints)

    def _joints_below(self, root: Node) -> dict[str, Array]:
        """Matrices of a node and of those below by `sid` and `id`."""
        if id(root) not in self._joints:
            found = self._joints[id(root)] = {}
            for node in root.walk():
                if id(node) in self._places:
                    for word in filter(None, (node.get("sid"), node.get("id"))):
                        found.setdefault(word, self._places[id(node)])
        return self._joints[id(root)]

    def _find_places(self) -> None:
        """Matrices of all nodes that the scene contains itself."""
        top = self._visual_scene()
        todo = [] if top is None else [(node, np.eye(4)) for node in top.all("node")]
        while todo:
            node, parent = todo.pop()
            own = self._matrix(node)
            if own is not None:
                self._places[id(node)] = matrix = parent @ own
                todo += [(child, matrix) for child in node.all("node")]

    def _show(
        self,
        geometry: Node,
        instance: Node,
        name: str,
        matrix: Array,
        figure: ColladaFigure | None = None,
    ) -> None:
        bend, key = (None, ()) if figure is None else (figure.bend, figure.key)

        def read() -> Mesh | None:
            found = read_geometry(self._document, self._ids, geometry, self.findings, bend)
            if found is None:
                return None
            self._shapes[id(found.mesh)] = found
            return found.mesh

        known = self.mesh((geometry.get("id") or str(id(geometry)), *key), read)
        if known is None:
            return
        if figure is None or figure.place is None:
            pose, local = self.axes.place(matrix)
        else:
            # Joints alone say where a skin is: its node's matrix does not count.
            pose, local = self.axes.place(affine(offset=figure.place[:3, 3]), np.eye(4))
        bound = dict(self._bound(instance))
        materials = {}
        for slot, word in enumerate(known.materials):
            symbol, color = self._shapes[id(known)].shades.get(word, (word, None))
            material = bound.get(symbol, symbol)
            material = self._names.get(material, material)
            materials[slot] = material if color is None else self._shade(material, color)
        part = Part(known, local, materials=materials)
        self.findings.count("mesh node")
        self.objects.append(SceneObject(name, (part,), pose, kind="node"))

    def _shade(self, name: str, color: Color) -> str:
        """A material in the colour of vertices, by its name; one with a picture stays as it is."""
        base = self._materials.get(name, WHITE)
        if base.texture is not None:
            self.findings.skip("colours of vertices under a picture", name)
            return name
        ((shade,), _) = shaded(np.array([color[:3]]), base)
        self._materials[shade.name] = shade
        return shade.name

    def _bound(self, instance: Node) -> Iterator[tuple[str, str]]:
        """Symbols of a geometry, and ids of the materials that an instance binds to them."""
        common = instance.child("bind_material", "technique_common")
        for binding in common.all("instance_material") if common is not None else ():
            yield binding.get("symbol"), binding.get("target").removeprefix("#")

    # ---- numbers ---------------------------------------------------------------------------

    def _matrix(self, node: Node) -> Array | None:
        """All transformations of a node, in the order in which they stand; None if one is bad."""
        matrix = np.eye(4)
        for child in node.children:
            if child.tag not in STEPS:
                continue
            values = self._document.vector(child, STEPS[child.tag], far=FAR)
            if values is None:
                return None
            match child.tag:
                case "matrix":
                    step = values.reshape(4, 4)
                case "translate":
                    step = affine(offset=values)
                case "scale":
                    step = affine(np.diag(values))
                case "rotate":
                    step = affine(axis_turn(values[:3], np.radians(values[3])))
                case _:
                    step = _look_at(values.reshape(3, 3))
            matrix = matrix @ step
        return matrix

    # ---- lights ----------------------------------------------------------------------------

    def _light(self, instance: Node, name: str, matrix: Array) -> None:
        found = self.target(instance.get("url"))
        common = None if found is None else found.child("technique_common")
        if common is None or not common.children:
            return
        lamp = common.children[0]
        kinds = {
            "directional": LightKind.DIRECTIONAL,
            "spot": LightKind.SPOT,
            "ambient": LightKind.AMBIENT,
        }
        values = self._document.vector_or(lamp.child("color"), np.ones(3), 3, 4)[:3]
        strength = float(values.max())
        if strength <= 0.0:
            return
        cone = self._document.number(lamp.child("falloff_angle"))
        self.light(
            name,
            kinds.get(lamp.tag, LightKind.POINT),
            matrix,
            (values / strength).clip(0.0, 1.0).tolist(),
            brightness=min(1.0, strength),
            cone=45.0 if cone is None else min(90.0, max(1.0, cone / 2.0)),
        )


def _look_at(rows: Array) -> Array:
    """Matrix of a node at rows[0] whose -z looks at rows[1], with rows[2] upwards."""
    back = rows[0] - rows[1]
    back = back / max(float(np.linalg.norm(back)), 1e-12)
    right = np.cross(rows[2], back)
    right = right / max(float(np.linalg.norm(right)), 1e-12)
    return affine(np.column_stack([right, np.cross(back, right), back]), rows[0])
