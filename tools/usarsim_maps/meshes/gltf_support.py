"""What the glTF reader does with extensions and with glTF's own objects.

Names are those of the glTF 2.0 extension registry, and of extensions outside of it that exporters
write (`OMI_`, `VRM`).
"""

from __future__ import annotations

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.gltf_data import GltfFile
from usarsim_maps.support import Support, support_table
from usarsim_server.base.errors import MapImportError, at

EXTENSIONS = support_table(
    read="""
        EXT_mesh_gpu_instancing EXT_mesh_manifold EXT_mesh_primitive_restart EXT_meshopt_compression
        EXT_texture_webp FB_ngon_encoding GODOT_single_root KHR_accessor_float64
        KHR_draco_mesh_compression KHR_lights_punctual KHR_materials_pbrSpecularGlossiness
        KHR_materials_transmission KHR_materials_unlit KHR_mesh_primitive_restart
        KHR_mesh_quantization KHR_meshopt_compression KHR_node_visibility KHR_texture_transform
        MSFT_lod MSFT_texture_dds
    """,
    left_out="""
        ADOBE_materials_clearcoat_specular ADOBE_materials_clearcoat_tint
        ADOBE_materials_thin_transparency AGI_articulations AGI_stk_metadata CESIUM_RTC
        CESIUM_primitive_outline EXT_feature_metadata EXT_instance_features EXT_lights_ies
        EXT_lights_image_based EXT_mesh_features EXT_mesh_polygon
        EXT_mesh_primitive_edge_visibility EXT_structural_metadata EXT_texture_astc
        EXT_texture_avif EXT_texture_procedurals_mx_1_39 FB_geometry_metadata GRIFFEL_bim_data
        KHR_animation_pointer KHR_audio_emitter KHR_audio_graph KHR_collision_shapes
        KHR_implicit_shapes KHR_interactivity KHR_lights KHR_materials_anisotropy
        KHR_materials_clearcoat KHR_materials_common KHR_materials_diffuse_transmission
        KHR_materials_dispersion KHR_materials_emissive_strength KHR_materials_ior
        KHR_materials_iridescence KHR_materials_sheen KHR_materials_specular
        KHR_materials_subsurface KHR_materials_variants KHR_materials_volume
        KHR_materials_volume_scatter KHR_node_hoverability KHR_node_selectability
        KHR_physics_rigid_bodies KHR_techniques_webgl KHR_texture_basisu KHR_texture_procedurals
        KHR_texture_video KHR_xmp KHR_xmp_json_ld MPEG_accessor_timed MPEG_animation_timing
        MPEG_audio_spatial MPEG_media MPEG_mesh_linking MPEG_scene_dynamic MPEG_texture_video
        MPEG_viewport_recommended MSFT_audio_emitter MSFT_packing_normalRoughnessMetallic
        MSFT_packing_occlusionRoughnessMetallic NV_materials_mdl OMI_collider OMI_physics_body
        OMI_physics_joint OMI_physics_shape OMI_seat OMI_spawn_point VRM VRMC_materials_mtoon
        VRMC_springBone VRMC_vrm
    """,
    refused="""
        EXT_implicit_cylinder_region EXT_implicit_ellipsoid_region EXT_primitive_voxels
        FRAUNHOFER_external_model KHR_gaussian_splatting KHR_gaussian_splatting_compression_spz
        KHR_gaussian_splatting_compression_spz_2 KITTYCAD_boundary_representation
        MPEG_buffer_circular
    """,
)
"""Refused are extensions only where the file requires them: what it shows without them is wrong or
nothing."""

OBJECTS = support_table(
    read="""
        accessors bufferViews buffers images materials meshes nodes samplers scenes skins targets
        textures TRIANGLES TRIANGLE_FAN TRIANGLE_STRIP
    """,
    left_out="""
        animations cameras emissiveTexture metallicRoughnessTexture normalTexture occlusionTexture
        LINES LINE_LOOP LINE_STRIP POINTS
    """,
)

MODES = (
    "POINTS", "LINES", "LINE_LOOP", "LINE_STRIP", "TRIANGLES", "TRIANGLE_STRIP", "TRIANGLE_FAN",
)  # fmt: skip
"""Kinds of primitives by the number of their mode."""

OF_LOOKS = {
    "animation", "audio", "camera", "image", "light", "lights", "lightmap", "material", "materials",
    "texture",
}  # fmt: skip
"""Second words of names of extensions that change no surface (`VENDOR_materials_fur`)."""

CURE = "export without compression and without this extension"


def note_extensions(file: GltfFile, findings: Findings) -> None:
    """Count the extensions that have no effect in the world.

    Raises:
        MapImportError: the file requires one that changes surfaces and cannot be read.
    """
    required = dict.fromkeys(file.words("extensionsRequired"))
    for name in required:
        if support_of(name) is Support.REFUSED:
            problem = f"the file requires {name[:80]}, which cannot be read"
            raise MapImportError(at(file.path, problem, CURE))
    for name in dict.fromkeys([*file.words("extensionsUsed"), *required]):
        if support_of(name) is not Support.READ:
            findings.skip("extension", name[:80])


def support_of(name: str) -> Support:
    """What happens to an extension; one that nobody knows is refused, unless it is for looks."""
    known = EXTENSIONS.get(name)
    if known is not None:
        return known
    words = name.split("_")
    return Support.LEFT_OUT if OF_LOOKS.intersection(words[1:2]) else Support.REFUSED
