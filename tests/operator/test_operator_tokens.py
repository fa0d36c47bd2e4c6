"""Tokens that outlive their gateway: as a file, and over a restart with a page that stays."""

from __future__ import annotations

import asyncio
import os
import stat
from pathlib import Path
from urllib.parse import urlsplit

import aiohttp
import pytest
from console_rig import Console
from held_ports import held_port

from usarsim_operator.roles import Role
from usarsim_operator.tokens import kept_tokens
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli import main
from usarsim_server.testing import PATIENCE, running_server

GOOD = 'operator = "aaaaaaaaaaaaaaaaaaaa"\ninstructor = "bbbbbbbbbbbbbbbbbbbb"\nviewer = "{}"\n'


def test_file_is_made_for_its_owner_and_read_again(tmp_path: Path) -> None:
    """Mode 0600 whatever the umask; the same tokens the next time, others in another file."""
    path, before = tmp_path / "tokens", os.umask(0)
    try:
        first = kept_tokens(path)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    second, other = kept_tokens(path), kept_tokens(tmp_path / "other")
    assert [first[role] for role in Role] == [second[role] for role in Role]
    assert len({first[role] for role in Role} | {other[role] for role in Role}) == 6
    assert second.role(first[Role.VIEWER]) is Role.VIEWER


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o666])
def test_file_of_others_is_refused(tmp_path: Path, mode: int) -> None:
    """Whoever may read it could drive, whoever may write it could choose."""
    path = tmp_path / "tokens"
    kept_tokens(path)
    path.chmod(mode)
    with pytest.raises(UsarsimError, match=r"others may read or change it.*chmod 600"):
        kept_tokens(path)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "operator"),
        (GOOD.format("short"), "viewer.*16 to 200"),
        (GOOD.format("a" * 20), "viewer.*another role"),
        (GOOD.format("é" * 20), "viewer.*ASCII"),
        (GOOD.format("c" * 20) + 'admin = "dddddddddddddddddddd"', "admin"),
        ("operator", "tokens"),
    ],
)
def test_wrong_file_is_refused(tmp_path: Path, text: str, why: str) -> None:
    """With the key that is wrong; what is right is read."""
    path = tmp_path / "tokens"
    path.write_text(GOOD.format("c" * 20))
    path.chmod(0o600)
    assert kept_tokens(path)[Role.VIEWER] == "c" * 20
    path.write_text(text)
    with pytest.raises(UsarsimError, match=why):
        kept_tokens(path)


def test_command_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line and exit code 2 where the file cannot be had."""
    missing = str(tmp_path / "no" / "tokens")
    assert main(["console", "--no-browser", "--tokens", missing]) == 2
    assert "--tokens" in capsys.readouterr().err


async def _hello(url: str, token: str) -> str:
    """Type of the gateway's answer to a hello; why it hangs up."""
    origin = url.partition("/#")[0]
    async with (
        aiohttp.ClientSession() as http,
        http.ws_connect(f"{origin}/socket", headers={"Origin": origin}) as page,
    ):
        await page.send_json({"type": "hello", "token": token, "name": "Ada"})
        message = await page.receive(timeout=PATIENCE)
        if message.type is aiohttp.WSMsgType.TEXT:
            return str(message.json()["type"])
        return str(message.extra)


def test_page_comes_back_after_a_restart(tmp_path: Path) -> None:
    """With the token that it has; a wrong one is still refused, also the one of another file."""
    with held_port() as port, running_server(world="empty") as (_, endpoints):
        control, urls = endpoints["control"].port, []
        for file in ("tokens", "tokens", "others"):
            options = (f"--console-port={port}", f"--tokens={tmp_path / file}")
            with Console(control, *options, folder=tmp_path) as console:
                urls.append(console.urls["operator"])
                token = urlsplit(urls[0]).fragment
                expected = "welcome" if file == "tokens" else "the token is wrong"
                assert asyncio.run(_hello(urls[0], token)) == expected
                assert asyncio.run(_hello(urls[0], token[:-1] + "!")) == "the token is wrong"
        assert urls[0] == urls[1] != urls[2]
