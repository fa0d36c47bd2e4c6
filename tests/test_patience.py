"""Tests pass beside other programs: none waits only as long as a client does by default, and none
takes the standard port of a server.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).parent
LIMITS = {"connect": "timeout", "connect_blocking": "timeout", "BlockingConnection": "patience"}
"""Argument of each way of the client to a server that says how long it waits; 10 s by default,
which a busy machine may take to draw a first picture."""


def calls(*names: str) -> Iterator[tuple[str, ast.Call, str]]:
    """Every call of some plain names in the tests: place, call, name."""
    for path in sorted(HERE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        # Files that do not have a name need no parsing.
        tree = ast.parse(text if any(f"{name}(" in text for name in names) else "")
        for node in ast.walk(tree):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name)
                and node.func.id in names
            ):
                yield f"{path.relative_to(HERE)}:{node.lineno}", node, node.func.id


def test_clients_of_tests_are_told_how_long_to_wait() -> None:
    """Whoever connects to a port; `connect()` of a test's own has no port."""
    hasty = [
        place
        for place, call, name in calls(*LIMITS)
        if (name == "BlockingConnection" or any(one.arg == "port" for one in call.keywords))
        and not any(one.arg in (LIMITS[name], None) for one in call.keywords)
    ]
    assert not hasty


def test_no_server_of_a_test_takes_the_standard_port() -> None:
    """`serve` opens its port before anything else, and ends where it is taken."""
    taking = [
        f"{place}: {words}"
        for place, call, _ in calls("main", "finished", "ServerProcess")
        if call.args
        for words in [_words(call)]
        if words[:1] == ["serve"]
        and not any(one.startswith(("--port", "--config", "--help", "*")) for one in words)
    ]
    assert not taking


def _words(call: ast.Call) -> list[str]:
    """The words of a command line, as far as they are written down; `*` for others."""
    first = call.args[0]
    parts = first.elts if isinstance(first, ast.List) else call.args
    return [
        str(one.value)
        if isinstance(one, ast.Constant)
        else "*"
        if isinstance(one, ast.Starred)
        else ""
        for one in parts
    ]
