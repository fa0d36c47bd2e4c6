"""Addresses as people write them: `HOST:PORT`, an IPv6 host in brackets, as READY prints it."""

from __future__ import annotations


def bare_host(text: str) -> str:
    """A host without blanks around it and without the brackets of an IPv6 address."""
    host = text.strip()
    inside = host.startswith("[") and host.endswith("]") and ":" in host
    return host[1:-1] if inside else host


def split_address(text: str) -> tuple[str, str]:
    """Host and port of `HOST:PORT`; the host may be empty. Without a colon all is the port.

    Of an IPv6 address without brackets the last part is the port.
    """
    host, _, port = text.strip().rpartition(":")
    return bare_host(host), port


def format_address(host: str, port: int) -> str:
    """`host:port`, with brackets around an IPv6 host."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
