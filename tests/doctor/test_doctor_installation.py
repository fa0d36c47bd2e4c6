"""What is installed: versions of libraries, worlds, robots and plug-ins, what draws pictures."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from usarsim_doctor.checks import installation as graphics
from usarsim_doctor.checks.installation import (
    PACKAGES,
    Device,
    Drawing,
    Package,
    devices,
    is_software,
    judge_drawing,
    judge_package,
    judge_plugin,
    judge_python,
    judge_robots,
    judge_worlds,
)
from usarsim_doctor.checks.server import judge_server
from usarsim_doctor.isolation import Outcome
from usarsim_doctor.registry import Context, Finding, Mark
from usarsim_doctor.trials import server as try_server
from usarsim_server.base.files import data_directory
from usarsim_server.cameras import backend as probe
from usarsim_server.settings import Settings


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with one good robot, which extends a shipped one, and two broken ones."""
    (tmp_path / "Good.toml").write_text('extends = "P3AT"\n')
    (tmp_path / "Bad.toml").write_text('extends = "P3AT"\ncolour = 3\n')
    (tmp_path / "Torn.toml").write_text('extends = "P3AT\n')
    return tmp_path


def test_all_broken_robot_files_are_named(own: Path) -> None:
    """Each has a line of its own, though the server would stop at the first; good ones count."""
    count, *broken = judge_robots([data_directory("robots"), own])
    assert [finding.subject for finding in broken] == ["Bad.toml", "Torn.toml"]
    assert {finding.mark for finding in broken} == {Mark.PROBLEM}
    assert "colour: unknown key" in broken[0].text
    assert "known keys: " in (broken[0].advice or "")
    shipped = len(list(data_directory("robots").glob("*.toml")))
    assert count.values == {"shipped": shipped, "own": 1, "broken": 2}
    assert count.mark is Mark.OK


def test_two_robots_with_one_name_are_found_out(tmp_path: Path) -> None:
    """Files that are good for themselves may still claim the same alias."""
    for name in ("One", "Two"):
        (tmp_path / f"{name}.toml").write_text('extends = "P3AT"\naliases = ["Mine"]\n')
    _, clash = judge_robots([data_directory("robots"), tmp_path])
    assert clash.mark is Mark.PROBLEM
    assert "'Mine' is also a name in" in clash.text


def test_worlds_are_counted_and_broken_ones_named(tmp_path: Path) -> None:
    """A world that cannot be read costs a warning, none at all is a problem."""
    [fine] = judge_worlds(data_directory("worlds"))
    assert "arena" in fine.text
    [none] = judge_worlds(tmp_path)
    assert none.mark is Mark.PROBLEM
    (tmp_path / "yard").mkdir()
    (tmp_path / "yard/world.toml").write_text("")
    _, broken = judge_worlds(tmp_path)
    assert (broken.subject, broken.mark) == ("yard", Mark.WARNING)
    assert "scene.xml: file is missing" in broken.text


def test_plug_ins_that_cannot_be_loaded_are_warnings() -> None:
    """A plug-in of another package is loaded; whatever it raises stands in one line."""
    group = "usarsim_server.sensors"
    fine = judge_plugin(EntryPoint("Json", "json:loads", group))
    assert (fine.mark, fine.subject) == (Mark.OK, "plug-in Json")
    gone = judge_plugin(EntryPoint("Gone", "json:no_such_thing", group))
    assert gone.mark is Mark.WARNING
    assert "json:no_such_thing cannot be loaded: AttributeError" in gone.text


