"""Everything that can be set about a server, in one table.

The command line is made from `OPTIONS`, the settings file is read with it, and both are checked by
it, so that a value means the same in either place.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.files import is_folder
from usarsim_server.logs import LEVELS
from usarsim_server.protocol.dialects import DialectMode
from usarsim_server.protocol.images import IMAGE_TYPES, ImageType

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
        switch: true or false; on the command line the option alone means true.
    """

    key: str
    expects: str
    check: Check
    help: str
    metavar: str | None = None
    text: bool = False
    repeat: bool = False
    switch: bool = False

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


def nearest(word: str, known: Iterable[str]) -> str | None:
    """A question that names the known word which the misspelt one resembles, if there is one."""
    close = difflib.get_close_matches(word.lower(), list(known), n=1)
    return f"did you mean {close[0]}?" if close else None


def _shown(value: object) -> str:
    """A value as the user wrote it, shortened."""
    quoted = isinstance(value, str | bool)
    text = json.dumps(value, ensure_ascii=False) if quoted else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _number_or_text(text: str) -> object:
    """What the text would be in the file without quotes: a truth, a number, or else text."""
    if text in ("true", "false"):
        return text == "true"
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
            advice = nearest(value, words)
            raise ValueError(f"{_shown(value)} is unknown" + (f", {advice}" if advice else ""))
        return value

    return check


def _dialect(value: object, folder: Path) -> DialectMode:
    return DialectMode(_one_of(*_DIALECTS)(value, folder))


def _image_type(value: object, folder: Path) -> ImageType:
    if isinstance(value, str):
        word = value.upper()
        return ImageType.named(str(_one_of(*IMAGE_TYPES)(word, folder) if word else word))
    number = _integer(0, 2**31 - 1)(value, folder)
    assert isinstance(number, int)
    return ImageType(number)


def _rate(low: float, high: float) -> Check:
    number = _number(low, high)

    def check(value: object, folder: Path) -> object:
        return math.inf if value == "off" else number(value, folder)

    return check


def _patience(value: object, folder: Path) -> object:
    return 0.0 if value == "off" else _number(0.0, 3600.0)(value, folder)


def _idle_timeout(value: object, folder: Path) -> object:
    return 0.0 if value == "off" else _number(10.0, 86400.0)(value, folder)


def _max_per_address(value: object, folder: Path) -> object:
    return None if value == "off" else _integer(1, 1024)(value, folder)


def _pair(value: object) -> tuple[int, int]:
    """Two whole numbers with an x between them."""
    found = (
        re.fullmatch(r"([0-9]{1,5}) ?[xX] ?([0-9]{1,5})", value) if isinstance(value, str) else None
    )
    if found is None:
        raise ValueError
    return int(found[1]), int(found[2])


def _tiles(value: object, folder: Path) -> tuple[int, int]:
    columns, rows = _pair(value)
    if not 1 <= columns * rows <= MOST_TILES:
        raise ValueError(f"{columns * rows} tiles do not fit")
    return columns, rows


def _tile_size(value: object, folder: Path) -> tuple[int, int]:
    width, height = _pair(value)
    if not all(_SIDE[0] <= side <= _SIDE[1] for side in (width, height)):
        raise ValueError
    return width, height


def _samples(value: object, folder: Path) -> int:
    if isinstance(value, bool) or value not in (0, 2, 4):
        raise ValueError
    return int(str(value))


def _viewpoints(value: object, folder: Path) -> tuple[str, ...]:
    """Texts as they stand; what they mean depends on the world."""
    entries = [value] if isinstance(value, str) else value
    if not isinstance(entries, list):
        raise ValueError
    if not all(isinstance(entry, str) and entry.strip() for entry in entries):
        raise ValueError
    return tuple(entries)


def _host(value: object, folder: Path) -> str:
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise ValueError
    return value.strip()


def _word(value: object, folder: Path) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ValueError
    return value.strip()


def _world(value: object, folder: Path) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ValueError
    # A bare word is a shipped world; anything with a slash is a place seen from the file.
    return str(_path(value, folder).absolute()) if "/" in value else value


def _radio(value: object, folder: Path) -> object:
    """A table as it stands, or the path of a file that holds one."""
    return value if isinstance(value, dict) else _file(value, folder)


def _file(value: object, folder: Path) -> Path:
    if not isinstance(value, str) or not value.strip():
        raise ValueError
    return _path(value, folder)


def _folders(value: object, folder: Path) -> tuple[Path, ...]:
    entries = [value] if isinstance(value, str) else value
    if not isinstance(entries, list):
        raise ValueError
    found = []
    for entry in entries:
        if not isinstance(entry, str) or not entry:
            raise ValueError
        path = _path(entry, folder)
        if not is_folder(path):
            raise ValueError(f"there is no folder {json.dumps(str(path))}")
        found.append(path)
    return tuple(found)


def _path(text: str, folder: Path) -> Path:
    if "\0" in text:
        raise ValueError("no file can have a NUL in its name")
    # Not `Path.expanduser`, which raises where there is no such user.
    return folder / os.path.expanduser(text)


MOST_TILES = 64
"""Largest number of tiles of the original's grid (side channels reference 2.10)."""
_SIDE = (16, 2048)
"""Pixels that a tile may have along a side."""
_DIALECTS = tuple(mode.value for mode in DialectMode)
_PORT = 'a port from 0 (any free one) to 65535, or "off"'


def _port_option(key: str, service: str) -> Option:
    return Option(key, _PORT, _port, f"port of {service}", "N")


