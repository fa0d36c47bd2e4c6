"""Reads OpenUSD stages, as Unreal Engine 4 and 5, Omniverse and Blender export (worlds 6).

The library is optional: `pip install usarsim-server[usd]`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from usarsim_maps.meshes.mesh_files import axes_of
from usarsim_maps.reader import Context, Reader, need, register
from usarsim_maps.scene import Scene
from usarsim_maps.support import SupportTable
from usarsim_maps.usd.schemas import API_SCHEMAS, COMPOSITION, PRIM_TYPES, PURPOSES, STAGES
from usarsim_server.base.errors import MapImportError, at

SMALLEST, LARGEST = 1e-6, 1e6
"""Metres per unit that are believed."""


@register("usd")
class UsdReader(Reader):
    """Stages with references, payloads, instances, variants, purposes, materials and physics."""

    title = "OpenUSD"
    extensions = STAGES
    support: ClassVar[Mapping[str, SupportTable]] = {
        "OpenUSD prim types": PRIM_TYPES,
        "OpenUSD API schemas": API_SCHEMAS,
        "OpenUSD purposes": PURPOSES,
        "OpenUSD composition": COMPOSITION,
    }

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """It begins with the cookie of one of the two formats."""
        return head.startswith((b"#usda", b"PXR-USDC"))

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`; syntax errors name the line (worlds 73)."""
        need("pxr.Usd", source, "USD files")
        from pxr import Tf, UsdGeom

        from usarsim_maps.usd.openusd.stage import (
            broken,
            files_of,
            finest_variants,
            listening,
            open_stage,
            tell_unused,
        )
        from usarsim_maps.usd.openusd.walker import StageReader

        context.progress("reading", 0.0)
        stage = open_stage(source, context)
        try:
            with listening(context.findings):
                finest_variants(stage, context.findings)
                tell_unused(stage, context.findings)
                axes = axes_of(
                    context.options,
                    _up(str(UsdGeom.GetStageUpAxis(stage)), source, context),
                    _unit(stage.GetMetadata("metersPerUnit"), source, context),
                    stated=bool(UsdGeom.StageHasAuthoredMetersPerUnit(stage)),
                )
                return StageReader(stage, source, context, axes).filled(self.title, files_of(stage))
        except (Tf.ErrorException, UnicodeDecodeError) as error:
            raise broken(source, error) from None


def _unit(stated: object, source: Path, context: Context) -> float:
    """Metres per unit, if they make sense or the user knows better.

    Some exporters store a number of single precision, as which 0.01 has seven digits.
    """
    unit = float(stated) if isinstance(stated, int | float) else 0.0
    if SMALLEST <= unit <= LARGEST and unit == np.float32(unit):
        unit = float(str(np.float32(unit)))
    if SMALLEST <= unit <= LARGEST:
        return unit
    if context.options.scale is None:
        cure = "give the true scale with --scale"
        raise MapImportError(at(source, f"metersPerUnit is {stated!r:.40}", cure))
    return 1.0


def _up(axis: str, source: Path, context: Context) -> str:
    """The axis that points up, if there is such an axis or the user knows better."""
    if axis in ("X", "Y", "Z"):
        return axis
    if context.options.up is None:
        raise MapImportError(at(source, f"upAxis is {axis!r}", "give the true one with --up"))
    return context.options.up
