"""The ground truth service: the wireless simulation asks here who is where, TCP 7435.

Nothing is said on connecting, every request that is known has exactly one line as its answer, and
the server never hangs up: the program that asks would end if it did (side channels reference 3.1
and 3.5).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from usarsim_server.protocol.framing import LineFramer
from usarsim_server.services.dialogue import DialogueLimits, DialogueService

__all__ = ["ground_truth_service"]

Answers = Callable[[Iterable[str]], list[str]]
"""Makes the replies, without line ends, to requests that came together; may block."""


def ground_truth_service(
    host: str,
    port: int,
    answers: Answers,
    *,
    required: bool = False,
    limits: DialogueLimits | None = None,
) -> DialogueService:
    """Describe the service; nothing is opened before it is started.

    Args:
        host: address or host name to listen on.
        port: 0 takes any free one.
        answers: see `Answers`; in general `GroundTruth.answers`.
        required: see `ready.Service`.
        limits: see `DialogueLimits`.
    """

    def respond(lines: list[bytes]) -> bytes:
        replies = answers([line.decode("latin-1") for line in lines])
        return "".join([f"{reply}\r\n" for reply in replies]).encode("latin-1", "replace")

    return DialogueService(
        "groundtruth",
        host,
        port,
        "--groundtruth-port",
        LineFramer,
        respond,
        required=required,
        limits=limits,
    )
