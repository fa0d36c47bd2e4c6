"""Programs that run beside a console, as its children: a server, controllers, a wanderer."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import signal
import socket
import tempfile
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections import deque
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path

from usarsim_server.base.children import python
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import reason

ROBOT = "P3AT_real"
"""Class of the robots: laser, camera, and as fast as the real one."""
_PORTS = {
    "port": 3000,
    "image-port": 5003,
    "groundtruth-port": 7435,
    "wireless-port": 50000,
    "truth-port": 3989,
}
_PATIENCE = 120.0  # s of wall time that a server has to begin; a map may have to be imported
_LAST = 12  # lines of a child that are shown when it has died
_END = 0.6  # s that a child has to end by itself


class Child:
    """A program of ours that runs, and the last lines that it wrote."""

    def __init__(self, name: str, process: Process) -> None:
        self.name, self._process = name, process
        self._lines: deque[str] = deque(maxlen=_LAST)
        self._reading = asyncio.create_task(self._read())

    async def line(self) -> str:
        """The next line that it prints; empty once it has closed its output."""
        assert self._process.stdout is not None
        data = await self._process.stdout.readline()
        if text := data.decode(errors="replace").strip():
            self._lines.append(text)
        return data.decode(errors="replace").strip()

    async def _read(self) -> None:
        assert self._process.stderr is not None
        while data := await self._process.stderr.readline():
            self._lines.append(data.decode(errors="replace").rstrip())

    async def died(self) -> UsarsimError:
        """Wait until it ends; why."""
        assert self._process.stdout is not None
        while await self._process.stdout.read(65536):
            pass
        code = await self._process.wait()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_END):
                await asyncio.shield(self._reading)
        how = f"exit code {code}" if code >= 0 else f"by {signal.Signals(-code).name}"
        said = "".join(f"\n  {line}" for line in self._lines)
        return UsarsimError(f"the {self.name} has ended ({how}){said}")

    async def end(self) -> None:
        """End it, now or soon."""
        for stop in (self._process.terminate, self._process.kill):
            if self._process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    stop()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_END):
                        await self._process.wait()
        self._reading.cancel()
        await asyncio.gather(self._reading, return_exceptions=True)


class Programs:
    """A server, and soon what drives its robots.

    Attributes:
        ports: of the server, by the names of its READY line. token: of its scene port.
    """

    def __init__(self, token: str) -> None:
        self.ports: dict[str, int] = {}
        self.token = token
        self._children: list[Child] = []
        self._watching: set[asyncio.Task[None]] = set()
        self._dead: asyncio.Queue[UsarsimError] = asyncio.Queue()

    async def failed(self) -> UsarsimError:
        """Wait until a program ends; why."""
        return await self._dead.get()

    async def serve(self, *options: str) -> None:
        """Start the server and wait until it is ready.

        Raises:
            UsarsimError: if it does not begin; with its last lines.
        """
        server = await _start("server", "usarsim_server", "serve", *options)
        self._children.append(server)
        self.ports = await _ready(server)
        self._watch(server)

    async def wander(self) -> None:
        """Have a robot wander."""
        words = (f"--port={self.ports['control']}", f"--robot={ROBOT}=Wanderer")
        wanderer = await _start("wanderer", "usarsim_operator.wanderer", *words)
        self._children.append(wanderer)
        self._watch(wanderer)

    async def control(self, command: Sequence[str], folder: Path, more: Mapping[str, str]) -> None:
        """Start a controller.

        Args:
            command: program and arguments. folder: in which it runs.
            more: variables of its environment beside ours.

        Raises:
            UsarsimError: if it cannot be started.
        """
        try:
            process = await asyncio.create_subprocess_exec(
                *command,
                cwd=folder,
                env={**os.environ, **more},
                stdin=DEVNULL,
                stdout=PIPE,
                stderr=PIPE,
                start_new_session=True,
            )
        except OSError as error:
            cure = "check its path and rights"
            raise UsarsimError(
                at(command[0], f"cannot be started: {reason(error)}", cure)
            ) from None
        controller = Child(f"controller {command[0]}", process)
        self._children.append(controller)
        self._watch(controller)

    def _watch(self, child: Child) -> None:
        async def watch() -> None:
            error = await child.died()
            await asyncio.sleep(0.0 if child is self._children[0] else 0.5)  # the server is why
            await self._dead.put(error)

        self._watching.add(asyncio.create_task(watch()))

    async def end(self) -> None:
        """End all of them."""
        for task in self._watching:
            task.cancel()
        await asyncio.gather(*self._watching, return_exceptions=True)
        await asyncio.gather(*(child.end() for child in self._children))


@contextlib.asynccontextmanager
async def running(*more: str, usual_ports: bool = True) -> AsyncIterator[Programs]:
    """Run a server with all of its ports, on this machine only.

    Args:
        more: options of `usarsim serve`.
        usual_ports: where others look for a server, if they can be had. Several that are started
            at once may each find them free; those take any instead.

    Raises:
        UsarsimError: if it does not begin; with its last lines.
    """
    programs = Programs(secrets.token_urlsafe(18))
    with tempfile.TemporaryDirectory(prefix="usarsim-") as folder:
        secret = Path(folder) / "token"  # a command line can be read by everybody
        secret.touch(0o600)
        secret.write_text(programs.token)
        options = [
            f"--{name}={free_port(port) if usual_ports else 0}" for name, port in _PORTS.items()
        ]
        options += ["--scene-port=0", f"--scene-token={secret}", "--supervise=on"]
        try:
            await programs.serve(*options, *more)
            yield programs
        finally:
            await programs.end()


async def _start(name: str, module: str, *words: str) -> Child:
    command = python("-m", module, *words, tied=True)
    # Ctrl-C is for us: children end when we say so, and the console first.
    process = await asyncio.create_subprocess_exec(
        *command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, start_new_session=True
    )
    return Child(name, process)


async def _ready(server: Child) -> dict[str, int]:
    """Ports of a server, once it is ready."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_PATIENCE):
            while line := await server.line():
                words = line.split()
                if words[0] == "READY":
                    pairs = (word.partition("=")[::2] for word in words[1:])
                    return {name: int(where.rpartition(":")[2]) for name, where in pairs}
            raise await server.died()
    raise UsarsimError(f"the server was not ready within {_PATIENCE:g} s")


def free_port(port: int) -> int:
    """The port if it can be had, else 0."""
    with socket.socket() as one, contextlib.suppress(OSError):
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        one.bind(("127.0.0.1", port))
        return port
    return 0
