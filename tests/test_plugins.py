"""Plug-ins are found, also after a moment in which files could not be opened."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from usarsim_server.base import plugins
from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.base.plugins import PluginTypes

STARVED = """
import os, resource
from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.sensors.base import TYPES as types
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
held = []
try:
    while True:
        held.append(os.open(os.devnull, os.O_RDONLY))
except OSError:
    pass
for left in range(8):
    try:
        types.names()
    except RobotDescriptionError as error:
        assert "Too many open files" in str(error), error
    else:
        raise AssertionError(f"found with {left} descriptors")
    os.close(held.pop())
assert "Hokuyo" in types.names()
"""


def test_discovery_is_tried_again_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error of the machine is told once for each question, and is over when it is over."""
    types: PluginTypes[object] = PluginTypes(
        "sensor", object, ("usarsim_server.sensors",), "nobody.at.home"
    )

    def fail() -> None:
        raise OSError(24, os.strerror(24))

    with monkeypatch.context() as patch:
        patch.setattr(plugins, "_check_descriptors", fail)
        for _ in range(2):
            with pytest.raises(RobotDescriptionError, match=r"Too many open files.*ulimit"):
                types.find("Hokuyo", "x.toml")
    assert types.names() == []


def test_few_descriptors_do_not_make_types_unknown_for_ever() -> None:
    """In a process that has no descriptor left, then some, then enough."""
    done = subprocess.run(
        [sys.executable, "-c", STARVED], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
