# ruff: noqa: E501  (drawn worlds are told as tables)
"""Serves the page and plays a moving world to it, as docs/console-protocol.md says, without a simulator.

Robots drive circles and see drawn pictures, a square room by laser, and marks; what the page says is kept in
``texts``. Run it to work on the page: ``python tests/operator/fake_gateway.py --robots 16``; it prints one URL per role.
"""

import argparse
import asyncio
import contextlib
import io
import json
import math
import struct
import time
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web
from PIL import Image, ImageDraw

from usarsim_report.page_files import page_headers

PAGE = Path(__file__).parents[2] / "tools" / "usarsim_operator" / "page"
ROOM = 6.0  # half the side of the room, m
BEAMS, FOV, REACH = 181, math.pi, 8.0
HUES = ("#5b7fa6", "#a6895b", "#5ba683", "#a65b7e", "#7b5ba6", "#5b9fa6")


class FakeGateway:
    """A gateway without a server; ``frozen``: one last state, then open sockets that say nothing."""

    def __init__(
        self, robots: int = 4, names: list[str] | None = None, framed_by: tuple[str, ...] = ()
    ) -> None:
        self.count, self.headers = robots, page_headers(framed_by)
        self.names = names or [f"R{i + 1}" for i in range(robots)]
        self.texts: list[tuple[float, dict[str, Any]]] = []
        self.frozen = self.stopped = self.paused = False
        self.last_time = -1.0  # simulated time of the last state text before silence, s
        self.speed = 1.0
        self.time = 40.0
        self.drives: dict[str, tuple[float, float, float]] = {}
        self.holders: dict[str, dict[str, Any] | None] = dict.fromkeys(self.names)
        self.holders[self.names[-1]] = {"page": None, "name": "127.0.0.1:50122"}
        self.cameras = dict.fromkeys(self.names, True)
        self.lasers = dict.fromkeys(self.names, True)
        self.marks: list[dict[str, Any]] = []
        self.acknowledged: set[int] = set()
        self.places = [self._start(i) for i in range(robots)]
        self.trails: list[list[float]] = [[] for _ in range(robots)]
        self.sequence = 0
        self.pages = 0
        self.sensors = ["Scanner1", "Odometry", "Sonar"]
        self.asked: list[dict[str, Any]] = []  # questions for the next page that listens

    def _start(self, i: int) -> list[float]:
        turn = 2 * math.pi * i / self.count
        return [3.4 * math.cos(turn), 3.4 * math.sin(turn), turn + math.pi / 2]

    # The world.

    def step(self, dt: float) -> None:
        """Moves every robot: by its drive, or along its circle while nobody holds it."""
        if self.paused:
            return
        self.time += dt * self.speed
        for i, name in enumerate(self.names):
            left, right, at = self.drives.get(name, (0.0, 0.0, -9.0))
            if time.monotonic() - at > 0.5:
                left = right = 0.0
            if self.holders[name] is None or self.holders[name]["page"] is None:
                left, right = 0.36, 0.24
            if self.stopped:
                left = right = 0.0
            x, y, yaw = self.places[i]
            forward, turn = 0.6 * (left + right), 2.0 * (left - right)
            if self.holders[name] is None:
                turn = forward / 3.4
            x = max(-ROOM + 0.4, min(ROOM - 0.4, x + forward * math.cos(yaw) * dt))
            y = max(-ROOM + 0.4, min(ROOM - 0.4, y + forward * math.sin(yaw) * dt))
            self.places[i] = [x, y, yaw + turn * dt]
            self.trails[i] = [*self.trails[i], x, y][-600:]

    def ranges(self, i: int) -> list[float]:
        """What the laser of robot i sees of the walls and of two boxes."""
        x, y, yaw = self.places[i]
        found = []
        for beam in range(BEAMS):
            a = yaw - FOV / 2 + FOV * beam / (BEAMS - 1)
            c, s = math.cos(a), math.sin(a)
            walls = [
                (ROOM * d - p) / v for p, v in ((x, c), (y, s)) for d in (1, -1) if v * d > 1e-6
            ]
            reach = min(walls)
            for bx, by in ((0.0, 0.0), (4.5, -4.5)):
                along = (bx - x) * c + (by - y) * s
                across = abs((bx - x) * s - (by - y) * c)
                if along > 0 and across < 0.6:
                    reach = min(reach, along - math.sqrt(0.36 - across * across))
            found.append(min(reach, REACH))
        return found

    # Messages.

    def robot(self, i: int) -> dict[str, Any]:
        name, (x, y, yaw) = self.names[i], self.places[i]
        bumpers = [
            {"ring": ring, "segment": n, "pressed": i == 1 and ring == "front" and n == 2}
            for ring in ("front", "rear")
            for n in range(5)
        ]
        return {
            "name": name, "index": i, "class": "P3AT", "kind": "ground", "own": i != self.count - 1,
            "pose": [x, y, -0.2, 0, 0, yaw], "pose_source": "Odometry", "pose_age": 0.1, "speed": 0.36,
            "battery": max(0.05, 0.93 - 0.17 * (i % 6)), "light": False, "enabled": True,
            "mode": "controller" if i == self.count - 1 else "operator",
            "zone": ("yellow", "orange", "red", "blue", None)[i % 5],
            "link": {"state": "weak" if i == 2 else "good", "age": 0.1, "signal_dbm": -48.0 - 6 * (i % 6)},
            "holder": self.holders[name],
            "sensors": [{"name": s, "type": s, "age": 0.1, "stale": False, "rate_hz": 5.0}
                        for s in self.sensors],
            "bumpers": bumpers, "path": len(self.trails[i]) // 2,
            "camera": {"on": self.cameras[name], "age": 0.1, "rate_hz": 5.0, "dropped": 0},
            "laser": {"on": self.lasers[name], "age": 0.1},
        }  # fmt: skip

    def alarms(self) -> list[dict[str, Any]]:
        rows = [(1, "battery", 2, "battery below 20 %"), (2, "stuck", 2, "commanded, does not move"),
                (3, "tipped", 3, "tipped over by 52°"), (4, "link", 1, "signal is weak")]  # fmt: skip
        return [
            {"id": n, "robot": self.names[n % self.count], "kind": kind, "severity": severity,
             "text": text, "since": 30.0 + n, "acknowledged": n in self.acknowledged, "count": n}
            for n, kind, severity, text in rows
        ]  # fmt: skip

    def state(self) -> dict[str, Any]:
        corner = 5.8
        quarter = {
            "yellow": [[0.5, 0.5], [corner, 0.5], [corner, corner], [0.5, corner]],
            "orange": [[-corner, 0.5], [-0.5, 0.5], [-0.5, corner], [-corner, corner]],
            "red": [[-corner, -corner], [-0.5, -corner], [-0.5, -0.5], [-corner, -0.5]],
            "blue": [[0.5, -corner], [corner, -corner], [corner, -0.5], [0.5, -0.5]],
        }
        return {
            "type": "state", "time": self.time, "gateway_clock": time.monotonic(), "paused": self.paused,
            "speed": self.speed, "real_time_factor": 0.99,
            "estop": {"by": "Ada", "time": self.time} if self.stopped else None,
            "mission": {"remaining": 1200 - self.time, "name": "arena"},
            "robots": [self.robot(i) for i in range(self.count)],
            "alarms": self.alarms(), "alarms_hidden": 0, "marks": self.marks,
            "zones": [{"colour": c, "corners": p} for c, p in quarter.items()],
        }  # fmt: skip

    def head(self, kind: int, robot: int) -> bytes:
        self.sequence += 1
        return struct.pack("<BBHId", kind, robot, 0, self.sequence, self.time)

    def picture(self, i: int) -> bytes:
        image = Image.new("RGB", (320, 240), "#c9ced4")
        draw = ImageDraw.Draw(image)
        draw.rectangle((0, 130, 320, 240), fill="#7d7a74")
        shift = int(120 * self.places[i % self.count][2]) % 400 - 80
        draw.polygon([(shift, 60), (shift + 120, 80), (shift + 120, 170), (shift, 190)],
                     fill=HUES[i % len(HUES)])  # fmt: skip
        draw.text((8, 222), f"t {self.time:.1f}", fill="white")
        out = io.BytesIO()
        image.save(out, "JPEG", quality=80)
        return self.head(1, i) + out.getvalue()

    def scan(self, i: int) -> bytes:
        mount = struct.pack("<8fHH", FOV, REACH, 0.2, 0, -0.3, 0, 0, 0, BEAMS, 0)
        return self.head(2, i) + mount + struct.pack(f"<{BEAMS}f", *self.ranges(i))

    def points(self, i: int) -> bytes:
        rows = [(2 + 0.1 * (n % 9), (n % 41 - 20) / 20, -(n // 41) / 10) for n in range(820)]
        flat = [value for row in rows for value in row]
        return self.head(3, i) + struct.pack(f"<I{len(flat)}f", len(rows), *flat)

    def poses(self) -> bytes:
        flat: list[float] = []
        for x, y, yaw in self.places:
            half = -yaw / 2
            flat += [x, -y, 0.2, math.cos(half), 0, 0, math.sin(half)]
        return self.head(4, 0) + struct.pack(f"<II{len(flat)}f", 1, self.count, *flat)

    def map(self) -> bytes:
        side = 130
        runs = bytearray()
        cells = bytearray()
        for c in range(side):
            for r in range(side):
                edge = min(c, r, side - 1 - c, side - 1 - r)
                box = math.hypot(c - 65, r - 65) < 6
                cells.append(0 if edge < 4 else 2 if edge < 6 or box else 1)
        at = 0
        while at < len(cells):
            end = at
            while end < len(cells) and end - at < 255 and cells[end] == cells[at]:
                end += 1
            runs += bytes((end - at, cells[at]))
            at = end
        return self.head(5, 0) + struct.pack("<3fHH", 0.1, -6.5, -6.5, side, side) + runs

    def path(self, i: int) -> bytes:
        flat = self.trails[i]
        return self.head(6, i) + struct.pack(f"<I{len(flat)}f", len(flat) // 2, *flat)

    def scene(self) -> dict[str, Any]:
        """A room, two boxes, a victim's box, and robots of boxes and cylinders, as the scene port tells them."""
        grey = [
            {"rgba": [0.62, 0.64, 0.66, 1]},
            {"rgba": [0.78, 0.77, 0.74, 1]},
            {"rgba": [0.75, 0.5, 0.3, 1]},
        ]
        walls = [{"shape": "box", "size": s, "pos": p, "material": 1}
                 for s, p in (([0.1, 6, 0.6], [6, 0, 0.6]), ([0.1, 6, 0.6], [-6, 0, 0.6]),
                              ([6, 0.1, 0.6], [0, 6, 0.6]), ([6, 0.1, 0.6], [0, -6, 0.6]))]  # fmt: skip
        still = [
            {"shape": "plane", "size": [8, 8], "material": 0},
            *walls,
            {"shape": "cylinder", "size": [0.6, 0.5], "pos": [0, 0, 0.5], "material": 2},
            {"shape": "capsule", "size": [0.2, 0.5], "pos": [4.5, 4.5, 0.2], "quat": [0.7071, 0, 0.7071, 0], "material": 2},
        ]  # fmt: skip
        kinds: dict[str, Any] = {}
        for i in range(self.count):
            tone = [int(HUES[i % 6][n : n + 2], 16) / 255 for n in (1, 3, 5)]
            wheels = [{"shape": "cylinder", "size": [0.11, 0.05], "pos": [x, y, -0.08], "quat": [0.7071, 0.7071, 0, 0], "material": 1}
                      for x in (0.18, -0.18) for y in (0.22, -0.22)]  # fmt: skip
            body = [{"shape": "box", "size": [0.25, 0.17, 0.09], "pos": [0, 0, 0.03], "material": 0},
                    {"shape": "box", "size": [0.06, 0.06, 0.08], "pos": [0.15, 0, 0.2], "material": 1}, *wheels]  # fmt: skip
            kinds[f"k{i}"] = {"materials": [{"rgba": [*tone, 1]}, {"rgba": [0.12, 0.12, 0.13, 1]}],
                              "bodies": [{"body": "base", "geoms": body}]}  # fmt: skip
        things = [{"id": i, "what": "robot", "name": n, "class": "P3AT", "kind": f"k{i}", "first": i}
                  for i, n in enumerate(self.names)]  # fmt: skip
        scene = {"world": "arena", "lower": [-8, -8, -1], "upper": [8, 8, 4], "materials": grey,
                 "still": [{"what": "world", "name": "", "geoms": still}], "bodies": []}  # fmt: skip
        return {"generation": 1, "scene": scene, "kinds": kinds, "meshes": {}, "textures": {},
                "present": {"generation": 1, "count": self.count, "things": things}}  # fmt: skip

    def rows(self, name: str) -> list[dict[str, Any]]:
        row = {"time": self.time, "direction": "in", "reading": None, "effect": None, "fault": None}
        return [
            {**row, "text": "DRIVE {Left 0.4} {Right 0.2}", "reading": "wheel speeds 0.4, 0.2 rad/s",
             "effect": "left 0.4, right 0.2"},
            {**row, "direction": "out", "text": f"STA {{Type GroundVehicle}} {{Time {self.time:.2f}}}"},
            {**row, "text": "DRIVE {Left abc}", "fault": "abc is not a number; the line is ignored"},
        ]  # fmt: skip

    # The page's side.

    def answer(self, page: int, name: str, text: dict[str, Any]) -> tuple[bool, str]:
        """Does what a text asks; returns whether it was done, and why not."""
        kind, robot = text["type"], text.get("robot")
        holder = self.holders.get(robot) if isinstance(robot, str) else None
        if kind in ("drive", "steer"):
            if holder is None or holder["page"] != page:
                return False, f"held by {holder['name'] if holder else 'nobody'}"
            self.drives[robot] = (text["left"], text["right"], time.monotonic())
        elif kind == "take":
            if holder and holder["page"] != page and not text.get("force"):
                return False, f"held by {holder['name']}"
            self.holders[robot] = {"page": page, "name": name}
        elif kind == "hand_back":
            self.holders[robot] = None
        elif kind in ("estop", "estop_reset"):
            self.stopped = kind == "estop"
        elif kind == "camera":
            self.cameras[robot] = text["on"]
        elif kind == "laser":
            self.lasers[robot] = text["on"]
        elif kind == "acknowledge":
            self.acknowledged.add(text["alarm"])
        elif kind == "mark":
            facts = {key: text[key] for key in ("robot", "place", "status", "note")}
            self.marks.append({"id": len(self.marks) + 1, **facts, "by": name, "time": self.time})
        elif kind == "pace" and text["action"] in ("pause", "run"):
            self.paused = text["action"] == "pause"
        elif kind == "pace" and text["action"] == "speed":
            self.speed = text["factor"]
        return True, ""

    async def play(self, socket: web.WebSocketResponse, role: str) -> None:
        tick, silent = 0, False
        while not socket.closed:
            await asyncio.sleep(0.05)
            if self.frozen and not silent:
                self.last_time = self.time
                await socket.send_json(self.state())
            silent = self.frozen
            if silent:
                continue
            while self.asked:
                await socket.send_json({"type": "asked", **self.asked.pop()})
            tick += 1
            if tick % 2 == 0:
                await socket.send_json(self.state())
                if role != "operator":
                    await socket.send_bytes(self.poses())
            for i, name in enumerate(self.names):
                if (tick + i) % 4 == 0:
                    if self.cameras[name]:
                        await socket.send_bytes(self.picture(i))
                    if self.lasers[name]:
                        await socket.send_bytes(self.scan(i))
                if (tick + i) % 20 == 0:
                    await socket.send_bytes(self.path(i))
            if tick % 40 == 2:
                await socket.send_bytes(self.map())
                await socket.send_bytes(self.points(0))
                await socket.send_bytes(self.picture(255))
            if tick % 20 == 0 and role == "instructor":
                rows = self.rows(self.names[0])
                await socket.send_json({"type": "lines", "robot": self.names[0], "rows": rows})

    async def socket(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(max_msg_size=65536)
        await socket.prepare(request)
        hello = await socket.receive_json()
        role, self.pages = hello["token"], self.pages + 1
        page = self.pages
        name = hello.get("name") or f"{role} {page}"
        features = {"scene": role != "operator", "takeover": True, "pace": True, "lines": role == "instructor"}  # fmt: skip
        await socket.send_json(
            {"type": "welcome", "page": page, "name": name, "role": role, "features": features, "watchdog_s": 0.5,
             "server": {"address": "127.0.0.1:3000", "level": "arena", "software": "fake"},
             "gateway_clock": time.monotonic()}
        )  # fmt: skip
        player = asyncio.create_task(self.play(socket, role))
        async for message in socket:
            if message.type is not WSMsgType.TEXT:
                continue
            text = json.loads(message.data)
            self.texts.append((time.monotonic(), text))
            if text["type"] == "ping" and not self.frozen:
                await socket.send_json({**text, "type": "pong", "gateway_clock": time.monotonic()})
            done, why = self.answer(page, name, text)
            if "id" in text and not self.frozen:
                await socket.send_json({"type": "answer", "id": text["id"], "ok": done, "why": why})
        player.cancel()
        with contextlib.suppress(asyncio.CancelledError, ConnectionError):
            await player
        return socket

    def app(self) -> web.Application:
        async def scene(_request: web.Request) -> web.Response:
            response = web.json_response(self.scene())
            response.enable_compression()
            return response

        async def file(request: web.Request) -> web.StreamResponse:
            path = PAGE / (request.match_info["name"] or "index.html")
            if not path.is_file():
                raise web.HTTPNotFound
            return web.FileResponse(path, headers=self.headers)

        app = web.Application()
        app.add_routes([web.get("/socket", self.socket), web.get("/scene/{generation}", scene),
                        web.get("/{name:[^/]*}", file)])  # fmt: skip
        return app

    @contextlib.asynccontextmanager
    async def serve(self, port: int = 0) -> Any:
        """Serves until the block ends; gives the port."""
        runner = web.AppRunner(self.app())
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", port)
        await site.start()

        async def world() -> None:
            while True:
                await asyncio.sleep(0.02)
                self.step(0.02)

        clock = asyncio.create_task(world())
        try:
            yield runner.addresses[0][1]
        finally:
            clock.cancel()
            await runner.cleanup()


async def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--port", type=int, default=0)
    args = parser.parse_args()
    async with FakeGateway(args.robots).serve(args.port) as port:
        for role in ("operator", "instructor", "viewer"):
            print(f"CONSOLE http://127.0.0.1:{port}/#{role}", flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main())
