"""The ground truth service: the wireless simulation asks here who is where, TCP 7435.

Nothing is said on connecting, every request that is known has exactly one line as its answer, and
the server never hangs up: the program that asks would end if it did (side channels reference 3.1
and 3.5).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from usarsim_server.protocol.framing import LineFramer
from usarsim_server.services.budget import whole_share
from usarsim_server.services.dialogue import (
    MAX_REQUEST,
    DialogueLimits,
    DialogueService,
    Instant,
    Respond,
)

__all__ = ["Answers", "ground_truth_service", "responder"]

Answers = Callable[[Iterable[str]], list[str | None]]
"""Makes the replies, without line ends, to requests that came together, one for each; None: there
is no reply. May block."""


def ground_truth_service(
    host: str,
    port: int,
    respond: Respond,
    *,
    required: bool = False,
    limits: DialogueLimits | None = None,
    instant: Instant | None = None,
    pace: Callable[[], float] = whole_share,
) -> DialogueService:
    """Describe the service; nothing is opened before it is started.

    Args:
        host: address or host name to listen on.
        port: 0 takes any free one.
        respond: in general `responder` of `GroundTruth.answers`.
        required: see `ready.Service`.
        limits: see `DialogueLimits`.
        instant: for how long an answer holds.
        pace: which part of the share may be used now.
    """
    return DialogueService(
        "groundtruth",
        host,
        port,
        "--groundtruth-port",
        lambda: LineFramer(MAX_REQUEST),
        respond,
        required=required,
        limits=limits,
        instant=instant,
        pace=pace,
    )


def responder(answers: Answers) -> Respond:
    """What a desk needs, in bytes."""

    def respond(lines: list[bytes]) -> list[bytes]:
        replies = answers([line.decode("latin-1") for line in lines])
        return [
            b"" if reply is None else f"{reply}\r\n".encode("latin-1", "replace")
            for reply in replies
        ]

    return respond