def test_the_server_is_put_together_and_own_robots_are_tried(tmp_path: Path) -> None:
    """A robot whose sensor does not exist is found out before any client asks for it."""
    (tmp_path / "Good.toml").write_text('extends = "P3AT"\n')
    (tmp_path / "Odd.toml").write_text(
        'extends = "P3AT"\nsensor = [{ type = "Sonnar", name = "S" }]\n'
    )
    settings = Settings(world="empty", robots=(tmp_path,))
    start, good, odd, steps = judge_server(Outcome(try_server(settings, "")))
    assert start.mark is Mark.OK
    assert start.text.endswith("with the world empty")
    assert good.text == "1 of your own can be put into the world"
    assert (odd.subject, odd.mark) == ("Odd", Mark.WARNING)
    assert "unknown sensor type 'Sonnar'" in odd.text
    assert (odd.advice or "").startswith("did you mean Sonar?")
    assert steps.subject == "steps"


def test_steps_that_are_not_compiled_are_a_note_with_the_reason() -> None:
    values = {"seconds": 1.0, "world": "empty", "broken": [], "tried": 0}
    *_, steps = judge_server(Outcome({**values, "not_compiled": "no C compiler (cc)"}))
    assert steps.mark is Mark.NOTE
    assert steps.text == "not compiled, so somewhat slower: no C compiler (cc)"


def test_a_server_that_would_not_start_says_why() -> None:
    """An error for users keeps its advice; a defect says of what kind it is."""
    told = Outcome(failure="nowhere: no such world", told=True, advice="known worlds: arena")
    [finding] = judge_server(told)
    assert finding.mark is Mark.PROBLEM
    assert finding.text == "would not start: nowhere: no such world"
    assert finding.advice == "known worlds: arena"
    [defect] = judge_server(Outcome(failure="the process was ended by SIGSEGV"))
    assert defect.text == "would not start: a defect, the process was ended by SIGSEGV"


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
    assert (finding.cure or "").endswith("apt-get install libosmesa6")
    assert "egl: no libEGL; osmesa: no libOSMesa" in finding.text
    assert finding.values["backend"] == "rays"


def test_with_a_graphics_card_egl_is_what_to_install() -> None:
    """OSMesa could not use the card."""
    cure = only(replace(NOTHING, cards=(CARD,))).cure
    assert (cure or "").endswith("apt-get install libegl1 libgl1-mesa-dri libgl1")


@pytest.mark.parametrize("platform", ["egl", "osmesa"])
def test_a_renderer_asked_for_by_name_must_work(platform: str) -> None:
    """Naming one that does not work is a problem, but not if there is no port for images."""
    settings = Settings(renderer=platform)  # type: ignore[arg-type]
    machine = Drawing(((platform, "not here"),), None)
    finding = only(machine, settings)
    assert finding.mark is Mark.PROBLEM
    assert (finding.cure or "").endswith(probe.INSTALL[platform])
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


BY_NAME = {package.name: package for package in PACKAGES}


def found(version: str) -> Outcome:
    """A library that could be imported."""
    return Outcome({"version": version})


def test_requirements_are_those_of_the_project() -> None:
    """What is demanded here is word for word what `pip` is told."""
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    project = tomllib.loads(text)["project"]
    needed = {package.requirement for package in PACKAGES if not package.optional}
    assert needed == set(project["dependencies"])
    optional = {package.requirement for package in PACKAGES if package.optional}
    brought = {one for group in project["optional-dependencies"].values() for one in group}
    assert optional == {one for one in brought if not one.startswith("usarsim-server")}
    assert project["requires-python"] == ">=3.11"


@pytest.mark.parametrize("version", ["4.0.0", "4.1.2", "3.2.6", "2.3.7"])
def test_mujoco_that_diverges_or_is_too_old_is_a_problem(version: str) -> None:
    """4.0.0 and what is older than 3.16 are refused, with the command that gets a good one."""
    finding = judge_package(BY_NAME["mujoco"], found(version))
    assert finding.mark is Mark.PROBLEM
    assert version in finding.text
    assert (finding.cure or "").endswith("-m pip install 'mujoco>=3.16,<4'")


def test_the_reason_is_that_of_the_server() -> None:
    """The text about 4.0.0 is the one that the server itself would give."""
    assert "diverges when robots touch" in judge_package(BY_NAME["mujoco"], found("4.0.0")).text


