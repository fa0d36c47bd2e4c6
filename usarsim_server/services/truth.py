"""The truth service: scoring tools ask here for the poses of everybody, TCP 3989.

Every line is a query, even an empty one, and is answered by a listing in one piece: a tool reads
once after data has arrived and takes what is there (side channels reference 6 and 7).
"""

from __future__ import annotations

from collections.abc import Callable

from usarsim_server.protocol.truth import MAX_LISTING, QueryFramer
from usarsim_server.services.budget import whole_share
from usarsim_server.services.dialogue import (
    MAX_REQUEST,
    DialogueLimits,
    DialogueService,
    Instant,
)

__all__ = ["TRUTH_LIMITS", "truth_service"]

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
