"""`usarsim watch`: what clients of a server send, how it was read, what it did, and why not."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from usarsim_client.inbox import HangupError, ProtocolError
from usarsim_client.scene import connect_scene
from usarsim_server.base.addresses import split_address
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.private import secret
from usarsim_server.cli.common import Subparsers, add_command

RED, YELLOW, BLUE, DIM, PLAIN = "\x1b[31m", "\x1b[33m", "\x1b[36m", "\x1b[2m", "\x1b[0m"
CONNECT = 10.0
"""s of wall time within which the server has to answer."""

_EPILOG = (
    "The server has to be started with --scene-port. Each line of a client is followed by how it "
    "was read and what it did; ! begins what could not be read or done. Ends with Ctrl-C, or with "
    "the server."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `watch`."""
    parser = add_command(
        subparsers,
        "watch",
        "show what robot controllers send, how it is read, and why it does nothing",
        run,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "address",
        metavar="[HOST:]PORT",
        type=_address,
        help="scene port of the server, as its READY line says",
    )
    parser.add_argument("--robot", metavar="NAME", help="only this robot, in any case")
    parser.add_argument(
        "--faults-only", action="store_true", help="only commands with which something is wrong"
    )
    parser.add_argument(
        "--streams", action="store_true", help="show STA and SEN lines, too, twice a second each"
    )
    parser.add_argument(
        "--json", action="store_true", help="one JSON object a line, as the scene port tells it"
    )
    parser.add_argument(
        "--token", metavar="TEXT|FILE", default="", help="what --scene-token of the server says"
    )


def _address(text: str) -> tuple[str, int]:
    host, port = split_address(text)
    if not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise argparse.ArgumentTypeError(f"{text!r} is no address (such as 127.0.0.1:4000)")
    return host or "127.0.0.1", int(port)


def run(arguments: argparse.Namespace) -> int:
    """Watch until interrupted or the server ends.

    Raises:
        UsarsimError: if there is no scene port there, or it refuses.
    """
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_watch(arguments))
    return 0


async def _watch(arguments: argparse.Namespace) -> None:
    host, port = arguments.address
    where = f"{host}:{port}"
    try:
        async with asyncio.timeout(CONNECT):
            scene = await connect_scene(
                host,
                port,
                token=secret(arguments.token),
                channels=["lines"],
                streams=arguments.streams,
            )
    except (OSError, TimeoutError) as error:
        why = getattr(error, "strerror", None) or "no answer"
        cure = "start the server with --scene-port, and give the port of its READY line"
        raise UsarsimError(f"{where}: {why} ({cure})") from None
    except (HangupError, ProtocolError) as error:
        raise UsarsimError(f"{where}: {error}") from None
    colour = sys.stdout.isatty() and not arguments.json
    print(f"watching {scene.welcome.get('world')} at {where}", file=sys.stderr)
    async with scene:
        async for news in scene:
            if isinstance(news, dict):
                for line in shown(news, arguments, colour):
                    print(line, flush=True)


def shown(
    news: Mapping[str, Any], arguments: argparse.Namespace, colour: bool = False
) -> Iterator[str]:
    """The lines to print of a message.

    Args:
        news: the message.
        arguments: `robot`, `faults_only` and `json` say what is wanted.
        colour: for a terminal.
    """
    wanted = (arguments.robot or "").lower()
    if news["type"] == "lines":
        if news.get("lost"):
            yield from _paint([(f"... {news['lost']} rows were lost", YELLOW)], colour)
        rows = list(news["rows"])
    elif news["type"] == "intervention" and not arguments.faults_only:
        rows = [news]
    else:
        return
    for row in rows:
        if wanted and str(row.get("robot") or "").lower() != wanted:
            continue
        if arguments.faults_only and not row.get("faults"):
            continue
        if arguments.json:
            yield json.dumps(row, ensure_ascii=False)
        else:
            yield from _paint(_lines(row), colour)


def _lines(row: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Texts of a row and their colours."""
    head = f"{row['time']:9.2f} {row.get('robot') or row.get('session') or 'world'}"
    if row.get("type") == "intervention":
        return [(f"{head} === {row['action']} by {row.get('by')}", YELLOW)]
    if "out" in row:
        return [(f"{head} < {row['out']}", DIM)]
    texts = [(f"{head} > {row['in']}", BLUE)]
    indent = " " * 10
    texts.append((f"{indent}{row['reading']}: {row['effect']}", YELLOW * bool("suspended" in row)))
    return texts + [(f"{indent}! {fault}", RED) for fault in row["faults"]]


def _paint(texts: list[tuple[str, str]], colour: bool) -> Iterator[str]:
    for text, paint in texts:
        # What clients say goes to a terminal: nothing in it may command that.
        safe = "".join(one if one.isprintable() else "?" for one in text)
        yield f"{paint}{safe}{PLAIN}" if colour and paint else safe