@pytest.mark.parametrize(
    ("name", "version", "mark"),
    [
        ("mujoco", "3.16.0", Mark.OK),
        ("numpy", "1.25.9", Mark.PROBLEM),
        ("numpy", "1.26.0", Mark.OK),
        ("numpy", "2.4.6rc1", Mark.OK),
        ("embreex", "4.4.0.post1", Mark.OK),
        ("embreex", "2.17.7", Mark.PROBLEM),
        ("pillow", "10.1.0", Mark.OK),
        ("usd-core", "23.11", Mark.WARNING),
    ],
)
def test_bounds_of_versions(name: str, version: str, mark: Mark) -> None:
    """Numbers are compared as numbers, and the lower bound itself will do."""
    assert judge_package(BY_NAME[name], found(version)).mark is mark


def test_an_upper_bound_counts() -> None:
    """A release at the upper bound is too new."""
    package = Package("thing", "thing", "thing>=1.2,<4", "things")
    assert judge_package(package, found("4.0")).mark is Mark.PROBLEM
    assert judge_package(package, found("3.99")).mark is Mark.OK


def test_what_is_missing_costs_what_it_is_for() -> None:
    """A missing library is a problem, a missing optional one a note that says what is lost."""
    needed = judge_package(BY_NAME["embreex"], Outcome(failure="no", missing="embreex"))
    assert (needed.mark, needed.text) == (
        Mark.PROBLEM,
        "not installed: needed for the rays of range sensors",
    )
    optional = judge_package(BY_NAME["usd-core"], Outcome(failure="no", missing="pxr"))
    assert optional.mark is Mark.NOTE
    assert ".usdz" in optional.text
    assert (optional.cure or "").endswith("-m pip install 'usd-core>=24.8'")


@pytest.mark.parametrize("package", PACKAGES, ids=lambda one: one.name)
def test_what_is_not_installed_is_told_alike(package: Package) -> None:
    """As Python says it of each library: an extra is a note, whatever module of it is imported."""
    name = package.module.partition(".")[0]
    script = (
        "import importlib, json, sys\n"
        f"sys.modules.pop({name!r}, None)\n"
        "class Gone:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name.partition('.')[0] == {name!r}:\n"
        "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n"
        "sys.meta_path.insert(0, Gone())\n"
        "try:\n"
        f"    importlib.import_module({package.module!r})\n"
        "except ModuleNotFoundError as error:\n"
        "    print(error.name)\n"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", script], capture_output=True, text=True, check=True
    )
    missing = done.stdout.strip()
    finding = judge_package(package, Outcome(failure="no", missing=missing))
    assert finding.mark is (Mark.NOTE if package.optional else Mark.PROBLEM)
    assert "not installed" in finding.text
    assert package.requirement in (finding.cure or "")


def test_what_is_broken_is_installed_again() -> None:
    """A library that is there but dies, or lacks another one, says so."""
    dead = Outcome(failure="the process was ended by SIGILL")
    finding = judge_package(BY_NAME["embreex"], dead)
    assert finding.mark is Mark.PROBLEM
    assert finding.text == "cannot be imported: the process was ended by SIGILL"
    assert "--force-reinstall" in (finding.cure or "")
    lacking = Outcome(failure="ModuleNotFoundError: No module named 'x'", missing="x")
    assert "cannot be imported" in judge_package(BY_NAME["pillow"], lacking).text


def test_python_that_is_too_old_is_a_problem() -> None:
    """3.10 will not do, 3.11 and later will."""
    old = judge_python((3, 10, 12), "/usr/bin/python3")
    assert old.mark is Mark.PROBLEM
    assert (old.cure or "").startswith("python3.11 -m venv")
    assert judge_python((3, 11, 0), "python").mark is Mark.OK
    assert judge_python((3, 14, 0), "python").mark is Mark.OK
