"""What the USD reader does with prim types, API schemas, purposes and composition.

Names are those of OpenUSD's schema domains. The library is not needed for these tables.
"""

from __future__ import annotations

from usarsim_maps.support import Support, support_table

STAGES = (".usd", ".usda", ".usdc", ".usdz")
"""Extensions of files."""

PRIM_TYPES = support_table(
    read="""
        BlendShape Capsule Capsule_1 Cone Cube Cylinder Cylinder_1 CylinderLight DiskLight
        DistantLight DomeLight DomeLight_1 GeomSubset Material Mesh NodeGraph Plane PointInstancer
        RectLight Scope Shader SkelAnimation SkelRoot Skeleton Sphere SphereLight Xform
    """,
    left_out="""
        Backdrop BasisCurves Camera Field3DAsset GenerativeProcedural GeometryLight HermiteCurves
        LODDistanceHeuristic LODScreenSizeHeuristic LightFilter NurbsCurves NurbsPatch
        OpenVDBAsset ParticleField ParticleField3DGaussianSplat PhysicsCollisionGroup
        PhysicsDistanceJoint PhysicsFixedJoint PhysicsJoint PhysicsPrismaticJoint
        PhysicsRevoluteJoint PhysicsScene PhysicsSphericalJoint PluginLight PluginLightFilter
        Points PortalLight RenderPass RenderProduct RenderSettings RenderVar SpatialAudio TetMesh
        Volume
    """,
)
"""Types of the domains UsdGeom, UsdLod, UsdLux, UsdMedia, UsdPhysics, UsdProc, UsdRender, UsdShade,
UsdSkel, UsdUI and UsdVol."""

API_SCHEMAS = support_table(
    read="""
        CollectionAPI LODRootAPI LightAPI MaterialBindingAPI PhysicsCollisionAPI PhysicsMassAPI
        PhysicsMaterialAPI PhysicsMeshCollisionAPI PhysicsRigidBodyAPI ShapingAPI SkelBindingAPI
        VisibilityAPI
    """,
    left_out="""
        AccessibilityAPI AssetPreviewsAPI AuthorshipAPI BackPlateAPI ClaimsAPI ColorSpaceAPI
        ColorSpaceDefinitionAPI CoordSysAPI GeomModelAPI HydraGenerativeProceduralAPI HydraPrimAPI
        HydraRenderPassAPI LODOverrideAPI LightListAPI ListAPI MeshLightAPI MotionAPI NodeDefAPI
        NodeGraphNodeAPI ParticleFieldKernelBaseAPI ParticleFieldKernelConstantSurfletAPI
        ParticleFieldKernelGaussianEllipsoidAPI ParticleFieldKernelGaussianSurfletAPI
        ParticleFieldOpacityAttributeAPI ParticleFieldOrientationAttributeAPI
        ParticleFieldPositionAttributeAPI ParticleFieldPositionBaseAPI
        ParticleFieldRadianceBaseAPI ParticleFieldScaleAttributeAPI
        ParticleFieldSphericalHarmonicsAttributeAPI PhysicsArticulationRootAPI PhysicsDriveAPI
        PhysicsFilteredPairsAPI PhysicsLimitAPI RiMaterialAPI RiSplineAPI SceneGraphPrimAPI
        SemanticsLabelsAPI ShadowAPI StatementsAPI VolumeLightAPI
    """,
)
"""Schemas that are applied to prims."""

PURPOSES = support_table(read="default guide render", left_out="proxy")
"""Values of the attribute `purpose`, computed by inheritance."""

COMPOSITION = support_table(
    read="class clips inherits instanceable payload references relocates specializes subLayers",
    left_out="inactive invisible over variant",
)
"""How prims come about, and what keeps them out: a variant that is not selected, an `over` of a
prim that no file defines, `active = false`, `visibility = "invisible"`."""


def is_read(table: dict[str, Support], name: str) -> bool:
    """Whether an element has its effect in the world; what the table does not know has none."""
    return table.get(name) is Support.READ
