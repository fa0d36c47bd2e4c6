"""`usarsim serve`: run a simulation server until it is told to end."""

from __future__ import annotations

import argparse
import gc
import os
from pathlib import Path
from types import ModuleType

from usarsim_server.base import logs
from usarsim_server.cli.common import Subparsers, add_command
from usarsim_server.options import OPTIONS, load_settings
from usarsim_server.services import listener
from usarsim_server.settings import Settings

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
    for option in OPTIONS:
        if option.metavar is not None:
            parser.add_argument(
                option.flag,
                dest=option.key,
                metavar=option.metavar,
                action="append" if option.repeat else "store",
                nargs="?" if option.switch else None,
                const="true" if option.switch else None,
                help=f"{option.declared.help} (default {option.default})",
            )


def run(arguments: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM, which end the server with exit code 0.

    Ports are opened before anything that takes long, the import of the physics included: a second
    server on the same ports says so at once.

    Raises:
        UsarsimError: if the server cannot start, or the physics has to give up.
    """
    settings = settings_from(arguments)
    logs.configure(settings.log_level)
    try:
        _open_ports(settings)
        return int(_imported().run(settings))
    except KeyboardInterrupt:
        return 0
    finally:
        listener.close_unused()


def _imported() -> ModuleType:
    """`app`, and with it the physics.

    Nothing of what is made here is ever garbage, and mujoco need not look for a window system, for
    which it starts a process: cameras draw without one (`cameras/gl.py`). That saves a tenth of
    the time until the server is ready.
    """
    named = os.environ.get("MUJOCO_GL")
    gc.disable()
    try:
        os.environ["MUJOCO_GL"] = named or "disable"
        from usarsim_server import app
    finally:
        if named is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = named
        gc.enable()
    gc.freeze()
    return app


def _open_ports(settings: Settings) -> None:
    """Open the ports that the server does not run without; the services take them over.

    Raises:
        ServiceError: one is taken, or not allowed.
    """
    for option in (option for option in OPTIONS if option.port):
        port: int | None = getattr(settings, option.key)
        # Without robot control, or a port that was asked for, the server ends.
        if port is not None and (option.key == "port" or settings.demands(option.key)):
            name = {"port": "control", "image_port": "images"}.get(option.key)
            listener.open_early(
                name or option.key.removesuffix("_port"), settings.host, port, option=option.flag
            )


def settings_from(arguments: argparse.Namespace) -> Settings:
    """Settings from parsed arguments and the file they name.

    Raises:
        SettingsError: see `load_settings`.
    """
    config = Path(arguments.config) if arguments.config is not None else None
    given = {option.key: getattr(arguments, option.key, None) for option in OPTIONS}
    return load_settings(given, config)
