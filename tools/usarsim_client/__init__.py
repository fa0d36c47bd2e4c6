"""A client of the protocol: connections, lines, pictures, and what the side channels answer.

    async with asyncio.timeout(10):
        control = await Connection.open("127.0.0.1", 3000)
        await control.send(command("GETSTARTPOSES"))
        poses = await control.line("NFO {StartPoses")

`BlockingConnection` has the same methods for programs without an event loop. Both keep what has
come in an `Inbox`, which knows no sockets.
"""

from usarsim_client.blocking import BlockingConnection, Closing
from usarsim_client.connection import Connection
from usarsim_client.inbox import HangupError, Inbox, Line, ProtocolError, command
from usarsim_client.pictures import FULL_FRAME, Picture, rectangle
from usarsim_client.services import Actor, actor, road

__all__ = [
    "FULL_FRAME",
    "Actor",
    "BlockingConnection",
    "Closing",
    "Connection",
    "HangupError",
    "Inbox",
    "Line",
    "Picture",
    "ProtocolError",
    "actor",
    "command",
    "rectangle",
    "road",
]
