"""docs/threat-model.md and docs/limits.md name limits, tests and attacks that exist."""

from __future__ import annotations

import argparse
import ast
import importlib
import importlib.util
import math
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest
from hostile.attackers import ATTACKS

from usarsim_report.gate import LOG_RATE, GateLimits
from usarsim_server.base import logs
from usarsim_server.cameras.view import Grid
from usarsim_server.cli.serve import add_parser
from usarsim_server.services.comserver import ComServerLimits
from usarsim_server.services.control import ControlLimits
from usarsim_server.services.dialogue import TRUTH_LIMITS, DialogueLimits
from usarsim_server.services.images import ImageLimits
from usarsim_server.services.port import PortLimits
from usarsim_server.services.relay import LinkOptions
from usarsim_server.services.scene_port import SceneLimits
from usarsim_server.services.wireless import WirelessLimits
from usarsim_server.settings import Settings

ROOT = Path(__file__).parents[1]
PAGES = ("threat-model.md", "limits.md")
TEXTS = {name: (ROOT / "docs" / name).read_text(encoding="utf-8") for name in PAGES}
SETTINGS = {field.name for field in fields(Settings)}


def quoted(text: str) -> Iterator[str]:
    """Everything between single back quotes, outside of code blocks."""
    yield from re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


def rows(text: str) -> Iterator[list[str]]:
    """Rows of tables with a column `Limit` and one `Shown by`: the cells of these two."""
    columns: list[int] | None = None
    for line in text.splitlines():
        if not line.startswith("|"):
            columns = None
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if columns is None:
            columns = [n for n, cell in enumerate(cells) if cell in ("Limit", "Shown by")]
        elif len(columns) == 2 and not set(line) <= set("|- "):
            yield [cells[n] for n in columns]


def names_in(tree: ast.Module) -> set[str]:
    """`test_x` and `TestX::test_x` of a test file."""
    found = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}::{one.name}" for one in node.body if hasattr(one, "name")}
    return found


@pytest.mark.parametrize("page", PAGES)
def test_tests_that_are_named_exist(page: str) -> None:
    """The file, and the function in it."""
    named = [one for one in quoted(TEXTS[page]) if one.startswith("tests/")]
    assert named
    for one in named:
        file, _, name = one.partition("::")
        assert (ROOT / file).exists(), one
        assert not name or name in names_in(ast.parse((ROOT / file).read_text())), one


def attacks_in(page: str) -> set[str]:
    """Names behind `hostile:`."""
    found = {one.partition(":")[2] for one in quoted(TEXTS[page]) if one.startswith("hostile:")}
    return found - {"NAME"}


def test_attacks_that_are_named_exist_and_all_are_named() -> None:
    """No attack without a promise that it tries to break."""
    assert attacks_in("threat-model.md") == set(ATTACKS)
    assert attacks_in("limits.md") <= set(ATTACKS)


def limit_exists(name: str) -> bool:
    """Whether it is a setting, an option of `serve`, or a constant of the server or of a tool."""
    if name.startswith("--"):
        parser = argparse.ArgumentParser()
        add_parser(parser.add_subparsers())
        return (
            name.split()[0] in parser._subparsers._group_actions[0].choices["serve"].format_help()
        )  # type: ignore[union-attr,index]
    if "." not in name:
        return name in SETTINGS
    path, rest = "usarsim_server", name.split(".")
    if importlib.util.find_spec(f"{path}.base.{rest[0]}"):
        path = f"{path}.base"
    if rest[0].startswith("usarsim_"):
        path = rest.pop(0)
    thing: object = None
    while rest:
        try:
            thing = importlib.import_module(f"{path}.{rest[0]}")
        except ModuleNotFoundError:
            break
        path = f"{path}.{rest.pop(0)}"
    for part in rest:
        known = getattr(thing, "__dataclass_fields__", {})
        if part in known or hasattr(thing, part):
            thing = getattr(thing, part, None)
        else:
            return False
    return True


