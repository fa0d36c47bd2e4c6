"""CONF of cameras and RES of viewports, exactly as the original wrote them."""

from __future__ import annotations

import math

from usarsim_server.protocol.messages import CameraItem, camera_configuration, viewports_result
from usarsim_server.protocol.values import Dialect

USUAL, NARROW, WIDE = (math.radians(angle) for angle in (80.0, 20.0, 120.0))


def test_exact_udk_form() -> None:
    """138: the composed example of side channels reference 2.10, without blanks inside."""
    item = CameraItem(
        name="Camera",
        offset=(320, 0),
        default_fov=USUAL,
        min_fov=NARROW,
        max_fov=WIDE,
        fov=USUAL,
    )
    assert camera_configuration(Dialect.UDK, "Camera", [item]) == (
        "CONF {Type Camera} {Name Camera}{TextureOffsetX 320}{TextureOffsetY 0}"
        "{TextureResolutionX 320}{TextureResolutionY 240}{CameraDefFov 80.0000}"
        "{CameraMinFov 20.0000}{CameraMaxFov 120.0000}{CameraFov 80.0000}"
    )


def test_exact_ut2004_form() -> None:
    """138, 9: radians, one blank between any two segments, no tiles."""
    line = camera_configuration(Dialect.UT2004, "Camera", [CameraItem(name="A")] * 2)
    one = "{Name A} {CameraDefFov 1.3963} {CameraMinFov 0.3491} {CameraMaxFov 2.0944}"
    assert line == f"CONF {{Type Camera}} {one} {{CameraFov 1.3963}} {one} {{CameraFov 1.3963}}"


def test_nothing_without_cameras() -> None:
    """7: no camera, no line."""
    assert camera_configuration(Dialect.UDK, "Camera", []) == ""


def test_viewports_result_with_configuration() -> None:
    """Side channels reference 2.11: status after Config and after each viewport."""
    viewports = [("Camera2", True), *[("Disabled", True)] * 3]
    assert viewports_result(12.34, viewports, ("SingleView", True)) == (
        "RES {Time 12.34} {Type Viewports} {Config SingleView} {Status OK} {Viewport1 Camera2} "
        "{Status OK} {Viewport2 Disabled} {Status OK} {Viewport3 Disabled} {Status OK} "
        "{Viewport4 Disabled} {Status OK}"
    )
