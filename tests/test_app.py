"""The composition root: what happens to a server as a whole."""

from __future__ import annotations

import pytest

from usarsim_server import app
from usarsim_server.errors import UsarsimError
from usarsim_server.settings import Settings
from usarsim_server.simulation.engine import Engine


def test_a_server_without_physics_does_not_live_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """If the physics thread has to give up, the server ends with an error that says why."""

    def fail(self: Engine, steps: int) -> list[int]:
        raise UsarsimError("the world diverges")

    monkeypatch.setattr(Engine, "advance", fail)
    with pytest.raises(UsarsimError, match="the world diverges"):
        app.run(Settings(world="empty", port=0, host="127.0.0.1"))
    assert capsys.readouterr().out.count("READY") <= 1