def _word_option(key: str, words: tuple[str, ...], help: str, metavar: str | None = None) -> Option:
    return Option(key, f"one of {', '.join(words)}", _one_of(*words), help, metavar, text=True)


def _switch_option(key: str, help: str) -> Option:
    return Option(key, "true or false", _boolean, help, "true|false", switch=True)


OPTIONS: tuple[Option, ...] = (
    Option(
        "world",
        "the name of a world (see `usarsim worlds`), the path of a world folder, or of a map",
        _world,
        "world to simulate: a name, a folder, or a map to import",
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
    _word_option(
        "truth",
        ("on", "off"),
        "off: nobody is told where robots really are, on no port and by no sensor",
        "on|off",
    ),
    Option(
        "wireless",
        "a table (see docs/wireless.md) or the path of a file with one",
        _radio,
        "file with the settings of the wireless simulation",
        "FILE.toml",
        text=True,
    ),
    Option(
        "wireless_model",
        "the name of a propagation model",
        _word,
        "how radio signals spread; without it the settings say so, or else it is obstacle",
        "NAME",
        text=True,
    ),
    Option(
        "wireless_log",
        "the path of a file, or of a folder",
        _file,
        "record the events of the wireless simulation",
        "FILE",
        text=True,
    ),
    _switch_option(
        "strict_radio",
        "let only robots of the world register for radio, each from its own machine",
    ),
    Option(
        "image_type",
        f"{', '.join(IMAGE_TYPES)} or a number from 0 up",
        _image_type,
        "encoding of the camera images",
        "RAW|NORMAL|...",
    ),
    _switch_option("image_legacy", "send image clients a picture before they ask"),
    Option(
        "image_silent_push",
        'seconds from 0 to 3600, or "off"',
        _patience,
        "seconds after which an image client that never asked gets a picture",
        "S|off",
    ),
    Option(
        "tiles",
        f"columns and rows such as 4x4, {MOST_TILES} tiles at most",
        _tiles,
        "tiles of the full camera image, one camera each",
        "CxR",
        text=True,
    ),
    Option(
        "tile_size",
        f"width and height such as 320x240, each from {_SIDE[0]} to {_SIDE[1]}",
        _tile_size,
        "pixels of a tile",
        "WxH",
        text=True,
    ),
    Option(
        "spectator",
        "x,y,z,x,y,z (from where, to where), the name of a view of the world, or a list of these",
        _viewpoints,
        "a camera that stands still fills the next tile; may be repeated",
        "VIEW",
        text=True,
        repeat=True,
    ),
    _word_option(
        "renderer",
        ("auto", "egl", "osmesa", "rays"),
        "what draws the camera images",
        "auto|egl|osmesa|rays",
    ),
    Option(
        "camera_rate",
        "a number from 0.1 to 60",
        _number(0.1, 60.0),
        "images of a camera per simulated second",
        "HZ",
    ),
    Option("shadows", "pixels from 0 to 4096", _integer(0, 4096), "size of shadow maps", "N"),
    Option("multisample", "0, 2 or 4", _samples, "samples per pixel, for smooth edges", "0|2|4"),
    _switch_option("always_render", "render cameras that nobody looks at, too"),
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
    _switch_option(
        "lockstep", "step only when every controller has answered the last tick (see docs)"
    ),
    Option(
        "tick",
        "simulated seconds from 0.01 to 60",
        _number(0.01, 60.0),
        "simulated seconds between two ticks of lockstep",
        "S",
    ),
    Option(
        "lockstep_patience",
        "seconds of wall time, 0 for ever",
        _number(0.0, 86400.0),
        "how long lockstep waits for one controller",
        "S",
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
        "max_robots",
        "a whole number from 1 to 256",
        _integer(1, 256),
        "robots at the same time",
        "N",
    ),
    Option(
        "max_objects",
        "a whole number from 0 to 4096",
        _integer(0, 4096),
        "objects of world controllers, and avatars, at the same time",
        "N",
    ),
    _switch_option(
        "allow_outside",
        "let maps, worlds and robot files read files outside the folders that were given",
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
    Option(
        "max_per_address",
        'a whole number from 1 to 1024, or "off"',
        _max_per_address,
        "control connections of one address at the same time",
    ),
    Option(
        "connection_rate",
        'a number from 1 to 10000, or "off"',
        _rate(1.0, 10000.0),
        "new control connections of one address per second in the long run",
    ),
    Option(
        "line_bytes",
        "bytes from 65536 to 16777216",
        _integer(64 * 1024, 16 * 1024 * 1024),
        "longest command line; longer ones are thrown away",
    ),
    Option(
        "command_rate",
        'a number from 200 to 1000000, or "off"',
        _rate(200.0, 1e6),
        "commands of one client per second in the long run",
    ),
    Option(
        "spawn_rate",
        'a number from 0.1 to 1000, or "off"',
        _rate(0.1, 1000.0),
        "robots that one address may start per second in the long run",
    ),
    Option(
        "idle_timeout",
        'seconds from 10 to 86400, or "off"',
        _idle_timeout,
        "silence after which a client without a robot is closed, on any port",
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
        "reply_bytes",
        "bytes from 65536 to 67108864",
        _integer(64 * 1024, 64 * 1024 * 1024),
        "replies that may wait for one client before it is closed",
    ),
    Option(
        "quiet_period",
        "seconds from 0 to 10",
        _number(0.0, 10.0),
        "silence after INIT, seconds of wall time",
    ),
)
"""Everything that can be set, in the order of the help."""


def is_port(option: Option) -> bool:
    """Whether an option is the port of a service."""
    return option.check is _port