@pytest.mark.parametrize("page", PAGES)
def test_limits_that_are_named_exist(page: str) -> None:
    """Each is a setting, an option or a constant; each promise has a limit and a proof."""
    promises = list(rows(TEXTS[page]))
    assert promises
    for limits, proofs in promises:
        assert list(quoted(proofs)), limits
        for name in quoted(limits):
            assert limit_exists(name), name


@pytest.mark.parametrize(
    "name", ["max_robot", "--no-such-option", "services.limits.NOTHING", "services.nothing.AT_ALL"]
)
def test_limits_that_do_not_exist_are_found(name: str) -> None:
    """The look-up can fail."""
    assert not limit_exists(name)


def test_bytes_that_a_connection_can_hold() -> None:
    """The table of docs/limits.md has the figures that the services work out."""
    grid = Settings()
    frame = Grid(*grid.tiles, *grid.tile_size).frame
    expected = {
        "3000": (ControlLimits().held_bytes, ControlLimits().kernel_bytes),
        "7435": (DialogueLimits().held_bytes, DialogueLimits().kernel_bytes),
        "3989": (TRUTH_LIMITS.held_bytes, TRUTH_LIMITS.kernel_bytes),
        "50000": (WirelessLimits().held_bytes, WirelessLimits().kernel_bytes),
        "5874": (ComServerLimits().held_bytes, ComServerLimits().kernel_bytes),
        "5003": (ImageLimits().held_bytes(frame), ImageLimits().kernel_bytes),
        "scene": (SceneLimits().held_bytes, SceneLimits().kernel_bytes),
    }
    found = re.findall(r"^\| (\w+) \| (\d+) KiB \| (\d+) KiB \|", TEXTS["limits.md"], re.MULTILINE)
    told = {port: (int(held), int(kernel)) for port, held, kernel in found}
    assert told == {
        port: (math.ceil(held / 1024), math.ceil(kernel / 1024))
        for port, (held, kernel) in expected.items()
    }
    assert max(held for held, _ in expected.values()) < 4 << 20
    assert max(kernel for _, kernel in expected.values()) < 1 << 20
    assert LinkOptions().held_bytes // 1024 == 64
    assert LinkOptions().kernel_bytes // 1024 == 512
    assert WirelessLimits().link_bytes(LinkOptions()) == 36 << 20
    assert ComServerLimits().names_bytes == 4 << 20


def test_what_a_newcomer_may_cost() -> None:
    """The table of docs/limits.md has the figures of the code, and all ports."""
    frame = Grid(*Settings().tiles, *Settings().tile_size).frame
    ports: dict[str, tuple[PortLimits, int]] = {
        "3000": (ControlLimits(), ControlLimits().held_bytes),
        "5003": (ImageLimits(), ImageLimits().held_bytes(frame)),
        "50000": (WirelessLimits(), WirelessLimits().held_bytes),
        "5874": (ComServerLimits(), ComServerLimits().held_bytes),
        "7435": (DialogueLimits(), DialogueLimits().held_bytes),
        "3989": (TRUTH_LIMITS, TRUTH_LIMITS.held_bytes),
        "scene": (SceneLimits(), SceneLimits().held_bytes),
    }
    gate = GateLimits()
    expected: dict[str, tuple[float, ...]] = {
        port: (
            one.max_connections,
            math.ceil(held / 1024),
            math.ceil(one.kernel_bytes / 1024),
            one.arrival_rate,
            one.share,
            one.hello if isinstance(one, SceneLimits) else one.idle,
            logs.RATE,
        )
        for port, (one, held) in ports.items()
    }
    expected["console, study desk"] = (
        *(gate.newcomers, gate.held_bytes / 1024, gate.kernel_bytes / 1024),
        *(gate.arrivals, gate.share, gate.head, LOG_RATE),
    )
    text = TEXTS["limits.md"].partition("## What a newcomer may cost")[2].partition("\n## ")[0]
    lines = re.findall(r"^\| ([^|]+?) \| ([\d.| ]+) \| `", text, re.MULTILINE)
    assert {port: tuple(map(float, cells.split("|"))) for port, cells in lines} == expected
