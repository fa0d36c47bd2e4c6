"""The console and the desk of a study in processes of their own, to be attacked.

`python -m hostile.web_servers FOLDER` serves the desk, with the tokens of its folder,
while no session runs.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.server import CarefulClosing, Measured
from hostile.attack import MIB
from hostile.web_attacks import TOKENS
from usarsim_server.base.extras import need
from usarsim_server.base.launch import python

MOST_GROWTH = 64 * MIB
"""Bytes by which the memory of each may grow."""
LINES, LINE_RATE = 5.0, 1.0
"""Lines that each may write to its log at once, and a second."""
MOST_CORES = 0.75
"""Processors that each may use: the attackers' share, and what answers to newcomers get."""
_ENDED = "cannot be written any further"


class _Page(Measured):
    """One of them. port: of its pages."""

    def __init__(self, what: str, module: Sequence[str], announced: int) -> None:
        super().__init__(what, python("-m", *module, tied=True))
        self.port = int(self.announced(r".*http://[^/]*:(\d+)/", announced)[0][1])
        self.told, self.opening = announced, self.usage()

    def faults(self) -> list[str]:
        """What is not as promised since it started."""
        now, found = self.usage(), []
        seconds = now.wall - self.opening.wall
        if now.resident - self.opening.resident > MOST_GROWTH:
            found.append(f"memory of {self.what}")
        if (now.cpu - self.opening.cpu) / seconds > MOST_CORES:
            found.append(f"processor of {self.what}")
        log = self.errors
        if (lines := log.count("\n") - self.told) > LINES + LINE_RATE * seconds:
            found.append(f"{lines} lines of {self.what}")
        if _ENDED in log:
            found.append(f"{self.what} records no more")
        return found


class WebServers(CarefulClosing):
    """Both of them. ports: of their pages, by name."""

    def __init__(self, port: int) -> None:
        """Start them, the console for a server on this machine.

        Raises:
            BenchError: one of them does not start, or cannot here.
        """
        need("aiohttp", extra="console", asker="the console")
        self._folder = tempfile.TemporaryDirectory(prefix="usarsim-bench-")
        folder = Path(self._folder.name)
        self._pages: list[_Page] = []
        try:
            tokens = folder / "tokens.toml"
            roles = ("operator", "instructor", "viewer")
            _kept(tokens, "".join(f'{role} = "{TOKENS[role]}"\n' for role in roles))
            words = [
                *("--connect", f"127.0.0.1:{port}", "--console-port", "0", "--no-browser"),
                *("--tokens", str(tokens), "--latch", str(folder / "latch.json")),
                *("--record", str(folder / "session.rec"), "--viewer-delay", "0"),
            ]
            self._pages.append(_Page("the console", ("usarsim_server", "console", *words), 3))
            self._pages.append(_Page("the desk", (__name__, str(folder)), 1))
        except BaseException:
            self.close()
            raise
        self.ports = {
            name: page.port for name, page in zip(("console", "desk"), self._pages, strict=True)
        }

    def faults(self) -> list[str]:
        """What is not as promised."""
        return [fault for page in self._pages for fault in page.faults()]

    def close(self) -> None:
        """End both; a second call does nothing.

        Raises:
            BenchError: if one of them ended with an error.
        """
        try:
            while self._pages:
                self._pages.pop().close()
        finally:
            self._folder.cleanup()


def _kept(path: Path, text: str) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT, 0o600), "w") as file:
        file.write(text)


async def _desk(folder: Path) -> None:
    # Not at the top: a bench without the extra must be able to import this module.
    from usarsim_study.session import web

    path = folder / web.TOKENS
    _kept(path, json.dumps({who: TOKENS[who] for who in web.SEATS.values()}))
    async with web.serving(web.Web(web.kept_tokens(path), ""), "127.0.0.1", 0) as urls:
        print(next(iter(urls.values())), flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    from usarsim_report.serving import until_interrupted

    asyncio.run(until_interrupted(_desk(Path(sys.argv[1]))))
