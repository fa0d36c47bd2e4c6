"""Settings of one server: frozen, each declared once with its type, default, range and help.

The command line's options, the keys of the settings file and the table in `docs/settings.md` follow
from the declarations; `options.py` reads them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as plain_field
from pathlib import Path
from typing import Any, Literal

from usarsim_server import readers
from usarsim_server.base.fields import field
from usarsim_server.base.logs import LEVELS
from usarsim_server.protocol.dialects import DialectMode
from usarsim_server.protocol.images import IMAGE_TYPES, NORMAL, ImageType
from usarsim_server.world_cost import MAX_MEMORY, MAX_PIECES, MOST

MOST_TILES = 64
"""Largest number of tiles of the original's grid (side channels reference 2.10)."""

_SIDE = (16, 2048)
"""Pixels that a tile may have along a side."""

_VISITORS = 16
"""Control connections that are no robots: world controllers, clients that only ask."""


_TILES = f"columns and rows such as 4x4, {MOST_TILES} tiles at most"
_TILE_SIZE = f"width and height such as 320x240, each from {_SIDE[0]} to {_SIDE[1]}"
_PORT: dict[str, Any] = {
    "low": 0,
    "high": 65535,
    "unit": "(0: any free one)",
    "words": {"off": None},
    "metavar": "N",
    "port": True,
}
_SWITCH: dict[str, Any] = {"default": False, "metavar": "true|false"}


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything a lab may change about a server.

    A field with `metavar` is an option of the command line, too; `text` is one whose text there is
    taken as it stands, even if it looks like a number; `repeat` may be given more than once.
    Rates are of wall time.
    """

    world: str = field(
        default="arena",
        parse=readers.world,
        expects="the name of a world (see `usarsim worlds`), the path of a world folder, or of a "
        "map",
        help="world to simulate: a name, a folder, or a map to import",
        metavar="NAME|PATH",
        text=True,
    )
    host: str = field(
        default="127.0.0.1",  # reaches this machine only
        parse=readers.host,
        expects="an address of this machine",
        help="address to listen on",
        metavar="ADDR",
        text=True,
    )
    port: int | None = field(default=3000, help="port of robot control", **_PORT)
    image_port: int | None = field(default=5003, help="port of the camera images", **_PORT)
    groundtruth_port: int | None = field(
        default=7435, help="port of positions for wireless simulation", **_PORT
    )
    wireless_port: int | None = field(default=50000, help="port of wireless simulation", **_PORT)
    truth_port: int | None = field(default=3989, help="port of poses for scoring tools", **_PORT)
    comserver_port: int | None = field(
        default=None, help="port of the older wireless simulation", **_PORT
    )
    scene_port: int | None = field(default=None, help="port of the live true world", **_PORT)
    scene_token: str | None = field(
        default=None,
        parse=readers.secret,
        expects="a text, or the path of a file with one",
        help="what clients of the scene port have to know; unset: nothing",
        metavar="TEXT|FILE",
        text=True,
    )
    supervise: Literal["on", "off"] = field(
        default="off",
        help="on: clients of the scene port may take robots over, pause and reset the world",
        metavar="on|off",
    )
    truth: Literal["on", "off"] = field(
        # By the ports for it, by GETPOS and GETOBS on the wireless port, by GroundTruth sensors.
        default="on",
        help="off: nobody is told where robots really are, on no port and by no sensor",
        metavar="on|off",
    )
    wireless: Mapping[str, object] | Path | None = field(
        # Checked by `radio.configuration.read_radio`.
        default=None,
        parse=readers.radio,
        expects="a table (see docs/wireless.md) or the path of a file with one",
        help="file with the settings of the wireless simulation",
        metavar="FILE.toml",
        text=True,
    )
    wireless_model: str | None = field(
        default=None,
        parse=readers.host,
        expects="the name of a propagation model",
        help="how radio signals spread; without it the settings say so, or else it is obstacle",
        metavar="NAME",
        text=True,
    )
    wireless_log: Path | None = field(
        default=None,
        parse=readers.file,
        expects="the path of a file, or of a folder",
        help="record the events of the wireless simulation",
        metavar="FILE",
        text=True,
    )
    strict_radio: bool = field(
        help="let only robots of the world register for radio, each from its own machine",
        **_SWITCH,
    )
    image_type: ImageType = field(
        default=NORMAL,  # side channels reference 2.3
        parse=readers.image_type,
        expects=f"{', '.join(IMAGE_TYPES)} or a number from 0 up",
        help="encoding of the camera images",
        metavar="RAW|NORMAL|...",
        shown="NORMAL",
    )
    image_legacy: bool = field(  # side channels reference 2.8
        help="send image clients a picture before they ask", **_SWITCH
    )
    image_silent_push: float = field(
        default=2.0,  # side channels reference 2.12
        unit="s",
        low=0.0,
        high=3600.0,
        words={"off": 0.0},
        help="wall time after which an image client that never asked gets a picture",
        metavar="S|off",
    )
    tiles: tuple[int, int] = field(
        default=(4, 4),
        parse=readers.pair(_TILES, lambda columns, rows: 1 <= columns * rows <= MOST_TILES),
        expects=_TILES,
        help="tiles of the full camera image, one camera each",
        shown="4x4",
        metavar="CxR",
        text=True,
    )
    tile_size: tuple[int, int] = field(
        default=(320, 240),  # side channels reference 2.10
        parse=readers.pair(
            _TILE_SIZE, lambda *sides: _SIDE[0] <= min(sides) <= max(sides) <= _SIDE[1]
        ),
        expects=_TILE_SIZE,
        help="pixels of a tile",
        shown="320x240",
        metavar="WxH",
        text=True,
    )
    spectator: tuple[str, ...] = field(
        default=(),
        parse=readers.texts,
        expects="x,y,z,x,y,z (from where, to where), the name of a view of the world, or a list "
        "of these",
        help="a camera that stands still fills the next tile; may be repeated",
        metavar="VIEW",
        text=True,
        repeat=True,
    )
    renderer: Literal["auto", "egl", "osmesa", "rays"] = field(
        default="auto", help="what draws the camera images", metavar="auto|egl|osmesa|rays"
    )
    camera_rate: float = field(
        default=15.0,  # side channels reference 2.6
        unit="Hz",
        low=0.1,
        high=60.0,
        help="images of a camera per simulated second",
        metavar="HZ",
    )
    shadows: int = field(
        default=0, unit="pixels", low=0, high=4096, help="size of shadow maps", metavar="N"
    )
    multisample: int = field(
        default=0,
        parse=readers.samples,
        expects="0, 2 or 4",
        help="samples per pixel, for smooth edges",
        metavar="0|2|4",
    )
    always_render: bool = field(help="render cameras that nobody looks at, too", **_SWITCH)
    dialect: DialectMode = field(
        default=DialectMode.AUTO,  # protocol reference 5.3
        help="shape of the output: that of an era, or by robot class",
        metavar="|".join(mode.value for mode in DialectMode),
    )
    speed: float = field(
        default=1.0,
        low=0.01,
        high=1000.0,
        words={"max": math.inf},
        help="simulated seconds per second",
        metavar="FACTOR|max",
    )
    lockstep: bool = field(
        help="step only when every controller has answered the last tick (see docs)", **_SWITCH
    )
    tick: float = field(
        default=0.1,
        unit="s",
        low=0.01,
        high=60.0,
        help="simulated seconds between two ticks of lockstep",
        metavar="S",
    )
    lockstep_patience: float = field(
        default=60.0,
        unit="s",
        low=0.0,
        high=86400.0,
        help="how long lockstep waits for one controller, wall time; 0: for ever",
        metavar="S",
    )
    seed: int = field(default=0, low=0, high=2**63 - 1, help="seed of all noise", metavar="N")
    timestep: float = field(
        default=0.004,
        unit="s",
        low=0.0005,
        high=0.02,
        help="step of the physics in seconds",
        metavar="S",
    )
    config: Path | None = None
    """The file that was read."""
    robots: tuple[Path, ...] = field(
        default=(),
        parse=readers.folders,
        expects="an existing folder, or a list of them",
        help="folder with further robot files; may be repeated",
        metavar="DIR",
        text=True,
        repeat=True,
    )
    max_robots: int = field(
        default=16, low=1, high=256, help="robots at the same time", metavar="N"
    )
    max_objects: int = field(
        default=256,
        low=0,
        high=4096,
        help="objects of world controllers, and avatars, at the same time",
        metavar="N",
    )
    max_pieces: int = field(
        default=MAX_PIECES,
        low=1,
        high=MOST,
        help="pieces of the world; more are refused",
        metavar="N",
    )
    max_world_memory: int = field(
        default=MAX_MEMORY,
        unit="MiB",
        low=1,
        high=MOST,
        help="memory of the compiled world; more is refused",
        metavar="MIB",
    )
    allow_outside: bool = field(
        help="let maps, worlds and robot files read files outside the folders that were given",
        **_SWITCH,
    )
    clean_on_close: bool = field(
        default=True, help="whether objects leave with their world controller"
    )
    log_level: str = field(
        default="warning",
        choices=tuple(LEVELS),
        help="least severe log lines to show",
        metavar="|".join(LEVELS),
    )
    sta_order: Literal["ut2004", "udk"] = field(  # protocol reference 5.3
        default="ut2004", help="order of STA segments in the udk dialect"
    )
    max_connections: int = field(
        default=64,
        low=1,
        high=1024,
        help="control connections at the same time, and room for `max_robots` unless it is set",
    )
    max_per_address: int | None = field(
        default=None,
        low=1,
        high=1024,
        words={"off": None},
        help="control connections of one address at the same time",
    )
    connection_rate: float = field(
        default=100.0,
        low=1.0,
        high=10000.0,
        words={"off": math.inf},
        help="new control connections of one address per second in the long run",
    )
    line_bytes: int = field(
        default=64 * 1024,  # protocol reference 1.4
        unit="bytes",
        low=64 * 1024,
        high=16 * 1024 * 1024,
        help="longest command line; longer ones are thrown away",
    )
    command_rate: float = field(
        default=1000.0,
        low=200.0,
        high=1e6,
        words={"off": math.inf},
        help="commands of one client per second in the long run, at real time",
    )
    spawn_rate: float = field(
        default=20.0,
        low=0.1,
        high=1000.0,
        words={"off": math.inf},
        help="robots that one address may start per second in the long run, at real time",
    )
    idle_timeout: float = field(
        default=300.0,
        unit="s",
        low=10.0,
        high=86400.0,
        words={"off": 0.0},
        help="silence after which a client without a robot is closed, on any port",
    )
    default_start: Literal["origin", "first"] = field(
        default="origin",
        help="place of robots whose INIT names none: the origin of the wire frame, or the first "
        "start pose of the world",
    )
    second_init: Literal["ignore", "replace"] = field(  # protocol reference 3.2
        default="ignore", help="what a second INIT does"
    )
    outbox_bytes: int = field(
        default=256 * 1024,
        unit="bytes",
        low=64 * 1024,
        high=64 * 1024 * 1024,
        help="periodic lines that may wait for one client",
    )
    reply_bytes: int = field(
        default=1024 * 1024,
        unit="bytes",
        low=64 * 1024,
        high=64 * 1024 * 1024,
        help="replies that may wait for one client before it is closed",
    )
    quiet_period: float = field(
        default=0.27,  # protocol reference 1.8
        unit="s",
        low=0.0,
        high=10.0,
        help="silence after INIT, seconds of wall time",
    )
    written: frozenset[str] = plain_field(default=frozenset(), compare=False)
    """Keys that somebody wrote down, whatever the value; see `demands`."""

    def __post_init__(self) -> None:
        if self.lockstep:  # it goes as fast as the controllers allow
            object.__setattr__(self, "speed", math.inf)

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
