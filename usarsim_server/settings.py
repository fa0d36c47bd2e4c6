"""Settings of one server: frozen, checked, from the command line and a TOML file.

`OPTIONS` is the one table of everything that can be set. The command line is made from it, the
file is read with it, and both are checked by it, so that a value means the same in either place.
A value on the command line wins over the file, the file over the default.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from usarsim_server.errors import SettingsError, at
from usarsim_server.logs import LEVELS
from usarsim_server.protocol.dialects import DialectMode

__all__ = ["OPTIONS", "Option", "Settings", "load_settings"]


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything a lab may change about a server.

    Attributes:
        world: name of a shipped world, or path of a world folder.
        host: address to listen on; the default reaches this machine only.
        port: control port; as for all ports 0 takes any free one and None switches it off.
        image_port, groundtruth_port, wireless_port, truth_port, comserver_port: side channels.
        dialect: shape of the output, or how it is chosen (protocol reference 5.3).
        speed: simulated seconds per second of wall time; `math.inf` for as fast as possible.
        seed: of all noise.
        timestep: of the physics, simulated s.
        config: the file that was read.
        robots: folders with further robot files.
        max_robots: robots at the same time.
        max_objects: objects that world controllers may put into the world, and avatars.
        clean_on_close: objects leave with the world controller that created them.
        log_level: a name of `logs.LEVELS`.
        sta_order: order of the STA segments in the udk dialect (protocol reference 5.3).
        max_connections: control connections at the same time.
        default_start: where an INIT without place puts the robot: the origin of the wire frame,
            or the first start pose of the world.
        second_init: what a second INIT on a connection does (protocol reference 3.2).
        outbox_bytes: budget of periodic lines waiting for one client, bytes.
        quiet_period: s of wall time after INIT without STA and SEN (protocol reference 1.8).
    """

    world: str = "arena"
    host: str = "127.0.0.1"
    port: int | None = 3000
    image_port: int | None = 5003
    groundtruth_port: int | None = 7435
    wireless_port: int | None = 50000
    truth_port: int | None = 3989
    comserver_port: int | None = None
    dialect: DialectMode = DialectMode.AUTO
    speed: float = 1.0
    seed: int = 0
    timestep: float = 0.004
    config: Path | None = None
    robots: tuple[Path, ...] = ()
    max_robots: int = 16
    max_objects: int = 256
    clean_on_close: bool = True
    log_level: str = "warning"
    sta_order: Literal["ut2004", "udk"] = "ut2004"
    max_connections: int = 64
    default_start: Literal["origin", "first"] = "origin"
    second_init: Literal["ignore", "replace"] = "ignore"
    outbox_bytes: int = 256 * 1024
    quiet_period: float = 0.27


Check = Callable[[object, Path], object]
"""Turns a value of the file, or the like from the command line, into that of the field.

The folder is the one that relative paths start from. Raises `ValueError` if the value does
not fit, with what is wrong or with an empty message for plain "does not fit".
"""


@dataclass(frozen=True, slots=True)
class Option:
    """One thing that can be set.

    Attributes:
        key: field of `Settings` and key of the file.
        expects: what to write, for help and for errors.
        check: see `Check`.
        help: one line.
        metavar: placeholder on the command line; None for what only the file can set.
        text: the value is text as it stands, even if it looks like a number.
        repeat: may be given more than once on the command line.
    """

    key: str
    expects: str
    check: Check
    help: str
    metavar: str | None = None
    text: bool = False
    repeat: bool = False

    @property
    def flag(self) -> str:
        """The command line option."""
        return "--" + self.key.replace("_", "-")

    def read(self, value: object, folder: Path) -> object:
        """The checked value of the field; `ValueError` in words if it does not fit."""
        try:
            return self.check(value, folder)
        except ValueError as error:
            raise ValueError(str(error) or f"{_shown(value)} does not fit") from None

    def read_text(self, text: str | list[str], folder: Path) -> object:
        """The checked value of what stood on the command line."""
        if self.text or isinstance(text, list):
            return self.read(text, folder)
        return self.read(_number_or_text(text), folder)


