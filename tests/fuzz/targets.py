"""What is fuzzed: every reader of bytes from outside, as a function that takes any bytes.

A target raises nothing unless something is wrong: errors that the reader declares are caught here,
and what has to hold of the result is asserted. Each has seeds, small inputs that lead a long way
in. `run.py` lets atheris look for inputs that a target cannot stand; those found so far are kept in
`corpus/NAME`, and `test_fuzz_corpus.py` tries them, and the seeds, without atheris.
"""

from __future__ import annotations

import atexit
import functools
import importlib.util
import math
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

HERE = Path(__file__).parent
CORPUS = HERE / "corpus"
for _folder in (HERE, HERE.parent / "maps", HERE.parent / "robots"):
    if str(_folder) not in sys.path:
        sys.path.insert(0, str(_folder))

import seeds  # noqa: E402

from usarsim_maps.fbx.library.text import check_text, plain_text  # noqa: E402
from usarsim_maps.numbers import read_numbers  # noqa: E402
from usarsim_maps.reader import Context, ImportOptions, find_reader  # noqa: E402
from usarsim_maps.reader import read_scene as read_map  # noqa: E402
from usarsim_maps.sidecar import load_sidecar  # noqa: E402
from usarsim_record.recording import RecordError, read  # noqa: E402
from usarsim_server.base.errors import MapImportError, UsarsimError, WorldError  # noqa: E402
from usarsim_server.options import load_settings  # noqa: E402
from usarsim_server.protocol import comserver, images, truth, wireless  # noqa: E402
from usarsim_server.protocol import truth as ground_truth  # noqa: E402
from usarsim_server.protocol.commands import interpret  # noqa: E402
from usarsim_server.protocol.dialects import DialectSelector  # noqa: E402
from usarsim_server.protocol.grammar import LineFramer, parse_line  # noqa: E402
from usarsim_server.protocol.numbers import (  # noqa: E402
    fixed,
    read_bool,
    read_int,
    read_number,
    read_vector,
    single,
)
from usarsim_server.protocol.values import LONGEST_NAME, clean_name, free_name  # noqa: E402
from usarsim_server.radio.configuration import read_radio, read_radio_file  # noqa: E402
from usarsim_server.robots.catalog import load_robot  # noqa: E402
from usarsim_server.worlds.avatars.bodies import load_avatars  # noqa: E402
from usarsim_server.worlds.loader import load_world  # noqa: E402
from usarsim_server.worlds.objects.bodies import load_objects  # noqa: E402


@dataclass(frozen=True)
class Target:
    """One thing to fuzz.

    Attributes:
        run: takes any bytes; an exception is a find.
        seeds: inputs to begin with.
        linear: work grows with the length of the input at most in proportion.
        longest: bytes of the inputs that are tried.
    """

    run: Callable[[bytes], None]
    seeds: Callable[[], list[bytes]]
    linear: bool = False
    longest: int = 4096


TARGETS: dict[str, Target] = {}


class Framer(Protocol):
    """Cuts bytes into pieces."""

    def feed(self, data: bytes) -> Any: ...


def target(begin: Callable[[], list[bytes]], **facts: Any) -> Callable[[Any], Any]:
    """Decorator: the function is the target of its name."""

    def add(run: Callable[[bytes], None]) -> Callable[[bytes], None]:
        TARGETS[run.__name__] = Target(run, begin, **facts)
        return run

    return add


def chunks(data: bytes) -> Iterator[bytes]:
    """The bytes cut into pieces of lengths that the bytes themselves give."""
    place = 0
    while place < len(data):
        size = 1 + data[place] % 7
        yield data[place : place + size]
        place += size


def in_pieces(whole: Framer, cut: Framer, data: bytes) -> list[Any]:
    """What a framer makes of the data; the same however they are cut."""
    found = list(whole.feed(data))
    again = [one for chunk in chunks(data) for one in cut.feed(chunk)]
    assert found == again
    return found


# The protocols


