"""Materials that only some renderers draw: the colour that their inputs name, else the mesh's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_samples import read, told
from PIL import Image

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Material, Mesh, Opacity, Scene

pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")

STAGE = """#usda 1.0
(
 defaultPrim = "W"
 metersPerUnit = 1
 upAxis = "Z"
)
def Xform "W" {
 def Mesh "Quad" (prepend apiSchemas = ["MaterialBindingAPI"]) {
  int[] faceVertexCounts = [4]
  int[] faceVertexIndices = [0, 1, 2, 3]
  point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
  uniform token subdivisionScheme = "none"
  texCoord2f[] primvars:UVs = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
  %s
  rel material:binding = </W/M>
 }
 def Material "M" {
  %s
 }
}
"""

HALF = 0.735
"""How screens show a linear half."""


def stage(folder: Path, material: str, mesh: str = "") -> tuple[Scene, Findings]:
    """A stage with a mesh that has this material."""
    path = folder / "a.usda"
    path.write_text(STAGE % (mesh, material))
    findings = Findings()
    return read(path, findings), findings


def surface(output: str, shader: str, more: str = "") -> str:
    """A material with one surface for one renderer."""
    return (
        f'token outputs:{output}.connect = </W/M/S.outputs:out>\n  def Shader "S" {{\n'
        f"   {shader}\n   token outputs:out\n  }}\n  {more}"
    )


def the_material(scene: Scene) -> Material:
    """The only material."""
    (shape,) = (part.shape for thing in scene.objects for part in thing.parts)
    assert isinstance(shape, Mesh)
    (name,) = shape.materials
    return scene.materials[name]


def mdl(inputs: str, kind: str = "OmniPBR") -> str:
    """A surface of MDL."""
    return surface(
        "mdl:surface",
        'uniform token info:implementationSource = "sourceAsset"\n'
        f"   uniform asset info:mdl:sourceAsset = @{kind}.mdl@\n"
        f'   uniform token info:mdl:sourceAsset:subIdentifier = "{kind}"\n   {inputs}',
    )


def known(output: str, kind: str, inputs: str) -> str:
    """A surface with an identifier."""
    return surface(output, f'uniform token info:id = "{kind}"\n   {inputs}')


RED_HALF = "= (0.5, 0, 0)"

COLORED = {
    "OmniPBR": mdl(f"color3f inputs:diffuse_color_constant {RED_HALF}"),
    "tint": mdl(
        "color3f inputs:diffuse_color_constant = (1, 1, 1)\n"
        f"   color3f inputs:diffuse_tint {RED_HALF}"
    ),
    "tint alone": mdl(f"color3f inputs:diffuse_tint {RED_HALF}"),
    "OmniSurface": mdl(
        "color3f inputs:diffuse_reflection_color = (1, 0, 0)\n"
        "   float inputs:diffuse_reflection_weight = 0.5",
        "OmniSurface",
    ),
    "MDL of others": mdl(f"color3f inputs:BaseColor {RED_HALF}", "M_Wall"),
    "Unreal": surface(
        "unreal:surface",
        'uniform token info:implementationSource = "sourceAsset"\n'
        "   uniform asset info:unreal:sourceAsset = @/Game/M.M@\n"
        f"   float3 inputs:Base_Color {RED_HALF}",
    ),
    "interface of Unreal": f"color3f inputs:BaseColor {RED_HALF}\n  token outputs:unreal:surface",
    "standard_surface": known(
        "mtlx:surface",
        "ND_standard_surface_surfaceshader",
        "color3f inputs:base_color = (1, 0, 0)\n   float inputs:base = 0.5",
    ),
    "OpenPBR": known(
        "mtlx:surface", "ND_open_pbr_surface_surfaceshader", f"color3f inputs:base_color {RED_HALF}"
    ),
    "gltf_pbr": known(
        "surface",
        "ND_gltf_pbr_surfaceshader",
        f"color3f inputs:base_color {RED_HALF}\n   float inputs:alpha = 0.3",
    ),
    "preview of MaterialX": known(
        "mtlx:surface",
        "ND_UsdPreviewSurface_surfaceshader",
        f"color3f inputs:diffuseColor {RED_HALF}",
    ),
    "Arnold": known("arnold:surface", "standard_surface", f"color3f inputs:base_color {RED_HALF}"),
    "RenderMan": known("ri:surface", "PxrDisneyBsdf", f"color3f inputs:baseColor {RED_HALF}"),
    "albedo": known("surface", "Anything", f"color3f inputs:albedo {RED_HALF}"),
    "four channels": known("surface", "Anything", "color4f inputs:baseColor = (0.5, 0, 0, 1)"),
    "unlit": known("surface", "ND_surface_unlit", f"color3f inputs:emission_color {RED_HALF}"),
    "interface": surface(
        "mdl:surface",
        "color3f inputs:diffuse_color_constant.connect = </W/M.inputs:paint>",
        f"color3f inputs:paint {RED_HALF}",
    ),
    "mixed": known(
        "surface", "ND_mix_surfaceshader", "token inputs:fg.connect = </W/M/T.outputs:out>"
    ) + (
        ' def Shader "T" {\n   uniform token info:id = "ND_standard_surface_surfaceshader"\n'
        f"   color3f inputs:base_color {RED_HALF}\n   token outputs:out\n  }}\n"
    ),
    "multiplied": known(
        "mtlx:surface",
        "ND_standard_surface_surfaceshader",
        "color3f inputs:base_color.connect = </W/M/T.outputs:out>",
    ) + (
        ' def Shader "T" {\n   uniform token info:id = "ND_multiply_color3"\n'
        "   color3f inputs:in1 = (0.5, 1, 1)\n   color3f inputs:in2 = (1, 0, 0)\n"
        "   color3f outputs:out\n  }\n"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", COLORED)
def test_colours_of_other_surfaces(tmp_path: Path, name: str) -> None:
    """The colour comes from what the surface's inputs name, and no line says otherwise."""
    scene, findings = stage(tmp_path, COLORED[name])
    assert the_material(scene).color == pytest.approx((HALF, 0, 0, 1), abs=0.003)
    assert the_material(scene).name == "M"
    assert "grey" not in told(findings)


