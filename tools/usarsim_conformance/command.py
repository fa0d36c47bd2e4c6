"""`usarsim conformance`: judge any server by the rules of the protocol, compare reports."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from usarsim_conformance.own_server import as_table as as_class_table
from usarsim_conformance.own_server import judge_classes, judged_server, robot_classes
from usarsim_conformance.places import place_from
from usarsim_conformance.registry import DIALECTS, Check, Failed, all_checks, select
from usarsim_conformance.report import Report, as_json, from_json
from usarsim_conformance.reports import (
    ProgressPrinter,
    as_junit,
    as_list,
    as_page,
    as_text,
    compare,
    named_apart,
)
from usarsim_conformance.runner import judge_all
from usarsim_conformance.survey import GROUND, Target
from usarsim_server import __version__
from usarsim_server.base.addresses import bare_host
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import write_text
from usarsim_server.base.tables import suggest
from usarsim_server.base.toml import read_text
from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "Exit code 0 if no rule that must be kept is broken, else 1. Side channels are judged if their "
    "ports are named. The server should have nothing else to do meanwhile, and some open floor "
    "around its start poses."
)
_SIDE_PORTS = {
    "images": "image",
    "groundtruth": "groundtruth",
    "wireless": "wireless",
    "comserver": "comserver",
    "truth": "truth",
}


def add_parser(subparsers: Subparsers) -> None:
    """Add `conformance`, and `conformance compare`."""
    parser = add_command(
        subparsers,
        "conformance",
        "judge a server by the rules of the protocol",
        run,
        epilog=_EPILOG,
    )
    parser.add_argument("--host", type=bare_host, default="127.0.0.1", help="address of the server")
    parser.add_argument("--port", metavar="N", type=_port, default=3000, help="robot control")
    for service, option in _SIDE_PORTS.items():
        parser.add_argument(
            f"--{option}-port", metavar="N", type=_port, dest=service, help="judge it, too"
        )
    parser.add_argument(
        "--robot",
        metavar="CLASS",
        help="robot class for most checks; with --self several with commas between, or all",
    )
    parser.add_argument(
        "--start", metavar="NAME|x,y,z", type=_start, help="put robots there, one at a time"
    )
    parser.add_argument(
        "--dialect",
        choices=("auto", *DIALECTS),
        default="auto",
        help="judge this dialect only (default: all that the server speaks)",
    )
    parser.add_argument(
        "--only", metavar="PATTERN", help="checks whose name fits, such as control.init.*"
    )
    parser.add_argument("--list", action="store_true", help="list the checks and do nothing else")
    parser.add_argument(
        "--report", metavar="DIR", type=Path, help="write report.json, .xml (JUnit) and .html there"
    )
    parser.add_argument("--name", help="of the server, for the report")
    parser.add_argument(
        "--self",
        action="store_true",
        dest="own",
        help="start our own server on free ports, judge it, and stop it",
    )
    parser.add_argument(
        "--speed",
        metavar="FACTOR|max",
        default="1",
        help="simulated seconds per second of our own server (default 1)",
    )
    kinds = parser.add_subparsers(metavar="compare")
    comparison = add_command(
        kinds, "compare", "put reports of several servers side by side", _compare
    )
    comparison.add_argument("files", metavar="FILE.json", nargs="+", type=Path)
    comparison.add_argument("--html", metavar="FILE", type=Path, help="write a page as well")


def run(arguments: argparse.Namespace) -> int:
    """Judge, print, write; 1 if a rule that must be kept is broken.

    Raises:
        UsarsimError: if the server cannot be reached, or nothing fits the pattern.
    """
    checks = select(all_checks(), arguments.only)
    if not checks:
        raise UsarsimError(
            at("--only", f"no check fits {arguments.only!r}", "see usarsim conformance --list")
        )
    if arguments.list:
        print(as_list(checks))
        return 0
    if arguments.report is not None:
        _make_folder(arguments.report)
    teller = ProgressPrinter(sys.stderr)
    target = Target(
        host=arguments.host if not arguments.own else "127.0.0.1",
        robot=arguments.robot or (GROUND[0] if arguments.own else None),
        start=arguments.start,
        dialect=None if arguments.dialect == "auto" else arguments.dialect,
        staged=arguments.own and arguments.robot is None,
    )
    if arguments.own and arguments.robot and len(classes := _classes(arguments.robot)) > 1:
        return _judge_classes(classes, target, checks, arguments, teller)
    with _ports(arguments) as ports:
        report = _judge(replace(target, ports=ports), checks, arguments, teller)
    print(as_text(report))
    if arguments.report is not None:
        _write(arguments.report, report)
        teller.say(f"written: {arguments.report}/report.html, report.json, report.xml")
    return 0 if report.conforms else 1


def _classes(text: str) -> list[str]:
    """Names between commas; every class of our own server for `all`.

    Raises:
        UsarsimError: it has no class of such a name.
    """
    known = robot_classes()
    if text.lower() == "all":
        return known
    classes = [name.strip() for name in text.split(",") if name.strip()]
    lower = {name.lower() for name in known}
    for name in classes:
        plain = name.rpartition(".")[2]
        if plain.lower() not in lower:
            cure = suggest(plain, known)
            raise UsarsimError(f"--robot: there is no robot class {name!r} ({cure})")
    return classes


def _judge_classes(
    classes: list[str],
    target: Target,
    checks: tuple[Check, ...],
    arguments: argparse.Namespace,
    teller: ProgressPrinter,
) -> int:
    """Judge, print, write a folder for each class; 1 if a rule that must be kept is broken."""

    def tell(robot: str, report: Report) -> None:
        teller.say(f"{robot}: {'conforms' if report.conforms else 'does NOT conform'}")
        if arguments.report is not None:
            _make_folder(arguments.report / robot)
            _write(arguments.report / robot, report)

    name = arguments.name or f"usarsim-server {__version__}"
    options = ("--speed", arguments.speed)
    try:
        reports = judge_classes(classes, checks, target, options=options, name=name, tell=tell)
    except Failed as error:
        raise UsarsimError(str(error)) from None
    print(as_class_table(reports))
    return 0 if all(report.conforms for report in reports.values()) else 1


def _judge(
    target: Target,
    checks: tuple[Check, ...],
    arguments: argparse.Namespace,
    teller: ProgressPrinter,
) -> Report:
    name = arguments.name or (f"usarsim-server {__version__}" if arguments.own else "")
    try:
        return asyncio.run(judge_all(target, checks, name=name, tell=teller))
    except Failed as error:
        cure = "start the server, or name it with --host and --port"
        raise UsarsimError(f"{error} ({cure})") from None
    finally:
        teller.done()


@contextlib.contextmanager
def _ports(arguments: argparse.Namespace) -> Iterator[dict[str, int]]:
    """Ports by service: those named, or those of a server of our own while inside."""
    if not arguments.own:
        named = {service: getattr(arguments, service) for service in _SIDE_PORTS}
        yield {"control": arguments.port, **{k: v for k, v in named.items() if v is not None}}
        return
    with judged_server("--speed", arguments.speed) as server:
        yield dict(server.ports)
        if server.died:
            raise UsarsimError(f"the server died while it was judged: {server.said}")


def _compare(arguments: argparse.Namespace) -> int:
    reports = named_apart([_read(file) for file in arguments.files])
    print(compare(reports))
    if arguments.html is not None:
        _save(arguments.html, as_page(reports, "USARSim conformance, side by side"))
    return 0


def _read(file: Path) -> Report:
    try:
        return from_json(read_text(file, UsarsimError))
    except ValueError as error:
        cure = "name a report.json that --report has written"
        raise UsarsimError(at(file, f"no report: {error}", cure)) from None


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        cure = "name a folder that can be made"
        raise UsarsimError(at(folder, f"cannot be made: {error.strerror}", cure)) from None


def _write(folder: Path, report: Report) -> None:
    _save(folder / "report.json", as_json(report))
    _save(folder / "report.xml", as_junit(report))
    _save(folder / "report.html", as_page([report], f"USARSim conformance of {report.name}"))


def _save(file: Path, text: str) -> None:
    try:
        write_text(file, text)
    except OSError as error:
        cure = "name a file in a folder that can be written"
        raise UsarsimError(at(file, f"cannot be written: {error.strerror}", cure)) from None


def _port(text: str) -> int:
    number = int(text)
    if not 1 <= number <= 65535:
        raise argparse.ArgumentTypeError(f"must be from 1 to 65535, not {number}")
    return number


def _start(text: str) -> str:
    try:
        place_from(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text
