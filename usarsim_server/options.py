"""What can be set about a server, on its command line and in its settings file.

Both follow from the declared fields of `Settings`, so that a value means the same in either place.
A value on the command line wins over the file, the file over the default.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usarsim_server.base.errors import SettingsError, UsarsimError, at
from usarsim_server.base.fields import Key, keys
from usarsim_server.base.files import read_regular, reason
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import decoded, parse_toml
from usarsim_server.settings import Settings

LONGEST_SIDE = 8192
"""Pixels of the full camera picture that can still be rendered everywhere."""


@dataclass(frozen=True, slots=True)
class Option:
    """One thing that can be set."""

    declared: Key

    @property
    def key(self) -> str:
        """Field of `Settings` and key of the file."""
        return self.declared.key

    @property
    def flag(self) -> str:
        """The command line option."""
        return "--" + self.key.replace("_", "-")

    @property
    def metavar(self) -> str | None:
        """Placeholder on the command line; None for what only the file can set."""
        return self.declared.more.get("metavar")

    @property
    def repeat(self) -> bool:
        """Whether it may be given more than once on the command line."""
        return bool(self.declared.more.get("repeat"))

    @property
    def switch(self) -> bool:
        """Whether the option alone means true."""
        return self.metavar == "true|false"

    @property
    def port(self) -> bool:
        """Whether it is the port of a service."""
        return bool(self.declared.more.get("port"))

    @property
    def default(self) -> str:
        """The default in words."""
        return self.declared.default_text.strip('"') or "unset"

    def read(self, value: object) -> object:
        """The checked value of the field.

        Raises:
            SettingsError: naming the option if it does not fit.
        """
        return self.declared.read(_LineTable({self.key: value}, self.flag, SettingsError), None)

    def read_text(self, text: str | list[str]) -> object:
        """The same for what stood on the command line."""
        if isinstance(text, list) or self.declared.more.get("text"):
            return self.read(text)
        return self.read(_number_or_text(text))


class _LineTable(Table):
    """One option of the command line."""

    def error(self, key: str, problem: str, cure: str) -> UsarsimError:
        return SettingsError(at(self.path, problem, cure))


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


OPTIONS: tuple[Option, ...] = tuple(map(Option, keys(Settings)))
"""Everything that can be set, in the order of the help."""


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
        if text is not None:
            values[option.key] = option.read_text(text)
            places[option.key] = option.flag
    fitting: dict[str, Any] = values
    settings = Settings(config=config, written=frozenset(values), **fitting)
    if settings.lockstep and values.get("speed", math.inf) != math.inf:
        cure = "leave one of them out"
        raise SettingsError(at(places["speed"], "lockstep goes at no pace of its own", cure))
    _check_ports(settings, places)
    _check_picture(settings, places)
    if settings.truth == "off" and settings.scene_port is not None:
        cure = "leave one of them out"
        raise SettingsError(at(places["scene_port"], "it tells where robots really are", cure))
    if settings.supervise == "on" and settings.scene_port is None:
        cure = "open it with --scene-port"
        raise SettingsError(at(places["supervise"], "there is no scene port to do it on", cure))
    return settings


def _check_ports(settings: Settings, places: Mapping[str, str]) -> None:
    """Refuse one port written for two services; a clash with a mere default shows at binding."""
    taken: dict[int, str] = {}
    for key in (option.key for option in OPTIONS if option.port):
        port: int | None = getattr(settings, key)
        if not port or key not in places:
            continue
        if port in taken:
            cure = "give each service its own port, or switch one off"
            problem = f"port {port} is asked for by {places[taken[port]]} too"
            raise SettingsError(at(places[key], problem, cure))
        taken[port] = key


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
    table = _FileTable(text, path)
    values = {one.key: one.declared.read(table, None) for one in OPTIONS if table.has(one.key)}
    table.finish()
    return values


class _FileTable(Table):
    """The settings file, whose errors name the lines of keys."""

    def __init__(self, text: str, path: Path) -> None:
        super().__init__(parse_toml(text, path, SettingsError), path, SettingsError, hyphens=True)
        self._text_of_file = text

    def error(self, key: str, problem: str, cure: str) -> UsarsimError:
        return SettingsError(at(self.path, problem, cure, where=_where(self._text_of_file, key)))


def _file_text(path: Path) -> str:
    try:
        return decoded(read_regular(path), path, SettingsError)
    except FileNotFoundError:
        raise SettingsError(at(path, "no such file", "check the path after --config")) from None
    except OSError as error:
        cure = "name a readable file after --config"
        raise SettingsError(at(path, f"cannot be read: {reason(error)}", cure)) from None


def _where(text: str, key: str) -> str:
    """`line N: key`, or the key alone where its line cannot be found."""
    pattern = re.compile(rf"^\s*\[*\s*[\"']?{re.escape(key)}[\"']?\s*[=.\]]")
    for number, line in enumerate(text.splitlines(), start=1):
        if pattern.match(line):
            return f"line {number}: {key}"
    return key
