"""The example of `usarsim_maps.api` works as it stands there."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import pytest
from built_worlds import build_world

from usarsim_maps import api
from usarsim_maps.reader import TYPES, readers
from usarsim_server.base.errors import MapImportError


def test_the_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its blocks are where the file says; what is no block is refused with its line."""
    readers()  # all are known before one more is, for the time of this test
    monkeypatch.setattr(TYPES, "_types", dict(TYPES._types))
    begin, end = "    @register", "\n\nLengths are metres"
    text = api.__doc__[api.__doc__.index(begin) : api.__doc__.index(end)]
    exec(textwrap.dedent(text), {**vars(api), "Path": Path})
    map_ = tmp_path / "map.blocks"
    map_.write_text("floor 0 0 -0.5 9 9 1\nwall 2 0 1 0.5 4 2\n")
    world = build_world(tmp_path, api.read_scene(map_))
    (distance,) = world.rays((0.0, 0.0, 1.0), np.array([[1.0, 0.0, 0.0]]))
    assert distance == pytest.approx(1.75)
    map_.write_text("floor 0 0\n")
    with pytest.raises(MapImportError, match=r"map\.blocks: line 1: no block \(write a name"):
        api.read_scene(map_)
