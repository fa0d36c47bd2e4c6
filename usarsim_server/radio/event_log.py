"""The record of a wireless simulation, one event a line, for analysis afterwards.

Comma-separated, as the original wrote it (side channels reference 4.6): event, local time, names,
then what belongs to the event; simulated time (s) comes last. Names that hold commas are quoted.

    REGISTERED,2026-01-31 12:00:00.125,Robot1,192.168.0.11,3333;2323,12.340
    IN_RANGE,2026-01-31 12:00:00.250,ComStation,Robot1,-56.6597,10.000,12.464
    DATA_SENT,2026-01-31 12:00:01.250,Robot1,ComStation,4096,13.460
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO

from usarsim_server.base.csv_files import CsvWriter
from usarsim_server.base.errors import SettingsError, at
from usarsim_server.base.logs import Log


class Event(StrEnum):
    """What can happen; the fields between time and simulated time are told for each."""

    REGISTERED = "REGISTERED"
    """Name, address, ports joined by semicolons."""
    DEREGISTERED = "DEREGISTERED"
    """Name."""
    OUT_OF_BATTERY = "OUT_OF_BATTERY"
    """Name."""
    OUT_OF_RANGE = "OUT_OF_RANGE"
    """Both names, strength in dBm, distance in m."""
    IN_RANGE = "IN_RANGE"
    """Both names, strength in dBm, distance in m."""
    CON_ESTABLISHED = "CON_ESTABLISHED"
    """Name of the source and of the target, address and port of the target."""
    CON_TERMINATED = "CON_TERMINATED"
    """As CON_ESTABLISHED."""
    DATA_SENT = "DATA_SENT"
    """Name of the sender and of the receiver, bytes since the last such line."""


_LONGEST = 65536
"""Characters after which lines are handed over to the system without being asked to."""


class EventLog:
    """Writes events to a file; without one it does nothing. For one thread."""

    def __init__(
        self,
        path: Path | None,
        clock: Callable[[], float],
        now: Callable[[], datetime] = datetime.now,
    ) -> None:
        """Open the file; an old one is replaced.

        Args:
            path: a file, or a folder, in which a file is then named like those of the original,
                `log-<date>-<time>.txt`; None for no record.
            clock: simulated time, s.
            now: local time.

        Raises:
            SettingsError: if it cannot be written.
        """
        self._clock = clock
        self._now = now
        self._file: BinaryIO | None = None
        self._pending = io.StringIO(newline="")
        self._rows = CsvWriter(self._pending)
        self._size = 0
        if path is not None:
            self._file = _open(path, now())

    @property
    def recording(self) -> bool:
        """Whether anything is written."""
        return self._file is not None

    def write(self, event: Event, *fields: object) -> None:
        """Add a line; numbers that are no whole ones are printed with six digits."""
        if self._file is None:
            return
        stamp = self._now().isoformat(sep=" ", timespec="milliseconds")
        texts = [f"{one:.6g}" if isinstance(one, float) else one for one in fields]
        self._rows.row([event, stamp, *texts, f"{self._clock():.3f}"])
        if self._pending.tell() >= _LONGEST:
            self.flush()

    def flush(self) -> None:
        """Hand over to the system what was written.

        A full disk ends the record, not the server; its last line is whole.
        """
        if self._file is None or not self._pending.tell():
            return
        data = self._pending.getvalue().encode(errors="replace")
        self._pending.seek(0)
        self._pending.truncate()
        written = 0
        try:
            while written < len(data):
                written += self._file.write(data[written:])
        except OSError as error:
            Log("wireless").warning("the record of events ends here", reason=error.strerror)
            with contextlib.suppress(OSError):
                self._file.truncate(self._size + data.rfind(b"\n", 0, written) + 1)
            self._file.close()
            self._file = None
        self._size += written

    def close(self) -> None:
        """End the record."""
        self.flush()
        if self._file is not None:
            self._file.close()
            self._file = None


def _open(path: Path, now: datetime) -> BinaryIO:
    if path.is_dir():
        stamp = now.strftime("%Y.%m.%d-%H.%M.%S.") + f"{now.microsecond // 1000:03d}"
        path = path / f"log-{stamp}.txt"
    try:
        return path.open("wb", buffering=0)
    except OSError as error:
        cure = "name a file in a folder that exists and may be written"
        raise SettingsError(at(path, f"cannot be written: {error.strerror}", cure)) from None
