"""The scene port of a whole server: true, complete, harmless, and asleep while nobody looks."""

from __future__ import annotations

import asyncio
import base64
import gzip
import math
import re
import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_client import HangupError
from usarsim_client.scene import LiveScene, Poses, Present, SceneReader, Thing, connect_scene
from usarsim_server.base.errors import SettingsError
from usarsim_server.options import load_settings
from usarsim_server.protocol.dialects import DialectMode
from usarsim_server.services.scene_port import ScenePort
from usarsim_server.simulation.frames import pose_from_wire
from usarsim_server.testing import (
    PATIENCE,
    Rehearsal,
    RehearsedClient,
    ScriptedClient,
    ServerProcess,
    eventually,
    running_server,
)

TRUTH = re.compile(
    r"\{Time ([\d.]+)\}.*\{Type GroundTruth\}.*\{Location ([^}]*)\}.*\{Orientation ([^}]*)\}"
)


class Onlooker:
    """Sees a rehearsal as a client of the scene port would; it reads everything."""

    def __init__(self, stage: Rehearsal) -> None:
        self.stage, self.reader = stage, SceneReader()
        self.feed = scene_port(stage.assembly.services).feed
        self._sent: set[str] = set()
        self.bytes = b""
        self.poses = self.look()

    def look(self) -> Poses:
        """Everything as it is now."""
        instant = self.feed.instant(self.stage.assembly.simulation.look())  # type: ignore[attr-defined]
        for part in (instant.scene, *(instant.kinds[kind] for kind in instant.needed)):
            for name, data in part:
                if name not in self._sent:
                    self._sent.add(name)
                    self.bytes += data
                    self.reader.feed(data)
        self.reader.feed(instant.present)
        (poses,) = self.reader.feed(instant.poses)
        assert isinstance(poses, Poses)
        assert self.reader.present is not None
        assert self.reader.present.generation == poses.generation
        assert self.reader.present.count == len(poses.rows)
        self.poses = poses
        return poses

    def find(self, name: str) -> Thing | None:
        """Who bears a name now."""
        assert self.reader.present is not None
        return self.reader.present.find(name)

    def names(self) -> list[str]:
        """Of everybody who is present."""
        assert self.reader.present is not None
        return [one.name for one in self.reader.present.things]


def scene_port(services: tuple[object, ...]) -> ScenePort:
    """The scene port among some services."""
    return next(one for one in services if isinstance(one, ScenePort))


@pytest.fixture
def stage() -> Iterator[Callable[..., tuple[Rehearsal, Onlooker]]]:
    """Starts rehearsals with somebody who looks on."""
    stages: list[Rehearsal] = []

    def start(**settings: object) -> tuple[Rehearsal, Onlooker]:
        stages.append(Rehearsal(**{"world": "empty", "scene_port": 0, **settings}))
        return stages[-1], Onlooker(stages[-1])

    yield start
    for one in stages:
        one.close()


def robot(on: Rehearsal, name: str, at: str, kind: str = "P3AT") -> RehearsedClient:
    """A robot that drives a bend."""
    client = on.connect()
    client.send(f"INIT {{ClassName USARBot.{kind}}} {{Name {name}}} {{Location {at}}}")
    client.send("DRIVE {Left 2.5} {Right 1.5}")
    return client


def errors_of(
    client: RehearsedClient, row: NDArray[np.float32], time: float
) -> tuple[float, float]:
    """Distance (m) and angle (degrees) between a row of the feed and what GroundTruth says for the
    same simulated time."""
    for line in reversed(client.lines):
        found = TRUTH.search(line)
        if found is not None and abs(float(found[1]) - time) < 0.006:
            location, rotation = ([float(one) for one in found[n].split(",")] for n in (2, 3))
            x, y, z = location
            roll, pitch, yaw = rotation
            truth = pose_from_wire((x, y, z), (roll, pitch, yaw))
            away = math.dist(truth.position, row[:3].tolist())
            inner = min(1.0, abs(float(np.dot(truth.quaternion, row[3:]))))
            return away, math.degrees(2.0 * math.acos(inner))
    raise AssertionError(f"no ground truth at {time}: {client.lines[-3:]}")


