"""The truth service: scoring tools ask here for the poses of everybody, TCP 3989.

Every line is a query, even an empty one, and is answered by a listing in one piece: a tool reads
once after data has arrived and takes what is there (side channels reference 6 and 7).

The ground truth service: the wireless simulation asks here who is where, TCP 7435.

Nothing is said on connecting, every request that is known has exactly one line as its answer, and
the server never hangs up: the program that asks would end if it did (side channels reference 3.1
and 3.5).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from usarsim_server.protocol.framing import LineFramer
from usarsim_server.protocol.truth import MAX_LISTING, QueryFramer
from usarsim_server.services.budget import whole_share
from usarsim_server.services.dialogue import (
    MAX_REQUEST,
    DialogueLimits,
    DialogueService,
    Instant,
    Respond,
)

TRUTH_LIMITS = DialogueLimits(together=False, pause=1 / 60, reply_bytes=MAX_LISTING)
"""One listing for each query; a tool that asks again at once gets sixty a second, about as many as
the original, which answered once a tick."""


def truth_service(
    host: str,
    port: int,
    answer: Callable[[str], str],
    *,
    required: bool = False,
    limits: DialogueLimits = TRUTH_LIMITS,
    instant: Instant | None = None,
    pace: Callable[[], float] = whole_share,
) -> DialogueService:
    """Describe the service; nothing is opened before it is started.

    Args:
        host: address or host name to listen on.
        port: 0 takes any free one.
        answer: the listing, line ends included, for a query without line end; may block.
        required: see `ready.Service`.
        limits: see `DialogueLimits`.
        instant: for how long a listing holds.
        pace: which part of the share may be used now.
    """

    def respond(lines: list[bytes]) -> list[bytes]:
        return [answer(line.decode("latin-1")).encode("latin-1", "replace") for line in lines]

    return DialogueService(
        "truth",
        host,
        port,
        "--truth-port",
        lambda: QueryFramer(MAX_REQUEST),
        respond,
        required=required,
        limits=limits,
        instant=instant,
        pace=pace,
    )


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
