"""`usarsim serve`: run a simulation server until it is told to end."""

from __future__ import annotations

import argparse
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from usarsim_server import logs
from usarsim_server.cli.common import Subparsers, add_command
from usarsim_server.options import OPTIONS, Option, is_port
from usarsim_server.settings import Settings, load_settings

__all__ = ["add_parser", "add_settings", "run", "settings_from"]

_EPILOG = (
    "Every option can also stand in the file, with underscores for hyphens; the command line wins. "
    "Only the file can set {file_only}."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `serve` to the command line; its options come from the table of the settings."""
    file_only = [option.key for option in OPTIONS if option.metavar is None]
    parser = add_command(
        subparsers,
        "serve",
        "run a simulation server",
        run,
        epilog=_EPILOG.format(file_only=", ".join(file_only)),
    )
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the options that `settings_from` reads: those of a server."""
    parser.add_argument("--config", metavar="FILE.toml", help="read settings from this file")
    defaults = Settings()
    for option in OPTIONS:
        if option.metavar is not None:
            parser.add_argument(
                option.flag,
                dest=option.key,
                metavar=option.metavar,
                action="append" if option.repeat else "store",
                nargs="?" if option.switch else None,
                const="true" if option.switch else None,
                help=f"{option.help} ({_default(option, defaults)})",
            )


def run(arguments: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM, which end the server with exit code 0."""
    try:
        with _terminable():
            settings = settings_from(arguments)
            logs.configure(settings.log_level)
            from usarsim_server import app

            return app.run(settings)
    except KeyboardInterrupt:
        return 0


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings from parsed arguments and the file they name.

    Raises:
        SettingsError: see `load_settings`.
    """
    config = Path(arguments.config) if arguments.config is not None else None
    given = {option.key: getattr(arguments, option.key, None) for option in OPTIONS}
    return load_settings(given, config)


def _default(option: Option, defaults: Settings) -> str:
    value = getattr(defaults, option.key)
    if value is None and is_port(option):
        return "default off"
    if value is None:
        return "default unset"
    if value == ():
        return "default none"
    if isinstance(value, bool):
        return f"default {str(value).lower()}"
    if isinstance(value, tuple):
        return f"default {'x'.join(map(str, value))}"
    return f"default {getattr(value, 'value', value)}"


@contextmanager
def _terminable() -> Iterator[None]:
    """While inside, SIGTERM raises `KeyboardInterrupt` as SIGINT does.

    Loading a world takes a while; a signal during it must end the program just as quietly as one
    while it serves, when the event loop handles the signals itself.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set signal handlers
        return
    previous = signal.signal(signal.SIGTERM, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
