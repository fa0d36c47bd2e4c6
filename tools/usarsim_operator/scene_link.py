"""The scene port of the server, if it has one: true poses, protocol lines, pace, taking over."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import itertools
import json
import secrets
from collections.abc import Callable
from typing import Any

from usarsim_client.inbox import HangupError, ProtocolError
from usarsim_client.scene import (
    LiveScene,
    News,
    Poses,
    Present,
    Scene,
    SceneReader,
    TruthRow,
    connect_scene,
)

_WANTED = (("scene", "poses", "clock"), ("scene", "poses"))
"""Channels; a server that has `clock` has `lines`, for which there is a connection of its own."""
_ANSWER = 5.0  # s that the server has to answer a request
_COLOURS = ("yellow", "orange", "red", "blue")
_PAUSE = 2.0  # s before a lost connection is tried again

Message = dict[str, Any]


class SceneLink:
    """A connection that comes back by itself.

    Attributes:
        features: what the server has: `scene`, `takeover`, `pace`, `lines`, `calls`.
        clock: its newest `clock` message; empty before.
        present: who is there now; None without a connection.
    """

    def __init__(
        self,
        host: str,
        port: int,
        token: str,
        poses: Callable[[Poses], None],
        told: Callable[[Message], None],
        changed: Callable[[], None],
    ) -> None:
        """Begin to connect.

        Args:
            host, port, token: of the scene port.
            poses: takes each message of poses.
            told: takes every other message that is no part of the scene.
            changed: called when others have come or gone, and when the connection does.
        """
        self.features = dict.fromkeys(("scene", "takeover", "pace", "lines", "calls"), False)
        self.clock: Message = {}
        self._where = host, port, token
        self._poses, self._told, self._changed = poses, told, changed
        self._live: LiveScene | None = None
        self._replies: dict[int, asyncio.Future[Message]] = {}
        self._packed: dict[tuple[int, tuple[int, ...]], bytes] = {}
        self._lengths: dict[str, list[int]] = {}
        self._epoch = ""
        self._rate = 30.0
        self._lines: asyncio.Task[None] | None = None
        self._task = asyncio.create_task(self._run())

    @property
    def present(self) -> Present | None:
        """Who is there, as the server told last."""
        return None if self._live is None else self._live.reader.present

    @property
    def reader(self) -> SceneReader | None:
        """Everything that the server has told of the scene; None without a connection."""
        return None if self._live is None else self._live.reader

    def scene(self, since: str = "") -> tuple[int, bytes] | None:
        """Generation and everything that its poses refer to, as compressed JSON.

        Args:
            since: version that the asker has, as `epoch` and `generation` of an answer say, with a
                dot between; what it has is left out then. If it is not known, nothing is.
        """
        reader = self.reader
        if reader is None or reader.scene is None or reader.present is None:
            return None
        generation = reader.present.generation
        tables = {"kinds": reader.kinds, "meshes": reader.meshes, "textures": reader.textures}
        # Tables only grow, so how long they were says what the asker has of them.
        self._lengths[f"{self._epoch}.{generation}"] = [len(table) for table in tables.values()]
        had = self._lengths.get(since)
        key = generation, tuple(had or ())
        if key not in self._packed:
            fields: Message = {
                "generation": generation,
                "epoch": self._epoch,
                "since": None if had is None else since,
                "scene": reader.scene.message if had is None else None,
                "present": self.present_message(),
            }
            for (name, table), skip in zip(tables.items(), had or (0, 0, 0), strict=True):
                fields[name] = dict(itertools.islice(table.items(), skip, None))
            data = json.dumps(fields, separators=(",", ":")).encode()
            self._packed[key] = gzip.compress(data, 6, mtime=0)
        return generation, self._packed[key]

    @property
    def zones(self) -> list[Message]:
        """Zones of the world that have a colour, as pages are told them: y to the right."""
        live = self._live
        scene = None if live is None else live.reader.scene
        found = []
        for one in [] if scene is None else scene.message.get("zones", ()):
            if one["kind"] in _COLOURS:
                corners = [[x, -y] for x, y in one["corners"]]
                found.append({"colour": one["kind"], "corners": corners})
        return found

    @property
    def victims(self) -> list[str]:
        """Names of the victims of the world, in order."""
        live = self._live
        scene = None if live is None else live.reader.scene
        parts = [] if scene is None else [*scene.message["still"], *scene.message["bodies"]]
        return sorted({str(one["name"]) for one in parts if one["what"] == "victim"})

    def present_message(self) -> Message:
        """`present` as the scene port sends it; for when there is one."""
        present = self.present
        assert present is not None
        things = [
            {
                "id": one.id,
                "what": one.what,
                "name": one.name,
                "class": one.class_name,
                "kind": one.kind,
                "first": one.first,
                "lit": one.lit,
            }
            for one in present.things
        ]
        return {
            "type": "present",
            "generation": present.generation,
            "time": present.time,
            "count": present.count,
            "things": things,
        }

    async def request(self, request: str, **fields: object) -> Message:
        """Ask the server for something; its reply.

        Raises:
            ProtocolError: if there is no connection, or no answer, or it refuses; with its reason.
        """
        live = self._live
        if live is None:
            raise ProtocolError("the server has no scene port that answers")
        answer: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        number = 0
        try:
            number = await live.request(request, **fields)
            self._replies[number] = answer
            async with asyncio.timeout(_ANSWER):
                reply = await answer
        except (OSError, TimeoutError) as error:
            raise ProtocolError(f"the scene port does not answer {request}: {error}") from None
        finally:
            self._replies.pop(number, None)
        if not reply.get("ok"):
            raise ProtocolError(str(reply.get("why", "the server refuses")))
        return reply

    async def look(self, rate: float) -> None:
        """Poses a second from now on; hardly any while nobody looks."""
        if rate != self._rate and self._live is not None:
            self._rate = rate
            with contextlib.suppress(OSError):
                await self._live.request("rate", rate_hz=rate)

    def hear_lines(self, on: bool) -> None:
        """Have protocol lines told, or no longer: it costs the server something, too."""
        if on and self._lines is None and self.features["lines"]:
            self._lines = asyncio.create_task(self._hear_lines())
        elif not on and self._lines is not None:
            self._lines.cancel()
            self._lines = None

    async def _hear_lines(self) -> None:
        host, port, token = self._where
        while True:
            with contextlib.suppress(OSError, ProtocolError, HangupError, TimeoutError):
                async with asyncio.timeout(10.0):
                    live = await connect_scene(host, port, token=token, channels=("lines",))
                async with live:
                    async for news in live:
                        self._take(news)
            await asyncio.sleep(_PAUSE)

    async def _run(self) -> None:
        host, port, token = self._where
        wanted = 0
        while True:
            try:
                async with asyncio.timeout(10.0):
                    live = await connect_scene(host, port, token=token, channels=_WANTED[wanted])
            except (OSError, ProtocolError, HangupError, TimeoutError):
                wanted = (wanted + 1) % len(_WANTED)
                await asyncio.sleep(0.05 if wanted else _PAUSE)
                continue
            async with live:
                self._live, self._rate, self._epoch = live, 30.0, secrets.token_hex(4)
                self._packed.clear()
                self._lengths.clear()
                requests = set(live.welcome.get("requests", ()))
                channels = set(live.welcome.get("channels", ()))
                self.features = {
                    "scene": "scene" in channels,
                    "takeover": {"take", "drive", "hand_back"} <= requests,
                    "pace": "pace" in requests,
                    "lines": "clock" in channels,
                    "calls": "call" in requests,
                }
                with contextlib.suppress(OSError, ProtocolError, HangupError):
                    async for news in live:
                        self._take(news)
            self._live = None
            self.clock = {}
            self._told({"type": "clock"})
            self.features = dict.fromkeys(self.features, False)
            for future in self._replies.values():
                future.cancel()
            self._changed()
            await asyncio.sleep(_PAUSE)

    def _take(self, news: News) -> None:
        match news:
            case Poses():
                self._poses(news)
            case Present():
                self._packed.clear()
                self._changed()
            case TruthRow():
                pass
            case Scene():
                self._packed.clear()
                self._lengths.clear()
            case {"type": "reply", "id": number}:
                future = self._replies.get(number)
                if future is not None and not future.done():
                    future.set_result(dict(news))
            case {"type": "clock"}:
                self.clock = dict(news)
                self._told(self.clock)
            case {"type": "lines" | "intervention"}:
                self._told(dict(news))
            case _:
                pass

    async def close(self) -> None:
        """Hang up."""
        tasks = [task for task in (self._task, self._lines) if task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
