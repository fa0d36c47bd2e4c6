"""Faults of the image port, and of what the control port tells of tiles."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mutants.fault_proxy import Link
from mutants.wire_faults import (
    FewClients,
    Greets,
    NoHalves,
    OneAtATime,
    deaf,
    hangs_up,
    heard,
    in_pieces,
    said,
    tires,
    wire_fault,
)

CONTROL = ("control",)
Pixels = NDArray[np.uint8]

# Requests.

heard("images.request.crlf-ok", (r"^\r\nOK", "OKOK"))
heard("images.request.junk", (r"^[^OU]{500,}$", "OK"))
hangs_up("images.request.much-junk", "x{1000}")
heard("images.request.ok-in-halves", (r"^O$", ""))
heard("images.request.telnet", (r"^GETSTART", "OK"))
heard("images.push.not-for-askers", (r"^OK$", "OKOK"))


tires("images.request.rapid", b"OK")
heard("images.request.lower-case", ("ok", "OK"))
heard("images.request.ok-crlf", (r"^OK\r\n$", "OKOK"))
heard("images.request.pipelined", ("(?:OK){5}", "OK"))
heard("images.request.ook", ("OOK", "OK"))


# Rectangles: what `U` and four numbers are taken for.


def _numbers(*values: int) -> str:
    """Four numbers of a rectangle as a regular expression finds them."""
    return "".join(f"\\x{byte:02x}" for value in values for byte in value.to_bytes(4))


def _bytes(*values: int) -> str:
    return b"".join(value.to_bytes(4) for value in values).decode("latin-1")


heard(
    "images.rectangle.big-endian",
    (f"U{_numbers(1, 2, 40, 30)}", "U" + _bytes(1 << 24, 2 << 24, 40 << 24, 30 << 24)),
)
heard("images.rectangle.byte-by-byte", (r"^U$", ""))
heard("images.rectangle.binary", (r"(?s)^U.*OK.*", "\\g<0>U" + 16 * "\xff"))
hangs_up("images.rectangle.qt-padding", r"^\x00{3}U")
heard("images.rectangle.crossing", (rf"(?s)U.{{8}}{_numbers(20, 20)}", r"\g<0>\g<0>"))
heard("images.rectangle.followed", (rf"(?s)(U{_numbers(0, 0, 32, 24)}).+", r"\1"))
hangs_up("images.rectangle.huge", r"U\xff{16}")
heard("images.rectangle.nothing", (f"U{_numbers(0, 0, 0, 10)}", r"\g<0>\g<0>"))
heard("images.rectangle.size", (f"U{_numbers(0, 0, 16, 8)}", "U" + _bytes(0, 0, 8, 8)))
heard(
    "images.rectangle.whole",
    (r"(?s)U\x00{8}\x00\x00[\x01-\xff].\x00\x00..", "U" + _bytes(0, 0, 16, 16)),
)


# Connections.

wire_fault("images.connect.silent")(Greets)

wire_fault("images.clients.half-close")(NoHalves)
wire_fault("images.clients.slow-reader")(OneAtATime)
wire_fault("images.clients.several")(FewClients)


@wire_fault("images.clients.vanishes")
class DiesOfReset(Link):
    """A reset kills the server."""

    def ended(self, reset: bool) -> None:
        if reset:
            self.die()


class ThreeFrames(Link):
    """Connections but the first end with their third frame, the mark's included."""

    told = 0

    def begin(self) -> None:
        self.memory["begun"] = self.memory.get("begun", 0) + 1
        self.told = -10 * (self.memory["begun"] == 1)

    def said(self, unit: bytes) -> bytes:
        self.told += 1
        self.hangs_up = self.told == 3
        return b"" if self.told == 3 else unit


wire_fault("images.clients.robot-leaves")(ThreeFrames)
wire_fault("images.connect.idle")(ThreeFrames)


@wire_fault("images.clients.resumes")
class LosesOne(Link):
    """One frame of many is lost."""

    told = 0

    def said(self, unit: bytes) -> bytes:
        self.told += 1
        return b"" if self.told == 7 else unit


wire_fault("images.header.type-alone")(in_pieces(5))


@wire_fault("images.legacy.frame-first")
class PushesTwo(Link):
    """Legacy mode, but with two frames at once."""

    def begin(self) -> None:
        self.ask(b"OKOK")


@wire_fault("images.legacy.two-frames")
class AnswersTwice(Link):
    """Legacy mode, and OK gets two frames."""

    def begin(self) -> None:
        self.ask(b"OK")

    def heard(self, data: bytes) -> bytes:
        return b"OKOK" if data == b"OK" else data


