"""The composition root: what happens to a server as a whole."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import mujoco
import pytest

from usarsim_server import app
from usarsim_server.base.errors import UsarsimError, WorldError
from usarsim_server.base.files import data_directory
from usarsim_server.sessions.session import Session
from usarsim_server.settings import Settings
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.servos import WheelServos
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.testing import ScriptedClient, eventually, running_server


def test_a_server_without_physics_does_not_live_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """If the physics thread has to give up, the server ends with an error that says why."""

    def fail(self: Engine, steps: int) -> list[int]:
        raise UsarsimError("the world diverges")

    monkeypatch.setattr(Engine, "advance", fail)
    with pytest.raises(UsarsimError, match="the world diverges"):
        app.run(Settings(world="empty", port=0, host="127.0.0.1"))
    assert capsys.readouterr().out.count("READY") <= 1


@pytest.mark.parametrize(("sized", "compilations"), [(True, 1), (False, 2)])
def test_a_scene_is_compiled_once_if_it_says_its_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sized: bool, compilations: int
) -> None:
    """Else it is compiled to learn its size first; the model has the same size, and a scene that
    cannot be compiled is an error of one line that names it, either way."""
    folder = tmp_path / "hall"
    shutil.copytree(data_directory("worlds") / "empty", folder)
    given = '<statistic extent="12.5" center="1 2 3"/>' if sized else ""
    head, ground = '<mujoco model="hall">' + given, '<geom type="plane" size="5 5 1"/>'
    (folder / "scene.xml").write_text(f"{head}<worldbody>{ground}</worldbody></mujoco>")
    plain, compiled = mujoco.MjSpec.compile, []

    def compile(spec: mujoco.MjSpec) -> mujoco.MjModel:
        compiled.append(plain(spec))
        return compiled[-1]

    monkeypatch.setattr(mujoco.MjSpec, "compile", compile)
    app.assemble(Settings(world=str(folder), port=0)).stop()
    assert len(compiled) == compilations
    assert compiled[-1].stat.extent == (12.5 if sized else compiled[0].stat.extent)
    flat = '<asset>\n<mesh name="flat" vertex="0 0 0 1 0 0 0 1 0 1 1 0"/></asset>'
    body = f'{ground}<geom type="mesh" mesh="flat"/>'
    (folder / "scene.xml").write_text(f"{head}{flat}<worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(WorldError, match=r"scene.xml: line 2: mesh 'flat'") as caught:
        app.assemble(Settings(world=str(folder), port=0))
    assert "\n" not in str(caught.value)


def test_a_drive_passes_eight_functions(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the socket to the wheels, beside the protocol and the queues between the threads."""
    carriers = ("protocol", "dispatcher.py", "mailbox.py", "clock.py")
    package, passed = Path(app.__file__).parent, []

    def note(owner: type, name: str) -> None:
        original = getattr(owner, name)

        def noted(*arguments: object) -> object:
            frame = sys._getframe(1)
            way = [f"{owner.__name__}.{name}"]
            while frame is not None:
                code, file = frame.f_code, Path(frame.f_code.co_filename)
                if file.is_relative_to(package) and not {*file.parts}.intersection(carriers):
                    way.insert(0, code.co_qualname.partition(".<locals>")[0])
                frame = frame.f_back
            passed.extend(one for one in way if one not in passed)
            return original(*arguments)

        monkeypatch.setattr(owner, name, noted)

    with running_server(world="empty") as (_, endpoints):
        client = ScriptedClient(endpoints["control"].port)
        client.send("INIT {ClassName P3AT} {Location 0,0,-0.3}")
        client.wait_for("STA")
        note(Session, "submit")
        note(BodyHandle, "drive")
        note(WheelServos, "command")
        client.send("DRIVE {Left 1} {Right 1}")
        assert eventually(lambda: "WheelServos.command" in passed)
        client.close()
    assert passed == [
        "_Connection._read",
        "Session.submit",
        "Session.execute",
        "RobotRole.obey",
        "WheelController.steer",
        "BodyHandle.drive",
        "Engine.drive",
        "WheelServos.command",
    ]
