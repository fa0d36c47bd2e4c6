"""Starting and ending services: the READY line, signals, and services that cannot start."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import signal
import socket
import threading

import pytest

from usarsim_server.base.errors import ServiceError
from usarsim_server.services.control import ControlService
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.port import print_ready, run_services
from usarsim_server.testing import PATIENCE, eventually


class FakeService:
    """Starts, fails or stops as told, and remembers it."""

    def __init__(self, name, *, required=False, host="127.0.0.1", fails=None, stop_fails=None):
        self.name = name
        self.required = required
        self.host = host
        self.fails = fails
        self.stop_fails = stop_fails
        self.events = []

    async def start(self):
        """Listen, or fail as told."""
        self.events.append("start")
        if self.fails is not None:
            raise self.fails
        return Endpoint(self.name, self.host, 1000 + len(self.name))

    async def stop(self):
        """Stop, or fail as told."""
        self.events.append("stop")
        if self.stop_fails is not None:
            raise self.stop_fails


def run_until_ready(*services):
    """Run services and stop as soon as they are ready; returns what was announced."""
    announced = []
    stop = asyncio.Event()

    def on_ready(endpoints):
        announced.append(list(endpoints))
        stop.set()

    asyncio.run(run_services(services, on_ready, stop))
    return announced


def test_ready_line_names_every_endpoint_in_order(capsys) -> None:
    """READY, then `name=HOST:PORT` of each service, separated by single blanks."""
    print_ready([Endpoint("control", "127.0.0.1", 3000), Endpoint("images", "::1", 5003)])
    assert capsys.readouterr().out == "READY control=127.0.0.1:3000 images=[::1]:5003\n"


async def test_exactly_one_line_on_standard_output_when_all_listen(capsys) -> None:
    """The READY line appears when the ports accept, is flushed, and is all of standard output."""
    lines = []

    stop = asyncio.Event()
    service = ControlService("127.0.0.1", 0, lambda: b"NFO\r\n", lambda *_: None)
    running = asyncio.create_task(run_services([service], stop=stop))
    while not lines:
        await asyncio.sleep(0.005)
        lines.extend(capsys.readouterr().out.splitlines(keepends=True))
    [line] = lines
    found = re.fullmatch(r"READY control=(127\.0\.0\.1):(\d+)\n", line)
    socket.create_connection((found[1], int(found[2]))).close()
    stop.set()
    await running
    assert capsys.readouterr().out == ""


async def test_ready_line_is_flushed_at_once(monkeypatch) -> None:
    """A script that waits for the line through a pipe sees it without delay."""
    events = []

    class Pipe:
        def write(self, text):
            events.append(text)

        def flush(self):
            events.append("flush")

    monkeypatch.setattr("sys.stdout", Pipe())
    stop = asyncio.Event()

    running = asyncio.create_task(run_services([FakeService("control")], stop=stop))
    assert await asyncio.to_thread(eventually, lambda: "flush" in events)
    stop.set()
    await running
    assert "".join(events) == "READY control=127.0.0.1:1007\nflush"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_the_services_quietly(number) -> None:
    """SIGINT and SIGTERM stop everything and return: no exception."""
    service = FakeService("control", required=True)

    def on_ready(endpoints) -> None:
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)  # an impatient second one changes nothing

    asyncio.run(run_services([service], on_ready))
    assert service.events == ["start", "stop"]


def test_signal_during_start_ends_before_ready() -> None:
    """A signal that comes while services start leaves no READY line and no service behind."""
    announced = []
    first = FakeService("control", required=True)
    second = FakeService("images")

    async def start():
        os.kill(os.getpid(), signal.SIGTERM)
        await asyncio.sleep(0.05)
        return Endpoint("control", "127.0.0.1", 1)

    first.start = start
    asyncio.run(run_services([first, second], announced.append))
    assert announced == []
    assert first.events == ["stop"]
    assert second.events == []


def test_signal_handlers_are_given_back() -> None:
    """After the services ended signals do what they did before."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]

    def mine(number, frame) -> None:
        pass

    try:
        for number in numbers:
            signal.signal(number, mine)
        run_until_ready(FakeService("control"))
        assert [signal.getsignal(number) for number in numbers] == [mine, mine]
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def test_services_run_in_a_thread_of_an_embedding_program() -> None:
    """Outside the main thread, where signals cannot be handled, the event ends them."""
    announced = []
    thread = threading.Thread(
        target=lambda: announced.extend(run_until_ready(FakeService("control")))
    )
    thread.start()
    thread.join(PATIENCE)
    assert len(announced) == 1


def test_required_service_that_cannot_start_ends_everything() -> None:
    """A busy control port is the error of the whole program; what had started is stopped."""
    images = FakeService("images")
    control = FakeService("control", required=True, fails=ServiceError("port 3000 is in use"))
    truth = FakeService("truth")
    with pytest.raises(ServiceError, match="port 3000 is in use"):
        run_until_ready(images, control, truth)
    assert images.events == ["start", "stop"]
    assert control.events == ["start"]
    assert truth.events == []


def test_busy_control_port_is_such_an_error() -> None:
    """The real control service is required and names its port and option."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        service = ControlService("127.0.0.1", port, lambda: b"NFO\r\n", lambda *_: None)
        with pytest.raises(ServiceError, match=rf"port {port} is already in use.*--port N"):
            run_until_ready(service)


def test_optional_service_that_cannot_start_is_a_warning(caplog) -> None:
    """Side channels reference 10 no. 10: a busy side port is a warning and READY leaves it out."""
    images = FakeService("images", fails=ServiceError("port 5003 is in use"))
    control = FakeService("control", required=True)
    announced = run_until_ready(control, images)
    assert [[endpoint.name for endpoint in endpoints] for endpoints in announced] == [["control"]]
    [warning] = [r.message for r in caplog.records if "5003" in r.message]
    assert warning == "goes on without images: port 5003 is in use"
    assert images.events == ["start"]


def test_server_without_any_service_is_an_error() -> None:
    """If nothing listens there is nothing to wait for."""
    with pytest.raises(ServiceError, match="no service listens"):
        run_until_ready()
    with pytest.raises(ServiceError, match="no service listens"):
        run_until_ready(FakeService("images", fails=ServiceError("busy")))


def test_service_that_fails_to_stop_does_not_keep_others_from_it(caplog) -> None:
    """All services are stopped; the defect of one is logged."""
    bad = FakeService("images", stop_fails=RuntimeError("stuck"))
    good = FakeService("control")
    run_until_ready(bad, good)
    assert good.events == bad.events == ["start", "stop"]
    assert "a service did not stop cleanly" in caplog.messages


@pytest.mark.parametrize(
    ("hosts", "warned"),
    [
        (["127.0.0.1", "127.0.0.1"], True),
        (["0.0.0.0", "0.0.0.0"], False),
        (["127.0.0.1", "192.0.2.7"], False),
    ],
)
def test_server_that_only_this_machine_reaches_says_how_to_open_it(caplog, hosts, warned) -> None:
    """With a loopback address one line names --host; an open server gives none."""
    caplog.set_level(logging.INFO)
    run_until_ready(*(FakeService(f"s{n}", host=host) for n, host in enumerate(hosts)))
    advice = [r for r in caplog.records if "--host 0.0.0.0" in r.message]
    assert len(advice) == int(warned)