@wire_fault("images.push.whole")
class PushesHalf(Link):
    """Who stays silent gets a frame that breaks off."""

    def begin(self) -> None:
        self.say(b"\x03\x00\x00\x10\x00half", after=0.05)


# Pictures.


class Repainted(Link):
    """Sends pictures otherwise."""

    def said(self, unit: bytes) -> bytes:
        payload = unit[5:]
        if not payload or not unit[0]:
            return unit
        return _frame(unit[0], self.painted(payload))

    def painted(self, payload: bytes) -> bytes:
        """The payload to send; by default that of other pixels."""
        with Image.open(io.BytesIO(payload)) as picture:
            return _jpeg(self.changed(np.asarray(picture.convert("RGB"))))

    def changed(self, pixels: Pixels) -> Pixels:
        """Other pixels."""
        return pixels


def _frame(kind: int, payload: bytes) -> bytes:
    return bytes([kind]) + len(payload).to_bytes(4) + payload


def _jpeg(pixels: Pixels, **how: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, "JPEG", **{"quality": 50, **how})
    return file.getvalue()


def _repainted(check: str, change: Callable[[Pixels], Pixels], **how: Any) -> None:
    wire_fault(check, **how)(type("Painted", (Repainted,), {"changed": lambda _, old: change(old)}))


def _encoded(check: str, **how: Any) -> None:
    def painted(_: Link, payload: bytes) -> bytes:
        with Image.open(io.BytesIO(payload)) as picture:
            return _jpeg(np.asarray(picture.convert("RGB")), **how)

    wire_fault(check)(type("Encoded", (Repainted,), {"painted": painted}))


_repainted("images.content.not-blank", lambda old: np.full_like(old, 90))
_repainted(
    "images.content.tile-of-frame", lambda old: 255 - old if 99 < len(old) < 300 else old
)  # a tile is smaller than the frame
_repainted("images.jpeg.decodes", lambda old: old[::2] if old.shape[:2] == (30, 50) else old)
_encoded("images.jpeg.baseline", progressive=True)
_encoded("images.jpeg.quality", quality=15)


_repainted("images.content.sky-is-blue", lambda old: old[:, :, ::-1])
_repainted("images.content.upright", lambda old: old[::-1])


class Later(Link):
    """Is wrong from the second answer of the second connection on: the first tells what kind of
    stream it is, the first answer of others is to the mark."""

    first = False
    told = 0

    def begin(self) -> None:
        self.first = self.memory.setdefault("first", self) is self

    def said(self, unit: bytes) -> bytes:
        self.told += 1
        return unit if self.first or self.told < 2 else self.changed(unit)

    def changed(self, unit: bytes) -> bytes:
        """Another reply."""
        return unit


@wire_fault("images.request.ok")
class NeedsLineEnd(Later):
    """OK by itself is not heard."""

    def heard(self, data: bytes) -> bytes:
        return b"" if data == b"OK" and not self.first else data


def _reframed(check: str, change: Callable[[bytes], bytes], **how: Any) -> None:
    """Replies are whole others."""
    kind = type("Reframed", (Later,), {"changed": lambda _, unit: change(unit)})
    wire_fault(check, **how)(kind)


