"""`usarsim record`: keep a session between any controller and any server."""

from __future__ import annotations

import argparse
import asyncio
import os
import secrets
from collections.abc import Sequence
from pathlib import Path

from usarsim_record.proxy import Proxy
from usarsim_record.recording import Link, RecordError, Writer
from usarsim_server.base.addresses import bare_host, format_address
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.interrupts import calling
from usarsim_server.base.private import private
from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "Point the controller to the port of --listen instead of the server's. Everything is passed on "
    "unchanged and written to FILE as it happens, until Ctrl-C. `usarsim replay FILE` plays the "
    "controller's side again."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `record`."""
    parser = add_command(
        subparsers, "record", "record a session of a controller and a server", run, epilog=_EPILOG
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="recording to write")
    parser.add_argument(
        "--listen",
        metavar="PORT",
        type=_port,
        default=3000,
        help="port to listen on (default 3000)",
    )
    parser.add_argument("--to", metavar="HOST:PORT", required=True, help="port of the server")
    parser.add_argument(
        "--also",
        metavar="PORT=HOST:PORT",
        action="append",
        default=[],
        help="a further port, such as that of the images; may be repeated",
    )
    parser.add_argument(
        "--host",
        metavar="ADDR",
        type=bare_host,
        default="127.0.0.1",
        help="address to listen on (default 127.0.0.1)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace FILE if it exists")


def run(arguments: argparse.Namespace) -> int:
    """Record until interrupted.

    Raises:
        UsarsimError: if a port cannot be had or the file cannot be written.
    """
    links = _links(arguments.listen, arguments.to, arguments.also)
    file = Path(os.path.realpath(arguments.file))
    if os.path.lexists(file) and not arguments.overwrite:
        raise UsarsimError(f"{file}: exists (name another file, or add --overwrite)")
    # Under its name there is the old recording, or a new one that has begun.
    plain = file.is_file() or not file.exists()
    fresh = file.with_name(f".new-{secrets.token_hex(8)}") if plain else file
    try:
        how = os.O_EXCL if plain else os.O_TRUNC
        stream = os.fdopen(private(fresh, os.O_WRONLY | os.O_CREAT | how), "wb", buffering=0)
    except OSError as error:
        raise UsarsimError(f"{file}: cannot be written: {error.strerror}") from error
    try:
        with stream:
            writer = Writer(stream, links)
            count = asyncio.run(_record(links, writer, arguments.host, fresh, file))
            if plain:
                os.fsync(stream.fileno())
    except RecordError as error:
        raise UsarsimError(str(error)) from None
    except OSError as error:
        raise UsarsimError(
            f"{file}: cannot be written any further: {error.strerror} (what was recorded "
            "before can be replayed)"
        ) from None
    finally:
        if plain:
            fresh.unlink(missing_ok=True)
    print(f"{file}: {count} events")
    return 0


async def _record(links: Sequence[Link], writer: Writer, host: str, fresh: Path, file: Path) -> int:
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    with calling(lambda: loop.call_soon_threadsafe(stop.set)):
        proxy = Proxy(links, writer, host)
        ports = await proxy.start()
        words = [
            f"{format_address(host, port)}->{format_address(link.host, link.port)}"
            for port, link in zip(ports, links, strict=True)
        ]
        if fresh != file:
            os.replace(fresh, file)
        print("RECORDING", *words, flush=True)
        ended = asyncio.create_task(stop.wait())
        await asyncio.wait((ended, proxy.failed), return_when=asyncio.FIRST_COMPLETED)
        await proxy.stop()
        ended.cancel()
    if proxy.failed.done():
        raise proxy.failed.result()
    return writer.count


def _links(listen: int, to: str, also: Sequence[str]) -> list[Link]:
    try:
        links = [Link.parse(listen, to)]
    except ValueError as error:
        raise UsarsimError(f"--to: {error}") from None
    for text in also:
        port, equals, target = text.partition("=")
        try:
            if not equals or not port.isdecimal():
                raise ValueError(f"{text!r} is not of the form PORT=HOST:PORT")
            links.append(Link.parse(int(port), target))
        except ValueError as error:
            raise UsarsimError(f"--also: {error}") from None
    return links


def _port(text: str) -> int:
    number = int(text)
    if not 0 <= number < 65536:
        raise argparse.ArgumentTypeError(f"must be from 0 to 65535, not {number}")
    return number