@target(seeds.control, linear=True)
def control(data: bytes) -> None:
    """Lines of robot controllers, world controllers and avatars."""
    framer = LineFramer(256)
    selector = DialectSelector()
    for line in in_pieces(LineFramer(256), framer, data):
        assert 0 < len(line) <= 256
        for command in parse_line(line):
            assert command.text.isprintable()
            for name, value in command.segments:
                assert name
                read_bool(value)
                assert all(map(math.isfinite, read_vector(value)))
            selector.observe(interpret(command))
    assert framer.pending <= 256


@target(seeds.numbers, linear=True)
def numbers(data: bytes) -> None:
    """Numbers as clients write them, and as the server does."""
    text = data.decode("latin-1")
    value = read_number(text)
    assert math.isfinite(value)
    assert isinstance(read_int(text), int)
    for written in (fixed(value, 4), single(value, 4)):
        again = read_number(written)
        assert abs(again - value) <= 1e-3 + 1e-6 * abs(value)


@target(seeds.names, linear=True)
def names(data: bytes) -> None:
    """Names of robots, people and objects."""
    text = data.decode("latin-1")
    clean = clean_name(text)
    assert clean_name(clean) == clean
    assert not set(clean) & set("{} \t\r\n")
    assert clean.isprintable()
    try:
        name = free_name(text, {clean.lower()})
    except ValueError:
        return
    assert 0 < len(name) <= LONGEST_NAME
    assert name.lower() != clean.lower()


@target(seeds.image, linear=True)
def image(data: bytes) -> None:
    """Requests of image clients."""
    lexer = images.RequestLexer()
    in_pieces(images.RequestLexer(), lexer, data)
    assert lexer.pending <= 16


@target(seeds.wireless, linear=True)
def wireless_lines(data: bytes) -> None:
    """Requests on the wireless port, those for ground truth included."""
    for line in in_pieces(LineFramer(256), LineFramer(256), data):
        request = wireless.parse_request(line)
        assert all(0 <= port <= 65535 for port in request.ports)
        if request.error is not None:
            wireless.encode(wireless.error_reply(request.error))
        reply = wireless.encode(wireless.strength_reply(request.robot, -50.0))
        assert reply.endswith(b"\r\n")
        wireless.asks_for_ground_truth(line)


@target(seeds.ground_truth, linear=True)
def ground_truth_lines(data: bytes) -> None:
    """GETPOS and GETOBS."""
    for line in in_pieces(LineFramer(256), LineFramer(256), data):
        query = ground_truth.read_ground_truth_query(line.decode("latin-1"))
        if isinstance(query, ground_truth.BetweenPoints | ground_truth.BetweenRobots):
            answer = ground_truth.obstacles(query, 3)
            assert "\n" not in answer
            assert answer.endswith("{ObstCount 3.0000}")


@target(seeds.truth, linear=True)
def truth_lines(data: bytes) -> None:
    """Queries of scoring tools."""
    for line in in_pieces(truth.QueryFramer(256), truth.QueryFramer(256), data):
        query = truth.read_query(line.decode("latin-1"))
        assert len(query.bare_class) <= len(line)


@target(seeds.comserver, linear=True)
def comserver_messages(data: bytes) -> None:
    """Requests of the older wireless simulation."""
    for message in in_pieces(comserver.MessageFramer(), comserver.MessageFramer(), data):
        comserver.parse_message(message)


@target(seeds.link, linear=True)
def comserver_link(data: bytes) -> None:
    """What robots send on its data links."""
    whole, cut = comserver.LinkReader(), comserver.LinkReader()
    payload = whole.feed(data)
    assert payload == b"".join(cut.feed(chunk) for chunk in chunks(data))
    assert whole.closed == cut.closed
    assert len(payload) <= len(data)


# Files of settings


@functools.cache
def folder() -> Path:
    """Where files of targets are written; gone at the end."""
    shared = Path("/dev/shm")
    found = Path(tempfile.mkdtemp(prefix="fuzz-", dir=shared if shared.is_dir() else None))
    atexit.register(shutil.rmtree, found, ignore_errors=True)
    return found


