"""Paths that no system has are one error of the command line, never a traceback."""

from __future__ import annotations

from pathlib import Path

import pytest

from usarsim_server.cli import main

LONG = "a" * 5000
MESH = "v 0 0 0\nv 3 0 0\nv 0 3 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    "words",
    [
        ["import", LONG],
        ["import", "~nobody.at.all/map.obj"],
        ["import", "map.obj", "--assets", LONG],
        ["import", "map.obj", "--sidecar", LONG],
        ["import", "map.obj", "--out", LONG],
        ["import", "map.obj", "--report", LONG],
        ["serve", "--port", "0", "--world", LONG],
        ["serve", "--config", LONG],
        ["serve", "--port", "0", "--robots", LONG],
        ["robots", "--robots", LONG],
        ["worlds", LONG],
    ],
)
def test_absurd_paths(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
) -> None:
    """Exit code 2 and one line, which is not as long as the path."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "map.obj").write_text(MESH)
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize("key", ["world", "robots", "wireless", "wireless_log"])
def test_a_name_with_a_nul(tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str) -> None:
    """TOML can write it; no file can have it."""
    (tmp_path / "lab.toml").write_text(f'{key} = "a\\u0000b"\n')
    ports = [f"--{port}-port=off" for port in ("image", "groundtruth", "wireless", "truth")]
    if key.startswith("wireless"):
        ports[2] = "--wireless-port=0"
    code = main(["serve", "--config", str(tmp_path / "lab.toml"), "--port", "0", *ports])
    assert code == 2
    assert capsys.readouterr().err.startswith("error: ")
