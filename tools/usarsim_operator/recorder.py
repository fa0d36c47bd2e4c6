"""Records a session: one more page, which nobody sees, and what it is sent goes to a file.

So a recording holds what an instructor sees, at the rate of a page that is about no robot, and a
slow disk is a slow page: it gets rarer pictures and poses, and nobody waits for it. Beside that it
is told every text of a page that counts, and what the rules log. Texts of pages are left out first
where too many wait, those of viewers before all others.
"""

from __future__ import annotations

import asyncio
import datetime
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_operator import packets
from usarsim_operator.pages import MOST_BYTES, MOST_TEXTS, Page
from usarsim_operator.recording import Writer
from usarsim_operator.roles import Role
from usarsim_server import __version__
from usarsim_server.base.logs import Log
from usarsim_server.protocol.json_text import parse_json

if TYPE_CHECKING:
    from usarsim_client.scene import Present, Scene
    from usarsim_operator.station import Station

ID = 0
"""Of the page that records; others count from 1."""
STATE = 0.18
"""s between two `state` that are kept, at least."""
_LONGEST = 2000  # characters kept of a page's text
ROOM = 0.5
"""Part of the texts and bytes of an outbox that may wait; what comes beyond is left out, so that no
flood ends a recording."""
_INPUTS = {Role.VIEWER: ROOM / 4.0}  # the same for what pages say
_INPUT = ROOM / 2.0

_log = Log("console")


class Recorder(Page):
    """A page whose outbox is a file.

    Attributes:
        lost: texts that were left out because the disk did not keep up.
    """

    def __init__(self, station: Station, path: Path) -> None:
        """Begin a file.

        Raises:
            RecordingError: if it cannot be written.
        """
        greeting = station.server.greeting
        about = {
            "software": __version__,
            "taken": datetime.date.today().isoformat(),
            "level": "" if greeting is None else greeting.level,
            "gateway_clock": station.now,
        }
        self._writer = Writer(path, about)
        super().__init__(ID, "recording", Role.INSTRUCTOR, _Tape(station, self._writer), 0.0)
        self._station, self.lost = station, 0

    def tell(self, message: Mapping[str, object]) -> None:
        """Keep a text; while too many wait it is counted and left out."""
        self._keep(message, ROOM)

    def _keep(self, message: Mapping[str, object], share: float) -> None:
        """Keep a text, unless more than a share of what may wait does."""
        if len(self._texts) >= share * MOST_TEXTS or self._bytes >= share * MOST_BYTES:
            self.lost += 1
        else:
            super().tell(message)

    def note(self, kind: str, facts: Mapping[str, object]) -> None:
        """Keep that something happened: a lock, an alarm, an intervention."""
        station = self._station
        clocks = {"time": station.time, "gateway_clock": station.wall}
        self.tell({**facts, "type": kind, **clocks})

    def event(self, fields: Mapping[str, object]) -> None:
        """Nothing: it is told as the page that it is."""

    def input(self, page: Page, text: str, heard: float) -> None:
        """Keep what a page said, with all three clocks: its own stands in the text as `clock`."""
        said: object = text[:_LONGEST]
        if len(text) <= _LONGEST:
            try:
                said = parse_json(text)
            except ValueError:
                said = text
        facts = {"page": page.id, "role": page.role.value, "text": said}
        if (lockstep := self._station.lockstep) is not None:
            facts["tick"] = lockstep.tick
        told = {**facts, "type": "input", "time": self._station.time, "gateway_clock": heard}
        self._keep(told, _INPUTS.get(page.role, _INPUT))

    async def run(self) -> None:
        """Write until cancelled, or until the disk takes no more."""
        try:
            await self.send_all()
            why = "the disk is too slow"
        except OSError as error:
            why = str(error.strerror)
        self.close(f"{self._writer.path}: cannot be written any further: {why}")

    def close(self, why: str = "") -> None:
        """End the file."""
        if self._station.pages.pop(ID, None) is not None:
            self._station.look()
            self._writer.close()
        if why:
            _log.error(f"{why}; what was recorded before can be used")


class _Tape:
    """What a recorder's page takes for its socket."""

    def __init__(self, station: Station, writer: Writer) -> None:
        self._station, self._writer = station, writer
        self._state = float("-inf")
        self._scene: Scene | None = None
        self._present: Present | None = None
        self._told: set[str] = set()

    async def send_str(self, data: str, compress: int | None = None) -> None:
        """Append a text; returns when it is written."""
        now = self._station.now
        if data.startswith('{"type":"state"'):
            if now - self._state < STATE:
                return
            self._state = now
        await asyncio.to_thread(self._writer.text, now, data)

    async def send_bytes(self, data: bytes, compress: int | None = None) -> None:
        """Append a binary message; before poses, everything they refer to."""
        now = self._station.now
        if data[0] == packets.POSES:
            generation = struct.unpack_from("<I", data, packets.HEAD)[0]
            for text in self._needed(generation) or ():
                await asyncio.to_thread(self._writer.text, now, text)
            if self._present is None or self._present.generation != generation:
                return  # of somebody who has left meanwhile
        await asyncio.to_thread(self._writer.binary, now, data)

    def _needed(self, generation: int) -> list[str]:
        """Messages of the scene port that are new since the last poses."""
        link = self._station.scene
        reader = None if link is None else link.reader
        if link is None or reader is None or reader.present is None or reader.scene is None:
            return []
        if reader.present is self._present or reader.present.generation != generation:
            return []
        found: list[str] = []
        for table in (reader.textures, reader.meshes, reader.kinds):
            for id, message in table.items():
                key = f"{message['type']} {id}"
                if key not in self._told:
                    self._told.add(key)
                    found.append(json.dumps(message))
        if reader.scene is not self._scene:
            self._scene = reader.scene
            found.append(json.dumps(reader.scene.message))
        self._present = reader.present
        return [*found, json.dumps(link.present_message())]
