"""What draws camera pictures: OpenGL with or without a graphics card, or rays."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.cameras.backend import INSTALL, platforms_to_try, works
from usarsim_server.doctor.isolation import apt, attempt, root
from usarsim_server.doctor.registry import Context, Finding, Mark, check
from usarsim_server.settings import Settings

TIMEOUT = 30.0
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software rasterizer")
"""Words in GL_RENDERER of programs that draw on the processor (Mesa 3D documentation, drivers)."""
WITHOUT = "pictures are cast with rays, which takes about four times as long"
"""As measured in `docs/cameras.md`."""


@dataclass(frozen=True, slots=True)
class Device:
    """A graphics card that the system knows.

    Attributes:
        path: of its file.
        usable: we may use it.
    """

    path: str
    usable: bool


@dataclass(frozen=True, slots=True)
class Drawing:
    """What the server would draw with.

    Attributes:
        tried: ways to have OpenGL that were tried, and why they do not work.
        platform: the way that works; None for none.
        renderer: GL_RENDERER of it; empty if it would not say.
        cards: what the system knows.
    """

    tried: tuple[tuple[str, str], ...]
    platform: str | None
    renderer: str = ""
    cards: tuple[Device, ...] = ()


@check("graphics", "Graphics", order=50)
def look(context: Context) -> Iterator[Finding]:
    """Try what the server would try, in the same order."""
    settings = context.settings
    tried = []
    platform = None
    for one in platforms_to_try(settings.renderer):
        reason = works(one)
        if reason is None:
            platform = one
            break
        tried.append((one, reason))
    renderer = ""
    if platform is not None:
        name = f"gl:{platform}"
        renderer = str(attempt([name], settings, TIMEOUT)[name].values.get("renderer", ""))
    yield from judge(Drawing(tuple(tried), platform, renderer, devices()), settings)


def devices(folder: Path = Path("/dev")) -> tuple[Device, ...]:
    """Graphics cards that could be drawn with: render nodes of the kernel, NVIDIA's own files."""
    found = [*sorted(folder.glob("dri/renderD*")), *sorted(folder.glob("nvidia[0-9]*"))]
    return tuple(Device(str(path), os.access(path, os.R_OK | os.W_OK)) for path in found)


def is_software(renderer: str) -> bool:
    """Whether a GL_RENDERER draws on the processor."""
    return any(word in renderer.lower() for word in SOFTWARE)


def judge(drawing: Drawing, settings: Settings) -> Iterator[Finding]:
    """What to say of it."""
    if settings.renderer == "rays":
        values = {"backend": "rays", "hardware": False}
        yield Finding("pictures", Mark.OK, "rays on the processor, as asked for", values=values)
    elif drawing.platform is None:
        yield _no_opengl(drawing, settings)
    else:
        yield from _opengl(drawing)


def _opengl(drawing: Drawing) -> Iterator[Finding]:
    software = is_software(drawing.renderer)
    where = "software, on the processor" if software else "hardware"
    if not drawing.renderer:
        where = "it would not say what it draws with"
    said = f": {drawing.renderer}" if drawing.renderer else ""
    values = {
        "backend": drawing.platform,
        "renderer": drawing.renderer,
        "hardware": bool(drawing.renderer) and not software,
    }
    text = f"OpenGL by {drawing.platform}, {where}{said}"
    yield Finding("pictures", Mark.OK, text, values=values)
    if software and drawing.cards:
        yield _idle_card(drawing)


def _idle_card(drawing: Drawing) -> Finding:
    """There is a graphics card, but nobody draws with it."""
    names = ", ".join(card.path for card in drawing.cards)
    values = {"devices": [card.path for card in drawing.cards]}
    text = f"{names} is there but does not draw"
    closed = [card for card in drawing.cards if not card.usable]
    if len(closed) == len(drawing.cards):
        text += ": this user may not open it"
        cure = root("usermod -aG render,video $USER") + "  # then log in again"
    elif drawing.platform != "egl":
        text += f": only EGL can use it ({dict(drawing.tried).get('egl', 'which was not tried')})"
        cure = apt(INSTALL["egl"])
    elif "nvidia" in names:
        text += ": NVIDIA's EGL driver is missing (in a container, its graphics capability)"
        cure = "docker run --gpus all -e NVIDIA_DRIVER_CAPABILITIES=all ..."
        if not Path("/.dockerenv").exists():
            cure = apt("apt-get install libnvidia-gl-" + _nvidia_release())
    else:
        text += ": its driver is missing"
        cure = apt(INSTALL["egl"])
    return Finding("graphics card", Mark.NOTE, text, cure, values=values)


def _nvidia_release() -> str:
    """Main number of the driver of the kernel; packages of the libraries are called after it."""
    try:
        words = Path("/sys/module/nvidia/version").read_text().split(".")
    except OSError:
        return "XXX"
    return words[0].strip()


def _no_opengl(drawing: Drawing, settings: Settings) -> Finding:
    reasons = "; ".join(f"{platform}: {reason}" for platform, reason in drawing.tried)
    values = {"backend": "rays", "hardware": False, "tried": dict(drawing.tried)}
    cure = apt(INSTALL[_best(drawing, settings)])
    if settings.renderer != "auto":
        text = f"--renderer {settings.renderer} does not work here: {reasons}"
        # Nothing is drawn, and so nothing checked, without the port for images.
        mark = Mark.PROBLEM if settings.image_port is not None else Mark.WARNING
        return Finding("pictures", mark, text, cure, values=values)
    text = f"no OpenGL, {WITHOUT}" + (f" ({reasons})" if reasons else "")
    return Finding("pictures", Mark.WARNING, text, cure, values=values)


def _best(drawing: Drawing, settings: Settings) -> str:
    """What to install: one small package, or what a graphics card needs."""
    if settings.renderer in INSTALL:
        return settings.renderer
    tried: Sequence[str] = [platform for platform, _ in drawing.tried]
    if drawing.cards or "osmesa" not in tried:
        return "egl"
    return "osmesa"
