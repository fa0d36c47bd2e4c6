"""What draws: made-up machines with and without OpenGL and graphics cards."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from usarsim_server.cameras import backend as probe
from usarsim_server.doctor.checks import installation as graphics
from usarsim_server.doctor.checks.installation import (
    Device,
    Drawing,
    devices,
    is_software,
    judge_drawing,
)
from usarsim_server.doctor.isolation import Outcome
from usarsim_server.doctor.registry import Context, Finding, Mark
from usarsim_server.settings import Settings

NOTHING = Drawing((("egl", "no libEGL"), ("osmesa", "no libOSMesa")), None)
MESA = Drawing((), "egl", "llvmpipe (LLVM 15.0.6, 256 bits)")
CARD = Device("/dev/dri/renderD128", True)


def only(drawing: Drawing, settings: Settings | None = None) -> Finding:
    """The one finding about a machine."""
    [finding] = judge_drawing(drawing, settings or Settings())
    return finding


def test_without_opengl_the_package_to_install_is_named() -> None:
    """The server runs, with rays; one apt command mends it, and the reasons are told."""
    finding = only(NOTHING)
    assert finding.mark is Mark.WARNING
    assert finding.cure is not None
    assert finding.cure.endswith("apt-get install libosmesa6")
    assert "egl: no libEGL; osmesa: no libOSMesa" in finding.text
    assert finding.values["backend"] == "rays"


def test_with_a_graphics_card_egl_is_what_to_install() -> None:
    """OSMesa could not use the card."""
    cure = only(replace(NOTHING, cards=(CARD,))).cure
    assert cure is not None
    assert cure.endswith("apt-get install libegl1 libgl1-mesa-dri libgl1")


@pytest.mark.parametrize("platform", ["egl", "osmesa"])
def test_a_renderer_asked_for_by_name_must_work(platform: str) -> None:
    """Naming one that does not work is a problem, but not if there is no port for images."""
    settings = Settings(renderer=platform)  # type: ignore[arg-type]
    machine = Drawing(((platform, "not here"),), None)
    finding = only(machine, settings)
    assert finding.mark is Mark.PROBLEM
    assert finding.cure is not None
    assert finding.cure.endswith(probe.INSTALL[platform])
    assert only(machine, replace(settings, image_port=None)).mark is Mark.WARNING


def test_rays_that_were_asked_for_are_fine() -> None:
    """Nobody is told to install what was not wanted."""
    finding = only(Drawing((), None), Settings(renderer="rays"))
    assert (finding.mark, finding.cure) == (Mark.OK, None)


def test_software_and_hardware_are_told_apart() -> None:
    """GL_RENDERER decides; a machine that would not say counts as neither."""
    software = only(MESA)
    assert software.mark is Mark.OK
    assert "software, on the processor: llvmpipe" in software.text
    assert software.values["hardware"] is False
    hardware = only(Drawing((), "egl", "NVIDIA GeForce RTX 3060/PCIe/SSE2", (CARD,)))
    assert "hardware: NVIDIA GeForce" in hardware.text
    assert hardware.values["hardware"] is True
    assert only(Drawing((), "egl")).values["hardware"] is False
    assert is_software("softpipe")
    assert is_software("Google SwiftShader")
    assert not is_software("Mesa Intel(R) UHD Graphics 620 (KBL GT2)")


def test_a_card_that_does_not_draw_is_noted() -> None:
    """With a reason and a command for each: rights, the way of drawing, the driver."""
    closed = replace(MESA, cards=(replace(CARD, usable=False),))
    _, note = judge_drawing(closed, Settings())
    assert note.mark is Mark.NOTE
    assert "may not open it" in note.text
    assert "usermod -aG render" in (note.cure or "")
    osmesa = Drawing((("egl", "no libEGL"),), "osmesa", "llvmpipe", (CARD,))
    _, note = judge_drawing(osmesa, Settings())
    assert "only EGL can use it (no libEGL)" in note.text
    assert "libegl1" in (note.cure or "")
    nvidia = replace(MESA, cards=(Device("/dev/nvidia0", True),))
    _, note = judge_drawing(nvidia, Settings())
    assert "NVIDIA's EGL driver is missing" in note.text


def test_the_server_s_own_probe_is_asked_in_its_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """EGL fails, OSMesa works: that is what the server would take, and it is asked its name."""
    asked = []

    def works(platform: str) -> str | None:
        asked.append(platform)
        return "no display" if platform == "egl" else None

    def attempt(names: list[str], settings: Settings, timeout: float) -> dict[str, Outcome]:
        return {name: Outcome({"renderer": f"llvmpipe for {name}"}) for name in names}

    for name in ("MUJOCO_GL", "PYOPENGL_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(probe, "works", works)
    monkeypatch.setattr(graphics, "attempt", attempt)
    monkeypatch.setattr(graphics, "devices", lambda: ())
    [finding] = graphics.look_at_graphics(Context(Settings()))
    assert asked == ["egl", "osmesa"]
    assert finding.values["backend"] == "osmesa"
    assert finding.values["renderer"] == "llvmpipe for gl:osmesa"


def test_cards_are_found_by_their_files(tmp_path: Path) -> None:
    """Render nodes and NVIDIA's own files count, other devices do not."""
    (tmp_path / "dri").mkdir()
    for name in ("dri/renderD128", "dri/card0", "nvidia0", "nvidiactl"):
        (tmp_path / name).touch()
    os.chmod(tmp_path / "nvidia0", 0)
    found = devices(tmp_path)
    assert [Path(card.path).name for card in found] == ["renderD128", "nvidia0"]
    assert found[0].usable