@pytest.mark.parametrize(
    "material",
    [
        "token outputs:mdl:surface",
        mdl("float inputs:reflection_roughness_constant = 0.5"),
        surface("unreal:surface", "uniform asset info:unreal:sourceAsset = @/Game/M.M@"),
        surface("surface", 'uniform token info:id = "UsdUVTexture"'),
        "token outputs:surface.connect = </W/M/Nowhere.outputs:out>",
    ],
)
def test_the_colour_of_the_mesh(tmp_path: Path, material: str) -> None:
    """Where no surface names a colour the mesh's own counts; a line tells where it has none."""
    scene, findings = stage(tmp_path, material, "color3f[] primvars:displayColor = [(0.5, 0, 0)]")
    assert the_material(scene).color == pytest.approx((HALF, 0, 0, 1), abs=0.003)
    assert "grey" not in told(findings)
    scene, findings = stage(tmp_path, material)
    red, green, blue, _ = the_material(scene).color
    assert (red, green) == pytest.approx((blue, blue), abs=0.03)
    assert told(findings).startswith("M: ")
    assert "grey" in told(findings)


def test_preview_surface_wins(tmp_path: Path) -> None:
    """Of several surfaces the one counts that all programs draw alike."""
    more = """
  token outputs:surface.connect = </W/M/P.outputs:surface>
  def Shader "P" {
   uniform token info:id = "UsdPreviewSurface"
   color3f inputs:diffuseColor = (0, 1, 0)
   token outputs:surface
  }
"""
    scene, _ = stage(tmp_path, mdl("color3f inputs:diffuse_color_constant = (1, 0, 0)") + more)
    assert the_material(scene).color == pytest.approx((0, 1, 0, 1))


