"""A client of the protocol, for programs that drive robots; asynchronous, and the same waiting.

    async with connect("127.0.0.1", 3000) as server:
        robot = await server.spawn("P3AT", start="RobotStart1")
        await robot.drive(left=1.0, right=1.0)
        async for scan in robot.scans():
            ...

`connect_blocking` has the same calls for programs without an event loop. Values are typed, in m,
rad, s and the frame of the wire, alike in both dialects; `frames` converts to that of ROS. See
docs/client.md.

Below that is a layer for who tests or measures a server, and wants its bytes: `Connection` and
`BlockingConnection`, whose `Inbox` knows no sockets; `RobotState` makes values of lines.
"""

from usarsim_client.blocking import BlockingConnection
from usarsim_client.cameras import Pictures
from usarsim_client.connection import Connection
from usarsim_client.decoder import Value, decode
from usarsim_client.depth import DepthPicture
from usarsim_client.inbox import HangupError, Inbox, Line, ProtocolError, command
from usarsim_client.link import NameTakenError, NoAnswerError, Retry, SpawnError
from usarsim_client.pictures import FULL_FRAME, Picture, rectangle
from usarsim_client.robot import Robot
from usarsim_client.scene import Poses, Present, Scene, SceneReader, connect_scene
from usarsim_client.server import Server, connect
from usarsim_client.side_channels import (
    Actor,
    GroundTruthPort,
    Position,
    Radio,
    RadioError,
    TruthPort,
    actor,
    road,
)
from usarsim_client.state import RobotState
from usarsim_client.streams import Stream
from usarsim_client.waiting import BlockingRobot, BlockingServer, connect_blocking
from usarsim_client.world import Avatar, WorldController
from usarsim_server.base.closing import Closing

__all__ = [
    "FULL_FRAME",
    "Actor",
    "Avatar",
    "BlockingConnection",
    "BlockingRobot",
    "BlockingServer",
    "Closing",
    "Connection",
    "DepthPicture",
    "GroundTruthPort",
    "HangupError",
    "Inbox",
    "Line",
    "NameTakenError",
    "NoAnswerError",
    "Picture",
    "Pictures",
    "Poses",
    "Position",
    "Present",
    "ProtocolError",
    "Radio",
    "RadioError",
    "Retry",
    "Robot",
    "RobotState",
    "Scene",
    "SceneReader",
    "Server",
    "SpawnError",
    "Stream",
    "TruthPort",
    "Value",
    "WorldController",
    "actor",
    "command",
    "connect",
    "connect_blocking",
    "connect_scene",
    "decode",
    "rectangle",
    "road",
]
