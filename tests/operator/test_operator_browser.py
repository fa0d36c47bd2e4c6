"""The browser that a console opens: what all users of the machine see of it is no token."""

from __future__ import annotations

import asyncio
import os
import sys
import webbrowser

import aiohttp
import pytest

from usarsim_operator.roles import Role, Tokens
from usarsim_operator.serving import Serving, served
from usarsim_operator.station import Settings, Station


async def test_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its address, an argument of a program that `ps` shows, leads to the page once, and only a
    program of the same user."""
    opened: asyncio.Queue[str] = asyncio.Queue()
    loop, us = asyncio.get_running_loop(), os.getuid()
    monkeypatch.setenv("BROWSER", "any")
    monkeypatch.setattr(
        webbrowser, "open", lambda url: not loop.call_soon_threadsafe(opened.put_nowait, url)
    )
    tokens = Tokens()
    station = Station(Settings("127.0.0.1", 1))
    serving = Serving("127.0.0.1", 0, browser=Role.INSTRUCTOR)
    async with served(station, serving, tokens), aiohttp.ClientSession() as http:
        url = await opened.get()
        assert not any(tokens[role] in url for role in Role)

        async def ask() -> tuple[int, str | None]:
            async with http.get(url, allow_redirects=False) as answer:
                assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
                return answer.status, answer.headers.get("Location")

        if sys.platform == "linux":
            monkeypatch.setattr(os, "getuid", lambda: us + 1)
            assert await ask() == (403, None)
            monkeypatch.setattr(os, "getuid", lambda: us)
        assert await ask() == (302, f"/#{tokens[Role.INSTRUCTOR]}")
        assert await ask() == (403, None)
    await station.close()
