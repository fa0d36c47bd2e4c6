"""The watch of a radio service over the world: who is still there, and who reaches whom."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from usarsim_server.errors import UsarsimError
from usarsim_server.logs import Log
from usarsim_server.radio.network import Network


class RadioWatch:
    """Looks at the world again and again while there is somebody to look for."""

    def __init__(
        self,
        name: str,
        network: Network,
        poll: float,
        needed: Callable[[], bool],
        review: Callable[[], None],
    ) -> None:
        """Describe the watch; nothing happens before `start`.

        Args:
            name: of the service, for the log.
            network: is looked at in a thread of its own, because that may block.
            poll: s of wall time between two looks.
            needed: whether anybody is registered.
            review: called after every look, on the event loop.
        """
        self._name = name
        self._network = network
        self._poll = poll
        self._needed = needed
        self._review = review
        self._log = Log(name)
        self._looking = asyncio.Lock()
        self._somebody = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin."""
        self._task = asyncio.create_task(self._run(), name=f"{self._name}-watch")

    async def stop(self) -> None:
        """End, and wait for the end."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def wake(self) -> None:
        """Somebody has registered."""
        self._somebody.set()

    async def look(self) -> None:
        """Look at the world now.

        Raises:
            UsarsimError: if the physics has ended.
        """
        async with self._looking:
            await asyncio.to_thread(self._network.observe)

    async def _run(self) -> None:
        while True:
            if not self._needed():
                self._somebody.clear()
                await self._somebody.wait()
            try:
                await self.look()
                self._review()
            except UsarsimError as error:
                self._log.warning("the watch ends", reason=error)
                return
            except Exception as error:  # a defect must not leave ports and links open for ever
                self._log.exception("the watch failed, goes on", error)
            await asyncio.sleep(self._poll)
