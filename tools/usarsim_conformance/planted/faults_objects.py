"""Faults of world controllers' objects and of avatars."""

from usarsim_conformance.planted.faults import plant

_WORLD = "usarsim_server/sessions/world_controller.py"
_TOLD = "usarsim_server/protocol/messages/world.py"
_WALKER = "usarsim_server/sessions/avatar.py"
_AVATARS = "usarsim_server/protocol/messages/world.py"

plant(
    "objects.create.rotation",
    _WORLD,
    '_vector(request, "Location") or zero, _vector(request, "Rotation") or zero\n',
    '_vector(request, "Location") or zero, zero\n',
    notices=("control.world.poses", "control.world.seen"),
    field="Rotation",
)
plant(
    "objects.create.y-sign",
    _WORLD,
    '_vector(request, "Location") or zero, _vector(request, "Rotation") or zero\n',
    "(lambda x, y, z: (x, -y, z))(*(_vector(request, 'Location') or zero)),"
    ' _vector(request, "Rotation") or zero\n',
    notices=("control.world.poses", "control.world.seen"),
    field="Location",
)
plant(
    "objects.create.memory",
    _WORLD,
    'memory=request.get("Memory") or "",',
    'memory="",',
    notices="control.world.poses",
    field="Memory",
)
plant(
    "objects.create.scale",
    _WORLD,
    'scale=_scale(_vector(request, "Scale")),',
    "scale=_scale(None),",
    notices="control.world.poses",
    field="Size",
)
plant(
    "objects.create.physics",
    _WORLD,
    'physics=_physics(request.get("Physics")),',
    "physics=Physics.NONE,",
    notices="control.world.physics",
    field="RigidBody",
)
plant(
    "objects.create.material",
    _WORLD,
    'material=request.get("Material") or None,',
    'material={"Red": "Blue", "Blue": "Red"}.get(request.get("Material") or ""),',
    notices="images.content.colours",
    field="red and blue",
    dialect="udk",
)
for _key, _bad in (
    ("x", "(-location[0], location[1], location[2])"),
    ("y", "(location[0], -location[1], location[2])"),
    ("z", "(location[0], location[1], -location[2])"),
):
    plant(
        f"objects.status.{_key}-sign",
        _WORLD,
        "location=location,",
        f"location={_bad},",
        notices="control.world.poses",
        field="Location",
    )
for _key, _bad in (
    ("roll", "(-rotation[0], rotation[1], rotation[2])"),
    ("pitch", "(rotation[0], -rotation[1], rotation[2])"),
    ("yaw", "(rotation[0], rotation[1], -rotation[2])"),
):
    plant(
        f"objects.status.{_key}-sign",
        _WORLD,
        "rotation=rotation,\n                        memory",
        f"rotation={_bad},\n                        memory",
        notices="control.world.poses",
        field="Rotation",
    )
plant(
    "objects.status.size",
    _TOLD,
    "[abs(extent) for extent in one.size]",
    "[abs(extent) / 2.0 for extent in one.size]",
    notices="control.world.poses",
    field="Size",
)
plant(
    "objects.abs-move.rotation",
    _WORLD,
    "turned if rotation is None else rotation",
    "turned",
    notices=("control.world.poses", "control.world.robots"),
    field="Rotation",
)
plant(
    "objects.abs-move.location",
    _WORLD,
    "here if location is None else location,",
    "here if location is None else location[:2] + here[2:],",
    notices="control.world.poses",
    field="Location",
)
plant(
    "objects.rel-move.location-sign",
    _WORLD,
    "_sum(here, location)",
    "_sum(here, (location[0], -location[1], location[2]))",
    notices=("control.world.poses", "control.world.robots"),
    field="Location",
)
plant(
    "objects.rel-move.rotation",
    _WORLD,
    "_sum(turned, rotation)",
    "turned",
    notices=("control.world.poses", "control.world.robots"),
    field="Rotation",
)
plant(
    "objects.rotate.sign",
    _WORLD,
    'rates = _vector(request, "Speed") or (0.0, 0.0, 0.0)',
    'rates = tuple(-one for one in _vector(request, "Speed") or (0.0, 0.0, 0.0))',
    notices="control.world.rotates",
    field="Speed",
)
plant(
    "objects.rotate.order",
    _WORLD,
    'rates = _vector(request, "Speed") or (0.0, 0.0, 0.0)',
    'rates = (_vector(request, "Speed") or (0.0, 0.0, 0.0))[::-1]',
    notices="control.world.rotates",
    field="Rotate about axis",
)
plant(
    "objects.path.speed",
    _WORLD,
    'speed=_number(request, "Speed"),',
    'speed=2.0 * (_number(request, "Speed") or 0.5),',
    notices="control.world.path",
    field="Speed",
)
plant(
    "objects.path.y-sign",
    _WORLD,
    "points = [flip_point(_triple(text))",
    "points = [_triple(text)",
    notices="control.world.path",
    field="Location|way points",
)
plant(
    "objects.path.loop",
    _WORLD,
    'loop=_boolean(request, "Loop"),',
    "loop=False,",
    notices="control.world.path",
    field="Loop",
)
plant(
    "objects.status.off",
    _WORLD,
    "location, rotation = wire_from_pose(pose)\n                entries",
    "location, rotation = wire_from_pose(pose)\n"
    "                location = _sum(location, (0.5, 0.0, 0.0))\n                entries",
    notices="control.world.poses",
    field="Location",
)

# Avatars.

plant(
    "avatars.status.y-sign",
    _AVATARS,
    'triple("Location", status.location, _COARSE)',
    'triple("Location", (status.location[0], -status.location[1], status.location[2]), _COARSE)',
    notices="control.avatar.walks",
    field="Location",
)
plant(
    "avatars.status.yaw-sign",
    _AVATARS,
    'triple("Orientation", status.orientation, _COARSE)',
    'triple("Orientation", [-one for one in status.orientation], _COARSE)',
    notices="control.avatar.faces",
    field="Orientation",
)
plant(
    "avatars.status.walking",
    _AVATARS,
    'flag("Walking", status.walking)',
    'flag("Walking", not status.walking)',
    notices="control.avatar.status",
    field="Walking",
)
plant(
    "avatars.run-walks",
    _WALKER,
    "return _Manner(kind.run_speed, RUNNING)",
    "return _Manner(kind.walk_speed, RUNNING)",
    notices="control.avatar.walks",
    field="Run",
)
plant(
    "avatars.backward-faces-ahead",
    _WALKER,
    "heading += math.pi",
    "heading += 0.0",
    notices="control.avatar.faces",
    field="Orientation",
)
