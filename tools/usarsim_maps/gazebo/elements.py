"""What is read of the elements of SDFormat 1.5 to 1.12 and of URDF, and what is counted instead.

Each table is one element's list of children in the specification. Whoever reads an element hands it
to `Elements.count` with its table, so that what is left out of it stands in the report.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.xml_text import Node
from usarsim_maps.support import Support, SupportTable, support_table

ROOT = support_table(
    read="include light model world",
    left_out="actor gui physics scene",
)
WORLD = support_table(
    read="frame include joint light model population state",
    left_out="actor atmosphere audio gravity gui magnetic_field physics plugin road scene "
    "spherical_coordinates wind",
)
INCLUDE = support_table(
    read="name placement_frame pose static uri",
    left_out="model_state plugin",
)
MODEL = support_table(
    read="frame include joint light link model pose static",
    left_out="allow_auto_disable enable_wind gripper model_state plugin self_collide",
)
LINK = support_table(
    read="collision inertial kinematic light pose visual",
    left_out="audio_sink audio_source battery enable_wind frame gravity must_be_base_link "
    "particle_emitter projector self_collide sensor velocity_decay",
)
INERTIAL = support_table(
    read="mass",
    left_out="auto_inertia_params density fluid_added_mass frame inertia pose",
)
VISUAL = support_table(
    read="geometry material pose transparency",
    left_out="cast_shadows frame laser_retro meta plugin visibility_flags",
)
COLLISION = support_table(
    read="geometry pose surface",
    left_out="auto_inertia_params density frame laser_retro max_contacts",
)
SURFACE = support_table(read="contact friction", left_out="bounce soft_contact")
FRICTION = support_table(read="ode", left_out="bullet torsional")
CONTACT = support_table(
    read="collide_bitmask",
    left_out="bullet category_bitmask collide_without_contact collide_without_contact_bitmask "
    "elastic_modulus ode poissons_ratio",
)
GEOMETRY = support_table(
    read="box capsule cone cylinder ellipsoid empty heightmap mesh plane polyline sphere",
    left_out="image",
)
MESH = support_table(read="scale submesh uri", left_out="convex_decomposition")
HEIGHTMAP = support_table(
    read="pos size texture uri",
    left_out="blend sampling use_terrain_paging",
)
MATERIAL = support_table(
    read="ambient diffuse pbr script",
    left_out="double_sided emissive lighting render_order shader shininess specular",
)
LIGHT = support_table(
    read="attenuation cast_shadows diffuse direction intensity light_on pose spot",
    left_out="frame specular visualize",
)
JOINT = support_table(
    read="child parent pose",
    left_out="axis axis2 frame gearbox_ratio gearbox_reference_body physics screw_thread_pitch "
    "sensor thread_pitch",
)
POPULATION = support_table(
    read="box cylinder distribution include model model_count pose",
    left_out="frame",
)
STATE = support_table(
    read="deletions insertions light light_state model model_state",
    left_out="iterations joint_state real_time sim_time wall_time",
)
MODEL_STATE = support_table(
    read="link link_state model model_state pose scale",
    left_out="frame joint joint_state",
)
LINK_STATE = support_table(
    read="pose",
    left_out="acceleration collision collision_state velocity wrench",
)
LIGHT_STATE = support_table(read="pose")

URDF_ROBOT = support_table(
    read="gazebo joint link material",
    left_out="transmission sensor",
    refused="xacro",
)
URDF_LINK = support_table(read="collision inertial visual")
URDF_INERTIAL = support_table(read="mass", left_out="inertia origin")
URDF_SHAPE = support_table(
    read="geometry material origin",
    left_out="contact_coefficients verbose",
)
URDF_GEOMETRY = support_table(read="box capsule cylinder mesh sphere")
URDF_MATERIAL = support_table(read="color texture")
URDF_JOINT = support_table(
    read="child origin parent",
    left_out="axis calibration dynamics limit mimic safety_controller",
)
URDF_GAZEBO = support_table(
    read="material mu1 static",
    left_out="plugin sensor",
)
"""Of `gazebo`, with and without `reference`."""

TABLES: Mapping[str, SupportTable] = {
    "SDF root elements": ROOT,
    "SDF world elements": WORLD,
    "SDF include elements": INCLUDE,
    "SDF model elements": MODEL,
    "SDF link elements": LINK,
    "SDF inertial elements": INERTIAL,
    "SDF visual elements": VISUAL,
    "SDF collision elements": COLLISION,
    "SDF surface elements": SURFACE,
    "SDF friction elements": FRICTION,
    "SDF contact elements": CONTACT,
    "SDF geometries": GEOMETRY,
    "SDF mesh elements": MESH,
    "SDF heightmap elements": HEIGHTMAP,
    "SDF material elements": MATERIAL,
    "SDF light elements": LIGHT,
    "SDF joint elements": JOINT,
    "SDF population elements": POPULATION,
    "SDF state elements": STATE,
    "SDF model state elements": MODEL_STATE,
    "SDF link state elements": LINK_STATE,
    "SDF light state elements": LIGHT_STATE,
    "URDF robot elements": URDF_ROBOT,
    "URDF link elements": URDF_LINK,
    "URDF inertial elements": URDF_INERTIAL,
    "URDF visual and collision elements": URDF_SHAPE,
    "URDF geometries": URDF_GEOMETRY,
    "URDF material elements": URDF_MATERIAL,
    "URDF joint elements": URDF_JOINT,
    "URDF gazebo elements": URDF_GAZEBO,
}
"""By the names of the lists, as docs/import.md has them."""

_SURROUNDED = {
    id(table): f"{name} "
    for name, table in (
        ("collision", COLLISION), ("collision", SURFACE), ("collision", FRICTION),
        ("collision", CONTACT), ("inertial", INERTIAL), ("inertial", URDF_INERTIAL),
        ("joint", JOINT), ("joint", URDF_JOINT), ("light", LIGHT), ("material", MATERIAL),
        ("material", URDF_MATERIAL), ("mesh", MESH), ("heightmap", HEIGHTMAP),
        ("visual", VISUAL), ("geometry", GEOMETRY), ("geometry", URDF_GEOMETRY),
        ("state", STATE), ("state", MODEL_STATE), ("state", LINK_STATE), ("state", LIGHT_STATE),
    )
}  # fmt: skip
"""What stands before a tag in the report, by table: `specular` alone would say little."""

_USUAL = {
    "gravity": {"1", "true"},
    "cast_shadows": {"1", "true"},
    "visualize": {"1", "true"},
    "lighting": {"1", "true"},
    "allow_auto_disable": {"1", "true"},
    "max_contacts": {"10", "20"},
}
"""Values that hold in any case; of other elements these are none at all, false and zeros."""


@dataclass(slots=True)
class Elements:
    """Counts elements that are left out, once each."""

    findings: Findings

    def count(self, node: Node, table: SupportTable, owner: str = "") -> None:
        """Count the children of an element that are left out by its table, or not in it.

        Those that are empty, or say what holds in any case, do not count.

        Args:
            node: the element.
            table: what happens to its children.
            owner: name for those without one of their own.
        """
        for child in node.children:
            self.count_child(child, table, owner)

    def count_child(self, child: Node, table: SupportTable, owner: str = "") -> None:
        """As `count`, one child alone."""
        if table.get(child.tag, Support.LEFT_OUT) is Support.READ or _says_nothing(child):
            return
        name = child.get("name") or child.get("filename") or owner
        self.leave(_SURROUNDED.get(id(table), "") + child.tag, name)

    def leave(self, kind: str, name: str = "") -> None:
        """Count one thing that is in the file and not in the world."""
        self.findings.skip(kind[:80], name[:80])


def _says_nothing(node: Node) -> bool:
    """Whether an element states what holds without it."""
    if node.children:
        return not node.attributes and all(map(_says_nothing, node.children))
    if node.get("name"):
        return False
    word = node.text.lower()
    if node.tag in _USUAL:
        return word in _USUAL[node.tag]
    if not word:
        return not node.attributes
    return word == "false" or not word.strip("0.- \t\r\n")
