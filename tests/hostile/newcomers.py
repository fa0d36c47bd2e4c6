"""Clients that come during an attack, ask one thing on each port and should get an answer."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Mapping, Sequence

from hostile.scene_attacks import hello
from hostile.web_attacks import reloaded
from usarsim_client import BlockingConnection, Closing, HangupError, Inbox

QUESTIONS: Mapping[str, tuple[bytes | Callable[[int], bytes], bytes]] = {
    "control": (b"GETSTARTPOSES\r\n", b"{StartPoses"),
    "groundtruth": (b"GETPOS\r\n", b"\r\n"),
    "wireless": (b"GETPOS\r\n", b"\r\n"),
    "truth": (b"\r\n", b"{End}\r\n"),
    # A rectangle without a point: answered, and nothing has to be drawn.
    "images": (b"U" + bytes(16), b"\x00\x00"),
    "comserver": (b"GETSS Nobody Noone;", b";"),
    "scene": (hello(), b'"welcome"'),
    # An operator, and an experimenter, who load their pages anew.
    "console": (reloaded("operator"), b'"welcome"'),
    "desk": (reloaded("experimenter"), b"no session runs"),
}
"""For each port what is asked, or is by the number of the port, and what an answer contains."""

PERIOD = 1.0
"""s between two rounds."""
TIMEOUT = 5.0
"""s that one attempt may take."""
_AGAIN = 0.1
_LEAST = 5


class Newcomers(Closing):
    """Comes again and again, on a thread of its own, until it is closed.

    Attributes:
        answers: the latest of each port.
        waits: the longest s that one of them had to wait, attempts that were refused included.
    """

    def __init__(self, ports: Mapping[str, int], names: Sequence[str]) -> None:
        """Begin to ask at some of the ports of the server, by name."""
        self.answers: dict[str, bytes] = {}
        self.waits = dict.fromkeys(names, 0.0)
        self._ports = ports
        self._ended = threading.Event()
        self._threads = [
            threading.Thread(target=self._ask_again, args=(name,), daemon=True) for name in names
        ]
        for thread in self._threads:
            thread.start()

    @property
    def slowest(self) -> tuple[float, str]:
        """The longest wait of all, and the port."""
        return max((wait, name) for name, wait in self.waits.items())

    def close(self) -> None:
        """No more of them; who waits now has waited in vain so far."""
        self._ended.set()
        for thread in self._threads:
            thread.join(2.0 * TIMEOUT)

    def _ask_again(self, name: str) -> None:
        while not self._ended.is_set():
            begun, answered = time.perf_counter(), False
            while not answered and not self._ended.is_set():
                with contextlib.suppress(OSError):
                    answered = self._ask(name)
                self.waits[name] = max(self.waits[name], time.perf_counter() - begun)
                if not answered:
                    self._ended.wait(_AGAIN)
            self._ended.wait(PERIOD)

    def _ask(self, name: str) -> bool:
        question, sign = QUESTIONS[name]

        def whole(inbox: Inbox) -> bytes | None:
            return inbox.rest if sign in inbox.rest and len(inbox) >= _LEAST else None

        with BlockingConnection(self._ports[name], patience=TIMEOUT) as client:
            client.send(question(self._ports[name]) if callable(question) else question)
            try:
                self.answers[name] = client.take(whole)
            except HangupError:
                return False
        return True
