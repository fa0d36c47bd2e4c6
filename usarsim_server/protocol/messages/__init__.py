"""Everything the server says: one function per kind of line, plain values in, text out.

All functions return one line without its end; an empty text means that nothing is to be sent.
`encode` turns a line into the bytes of one write. Between any two segments there is exactly one
blank, also where the original glued them (protocol reference 1.3); only the configuration of
cameras in `udk` keeps the original's form.
"""

from usarsim_server.protocol.messages.actuators import (
    ActuatorItem,
    ActuatorLink,
    EffectorMount,
    actuator_configuration,
    actuator_geometry,
    actuator_status,
    effector_geometry,
    effector_status,
    gripper_item,
    mission_package_configuration,
    mission_package_geometry,
    tool_changer_item,
)
from usarsim_server.protocol.messages.avatars import (
    AvatarStatus,
    avatar_bones,
    avatar_status,
)
from usarsim_server.protocol.messages.cameras import CameraItem, camera_configuration
from usarsim_server.protocol.messages.machines import (
    legged_status,
    machine_configuration,
    machine_geometry,
    nautic_status,
)
from usarsim_server.protocol.messages.results import result, viewports_result
from usarsim_server.protocol.messages.sensors import (
    SensorMount,
    configuration,
    sensor_geometry,
    sensor_line,
)
from usarsim_server.protocol.messages.text import encode
from usarsim_server.protocol.messages.vehicles import (
    AerialStatus,
    GroundStatus,
    aerial_status,
    ground_configuration,
    ground_geometry,
    ground_status,
    static_configuration,
    static_geometry,
    static_status,
)
from usarsim_server.protocol.messages.world import (
    closest_path_node,
    die,
    greeting,
    path_nodes,
    start_poses,
    status_change,
    tick,
)
from usarsim_server.protocol.messages.world_objects import ObjectStatus, object_status

__all__ = [
    "ActuatorItem",
    "ActuatorLink",
    "AerialStatus",
    "AvatarStatus",
    "CameraItem",
    "EffectorMount",
    "GroundStatus",
    "ObjectStatus",
    "SensorMount",
    "actuator_configuration",
    "actuator_geometry",
    "actuator_status",
    "aerial_status",
    "avatar_bones",
    "avatar_status",
    "camera_configuration",
    "closest_path_node",
    "configuration",
    "die",
    "effector_geometry",
    "effector_status",
    "encode",
    "greeting",
    "gripper_item",
    "ground_configuration",
    "ground_geometry",
    "ground_status",
    "legged_status",
    "machine_configuration",
    "machine_geometry",
    "mission_package_configuration",
    "mission_package_geometry",
    "nautic_status",
    "object_status",
    "path_nodes",
    "result",
    "sensor_geometry",
    "sensor_line",
    "start_poses",
    "static_configuration",
    "static_geometry",
    "static_status",
    "status_change",
    "tick",
    "tool_changer_item",
    "viewports_result",
]
