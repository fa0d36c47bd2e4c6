"""The file of a recorded session, one JSON object per line, a header first; and its clock.

The header names format, time and links; every further line is an event:

    {"t": 1.25, "connection": 1, "event": "data", "from": "client", "text": "GETPOS\r\n"}

Bytes that are printable ASCII with line ends stand as `text`, all others as `base64`. Lines are
written as things happen, each handed over to the system whole before what it tells of is passed
on, so what was recorded survives the end of everybody involved. A last line that is cut off is
passed over by the reader; where the disk is full, the file ends with the last whole one.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
import json
import re
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from usarsim_server.base.addresses import format_address, split_address
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import open_regular, reason
from usarsim_server.base.toml import decoded
from usarsim_server.protocol.json_text import parse_json

FORMAT = 1
CLIENT, SERVER = "client", "server"

OPEN, DATA, END, RESET, REFUSED = "open", "data", "end", "reset", "refused"
"""Events: a client connects; bytes; end of file of one side; a reset by one side; the server was
not there."""

_PLAIN = re.compile(rb"[\t\r\n -~]*")


class RecordError(Exception):
    """A recording cannot be made or read; the text names place and cure."""


@dataclass(frozen=True, slots=True)
class Link:
    """One port of the server, and the port where the proxy stands in for it.

    Attributes:
        listen: port of the proxy.
        host: of the server. port: likewise.
    """

    listen: int
    host: str
    port: int

    @classmethod
    def parse(cls, listen: int, to: str) -> Link:
        """From a port and `HOST:PORT`.

        Raises:
            ValueError: if it is not of that form.
        """
        host, port = split_address(to)
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise ValueError(f"{to!r} is not of the form HOST:PORT")
        if not 0 <= listen < 65536:
            raise ValueError(f"{listen} is no port")
        return cls(listen, host, int(port))


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened on a connection."""

    time: float  # s since the recording began
    connection: int  # number of the connection, from 1
    kind: str  # `open`, `data`, `end`, `reset` or `refused`
    side: str = CLIENT  # who did it, `client` or `server`
    data: bytes = b""  # bytes of `data`
    link: int = 0  # index of the link, of `open`


@dataclass(frozen=True, slots=True)
class Recording:
    """A whole session."""

    links: tuple[Link, ...]  # ports that were recorded
    taken: str  # when, as text
    events: tuple[Event, ...]  # in their order

    @property
    def connections(self) -> dict[int, int]:
        """Link of each connection by its number."""
        return {one.connection: one.link for one in self.events if one.kind == OPEN}

    @property
    def seconds(self) -> float:
        """Time of the last event."""
        return self.events[-1].time if self.events else 0.0


class Writer:
    """Writes events as they happen; any thread may use it.

    Attributes:
        count: events written.
    """

    def __init__(self, file: BinaryIO, links: Sequence[Link]) -> None:
        """Write the header.

        Args:
            file: to write to, opened without a buffer.
            links: ports that are recorded.

        Raises:
            OSError: if the disk is full, for example.
        """
        self._file = file
        self._size = 0
        self._begun = time.monotonic()
        self._lock = threading.Lock()
        self.count = 0
        header = {
            "usarsim_recording": FORMAT,
            "taken": datetime.now(UTC).isoformat(timespec="seconds"),
            "links": [
                {"listen": one.listen, "to": format_address(one.host, one.port)} for one in links
            ],
        }
        self._write(header)

    def add(
        self, connection: int, kind: str, side: str = CLIENT, data: bytes = b"", link: int = 0
    ) -> None:
        """Write an event of this moment.

        Raises:
            OSError: if the disk is full, for example.
        """
        line: dict[str, Any] = {
            "t": round(time.monotonic() - self._begun, 6),
            "connection": connection,
            "event": kind,
        }
        if kind == OPEN:
            line["link"] = link
        else:
            line["from"] = side
        if kind == DATA:
            if _PLAIN.fullmatch(data):
                line["text"] = data.decode("ascii")
            else:
                line["base64"] = base64.b64encode(data).decode("ascii")
        self._write(line)
        self.count += 1

    def _write(self, line: dict[str, Any]) -> None:
        data = json.dumps(line, separators=(", ", ": ")).encode("ascii") + b"\n"
        with self._lock:
            written = 0
            try:
                while written < len(data):
                    written += self._file.write(data[written:])
            except OSError:
                with contextlib.suppress(OSError):
                    self._file.truncate(self._size)
                raise
            self._size += written


