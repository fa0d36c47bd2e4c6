"""Programs that run beside a console, as its children: a server, controllers, a wanderer."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import signal
import socket
import tempfile
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.launch import LaunchError, OwnServer, Program, python

ROBOT = "P3AT_real"
"""Class of the robots: laser, camera, and as fast as the real one."""
_PORTS = {
    "port": 3000,
    "image-port": 5003,
    "groundtruth-port": 7435,
    "wireless-port": 50000,
    "truth-port": 3989,
}
_LAST = 12  # lines of a program that are shown when it has died
_END = 0.6  # s that a program has to end by itself


class Programs:
    """A server, and soon what drives its robots.

    Attributes:
        ports: of the server, by the names of its READY line. token: of its scene port.
    """

    def __init__(self, token: str) -> None:
        self.ports: dict[str, int] = {}
        self.token = token
        self._all: list[Program] = []
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
        self._all.append(server := OwnServer(*options, waits=False))
        try:
            await asyncio.to_thread(server.wait)
        except LaunchError as error:
            raise _death(server) if server.process.returncode > 0 else error from None
        self.ports = server.ports
        self._watch(server)

    async def wander(self) -> None:
        """Have a robot wander."""
        words = (f"--port={self.ports['control']}", f"--robot={ROBOT}=Wanderer")
        command = python("-m", "usarsim_operator.wanderer", *words, tied=True)
        self._watch(Program("the wanderer", command))

    async def control(self, command: Sequence[str], folder: Path, more: Mapping[str, str]) -> None:
        """Start a controller.

        Args:
            command: program and arguments. folder: in which it runs.
            more: variables of its environment beside ours.

        Raises:
            LaunchError: if it cannot be started.
        """
        controller = f"the controller {command[0]}"
        self._watch(Program(controller, command, folder=folder, more=more))

    def _watch(self, one: Program) -> None:
        async def watch() -> None:
            await asyncio.wrap_future(one.ended)
            await asyncio.sleep(0.0 if one is self._all[0] else 0.5)  # the server is why
            await self._dead.put(_death(one))

        if one not in self._all:
            self._all.append(one)
        self._watching.add(asyncio.create_task(watch()))

    async def end(self) -> None:
        """End all of them."""
        for task in self._watching:
            task.cancel()
        await asyncio.gather(*self._watching, return_exceptions=True)
        for one in self._all:
            one.grace = _END
        await asyncio.gather(*(asyncio.to_thread(one.close) for one in self._all))


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


def _death(one: Program) -> LaunchError:
    """Why a program has ended, as far as it said."""
    code = one.ended.result()
    how = f"exit code {code}" if code >= 0 else f"by {signal.Signals(-code).name}"
    said = "".join(f"\n  {line}" for line in one.errors.splitlines()[-_LAST:])
    return LaunchError(f"{one.what} has ended ({how}){said}")


def free_port(port: int) -> int:
    """The port if it can be had, else 0."""
    with socket.socket() as one, contextlib.suppress(OSError):
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        one.bind(("127.0.0.1", port))
        return port
    return 0
