"""What robots say to the wireless simulation server, and its answers (side channels reference 4).

Lines like `GETSS {Robot ComStation}`; verbs and keys are case-sensitive, every request gets one
line back. Requests are read leniently, replies are spelt exactly, mistakes of spelling included.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import StrEnum

from usarsim_server.protocol.values import LONGEST_NAME, clean_name

MAX_LINE = 100 * 1024
"""Longest line in bytes: the buffer of the original (side channels 4.1)."""

MOST_PORTS = 256
"""Ports that a robot may say it listens on; the original set no limit, clients name one or two."""

INIT_OK = "INITREPLY {Status OK}"


class Reason(StrEnum):
    """Why a request is refused, in the words of side channels 4.2."""

    INIT_FIRST = "Must.Use.INIT.Method.First"
    PORTS = "Ports.List.Must.Be.Integer"
    NO_NAME = "Robot.Name.Must.Not.Be.Empty"
    NAME_TAKEN = "Robot.Alread.Exists"
    PORT = "Port.Must.Be.Integer"
    NO_PORT_LEFT = "Could.Not.Allocate.Port"
    UNKNOWN = "Method.Unknown.Or.Can.INIT.only.once"


_VERB = re.compile(r"[^\s{}]*")
_GROUP = re.compile(r"\{\s*([^\s{}]+)\s*([^{}]*)\}")
_PORT = re.compile(r"[0-9]{1,5}")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_TRUTH_VERBS = frozenset({"GETPOS", "GETOBS"})


@dataclass(frozen=True, slots=True)
class Request:
    """One line of a robot."""

    verb: str  # as it was sent; empty if the line has none
    robot: str = ""  # value of Robot, empty if there is none
    ports: tuple[int, ...] = ()  # of an INIT, in their order
    port: int | None = None  # of DNS and REVERSEDNS; None if it was left out
    error: Reason | None = None  # what is wrong with the arguments, or None


def parse_request(line: bytes) -> Request:
    """Read one line without its end; never raises. Bytes are taken as Latin-1.

    Names are cleaned as those of the robots are (see `names`); one that is too long is none.
    """
    text = _text(line)
    verb = _VERB.match(text)
    assert verb is not None  # the pattern matches the empty string
    groups: dict[str, str] = {}
    for key, value in _GROUP.findall(text, verb.end()):
        groups.setdefault(key, value.strip())
    robot = clean_name(groups.get("Robot", ""))
    if len(robot) > LONGEST_NAME:
        return Request(verb[0], error=Reason.NO_NAME)
    match verb[0]:
        case "INIT":
            return _init(robot, groups.get("Port", ""))
        case "DNS":
            given = groups.get("Port")
            port = None if given is None else _port(given)
            wrong = given is not None and port is None
            return Request("DNS", robot, port=port, error=Reason.PORT if wrong else None)
        case "REVERSEDNS":
            port = _port(groups.get("Port", ""))
            return Request("REVERSEDNS", port=port, error=Reason.PORT if port is None else None)
        case other:
            return Request(other, robot)


def asks_for_ground_truth(line: bytes) -> bool:
    """Whether a line is one of those that simulators answer (side channels 3.2, 3.3), in any
    case."""
    verb = _VERB.match(_text(line))
    return verb is not None and verb[0].upper() in _TRUTH_VERBS


def encode(reply: str) -> bytes:
    """The bytes of a reply, line end included."""
    return reply.encode("latin-1", "replace") + b"\r\n"


def error_reply(reason: Reason) -> str:
    """A request that is refused."""
    return f"ERROR {{Reason {reason.value}}}"


def strength_reply(robot: str, strength: float, *, oneself: bool = False) -> str:
    """Answer to GETSS about a registered robot.

    Args:
        robot: as the request spelt it.
        strength: dBm. What is not a number or positive counts as a failure of the model
        (side channels 4.2), and
            so does minus infinity, for which the original has no word.
        oneself: the robot asked about itself.
    """
    if oneself:
        return f"SS {{Robot {robot}}} {{Strength INF}} {{Error SS.To.Self}}"
    if strength == math.inf:
        return f"SS {{Robot {robot}}} {{Strength INF}} {{Error Model.Returned.INF}}"
    if not -math.inf < strength <= 0.0:
        return f"SS {{Robot {robot}}} {{Strength NaN}} {{Error Model.Returned.NaN}}"
    return f"SS {{Robot {robot}}} {{Strength {strength + 0.0:.6g}}}"


def unknown_robot_reply(robot: str) -> str:
    """Answer to GETSS about a robot that is not registered."""
    return f"SS {{Robot {robot}}} {{Strength NaN}} {{Error Robot.Does.Not.Exist}}"


def port_reply(robot: str, port: int) -> str:
    """Answer to DNS: the port that leads to a robot."""
    return f"DNSREPLY {{Robot {robot}}} {{Port {port}}}"


def no_port_reply(robot: str, *, known: bool) -> str:
    """Answer to DNS without a port: the robot is unknown, or does not listen on the one named."""
    error = "RobotDoesNotListenOnThisPort" if known else "NoSuchRobot"
    return f"DNSREPLY {{Robot {robot}}} {{Port -1}} {{Error {error}}}"


def owner_reply(port: int, robot: str) -> str:
    """Answer to REVERSEDNS: who is behind a connection."""
    return f"REVERSEDNSREPLY {{Port {port}}} {{Robot {robot}}}"


def no_owner_reply(port: int) -> str:
    """Answer to REVERSEDNS: no connection of the asking robot comes from this port."""
    return f"REVERSEDNSREPLY {{Port {port}}} {{Error UnknownOrIllegalPort}}"


def _text(line: bytes) -> str:
    return line.removeprefix(_BYTE_ORDER_MARK).decode("latin-1").strip()


def _init(robot: str, ports: str) -> Request:
    texts = [part.strip() for part in ports.split(",") if part.strip()]
    numbers = [port for port in map(_port, texts[: MOST_PORTS + 1]) if port is not None]
    if len(numbers) < len(texts) or len(numbers) > MOST_PORTS:
        return Request("INIT", robot, error=Reason.PORTS)
    error = None if robot else Reason.NO_NAME
    return Request("INIT", robot, tuple(numbers), error=error)


def _port(text: str) -> int | None:
    if not _PORT.fullmatch(text):
        return None
    number = int(text)
    return number if number <= 65535 else None