def test_poses_are_those_of_ground_truth(stage: Callable[..., tuple[Rehearsal, Onlooker]]) -> None:
    """CON-06: robots that drive, join, leave and make the model grow: below 5 mm and .5 degree of
    GroundTruth at equal simulated time, names and bodies right in each generation."""
    world, sight = stage(max_robots=32, dialect=DialectMode.UDK)  # which has more decimals
    clients = {"A": robot(world, "A", "0,0,-0.3")}
    joins = {
        1: ("B", "5,5,-0.3", "P3AT"),
        2: ("C", "-5,5,-0.3", "P2AT"),
        4: ("D", "-5,-5,-0.3", "P3AT"),
        5: ("E", "9,-5,-0.3", "AirRobot"),
    }
    generations = set()
    for second in range(8):
        if second in joins:
            name, place, kind = joins[second]
            clients[name] = robot(world, name, place, kind)
        if second == 3:
            clients.pop("A").close()
        world.run(1.0)
        poses = sight.look()
        generations.add(world.assembly.simulation.look().generation)
        assert sorted(sight.names()) == sorted(clients)
        for name, client in clients.items():
            row = poses.of(sight.find(name))
            assert row is not None
            away, turned = errors_of(client, row, poses.time)
            assert away < 0.005, name
            assert turned < 0.5, name
    assert len(generations) > 3, "the model never grew"


def test_the_arena_with_sixteen_robots_is_small(
    stage: Callable[..., tuple[Rehearsal, Onlooker]],
) -> None:
    """CON-04: everything that a client gets before the first pose: 50 kB compressed at most."""
    world, sight = stage(world="arena", max_robots=16)
    for number in range(16):
        robot(world, f"R{number}", f"{-6 + 2 * (number % 6)},{-4 + 2 * (number // 6)},-0.3")
    world.run(0.5)
    sight.look()
    assert len(sight.names()) == 16
    assert len(gzip.compress(sight.bytes)) < 50_000
    assert len(sight.reader.kinds) == 1


def crumpled(folder: Path, side: int) -> tuple[Path, int]:
    """A map of another program: ground with bumps and overhangs, no triangle like another."""
    dice, lines = np.random.default_rng(0), list[str]()
    for row in range(side):
        for column in range(side):
            u, v = column / (side - 1), row / (side - 1)
            height = 3.0 * math.sin(3.0 * u + 12.0 * v) + dice.normal(0.0, 0.05)
            x, y = 20.0 * u + 1.5 * math.sin(9.0 * v), 20.0 * v + 1.5 * math.cos(12.0 * u)
            lines += [f"v {x:.4f} {height:.4f} {y:.4f}", f"vt {column / 4} {row / 4}"]
    for row in range(side - 1):
        for first in range(row * side + 1, row * side + side):
            corners = (first, first + side, first + side + 1, first + 1)
            a, b, c, d = (f"{one}/{one}" for one in corners)
            lines += [f"f {a} {b} {c}", f"f {a} {c} {d}"]
    path = folder / "Crumpled.obj"
    path.write_text("\n".join(lines))
    return path, 2 * (side - 1) ** 2


