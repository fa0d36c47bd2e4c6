"""What a gateway is given."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from usarsim_client.cameras import Tile
from usarsim_operator.allowance import Allowance
from usarsim_operator.impairment import Plan
from usarsim_operator.pictures import Grid
from usarsim_operator.signals import BASE


@dataclass(frozen=True, slots=True)
class Settings:
    """What a gateway is given.

    Attributes:
        host, port: of the server. image_port: of its pictures.
        scene: host and port of its scene port; None: it has none. scene_token: of that port.
        latch: file of the emergency stop; None: it ends with the gateway.
        delay: s by which viewers see everything later.
        impairment: how bad the links to pages are; None: as they are.
        tiles: columns and rows of the image port's picture, for servers that tell no tiles.
        spectator: x, y, width, height of the part of it that shows the world from outside, pixels.
        patience: s of wall time that an answer of the server may take.
        wireless: port of the server's wireless simulation; None: it has none. base: name of the
            operator's base there.
        lockstep: the server is in lockstep; else that is found out by the first robot of ours.
        pace: simulated s per s of wall time in lockstep; infinity for as fast as it goes.
        allowance: what operators may do.
    """

    host: str
    port: int
    image_port: int = 5003
    scene: tuple[str, int] | None = None
    scene_token: str = ""
    latch: Path | None = None
    delay: float = 10.0
    impairment: Plan | None = None
    tiles: Grid | None = None
    spectator: Tile | None = None
    wireless: int | None = None
    base: str = BASE
    lockstep: bool = False
    pace: float = 1.0
    patience: float = 10.0
    allowance: Allowance = field(default_factory=Allowance)