TEXTURED = {
    "OmniPBR": mdl(
        "asset inputs:diffuse_texture = @mark.png@\n   color3f inputs:diffuse_tint = (0.5, 1, 1)\n"
        "   color3f inputs:diffuse_color_constant = (0, 0, 0)\n"
        "   asset inputs:normalmap_texture = @normal.png@\n   float2 inputs:texture_scale = (2, 3)"
    ),
    "Houdini": surface(
        "surface",
        "asset inputs:basecolor_texture = @mark.png@\n   bool inputs:basecolor_useTexture = 1\n"
        "   float2 inputs:texture_scale = (2, 3)\n   color3f inputs:diffuse_tint = (0.5, 1, 1)",
    ),
    "MaterialX": known(
        "mtlx:surface",
        "ND_standard_surface_surfaceshader",
        "color3f inputs:base_color.connect = </W/M/T.outputs:out>",
    ) + (
        ' def Shader "T" {\n   uniform token info:id = "ND_multiply_color3"\n'
        "   color3f inputs:in1.connect = </W/M/I.outputs:out>\n"
        "   color3f inputs:in2 = (0.5, 1, 1)\n   color3f outputs:out\n  }\n"
        '  def Shader "I" {\n   uniform token info:id = "ND_tiledimage_color3"\n'
        "   asset inputs:file = @mark.png@\n   float2 inputs:uvtiling = (2, 3)\n"
        "   float2 inputs:texcoord.connect = </W/M/C.outputs:out>\n   color3f outputs:out\n  }\n"
        '  def Shader "C" {\n   uniform token info:id = "ND_geompropvalue_vector2"\n'
        '   string inputs:geomprop = "UVs"\n   float2 outputs:out\n  }\n'
    ),
    "preview, through a graph": known(
        "surface", "UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </W/M/G.outputs:out>"
    ) + (
        ' def NodeGraph "G" {\n   color3f outputs:out.connect = </W/M/G/I.outputs:rgb>\n'
        '  def Shader "I" {\n   uniform token info:id = "UsdUVTexture"\n'
        "   asset inputs:file = @mark.png@\n   float4 inputs:scale = (0.5, 1, 1, 1)\n"
        "   float2 inputs:st.connect = </W/M/G/T.outputs:result>\n   float3 outputs:rgb\n  }\n"
        '  def Shader "T" {\n   uniform token info:id = "UsdTransform2d"\n'
        "   float2 inputs:scale = (2, 3)\n   float2 outputs:result\n  }\n  }\n"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TEXTURED)
def test_pictures_of_other_surfaces(tmp_path: Path, name: str) -> None:
    """A surface's picture is found, with its tint, and lies as often on the mesh as it says."""
    Image.new("RGB", (2, 2), (255, 255, 255)).save(tmp_path / "mark.png")
    Image.new("RGB", (2, 2), (0, 0, 255)).save(tmp_path / "normal.png")
    scene, _ = stage(tmp_path, TEXTURED[name])
    material = the_material(scene)
    assert material.texture == tmp_path / "mark.png"
    assert material.color == pytest.approx((HALF, 1, 1, 1), abs=0.002)
    (shape,) = (part.shape for thing in scene.objects for part in thing.parts)
    expected = shape.vertices[shape.triangles][..., :2] * [2.0, 3.0]
    np.testing.assert_allclose(shape.uvs, expected)


GREEN = "color3f inputs:diffuseColor = (0, 1, 0)\n   "

CLEAR = {
    "constant": (known("surface", "UsdPreviewSurface", GREEN + "float inputs:opacity = 0.3"), 0.3),
    "threshold above": (
        known(
            "surface",
            "UsdPreviewSurface",
            GREEN + "float inputs:opacity = 0.3\n   float inputs:opacityThreshold = 0.2",
        ),
        1.0,
    ),
    "MDL": (
        mdl(
            "color3f inputs:diffuse_color_constant = (0, 1, 0)\n   bool inputs:enable_opacity = 1\n"
            "   float inputs:opacity_constant = 0.3"
        ),
        0.3,
    ),
    "MDL, switched off": (
        mdl(
            "color3f inputs:diffuse_color_constant = (0, 1, 0)\n   bool inputs:enable_opacity = 0\n"
            "   float inputs:opacity_constant = 0.3"
        ),
        1.0,
    ),
    "OmniGlass": (mdl("color3f inputs:glass_color = (0, 1, 0)", "OmniGlass"), 0.2),
    "standard_surface": (
        known(
            "mtlx:surface",
            "ND_standard_surface_surfaceshader",
            "color3f inputs:base_color = (0, 1, 0)\n   color3f inputs:opacity = (0.3, 0.3, 0.3)",
        ),
        0.3,
    ),
    "transmission": (
        known(
            "mtlx:surface",
            "ND_open_pbr_surface_surfaceshader",
            "color3f inputs:base_color = (0, 1, 0)\n   float inputs:transmission_weight = 1",
        ),
        0.2,
    ),
    "gltf_pbr": (
        known(
            "mtlx:surface",
            "ND_gltf_pbr_surfaceshader",
            "color3f inputs:base_color = (0, 1, 0)\n   float inputs:alpha = 0.3\n"
            "   int inputs:alpha_mode = 2",
        ),
        0.3,
    ),
}


@pytest.mark.parametrize("name", CLEAR)
def test_opacity(tmp_path: Path, name: str) -> None:
    """Clear surfaces are as clear as their inputs say."""
    text, opacity = CLEAR[name]
    scene, findings = stage(tmp_path, text)
    assert the_material(scene).color == pytest.approx((0, 1, 0, opacity))
    assert "clear" not in told(findings)


TEXTURE = (
    ' def Shader "T" {\n   uniform token info:id = "UsdUVTexture"\n'
    "   asset inputs:file = @fence.png@\n   float outputs:a\n   float outputs:r\n"
    "   float3 outputs:rgb\n  }\n"
)

HOLES = {
    "opacity of the picture": (
        known(
            "surface",
            "UsdPreviewSurface",
            "color3f inputs:diffuseColor.connect = </W/M/T.outputs:rgb>\n"
            "   float inputs:opacity.connect = </W/M/T.outputs:a>\n"
            "   float inputs:opacityThreshold = 0.3",
        )
        + TEXTURE,
        Opacity(None, pytest.approx(0.3), False, False),
    ),
    "opacity of another picture": (
        known(
            "surface",
            "UsdPreviewSurface",
            GREEN + "float inputs:opacity.connect = </W/M/T.outputs:a>",
        )
        + TEXTURE,
        Opacity("fence.png", 0.5, True, False),
    ),
    "brightness": (
        known(
            "surface",
            "UsdPreviewSurface",
            GREEN + "float inputs:opacity.connect = </W/M/T.outputs:r>",
        )
        + TEXTURE,
        Opacity("fence.png", 0.5, True, True),
    ),
    "OmniPBR": (
        mdl(
            "asset inputs:diffuse_texture = @fence.png@\n   bool inputs:enable_opacity = 1\n"
            "   bool inputs:enable_opacity_texture = 1\n   float inputs:opacity_threshold = 0.5\n"
            "   asset inputs:opacity_texture = @fence.png@"
        ),
        Opacity("fence.png", 0.5, False, True),
    ),
    "OmniPBR, switched off": (
        mdl(
            "asset inputs:diffuse_texture = @fence.png@\n   bool inputs:enable_opacity = 1\n"
            "   bool inputs:enable_opacity_texture = 0\n"
            "   asset inputs:opacity_texture = @fence.png@"
        ),
        None,
    ),
}


@pytest.mark.parametrize("name", HOLES)
def test_holes_of_a_picture(tmp_path: Path, name: str) -> None:
    """Where a picture says what is clear, the surface has holes there."""
    picture = tmp_path / "fence.png"
    Image.new("RGBA", (2, 2), (255, 255, 255, 0)).save(picture)
    text, expected = HOLES[name]
    scene, _ = stage(tmp_path, text)
    material = the_material(scene)
    if expected is not None and expected.picture is not None:
        expected = replace(expected, picture=picture)
    assert material.opacity == expected
    assert material.color[3] == 1.0
    assert scene.objects[0].parts[0].shape.uvs is not None


@pytest.mark.slow
def test_networks_without_an_end(tmp_path: Path) -> None:
    """Shaders that feed each other, or themselves, end somewhere."""
    loop = known(
        "surface", "UsdPreviewSurface", "color3f inputs:diffuseColor.connect = </W/M/A.outputs:out>"
    )
    for name, other in (("A", "B"), ("B", "A")):
        loop += (
            f' def Shader "{name}" {{\n   uniform token info:id = "ND_multiply_color3"\n'
            f"   color3f inputs:in1.connect = </W/M/{other}.outputs:out>\n"
            f"   color3f inputs:in2.connect = </W/M/{other}.outputs:out>\n"
            "   color3f outputs:out\n  }\n"
        )
    scene, _ = stage(tmp_path, loop)
    assert the_material(scene)


def test_copies_with_materials_of_their_own(tmp_path: Path) -> None:
    """Two instances of one mesh below different colours and materials keep them."""
    path = tmp_path / "a.usda"
    path.write_text(
        '#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Z"\n)\nclass "Tile" {\n def Mesh "Quad" {\n'
        "  int[] faceVertexCounts = [3]\n  int[] faceVertexIndices = [0, 1, 2]\n"
        "  point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]\n }\n}\n"
        + "".join(
            f'def Xform "{name}" (\n  instanceable = true\n  inherits = </Tile>\n) {{\n'
            f"  color3f[] primvars:displayColor = [{color}]\n}}\n"
            for name, color in (("A", "(1, 0, 0)"), ("B", "(0, 0, 1)"), ("C", "(1, 0, 0)"))
        )
    )
    shapes = [part.shape for thing in read(path).objects for part in thing.parts]
    assert [shape.materials for shape in shapes] == [
        ("color_ff0000",), ("color_0000ff",), ("color_ff0000",)
    ]  # fmt: skip
    assert shapes[0] is shapes[2]