def read(path: Path) -> Recording:
    """Read a recording.

    Raises:
        RecordError: if the file cannot be read or is no recording; names the line.
    """
    try:
        with open_regular(path) as file:
            texts = decoded(file.read(), path, UsarsimError).split("\n")
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {reason(error)}") from None
    except UsarsimError as error:
        raise RecordError(str(error)) from None
    links, taken = _header(path, texts[0])
    events: list[Event] = []
    known: set[int] = set()
    for number, text in enumerate(texts[1:], start=2):
        if not text:
            continue
        try:
            event = _event(parse_json(text))
            _check(event, known, len(links))
        except (ValueError, KeyError, TypeError, OverflowError, binascii.Error) as error:
            if number == len(texts):
                break  # cut off: whoever wrote it was killed
            what = f"no {error}" if isinstance(error, KeyError) else str(error)
            raise RecordError(f"{path}: line {number}: is no event ({what})") from None
        events.append(event)
    return Recording(links, taken, tuple(events))


def _header(path: Path, text: str) -> tuple[tuple[Link, ...], str]:
    try:
        header = parse_json(text)
        version = header["usarsim_recording"]
        if version != FORMAT:
            raise RecordError(
                f"{path}: has format {version!r}, this program reads {FORMAT}: use the version of "
                "usarsim that recorded it"
            )
        links = tuple(Link.parse(int(one["listen"]), str(one["to"])) for one in header["links"])
        return links, str(header["taken"])
    except (ValueError, KeyError, TypeError, OverflowError):
        raise RecordError(f"{path}: line 1: is no recording of `usarsim record`") from None


def _event(line: dict[str, Any]) -> Event:
    kind, side = str(line["event"]), str(line.get("from", CLIENT))
    if kind not in (OPEN, DATA, END, RESET, REFUSED) or side not in (CLIENT, SERVER):
        raise ValueError(f"{kind!r} from {side!r} is unknown")
    data = b""
    if kind == DATA:
        text = line.get("text")
        if text is None:
            data = base64.b64decode(line["base64"], validate=True)
        elif isinstance(text, str):
            data = text.encode("ascii")
        else:
            raise ValueError(f"text is {text!r}, no text")
    link = int(line["link"]) if kind == OPEN else 0
    return Event(float(line["t"]), int(line["connection"]), kind, side, data, link)


def _check(event: Event, known: set[int], links: int) -> None:
    if event.kind == OPEN:
        if not 0 <= event.link < links:
            raise ValueError(f"there is no link {event.link}")
        known.add(event.connection)
    elif event.connection not in known:
        raise ValueError(f"connection {event.connection} was never opened")


_TIME = re.compile(rb"\{Time (\d+\.?\d*)\}")
_CUT = 40
"""Bytes kept of a chunk: a time may go on in the next one."""


def time_told(data: bytes) -> float | None:
    """The last simulated time in some bytes, s; None without one."""
    found = _TIME.findall(data)
    return float(found[-1]) if found else None


@dataclass
class SessionClock:
    """How much simulated time was told on all connections together.

    While none is open that tells it, it stands still: how long nobody was there does not count.
    """

    elapsed: float | None = None  # s of simulated time since the first one told; None before
    telling: set[int] = field(default_factory=set)  # connections that are open and have told a time
    _zero: float = 0.0
    _rests: dict[int, bytes] = field(default_factory=dict)

    def hear(self, connection: int, data: bytes) -> bool:
        """Take what the server said; returns whether it told a time."""
        data = self._rests.get(connection, b"") + data
        told = time_told(data)
        self._rests[connection] = data[max(data.rfind(b"}") + 1, len(data) - _CUT) :]
        if told is None:
            return False
        if not self.telling:
            self.elapsed = self.elapsed or 0.0
            self._zero = told - self.elapsed
        self.telling.add(connection)
        assert self.elapsed is not None
        self.elapsed = max(self.elapsed, told - self._zero)
        return True

    def end(self, connection: int) -> None:
        """The connection has ended."""
        self.telling.discard(connection)


@dataclass(frozen=True, slots=True)
class Cue:
    """When a controller did something."""

    elapsed: float | None  # of a `SessionClock` before that; None if no time had been told
    pause: float  # s of wall time since anything happened, where no simulated time passed


def cues(events: Sequence[Event]) -> Iterator[Cue]:
    """For each event its cue; that of the server's events means nothing."""
    clock, latest = SessionClock(), 0.0
    for event in events:
        yield Cue(clock.elapsed, 0.0 if clock.telling else max(0.0, event.time - latest))
        latest = event.time
        if event.kind == DATA and event.side == SERVER:
            clock.hear(event.connection, event.data)
        elif event.kind in (END, RESET):
            clock.end(event.connection)