def test_an_imported_map_is_small(
    stage: Callable[..., tuple[Rehearsal, Onlooker]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """CON-04: 100,000 triangles of an imported map take 5 MB compressed at most; by the triangle,
    with the whole scene around them."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path, triangles = crumpled(tmp_path, 32)
    _, sight = stage(world=str(path))
    sizes = [
        len(base64.b64decode(one["faces"])) // (6 if len(one["vertices"]) < 1 << 20 else 12)
        for one in sight.reader.meshes.values()
    ]
    assert sum(sizes) >= triangles, "not all of it is shown"
    assert len(gzip.compress(sight.bytes)) / triangles < 5_000_000 / 100_000


def test_what_moves_in_a_building(stage: Callable[..., tuple[Rehearsal, Onlooker]]) -> None:
    """A door that opens for a robot, a cart and a sweeper are seen to move, in their own rows; what
    stands still does not."""
    world, sight = stage(world="plant")
    assert sight.reader.scene is not None
    bodies = sight.reader.scene.bodies
    robot(world, "R", "-3.9,-2.0,-0.3")
    rows = []
    for _ in range(12):
        world.run(0.5)
        rows.append(sight.look().rows[: len(bodies), :3].copy())
    ways = np.ptp(np.array(rows), axis=0).max(axis=1)
    moved = {body["name"] for body, way in zip(bodies, ways, strict=True) if way > 0.05}
    assert {"gate", "sweeper"} <= moved
    assert "lift" not in moved
    victims = [one["name"] for one in (*sight.reader.scene.still, *bodies)]
    assert {one.name for one in world.assembly.world.victims} <= set(victims)


def test_things_of_clients_and_headlights(
    stage: Callable[..., tuple[Rehearsal, Onlooker]],
) -> None:
    """Objects of a world controller with their materials, an avatar who walks, a light that is
    switched on: all of them come, move, and go."""
    world, sight = stage()
    control = world.connect()
    control.send("INIT {ClassName USARBot.WorldController} {Name WC} {Location 0,0,0}")
    for name, material in (("Plain", ""), ("Red", "{Material Red}")):
        x = 4 if material else 6
        control.send(
            f"CONTROL {{Type Create}} {{ClassName USARPhysObj.Wall}} {{Name {name}}} "
            f"{{Location {x},4,-0.6}} {{Physics None}} {material}"
        )
    avatar = world.connect()
    avatar.send("INIT {ClassName USARAvatar.Worker} {Name W} {Location 0,-5,-1}")
    pilot = robot(world, "R", "0,0,-0.3")
    world.run(0.5)
    sight.look()
    plain, red, walker, machine = map(sight.find, ("Plain", "Red", "W", "R"))
    assert plain is not None
    assert red is not None
    assert walker is not None
    assert machine is not None
    whats = {one.name: one.what for one in (plain, red, walker, machine)}
    assert whats == {"Plain": "object", "Red": "object", "W": "avatar", "R": "robot"}
    assert plain.kind != red.kind
    materials = sight.reader.kinds[red.kind]["materials"]
    assert materials[0]["rgba"] == [0.8, 0.1, 0.1, 1]
    row = sight.poses.of(red)
    assert row is not None
    assert row[:2].tolist() == pytest.approx([4.0, -4.0], abs=1e-3)

    assert not machine.lit
    pilot.send("DRIVE {Light true}")
    control.send("CONTROL {Type AbsMove} {Name Red} {Location 5,3,-0.6}")
    world.run(0.5)
    sight.look()
    red, machine = sight.find("Red"), sight.find("R")
    assert machine is not None
    assert machine.lit
    row = sight.poses.of(red)
    assert row is not None
    assert row[:2].tolist() == pytest.approx([5.0, -3.0], abs=1e-3)
    control.send("CONTROL {Type Kill} {Name Red}")
    avatar.close()
    world.run(0.5)
    sight.look()
    assert sorted(sight.names()) == ["Plain", "R"]


def played(looked_at: bool) -> tuple[list[str], int]:
    """All lines of a small drama in a world that somebody looks at, or nobody; and how often."""
    with Rehearsal(world="plant", scene_port=0, max_robots=8) as stage:
        feed = scene_port(stage.assembly.services).feed
        if looked_at:
            feed.start(lambda instant: None, lambda: None)
        clients = [robot(stage, "A", "0,0,-0.3")]
        stage.run(2.0)
        clients.append(robot(stage, "B", "2,2,-0.3"))
        stage.run(2.0)
        clients.append(robot(stage, "C", "-4,2,-0.3", "P2AT"))
        clients[1].close()
        stage.run(2.0)
        feed.stop()
        looks: int = feed.looks  # type: ignore[attr-defined]
        return [line for client in clients for line in client.lines], looks


def test_who_looks_changes_nothing() -> None:
    """Robots, doors, lifts and models that grow: every line is the same, to the last digit."""
    alone, nobody = played(False)
    seen, looks = played(True)
    assert nobody == 0
    assert looks > 3
    assert seen == alone


def live(port: int, watch: Callable[[LiveScene], object], **about: object) -> None:
    """Connect, watch, hang up, within `PATIENCE`."""

    async def main() -> None:
        async with asyncio.timeout(PATIENCE):
            async with await connect_scene("127.0.0.1", port, **about) as scene:  # type: ignore[arg-type]
                result = watch(scene)
                if asyncio.iscoroutine(result):
                    await result

    asyncio.run(main())


def test_over_sockets() -> None:
    """A server process with a token in a file: robots come and go while somebody looks, poses go on
    in time, and a wrong token sees nothing."""
    with ServerProcess("--scene-port=0", "--scene-token=open sesame", "--world=empty") as server:
        port = server.ports["scene"]
        client = server.client()

        async def watch(scene: LiveScene) -> None:
            assert (await scene.poses()).rows.shape == (0, 7)
            client.send("INIT {ClassName USARBot.P3AT} {Name R} {Location 1,2,-0.3}")
            poses = await scene.poses()
            while poses.of(scene.find("R")) is None:
                poses = await scene.poses()
            row = poses.of(scene.find("R"))
            assert row is not None
            assert row[:2].tolist() == pytest.approx([1.0, -2.0], abs=0.05)
            later = await scene.poses()
            assert later.time > poses.time
            client.close()
            while scene.find("R") is not None:
                await scene.poses()

        live(port, watch, token="open sesame")
        with pytest.raises(HangupError, match="token"):
            live(port, lambda scene: None)
        assert server.end() == 0
        assert "sesame" not in server.errors


def test_nothing_is_done_while_nobody_looks() -> None:
    """CON-07, CON-23: no snapshot, no thread before anybody came and after 50 have gone."""
    with running_server(world="empty", scene_port=0) as (assembly, endpoints):
        feed = scene_port(assembly.services).feed
        port = endpoints["scene"].port

        def threads() -> int:
            return sum(one.name == "scene" for one in threading.enumerate())

        assert (feed.looks, threads()) == (0, 0)  # type: ignore[attr-defined]
        for number in range(50):
            if number % 2:
                live(port, LiveScene.poses)
            else:
                live(port, lambda scene: scene.send({"hello": 1}))
        assert eventually(lambda: threads() == 0)
        looks = feed.looks  # type: ignore[attr-defined]
        with ScriptedClient(endpoints["control"].port) as client:
            client.send("INIT {ClassName USARBot.P3AT} {Location 0,0,-0.3}")
            client.listen(0.5)
        assert looks == feed.looks  # type: ignore[attr-defined]


def test_a_world_that_stands_still_is_told_of() -> None:
    """At `--speed max` time waits for a robot; who looks meanwhile sees the world all the same, and
    the last instant once a second."""
    with running_server(world="empty", scene_port=0, speed=math.inf) as (_, endpoints):

        async def watch(scene: LiveScene) -> None:
            times = [(await scene.poses()).time for _ in range(3)]
            assert times == [0.0, 0.0, 0.0]

        live(endpoints["scene"].port, watch)


def test_hostile_clients_hurt_nobody() -> None:
    """Clients that send rubbish, never read or say half a hello; a robot's lines and the poses of
    a good client go on."""
    with running_server(world="empty", scene_port=0) as (_, endpoints):
        port = endpoints["scene"].port
        bad = [ScriptedClient(port) for _ in range(6)]
        bad[0].send_bytes(struct.pack(">IB", 1 << 20, ord("J")) + b"{" * 1000)
        bad[1].send_bytes(b"\x00\x00\x01")
        bad[2].send_bytes(b'\x00\x00\x00\x0cJ{"hello":1}')
        bad[3].send_bytes(b'\x00\x00\x00\x0cJ{"hello":1}' + b"\x00\x00\x00\x03J{}" * 5000)
        bad[4].send_bytes(b"INIT {ClassName USARBot.P3AT}\r\n")

        async def watch(scene: LiveScene) -> None:
            begun = (await scene.poses()).time
            while (await scene.poses()).time < begun + 1.0:
                pass
            news = scene.reader.present
            assert isinstance(news, Present)

        with ScriptedClient(endpoints["control"].port) as client:
            client.send("INIT {ClassName USARBot.P3AT} {Location 0,0,-0.3}")
            live(port, watch)
            assert client.listen(0.3)
        for one in bad:
            one.close()


def test_where_truth_is_hidden_there_is_no_scene(tmp_path: Path) -> None:
    """`--truth off` and the scene port exclude each other; the error names the option."""
    with pytest.raises(SettingsError, match=r"--scene-port: .*where robots really are.*leave one"):
        load_settings({"truth": "off", "scene_port": "0"})
    assert load_settings({"truth": "off"}).scene_port is None


def test_the_token_may_stand_in_a_file(tmp_path: Path) -> None:
    """A text, or the name of a file; a file must hold something."""
    file = tmp_path / "token"
    file.write_text("from a file\n")
    file.chmod(0o600)
    assert load_settings({"scene_token": "a text"}).scene_token == "a text"
    assert load_settings({"scene_token": str(file)}).scene_token == "from a file"
    file.write_text("\n")
    with pytest.raises(SettingsError, match="empty"):
        load_settings({"scene_token": str(file)})