def load_settings(
    command_line: Mapping[str, str | list[str] | None], config: Path | None = None
) -> Settings:
    """Put settings together.

    Args:
        command_line: texts by key of `OPTIONS`; None stands for an option that was not given.
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
    settings = Settings(config=config, **fitting)
    _check_ports(settings, places)
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


def _read_file(path: Path) -> dict[str, object]:
    text = _file_text(path)
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(at(path, f"not TOML: {error}", "mend the line")) from None
    values: dict[str, object] = {}
    for written, value in table.items():
        where = _where(text, written)
        key = written.replace("-", "_")
        option = _BY_KEY.get(key)
        if option is None:
            cure = _nearest(key, _BY_KEY) or f"known: {', '.join(_BY_KEY)}"
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
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SettingsError(at(path, "no such file", "check the path after --config")) from None
    except OSError as error:
        cure = "name a readable file after --config"
        raise SettingsError(at(path, f"cannot be read: {error.strerror}", cure)) from None
    except UnicodeDecodeError:
        raise SettingsError(at(path, "not UTF-8 text", "save it as UTF-8")) from None


def _where(text: str, key: str) -> str:
    """`line N: key`, or the key alone where its line cannot be found."""
    pattern = re.compile(rf"^\s*\[*\s*[\"']?{re.escape(key)}[\"']?\s*[=.\]]")
    for number, line in enumerate(text.splitlines(), start=1):
        if pattern.match(line):
            return f"line {number}: {key}"
    return key


def _nearest(word: str, known: Iterable[str]) -> str | None:
    """A question that names the known word which the misspelt one resembles, if there is one."""
    close = difflib.get_close_matches(word.lower(), list(known), n=1)
    return f"did you mean {close[0]}?" if close else None


def _shown(value: object) -> str:
    """A value as the user wrote it, shortened."""
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _number_or_text(text: str) -> object:
    """What the text would be in the file without quotes: an integer, a number, or else text."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _integer(low: int, high: int) -> Check:
    def check(value: object, folder: Path) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ValueError
        return value

    return check


def _number(low: float, high: float) -> Check:
    def check(value: object, folder: Path) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError
        if not low <= value <= high:  # false for NaN
            raise ValueError
        return float(value)

    return check


def _boolean(value: object, folder: Path) -> bool:
    if not isinstance(value, bool):
        raise ValueError
    return value


def _port(value: object, folder: Path) -> int | None:
    if value == "off":
        return None
    number = _integer(0, 65535)(value, folder)
    assert isinstance(number, int)
    return number


def _speed(value: object, folder: Path) -> object:
    return math.inf if value == "max" else _number(0.01, 1000.0)(value, folder)


def _one_of(*words: str) -> Check:
    def check(value: object, folder: Path) -> str:
        if not isinstance(value, str):
            raise ValueError
        if value not in words:
            advice = _nearest(value, words)
            raise ValueError(f"{_shown(value)} is unknown" + (f", {advice}" if advice else ""))
        return value

    return check


def _dialect(value: object, folder: Path) -> DialectMode:
    return DialectMode(_one_of(*_DIALECTS)(value, folder))


def _host(value: object, folder: Path) -> str:
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise ValueError
    return value.strip()


def _world(value: object, folder: Path) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ValueError
    # A bare word is a shipped world; anything with a slash is a place seen from the file.
    return str(_path(value, folder).absolute()) if "/" in value else value


def _folders(value: object, folder: Path) -> tuple[Path, ...]:
    entries = [value] if isinstance(value, str) else value
    if not isinstance(entries, list):
        raise ValueError
    found = []
    for entry in entries:
        if not isinstance(entry, str) or not entry:
            raise ValueError
        path = _path(entry, folder)
        if not path.is_dir():
            raise ValueError(f"there is no folder {json.dumps(str(path))}")
        found.append(path)
    return tuple(found)


