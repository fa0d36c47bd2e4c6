"""Files of the built pages over HTTP, and what browsers are told to allow them."""

from __future__ import annotations

import functools
import gzip
import mimetypes
from collections.abc import Iterable, Mapping
from pathlib import Path

from aiohttp import web

_NO_PAGE = (
    "<!doctype html><title>usarsim</title><p>The page was not built. In a clone of the "
    "repository <code>make page</code> builds it; everything else works.</p>"
)


def page_headers(framed_by: Iterable[str] = (), frames: str = "") -> dict[str, str]:
    """Headers of everything that is served: nothing comes from, or goes to, another origin.

    Args:
        framed_by: values of `Host` (`127.0.0.1:8080`) whose pages may show this one inside them;
            none: nobody may. IPv6 literals are left out: policies cannot name them.
        frames: what this page may show inside itself, as a source of the policy; empty: nothing.
    """
    hosts = sorted(host for host in framed_by if "[" not in host)
    ancestors = " ".join(f"http://{host} https://{host}" for host in hosts) or "'none'"
    shown = frames or "'none'"
    return {
        "Content-Security-Policy": (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
            "connect-src 'self'; font-src 'self'; worker-src 'self' blob:; base-uri 'none'; "
            f"form-action 'none'; frame-src {shown}; frame-ancestors {ancestors}"
        ),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-cache",
    }


def page_file(
    folder: Path,
    name: str,
    headers: Mapping[str, str],
    first: str = "index.html",
    accepted: str = "",
) -> web.Response:
    """Answer with a file of a folder of pages.

    Args:
        folder: absolute. name: as it was asked for; empty: `first`.
        headers: of the answer, see `page_headers`. accepted: encodings, as `Accept-Encoding` says.
    """
    name = name or first
    try:
        path = (folder / name).resolve()
        found = path.stat() if path.is_relative_to(folder) and path.is_file() else None
    except (OSError, ValueError):  # no name of a file at all
        found = None
    if found is None:
        if name == first:
            return web.Response(text=_NO_PAGE, content_type="text/html", headers=headers)
        return web.Response(status=404, text="there is no such file", headers=headers)
    plain, packed = _contents(path, found.st_mtime_ns, found.st_size)
    gzipped = "gzip" in accepted.lower()
    coding = {"Content-Encoding": "gzip"} if gzipped else {}
    return web.Response(
        body=packed if gzipped else plain,
        content_type=mimetypes.guess_type(path.name)[0] or "application/octet-stream",
        headers={**headers, **coding, "Vary": "Accept-Encoding"},
    )


@functools.lru_cache(maxsize=32)
def _contents(path: Path, changed: int, size: int) -> tuple[bytes, bytes]:
    """A file as it is and compressed: 0.7 MB of script, 0.2 MB of it on the wire. Once for all who
    ask: else each of them could have it compressed anew, for 30 ms of the processor."""
    plain = path.read_bytes()
    return plain, gzip.compress(plain, mtime=0)
