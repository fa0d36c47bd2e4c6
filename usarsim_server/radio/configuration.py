"""From the `[wireless]` table of a settings file to a model and all that goes with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.errors import SettingsError
from usarsim_server.fields import field
from usarsim_server.radio.fading import Fading, LinkShape
from usarsim_server.radio.models import Propagation, create_model
from usarsim_server.tables import Table
from usarsim_server.toml import read_toml

DEFAULT_MODEL = "obstacle"


@dataclass(frozen=True, slots=True, eq=False)
class RadioOptions:
    """How the wireless simulation works."""

    model: Propagation  # propagation
    fading: Fading  # random part of the signal
    shape: LinkShape  # of the traffic that links carry
    poll: float = field(
        default=0.25, unit="s", low=0.02, high=60.0, help="wall time between two looks at the world"
    )
    patience: float = field(
        default=1.0,
        unit="s",
        low=0.0,
        high=1e9,
        help="wall time that a registered robot may be missing in the simulator",
    )
    cache_distance: float = field(
        default=0.25,
        unit="m",
        low=0.0,
        high=1000.0,
        help="how far a robot may move before obstacles are counted again",
    )
    share: float = field(
        default=0.15, low=0.01, high=64.0, help="of a processor that all links together may use"
    )


def read_radio(
    content: Mapping[str, object], place: str, model: str | None = None, seed: int = 0
) -> RadioOptions:
    """Read a table.

    Args:
        content: keys as in docs/wireless.md; the model's own stand among them.
        place: where it stands, for errors.
        model: name that wins over the table's.
        seed: of fading and loss, unless the table names one.

    Raises:
        SettingsError: for the first thing that is wrong, with place and cure.
    """
    table = Table(content, place, SettingsError, kind="the wireless simulation", hyphens=True)
    written = table.text("model", DEFAULT_MODEL)
    where = f"{place}: model" if model is None else "--wireless-model"
    chosen = create_model(model or written, table, where)
    fading = table.read(Fading, Fading(seed=seed))
    options = table.read(RadioOptions, model=chosen, fading=fading, shape=table.read(LinkShape))
    table.finish()
    return options


def read_radio_file(path: Path) -> dict[str, object]:
    """The table that a file of its own holds, with or without a `[wireless]` head.

    Raises:
        SettingsError: if it cannot be read or is not TOML.
    """
    table = read_toml(path, SettingsError, "wireless.obstacle")
    inner = table.get("wireless")
    return inner if isinstance(inner, dict) and len(table) == 1 else table
