"""Faults of the angle of view that cameras tell."""

from usarsim_conformance.planted.faults import plant

_MOUNT = "usarsim_server/sessions/cameras.py"
_MESSAGE = "usarsim_server/protocol/messages/sensors.py"
_ZOOM = "control.values.camera-zoom"

plant(
    "sensors.camera.zoom-unlimited",
    _MOUNT,
    "return min(max(wanted, camera.min_fov), camera.max_fov) if wanted else camera.fov",
    "return wanted or camera.fov",
    notices=_ZOOM,
    field="CameraFov",
)
plant(
    "sensors.camera.zoom-no-default",
    _MOUNT,
    "camera.max_fov) if wanted else camera.fov",
    "camera.max_fov)",
    notices=_ZOOM,
    field="CameraFov",
)
plant(
    "sensors.camera.limits-degrees",
    _MESSAGE,
    'number("CameraMaxFov", camera.max_fov * unit, _DIGITS)',
    'number("CameraMaxFov", camera.max_fov * 57.29578, _DIGITS)',
    notices=_ZOOM,
    field="CameraFov",
)
plant(
    "sensors.camera.fov-halved",
    _MESSAGE,
    'number("CameraFov", camera.fov * unit, _DIGITS)',
    'number("CameraFov", 0.5 * camera.fov * unit, _DIGITS)',
    notices=_ZOOM,
    field="CameraFov",
)
