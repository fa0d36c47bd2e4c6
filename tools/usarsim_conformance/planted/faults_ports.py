"""Faults of ground truth, wireless simulation, truth port, pictures and the angle of view that
cameras tell."""

from usarsim_conformance.planted.faults import plant

_GROUND = "usarsim_server/truth/ground_truth.py"
_RADIO = "usarsim_server/radio/models.py"
_TRUTH = "usarsim_server/protocol/truth.py"
_JPEG = "usarsim_server/cameras/encoding.py"
_LENS = "usarsim_server/sessions/cameras.py"
_PLACE = "flip_point(station.position)"

for _key, _bad in (
    ("x", "tuple(a * b for a, b in zip(flip_point(station.position), (-1, 1, 1)))"),
    ("y", "tuple(a * b for a, b in zip(flip_point(station.position), (1, -1, 1)))"),
    ("z", "tuple(a * b for a, b in zip(flip_point(station.position), (1, 1, -1)))"),
):
    plant(
        f"ports.getpos.{_key}-sign",
        _GROUND,
        _PLACE,
        _bad,
        notices="groundtruth.getpos.exact",
        field=f"{_key} of Location",
        robot="P2AT",
    )
plant(
    "ports.getpos.off",
    _GROUND,
    _PLACE,
    "tuple(one + 0.1 for one in flip_point(station.position))",
    notices="groundtruth.getpos.exact",
    field="of Location",
)
plant(
    "ports.getpos.battery",
    _GROUND,
    "station.battery_empty)",
    "False)",
    notices="groundtruth.getpos.battery-empty",
    field="BatteryEmpty",
)
plant(
    "ports.getobs.z-sign",
    _GROUND,
    "ends = flip_point(query.start_point), flip_point(query.end_point)",
    "ends = query.start_point, query.end_point",
    notices="groundtruth.getobs.ground",
    field="obstacles",
)
plant(
    "ports.getobs.count",
    "usarsim_server/protocol/truth.py",
    "{{ObstCount {count}.0000}}",
    "{{ObstCount {count + 1}.0000}}",
    notices="groundtruth.getobs.free-air",
    field="obstacles",
)
plant(
    "ports.radio.exponent",
    _RADIO,
    "self.reference_power - 10.0 * self.path_loss_exponent",
    "self.reference_power - 20.0 * self.path_loss_exponent",
    notices="wireless.getss.distance",
    field="Strength",
)
plant(
    "ports.radio.sign",
    _RADIO,
    "self.reference_power - 10.0 * self.path_loss_exponent",
    "self.reference_power + 10.0 * self.path_loss_exponent",
    notices="wireless.getss.distance",
    field="Strength",
)
plant(
    "ports.radio.power",
    _RADIO,
    "default=-49.67",
    "default=-39.67",
    notices="wireless.getss.distance",
    field="Strength",
)
plant(
    "ports.radio.reference",
    _RADIO,
    "reference_distance: float = field(default=2.0",
    "reference_distance: float = field(default=1.0",
    notices="wireless.getss.distance",
    field="Strength",
)
plant(
    "ports.radio.logarithm",
    _RADIO,
    "math.log10(distance / self.reference_distance)",
    "math.log(distance / self.reference_distance)",
    notices="wireless.getss.distance",
    field="Strength",
)
for _number, _key in enumerate("xyz"):
    _signs = tuple(-1.0 if one == _number else 1.0 for one in range(3))
    plant(
        f"ports.truth.{_key}-sign",
        _TRUTH,
        "{_vector(actor.location)}",
        f"{{_vector([a * b for a, b in zip(actor.location, {_signs})])}}",
        notices="truth.listing.poses",
        field=f"{_key} of Location",
    )
for _number, _key in enumerate(("roll", "pitch", "yaw")):
    _signs = tuple(-1.0 if one == _number else 1.0 for one in range(3))
    plant(
        f"ports.truth.{_key}-sign",
        _TRUTH,
        "{_vector(actor.rotation)}",
        f"{{_vector([a * b for a, b in zip(actor.rotation, {_signs})])}}",
        notices=("truth.listing.poses", "truth.listing.objects"),
        field=f"{_key} of Rotation|Rotation is",
    )
plant(
    "ports.truth.time",
    _TRUTH,
    "{_rounded(time, 4)}",
    "{_rounded(time + 5.0, 4)}",
    notices="truth.listing.exact-time",
    field="Time",
)

# Pictures.

plant(
    "ports.images.mirrored",
    _JPEG,
    "cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)",
    "cv2.cvtColor(pixels[:, ::-1].copy(), cv2.COLOR_RGB2BGR)",
    notices="images.content.left-right",
    field="mirrored",
    dialect="udk",
)
plant(
    "ports.images.upside-down",
    _JPEG,
    "cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)",
    "cv2.cvtColor(pixels[::-1].copy(), cv2.COLOR_RGB2BGR)",
    notices="images.content.top-bottom",
    field="upside down",
    dialect="udk",
)
plant(
    "ports.images.colours",
    _JPEG,
    "cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)",
    "pixels",
    notices="images.content.colours",
    field="red and blue",
    dialect="udk",
)
plant(
    "ports.images.fov-told",
    _LENS,
    "fov=angle(fov),",
    "fov=angle(0.8 * fov),",
    notices="images.content.fov",
    field="CameraFov",
    dialect="udk",
)
plant(
    "ports.images.zoom-ignored",
    "usarsim_server/cameras/painter.py",
    "Eye(pose, view.fov, width, height)",
    "Eye(pose, 1.3963, width, height)",
    notices="images.content.fov",
    field="after SET FOV",
    dialect="udk",
)
plant(
    "ports.images.fov-vertical",
    "usarsim_server/cameras/view.py",
    "return math.tan(self.fov / 2.0)",
    "return math.tan(self.fov / 2.0) * self.width / self.height",
    notices="images.content.fov",
    field="CameraFov",
    dialect="udk",
)
plant(
    "ports.images.mount-axis",
    "usarsim_server/actuators/base.py",
    "roll = math.atan2(-y, z)",
    "roll = math.atan2(y, z)",
    notices="images.camera.mount",
    field="[Ll]ink 2",
    dialect="udk",
)


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
