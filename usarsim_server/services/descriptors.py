"""Open files of the process: as many as the system lets it have, up to what a team needs."""

from __future__ import annotations

import contextlib
import resource

__all__ = ["WANTED", "descriptor_limit", "raise_descriptor_limit"]

WANTED = 8192
"""Open files that a large team may need: two for each link, one for each pair that asked."""


def raise_descriptor_limit(wanted: int = WANTED) -> None:
    """Let the process open as many files as it may, up to a number; never lowers the limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def descriptor_limit() -> int:
    """Files that the process may have open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return WANTED if soft == resource.RLIM_INFINITY else soft
