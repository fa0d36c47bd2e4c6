"""Teams of given sizes that have given factors, without any server."""

from __future__ import annotations

from types import ModuleType

import pytest
from bench_fakes import Nobody, Pretend, Tried, a_trial

from usarsim_bench.server import BenchError
from usarsim_bench.team import TeamTrial


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch) -> Pretend:
    """Lets a function of a module have teams of some sizes; others fail. Returns what it tried."""

    def install(module: ModuleType, name: str, factors: dict[int, float]) -> Tried:
        tried: Tried = []

        def fake(*given: object) -> TeamTrial:
            *_, robots, seconds = given
            assert isinstance(robots, int)
            assert isinstance(seconds, float)
            tried.append((robots, seconds))
            if robots not in factors:
                raise BenchError("the server died: Traceback\n  nobody cares\nMemoryError")
            return a_trial(robots, factors[robots])

        monkeypatch.setattr(module, name, fake)
        for one in ("Server", "Crowd"):
            monkeypatch.setattr(module, one, Nobody, raising=False)
        return tried

    return install