def _unpadded(unit: bytes) -> bytes:
    width, row = int.from_bytes(unit[5:7]), -(-3 * int.from_bytes(unit[5:7]) // 4) * 4
    rows = (unit[start : start + 3 * width] for start in range(9, len(unit), row or 1))
    return _frame(unit[0], unit[5:9] + b"".join(rows))


_LENGTH = r"length in the header.* is \d+\b.*\b\d+ bytes of payload follow"
"""What is named, and what comes."""
_reframed(
    "images.header.length",
    lambda unit: unit[:1] + len(unit).to_bytes(4) + unit[5:],
    says=_LENGTH,
)
_reframed(
    "images.header.length",
    lambda unit: unit[:1] + (len(unit) - 5).to_bytes(4, "little") + unit[5:],
    says="little-endian",
)


def _long(more: int) -> type[Link]:
    class Long(Link):
        """The length in every header is that of the payload and some bytes more."""

        def said(self, unit: bytes) -> bytes:
            return unit[:1] + (len(unit) - 5 + more).to_bytes(4) + unit[5:]

    return Long


wire_fault("images.header.length", says=_LENGTH)(_long(4))
wire_fault("images.header.length", says=_LENGTH)(_long(-4))
_reframed("images.header.one-type", lambda unit: unit if len(unit) > 5000 else b"\x04" + unit[1:])
_reframed("images.rectangle.outside", lambda unit: unit if len(unit) > 5 else b"")
_reframed("images.jpeg.markers", lambda unit: _frame(unit[0], unit[5:-2]))
_reframed("images.raw.padding", _unpadded, server="raw")


@wire_fault(
    "images.content.moves", says=r"differs by 0\.00 of 255 .* not by more than 0\.50.* stale"
)
class Frozen(Link):
    """Pictures of a size are for ever the first one."""

    def said(self, unit: bytes) -> bytes:
        with Image.open(io.BytesIO(unit[5:])) as picture:
            return bytes(self.memory.setdefault(str(picture.size), unit))


@wire_fault("images.connect.without-robot")
class NothingToSee(Link):
    """Full frames are empty."""

    def said(self, unit: bytes) -> bytes:
        with Image.open(io.BytesIO(unit[5:])) as picture:
            return _frame(unit[0], b"") if picture.size[0] > 300 else unit


@wire_fault("images.header.known-type")
class TypeNine(Link):
    """A type that nobody knows."""

    def said(self, unit: bytes) -> bytes:
        return b"\x09" + unit[1:]


@wire_fault("images.rectangle.empty-form")
class EmptyAsRaw(Link):
    """An empty JPEG reply that looks like a raw one."""

    def said(self, unit: bytes) -> bytes:
        return unit if len(unit) > 5 else _frame(unit[0], bytes(4))


@wire_fault("images.raw.sides", server="raw")
class SidesSwapped(Link):
    """Height before width in the raw picture of 40 x 24."""

    def said(self, unit: bytes) -> bytes:
        return unit.replace(bytes((0, 40, 0, 24)), bytes((0, 24, 0, 40)), 1)


@wire_fault("images.raw.length", server="raw")
class OneByteMore(Link):
    """Full frames have a row more than their sides tell."""

    def said(self, unit: bytes) -> bytes:
        return _frame(unit[0], unit[5:] + b"x" * 4) if len(unit) > 10_000 else unit


# Tiles, of which the control port tells.

said("images.camera.clamped", (r"CameraFov [\d.]+", "CameraFov 60.0000"), services=CONTROL)
hangs_up("images.camera.viewports", "Viewports", services=CONTROL)
said("images.camera.zoom", (r"CameraFov [\d.]+", "CameraFov 60.0000"), services=CONTROL)
deaf("images.conf.by-name", r"\{Type Camera\} \{Name", services=CONTROL)
said("images.conf.degrees", (r"CameraDefFov [\d.]+", "CameraDefFov 0.7854"), services=CONTROL)
said("images.conf.form", (r"\}\{TextureOffsetX", "} {TextureOffsetX"), services=CONTROL)
said("images.conf.inside", (r"TextureOffsetX \d+", "TextureOffsetX 9999"), services=CONTROL)
said("images.tiles.grid", (r"TextureOffsetX (\d+)", r"TextureOffsetX \g<1>5"), services=CONTROL)
_ONE_TILE = ((r"TextureOffsetX \d+", "TextureOffsetX 64"), (r"OffsetY \d+", "OffsetY 64"))
said("images.tiles.own", *_ONE_TILE, services=CONTROL)
said("images.tiles.two-cameras", *_ONE_TILE, services=CONTROL)


@wire_fault("images.conf.unsolicited", services=CONTROL)
class TellsIfAsked(Link):
    """The first CONF of a camera, which nobody asked for, does not come."""

    told = False

    def said(self, unit: bytes) -> bytes:
        if self.told or not unit.startswith(b"CONF {Type Camera}"):
            return unit
        self.told = True
        return b""


@wire_fault("images.tiles.first", services=("control", "images"))
class SkipsTheFirst(Repainted):
    """The first tile stays empty: what is there is shown to be elsewhere."""

    def said(self, unit: bytes) -> bytes:
        if self.service == "images":
            return super().said(unit)
        return unit.replace(b"{TextureOffsetX 0}", b"{TextureOffsetX 320}")

    def changed(self, pixels: Pixels) -> Pixels:
        return np.zeros_like(pixels)


@wire_fault("images.tiles.lowest", services=CONTROL)
class NeverLowest(Link):
    """The third robot does not get the tile of the first."""

    number = 0

    def heard(self, data: bytes) -> bytes:
        if data.startswith(b"INIT"):
            self.number = self.memory["inits"] = self.memory.get("inits", 0) + 1
        return data

    def said(self, unit: bytes) -> bytes:
        if self.number < 3:
            return unit
        return unit.replace(b"{TextureOffsetX 0}", b"{TextureOffsetX 640}")