def _path(text: str, folder: Path) -> Path:
    # Not `Path.expanduser`, which raises where there is no such user.
    return folder / os.path.expanduser(text)


_DIALECTS = tuple(mode.value for mode in DialectMode)
_PORT = 'a port from 0 (any free one) to 65535, or "off"'


def _port_option(key: str, service: str) -> Option:
    return Option(key, _PORT, _port, f"port of {service}", "N")


def _word_option(key: str, words: tuple[str, ...], help: str, metavar: str | None = None) -> Option:
    return Option(key, f"one of {', '.join(words)}", _one_of(*words), help, metavar, text=True)


OPTIONS: tuple[Option, ...] = (
    Option(
        "world",
        "the name of a world (see `usarsim worlds`) or the path of a world folder",
        _world,
        "world to simulate, a name or a folder",
        "NAME|PATH",
        text=True,
    ),
    Option("host", "an address of this machine", _host, "address to listen on", "ADDR", text=True),
    _port_option("port", "robot control"),
    _port_option("image_port", "the camera images"),
    _port_option("groundtruth_port", "positions for wireless simulation"),
    _port_option("wireless_port", "wireless simulation"),
    _port_option("truth_port", "poses for scoring tools"),
    _port_option("comserver_port", "the older wireless simulation"),
    Option(
        "dialect",
        f"one of {', '.join(_DIALECTS)}",
        _dialect,
        "shape of the output: that of an era, or by robot class",
        "|".join(_DIALECTS),
        text=True,
    ),
    Option(
        "speed",
        'a factor from 0.01 to 1000, or "max"',
        _speed,
        "simulated seconds per second",
        "FACTOR|max",
    ),
    Option(
        "seed",
        "a whole number from 0 to 2^63 - 1",
        _integer(0, 2**63 - 1),
        "seed of all noise",
        "N",
    ),
    Option(
        "timestep",
        "seconds from 0.0005 to 0.02",
        _number(0.0005, 0.02),
        "step of the physics in seconds",
        "S",
    ),
    Option(
        "robots",
        "an existing folder, or a list of them",
        _folders,
        "folder with further robot files; may be repeated",
        "DIR",
        text=True,
        repeat=True,
    ),
    Option(
        "max_robots", "a whole number from 1 to 64", _integer(1, 64), "robots at the same time", "N"
    ),
    Option(
        "max_objects",
        "a whole number from 0 to 4096",
        _integer(0, 4096),
        "objects of world controllers, and avatars, at the same time",
        "N",
    ),
    Option(
        "clean_on_close",
        "true or false",
        _boolean,
        "whether objects leave with their world controller",
    ),
    _word_option("log_level", tuple(LEVELS), "least severe log lines to show", "|".join(LEVELS)),
    _word_option("sta_order", ("ut2004", "udk"), "order of STA segments in the udk dialect"),
    Option(
        "max_connections",
        "a whole number from 1 to 1024",
        _integer(1, 1024),
        "control connections at the same time",
    ),
    _word_option("default_start", ("origin", "first"), "place of robots whose INIT names none"),
    _word_option("second_init", ("ignore", "replace"), "what a second INIT does"),
    Option(
        "outbox_bytes",
        "bytes from 65536 to 67108864",
        _integer(64 * 1024, 64 * 1024 * 1024),
        "periodic lines that may wait for one client",
    ),
    Option(
        "quiet_period",
        "seconds from 0 to 10",
        _number(0.0, 10.0),
        "silence after INIT, seconds of wall time",
    ),
)
"""Everything that can be set, in the order of the help."""

_BY_KEY = {option.key: option for option in OPTIONS}
_PORT_KEYS = tuple(option.key for option in OPTIONS if option.check is _port)
