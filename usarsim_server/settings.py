"""Settings of one server: frozen, checked, from the command line and a TOML file.

A value on the command line wins over the file, the file over the default; what can be set at all
stands in `options.py`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from usarsim_server.errors import SettingsError, at
from usarsim_server.files import read_regular, reason
from usarsim_server.options import OPTIONS, is_port, nearest
from usarsim_server.protocol.dialects import DialectMode
from usarsim_server.protocol.images import NORMAL, ImageType
from usarsim_server.toml import parse_toml

LONGEST_SIDE = 8192
"""Pixels of the full camera picture that can still be rendered everywhere."""

_VISITORS = 16
"""Control connections that are no robots: world controllers, clients that only ask."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything a lab may change about a server.

    Attributes:
        world: name of a shipped world, or path of a world folder.
        host: address to listen on; the default reaches this machine only.
        port: control port; as for all ports 0 takes any free one and None switches it off.
        image_port, groundtruth_port, wireless_port, truth_port, comserver_port: side channels.
        truth: whether anybody is told where robots really are: by the ports for it, by GETPOS and
            GETOBS on the wireless port, by the GroundTruth sensors of robots. Off wins over ports.
        wireless: settings of the wireless simulation, or the file that holds them; checked by
            `radio.configuration.read_radio`.
        wireless_model: propagation model that wins over theirs.
        wireless_log: where to record its events; None for nowhere.
        strict_radio: only robots of the world may be registered with the wireless simulation,
            each once and from the machine of its control connection.
        image_type: encoding of the camera images (side channels reference 2.3).
        image_legacy: send image clients a picture before they ask (side channels reference 2.8).
        image_silent_push: s of wall time after which an image client that has sent nothing gets
            one picture; 0 for never (side channels reference 2.12).
        tiles: columns and rows of the full camera picture, one camera each.
        tile_size: width and height of a tile, pixels (side channels reference 2.10).
        spectator: views that fill tiles from the start: six numbers in the wire frame, or names.
        renderer: what draws camera pictures; auto takes the best that works.
        camera_rate: pictures of a camera per simulated s (side channels reference 2.6).
        shadows: edge of the shadow maps, pixels; 0 for none.
        multisample: samples per pixel; 0 for one.
        always_render: render cameras that nobody looks at, too.
        dialect: shape of the output, or how it is chosen (protocol reference 5.3).
        speed: simulated seconds per second of wall time; `math.inf` for as fast as possible.
        lockstep: the world goes on only when every controller has answered the last tick.
        tick: simulated s between two ticks of lockstep.
        lockstep_patience: s of wall time for which lockstep waits for a controller; 0 for ever.
        seed: of all noise.
        timestep: of the physics, simulated s.
        config: the file that was read.
        robots: folders with further robot files.
        allow_outside: what maps, worlds and robot files name is read wherever it lies.
        max_robots: robots at the same time.
        max_objects: objects that world controllers may put into the world, and avatars.
        clean_on_close: objects leave with the world controller that created them.
        log_level: a name of `logs.LEVELS`.
        sta_order: order of the STA segments in the udk dialect (protocol reference 5.3).
        max_connections: control connections at the same time; see `connections`.
        default_start: where an INIT without place puts the robot: the origin of the wire frame,
            or the first start pose of the world.
        second_init: what a second INIT on a connection does (protocol reference 3.2).
        max_per_address: control connections of one address; None for no other limit.
        connection_rate: new control connections of one address per s; `math.inf` for any number,
            here and with the other rates. All of them are of wall time.
        line_bytes: longest command line, bytes (protocol reference 1.4).
        command_rate: commands of one client per s at real time; see `input_rate`.
        spawn_rate: robots that one address may start per s at real time; see `robot_rate`.
        idle_timeout: s after which a client that wants nothing is closed, on any port; 0 for
            never.
        outbox_bytes: budget of periodic lines waiting for one client, bytes.
        reply_bytes: the same for replies, which are never dropped: beyond it the client is closed.
        quiet_period: s of wall time after INIT without STA and SEN (protocol reference 1.8).
        written: keys that somebody wrote down, whatever the value; see `demands`.
    """

    world: str = "arena"
    host: str = "127.0.0.1"
    port: int | None = 3000
    image_port: int | None = 5003
    groundtruth_port: int | None = 7435
    wireless_port: int | None = 50000
    truth_port: int | None = 3989
    comserver_port: int | None = None
    truth: Literal["on", "off"] = "on"
    wireless: Mapping[str, object] | Path | None = None
    wireless_model: str | None = None
    wireless_log: Path | None = None
    strict_radio: bool = False
    image_type: ImageType = NORMAL
    image_legacy: bool = False
    image_silent_push: float = 2.0
    tiles: tuple[int, int] = (4, 4)
    tile_size: tuple[int, int] = (320, 240)
    spectator: tuple[str, ...] = ()
    renderer: Literal["auto", "egl", "osmesa", "rays"] = "auto"
    camera_rate: float = 15.0
    shadows: int = 0
    multisample: int = 0
    always_render: bool = False
    dialect: DialectMode = DialectMode.AUTO
    speed: float = 1.0
    lockstep: bool = False
    tick: float = 0.1
    lockstep_patience: float = 60.0
    seed: int = 0
    timestep: float = 0.004
    config: Path | None = None
    robots: tuple[Path, ...] = ()
    allow_outside: bool = False
    max_robots: int = 16
    max_objects: int = 256
    clean_on_close: bool = True
    log_level: str = "warning"
    sta_order: Literal["ut2004", "udk"] = "ut2004"
    max_connections: int = 64
    default_start: Literal["origin", "first"] = "origin"
    second_init: Literal["ignore", "replace"] = "ignore"
    max_per_address: int | None = None
    connection_rate: float = 100.0
    line_bytes: int = 64 * 1024
    command_rate: float = 1000.0
    spawn_rate: float = 20.0
    idle_timeout: float = 300.0
    outbox_bytes: int = 256 * 1024
    reply_bytes: int = 1024 * 1024
    quiet_period: float = 0.27
    written: frozenset[str] = field(default=frozenset(), compare=False)

    def demands(self, key: str) -> bool:
        """Whether a setting was asked for and is no mere default.

        A server that cannot have a port that was asked for does not start; without one that it
        would merely have liked it goes on.
        """
        return key in self.written

    @property
    def connections(self) -> int:
        """Control connections at the same time: room for all robots, unless somebody wrote how
        many there may be."""
        if self.demands("max_connections"):
            return self.max_connections
        return max(self.max_connections, self.max_robots + _VISITORS)

    @property
    def input_rate(self) -> float:
        """Commands of one client per s of wall time: controllers of a world that runs faster send
        faster; at `--speed max` there is no limit."""
        return self.command_rate * max(1.0, self.speed)

    @property
    def robot_rate(self) -> float:
        """Robots that one address may start per s of wall time; no limit at `--speed max`, where
        the same script has to give the same run."""
        return self.spawn_rate * max(1.0, self.speed)


def load_settings(
    command_line: Mapping[str, str | list[str] | None], config: Path | None = None
) -> Settings:
    """Put settings together.

    Args:
        command_line: texts by key of `options.OPTIONS`; None stands for an option not given.
        config: the file, or None.

    Raises:
        SettingsError: for the first thing that is wrong, with place and cure.
    """
    values = _read_file(config) if config is not None else {}
    places = {key: f"{config}: {key}" for key in values}
    for option in OPTIONS:
        text = command_line.get(option.key)
        if text is None:
            continue
        try:
            values[option.key] = option.read_text(text, Path())
        except ValueError as error:
            raise SettingsError(at(option.flag, str(error), f"write {option.expects}")) from None
        places[option.key] = option.flag
    fitting: dict[str, Any] = values
    settings = Settings(config=config, written=frozenset(values), **fitting)
    if settings.lockstep:
        settings = _without_pace(settings, places)
    _check_ports(settings, places)
    _check_picture(settings, places)
    return settings


def _check_ports(settings: Settings, places: Mapping[str, str]) -> None:
    """Refuse one port written for two services; a clash with a mere default shows at binding."""
    taken: dict[int, str] = {}
    for key in _PORT_KEYS:
        port: int | None = getattr(settings, key)
        if not port or key not in places:
            continue
        if port in taken:
            cure = "give each service its own port, or switch one off"
            problem = f"port {port} is asked for by {places[taken[port]]} too"
            raise SettingsError(at(places[key], problem, cure))
        taken[port] = key


def _without_pace(settings: Settings, places: Mapping[str, str]) -> Settings:
    """The settings of lockstep, which goes as fast as the controllers allow."""
    if "speed" in places and not math.isinf(settings.speed):
        cure = "leave one of them out"
        raise SettingsError(at(places["speed"], "lockstep goes at no pace of its own", cure))
    return replace(settings, speed=math.inf)


def _check_picture(settings: Settings, places: Mapping[str, str]) -> None:
    """Refuse a full picture that no graphics card could hold, nor the header of its reply."""
    width, height = (n * size for n, size in zip(settings.tiles, settings.tile_size, strict=True))
    if max(width, height) > LONGEST_SIDE:
        place = places.get("tile_size") or places["tiles"]
        problem = f"the full picture would be {width}x{height} pixels"
        cure = f"have fewer or smaller tiles, at most {LONGEST_SIDE} pixels a side in all"
        raise SettingsError(at(place, problem, cure))


def _read_file(path: Path) -> dict[str, object]:
    text = _file_text(path)
    table = parse_toml(text, path, SettingsError)
    values: dict[str, object] = {}
    for written, value in table.items():
        where = _where(text, written)
        key = written.replace("-", "_")
        option = _BY_KEY.get(key)
        if option is None:
            cure = nearest(key, _BY_KEY) or f"known: {', '.join(_BY_KEY)}"
            raise SettingsError(at(path, "no such setting", cure, where=where))
        if key in values:
            raise SettingsError(at(path, "given twice", f"write {key} once", where=where))
        try:
            values[key] = option.read(value, path.parent)
        except ValueError as error:
            cure = f"write {option.expects}"
            raise SettingsError(at(path, str(error), cure, where=where)) from None
    return values


def _file_text(path: Path) -> str:
    try:
        return read_regular(path).decode("utf-8")
    except FileNotFoundError:
        raise SettingsError(at(path, "no such file", "check the path after --config")) from None
    except OSError as error:
        cure = "name a readable file after --config"
        raise SettingsError(at(path, f"cannot be read: {reason(error)}", cure)) from None
    except UnicodeDecodeError:
        raise SettingsError(at(path, "not UTF-8 text", "save it as UTF-8")) from None


def _where(text: str, key: str) -> str:
    """`line N: key`, or the key alone where its line cannot be found."""
    pattern = re.compile(rf"^\s*\[*\s*[\"']?{re.escape(key)}[\"']?\s*[=.\]]")
    for number, line in enumerate(text.splitlines(), start=1):
        if pattern.match(line):
            return f"line {number}: {key}"
    return key


_BY_KEY = {option.key: option for option in OPTIONS}
_PORT_KEYS = tuple(option.key for option in OPTIONS if is_port(option))
