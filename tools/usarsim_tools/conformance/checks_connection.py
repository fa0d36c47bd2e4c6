"""Connecting, greeting, hanging up (protocol reference 6.1)."""

from __future__ import annotations

from usarsim_tools.conformance.case import Case
from usarsim_tools.conformance.registry import ONCE, check

_SECTION = "protocol reference 6.1"


@check("control.connection.greeting", "Greets whoever connects", source="6.1.2", dialects=ONCE)
async def greeting(case: Case) -> None:
    """Within 1 s of accept, before any input, the server sends exactly one line, the game NFO."""
    client = await case.connect(greet=False)
    lines = await client.listen(1.5)
    case.expect(lines, "nothing was sent within 1.5 s")
    case.expect(len(lines) == 1, f"{len(lines)} lines were sent, not one")
    case.expect(lines[0].text.startswith("NFO {Gametype "), f"not the game NFO: {lines[0]}")
