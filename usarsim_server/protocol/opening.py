"""Tells by the first line of a connection whether a program speaks HTTP or TLS to a text port.

A page of any site can have a browser send an HTTP request to a port of this machine, with commands
in its body. Lines that no parser knows are skipped by the protocol, so the request's head would be
skipped and the body obeyed.
"""

from __future__ import annotations

import re

_END = re.compile(rb"[\r\n]")
_HTTP = re.compile(rb" HTTP/\d(\.\d)?[ \t]*$")
"""Ends the first line of a request (RFC 9112, 3), and of the preface of HTTP/2 (RFC 9113, 3.4)."""
_TLS = re.compile(rb"\x16\x03[\x00-\x04]")
"""Type and version of the record that holds a TLS hello (RFC 8446, 5.1)."""
_TAIL = 32
"""Bytes of the line's end that are kept."""


class Opening:
    """The first line of one connection; empty lines before it do not count."""

    def __init__(self) -> None:
        self._head = self._tail = b""
        self._over = False

    def foreign(self, chunk: bytes) -> str:
        """The protocol that the client speaks, known once the first line has ended.

        Args:
            chunk: what came next; to be asked before it is obeyed.

        Returns:
            `HTTP` or `TLS`; empty for all that may be the protocol of a text port.
        """
        if self._over:
            return ""
        if not self._tail:
            chunk = chunk.lstrip(b"\r\n")
        end = _END.search(chunk)
        line = chunk if end is None else chunk[: end.start()]
        self._head = (self._head + line[:3])[:3]
        self._tail = (self._tail + line)[-_TAIL:]
        if _TLS.match(self._head):
            return "TLS"
        self._over = end is not None
        return "HTTP" if self._over and _HTTP.search(self._tail) else ""
