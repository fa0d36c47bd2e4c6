"""RES lines, which only the UT2004 generation sends (protocol reference 4.10)."""

from __future__ import annotations

from collections.abc import Sequence

from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.messages.text import line, segment, time_segment
from usarsim_server.protocol.values import Dialect, Segment

__all__ = ["result", "viewports_result"]

_TIME_DIGITS = FACETS[Dialect.UT2004].time_digits
# RDK reads the lower case spelling for these, MOAST the other for the rest (5.2 no. 19).
_LOWER_CASE_STATUS = frozenset({"RFID", "RFIDReleaser"})


def result(
    time: float, wire_type: str, name: str | None, ok: bool, extra: Sequence[Segment] = ()
) -> str:
    """RES of a SET.

    Args:
        time: simulated s.
        wire_type: Type, canonical spelling.
        name: item name, None to leave it out.
        ok: whether the item obeyed.
        extra: segments behind the status, for example ID and Mem of an RFID tag.
    """
    status = "status" if wire_type in _LOWER_CASE_STATUS else "Status"
    return line(
        "RES",
        time_segment(time, _TIME_DIGITS),
        segment("Type", wire_type),
        *(() if name is None else (segment("Name", name),)),
        segment(status, _verdict(ok)),
        *(segment(key, value) for key, value in extra),
    )


def viewports_result(
    time: float,
    viewports: Sequence[tuple[str, bool]],
    config: tuple[str, bool] | None = None,
) -> str:
    """RES of `SET {Type Viewports}`.

    Args:
        time: simulated s.
        viewports: camera (or Disabled, None) and success of each viewport.
        config: SingleView or QuadView, and success (side channels reference 2.11).
    """
    body: list[str] = []
    if config is not None:
        body += (segment("Config", config[0]), segment("Status", _verdict(config[1])))
    for index, (camera, ok) in enumerate(viewports, start=1):
        body += (segment(f"Viewport{index}", camera), segment("Status", _verdict(ok)))
    stamp = time_segment(time, _TIME_DIGITS)
    return line("RES", stamp, segment("Type", "Viewports"), *body)


def _verdict(ok: bool) -> str:
    return "OK" if ok else "Failed"
