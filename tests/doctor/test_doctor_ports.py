"""Ports: really opened, by whom they are taken, and one command for all that are."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator

import pytest

from usarsim_server.doctor.checks.machine import look_at_ports as look
from usarsim_server.doctor.registry import Context, Finding, Mark
from usarsim_server.settings import Settings

SIDE_PORTS = ("image_port", "groundtruth_port", "wireless_port", "truth_port", "comserver_port")


def quiet_port(first: int) -> socket.socket:
    """A listening socket on a port that no program gets which asks for any free one."""
    for number in range(first, first + 1000):
        try:
            return socket.create_server(("127.0.0.1", number))
        except OSError:
            continue
    raise AssertionError("no port is free")


@pytest.fixture
def taken() -> Iterator[int]:
    """A port that this process listens on."""
    with quiet_port(21000) as listening:
        yield listening.getsockname()[1]


def seen(given: tuple[tuple[str, str], ...] = (), **settings: object) -> dict[str, Finding]:
    """Findings by option, for settings whose other ports are any or off."""
    ports: dict[str, object] = {"port": 0, **dict.fromkeys(SIDE_PORTS)}
    context = Context(Settings(**{**ports, **settings}), given)  # type: ignore[arg-type]
    return {str(finding.values.get("option", "")): finding for finding in look(context)}


def test_free_ports_are_free_and_others_off() -> None:
    """A port that can be opened is ok, one that is switched off a note, and all of them appear."""
    found = seen()
    assert found["--port"].mark is Mark.OK
    assert {one.mark for option, one in found.items() if option != "--port"} == {Mark.NOTE}
    assert set(found) == {"--port", *(f"--{key.replace('_', '-')}" for key in SIDE_PORTS)}


def test_a_taken_control_port_is_a_problem_with_its_process(taken: int) -> None:
    """Who has it is named by its number, and another port that is free is advised."""
    finding = seen((("--world", "office"), ("--port", str(taken))), port=taken)["--port"]
    assert finding.mark is Mark.PROBLEM
    assert finding.values["taken_by"] == os.getpid()
    assert "this very program" in finding.text
    assert finding.cure is not None
    command, _, other = finding.cure.rpartition(" ")
    assert command == "usarsim serve --world office --port"
    with socket.create_server(("127.0.0.1", int(other))):
        pass


def test_a_taken_side_port_is_a_warning_unless_asked_for(taken: int) -> None:
    """The server goes on without a port that is a mere default, as `serve` does."""
    default = seen(image_port=taken)["--image-port"]
    assert default.mark is Mark.WARNING
    assert "goes on without" in default.text
    wanted = seen(image_port=taken, written=frozenset({"image_port"}))["--image-port"]
    assert wanted.mark is Mark.PROBLEM


def test_two_services_with_one_port_are_found_out(taken: int) -> None:
    """The second one is told of the first, and one command mends that and everything else."""
    with quiet_port(24000) as free:
        number = free.getsockname()[1]
    found = seen(groundtruth_port=number, truth_port=number, image_port=taken)
    clash, image = found["--truth-port"], found["--image-port"]
    assert found["--groundtruth-port"].mark is Mark.OK
    assert "--groundtruth-port has the same port" in clash.text
    assert clash.cure == image.cure
    assert clash.cure is not None
    words = clash.cure.split()
    assert words[2::2] == ["--image-port", "--truth-port"]
    assert len({str(number), str(taken), *words[3::2]}) == 4


def test_a_host_of_another_machine_is_one_problem() -> None:
    """An address that is not ours spoils all ports, and is told once (RFC 5737 example net)."""
    [finding] = look(Context(Settings(host="192.0.2.1", port=0)))
    assert finding.mark is Mark.PROBLEM
    assert "192.0.2.1 is not an address of this machine" in finding.text
    assert finding.advice == "give --host one that is, or 0.0.0.0 for all of them"
