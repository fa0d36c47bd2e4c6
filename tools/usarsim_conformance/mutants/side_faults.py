"""What the small servers can get wrong, and which check is meant to notice."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from functools import partial

from usarsim_conformance.mutants.side_ground_truth import MiniGroundTruth, MiniTruth
from usarsim_conformance.mutants.side_images import MiniImages
from usarsim_conformance.mutants.side_wireless import MiniWireless
from usarsim_conformance.mutants.side_world import Handler, MiniWorld

FAULTS = {
    "image-any-case": "images.request.lower-case",
    "image-answers-newline": "images.request.ok-crlf",
    "image-banner": "images.connect.silent",
    "image-coalesced": "images.request.pipelined",
    "image-cut-jpeg": "images.jpeg.markers",
    "image-length-of-all": "images.header.length",
    "image-line-based": "images.request.ok",
    "image-little-endian": "images.header.length",
    "image-no-buffer": "images.rectangle.byte-by-byte",
    "image-no-padding": "images.raw.padding",
    "image-ook": "images.request.ook",
    "image-reads-arguments": "images.rectangle.binary",
    "image-rgb": "images.content.sky-is-blue",
    "image-silent-outside": "images.rectangle.outside",
    "image-strict": "images.rectangle.qt-padding",
    "image-two-types": "images.header.one-type",
    "image-upside-down": "images.content.upright",
    "groundtruth-blank-lines": "groundtruth.request.blank-lines",
    "groundtruth-by-name": "groundtruth.getpos.order",
    "groundtruth-counts-robots": "groundtruth.getobs.bodies",
    "groundtruth-error": "groundtruth.request.unknown",
    "groundtruth-lf": "groundtruth.getpos.form",
    "groundtruth-lookup-case": "groundtruth.getobs.any-case",
    "groundtruth-lower-case": "groundtruth.getpos.names",
    "groundtruth-many-groups": "groundtruth.getpos.splitter",
    "groundtruth-one-per-read": "groundtruth.request.pipelined",
    "groundtruth-rewrites-points": "groundtruth.getobs.echo",
    "groundtruth-rounds": "groundtruth.getpos.truncated",
    "groundtruth-silent-missing": "groundtruth.getobs.missing",
    "groundtruth-two-blanks": "groundtruth.getpos.form",
    "keeps-leavers": "groundtruth.getpos.leaves",
    "wireless-half-open": "wireless.relay.hangup",
    "wireless-hears-self": "wireless.getss.self",
    "wireless-init-twice": "wireless.init.once",
    "wireless-keeps": "wireless.kick.leaver",
    "wireless-new-ports": "wireless.dns.stable",
    "wireless-no-init": "wireless.init.first",
    "wireless-positive": "wireless.getss.known",
    "wireless-reverse": "wireless.reversedns.owner",
    "wireless-spelling": "wireless.init.duplicate",
    "wireless-text-only": "wireless.relay.there",
    "truth-any-class": "truth.query.unknown-class",
    "truth-blanks": "truth.listing.form",
    "truth-ignores-empty": "truth.query.empty-line",
    "truth-init-names": "truth.listing.names",
    "truth-name-case": "truth.query.keys",
    "truth-no-end": "truth.query.unknown-class",
    "truth-packages": "truth.query.class",
    "truth-three-digits": "truth.listing.digits",
    "truth-two-writes": "truth.listing.one-read",
}
"""The check that is meant to notice a fault, by the fault's name."""

_SETTLES = 0.02
"""s until the sockets of closed connections are closed, too."""


@contextlib.asynccontextmanager
async def side_server(*faults: str, jpeg: bool = False) -> AsyncIterator[dict[str, int]]:
    """A server of all side channels while inside; its ports by service.

    Args:
        faults: keys of `FAULTS`; none for a healthy server.
        jpeg: whether pictures are JPEG rather than raw.
    """
    world = MiniWorld(frozenset(faults))
    wireless = MiniWireless(world)
    handlers = {
        "control": world.control,
        "images": MiniImages(world, 3 if jpeg else 0).serve,
        "groundtruth": MiniGroundTruth(world).serve,
        "wireless": wireless.serve,
        "truth": MiniTruth(world).serve,
    }
    busy: set[asyncio.Task[None]] = set()
    servers = {
        name: await asyncio.start_server(partial(_guarded, handler, busy), "127.0.0.1", 0)
        for name, handler in handlers.items()
    }
    flow = asyncio.create_task(world.ticks.run())
    try:
        yield {name: one.sockets[0].getsockname()[1] for name, one in servers.items()}
    finally:
        for server in servers.values():
            server.close()
        wireless.close()
        flow.cancel()
        for task in busy:
            task.cancel()
        await asyncio.gather(*busy, return_exceptions=True)
        await asyncio.sleep(_SETTLES)


async def _guarded(
    handler: Handler,
    busy: set[asyncio.Task[None]],
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
) -> None:
    """Serve a connection, whatever becomes of it."""
    task = asyncio.current_task()
    assert task is not None
    busy.add(task)
    task.add_done_callback(busy.discard)
    try:
        with contextlib.suppress(OSError, asyncio.CancelledError):
            await handler(reader, writer)
    finally:
        writer.close()