def written(data: bytes, name: str) -> Path:
    """The bytes as a file."""
    path = folder() / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    return path


def told(error: Exception) -> None:
    """An error for users is one line that can be printed anywhere."""
    assert str(error)
    assert "\n" not in str(error)


def add_file(
    name: str,
    file: str,
    begin: Callable[[], list[bytes]],
    load: Callable[[Path], object],
    error: type[Exception] = UsarsimError,
    **facts: Any,
) -> None:
    """A target that loads files of one kind; only the declared error may come of it."""

    def run(data: bytes) -> None:
        try:
            load(written(data, file))
        except error as problem:
            told(problem)

    TARGETS[name] = Target(run, begin, **facts)


def in_a_world(path: Path) -> object:
    """The folder of a world file, with a scene beside it."""
    written(seeds.SCENE, "world/scene.xml")
    return load_world(path.parent)


add_file("robot_toml", "Fuzzed.toml", seeds.robot, load_robot)
add_file("world_toml", "world/world.toml", seeds.world, in_a_world, WorldError)
add_file("objects_toml", "objects.toml", seeds.objects, lambda path: load_objects([path]))
add_file("avatars_toml", "objects.toml", seeds.objects, lambda path: load_avatars([path]))
add_file(
    "radio_toml",
    "radio.toml",
    seeds.radio,
    lambda path: read_radio(read_radio_file(path), str(path), None, 0),
)
add_file("settings_toml", "settings.toml", seeds.settings, lambda path: load_settings({}, path))
add_file("sidecar_toml", "map.usarsim.toml", seeds.sidecar, load_sidecar)
add_file("recording", "session.rec", seeds.recording, read, RecordError)


# Maps


@target(seeds.map_numbers, linear=True)
def map_numbers(data: bytes) -> None:
    """Numbers of maps, read tolerantly."""
    text = data.decode("latin-1")
    for counts in ((), (1,), (3, 6)):
        try:
            values = read_numbers(text, *counts)
        except ValueError as error:
            told(error)
            continue
        assert all(isinstance(value, float) for value in values)


def read_any(path: Path) -> None:
    """Read a map as its name says."""
    find_reader(path)
    read_map(path, Context(ImportOptions(assets=(path.parent,))))


def add_reader(name: str, file: str, begin: Callable[[], list[bytes]], **facts: Any) -> None:
    """A target that reads maps of one kind."""
    add_file(name, f"maps/{file}", begin, read_any, MapImportError, **facts)


add_reader("t3d", "map.t3d", seeds.t3d)
add_reader("ase", "map.ase", seeds.ase)
add_reader("unreal", "map.udk", seeds.unreal, longest=16384)
add_reader("sdf", "map.world", seeds.sdf)
add_reader("urdf", "map.urdf", seeds.urdf)
add_reader("collada", "map.dae", seeds.collada)
add_reader("gltf", "map.gltf", seeds.gltf)
add_reader("glb", "map.glb", seeds.glb)
add_reader("obj", "map.obj", seeds.obj)
add_reader("stl", "map.stl", seeds.stl)
add_reader("ply", "map.ply", seeds.ply)
add_reader("x3d", "map.x3d", seeds.x3d)
add_reader("vrml", "map.wrl", seeds.vrml)
add_reader("ros_map", "map.yaml", seeds.ros_map)
add_reader("picture", "map.png", seeds.picture)
add_reader("mresim", "map.txt", seeds.mresim)
if importlib.util.find_spec("pxr") is not None:
    add_reader("usd", "map.usda", seeds.usd)


@target(seeds.fbx_text, linear=True)
def fbx_text(data: bytes) -> None:
    """FBX as text, before the library sees it."""
    for closely in (False, True):
        try:
            check_text(Path("map.fbx"), plain_text(data), closely=closely)
        except MapImportError as error:
            told(error)


if importlib.util.find_spec("ufbx") is not None:
    add_reader("fbx", "map.fbx", seeds.fbx)
if importlib.util.find_spec("trimesh") is not None:
    add_reader("off", "map.off", seeds.off)
