"""Programs that are killed, disks that are full, clocks that jump: judged by the files alone.

Nothing that was reported as written is lost or half there.
"""

from __future__ import annotations

import ast
import json
import os
import random
import resource
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from lanes import slow_but
from signalled import finished
from test_e2e_import import level

from usarsim_maps.cache import KEPT, RECORD, ImportCache
from usarsim_maps.convert import Request, import_map
from usarsim_record.recording import read
from usarsim_server.radio.event_log import Event, EventLog
from usarsim_server.testing import PATIENCE, ServerProcess
from usarsim_server.worlds.loader import load_world

HERE = Path(__file__).parent
PACKAGES = (HERE.parents[1] / "usarsim_server", HERE.parents[1] / "tools")
HANG = PATIENCE


def usarsim(*arguments: str) -> list[str]:
    """A command line."""
    return [sys.executable, "-m", "usarsim_server", *arguments]


def points(how: str, given: Path, program: str, first: int = 1, step: int = 1) -> dict[int, int]:
    """Exit codes by point; see crash_points.py."""
    done = _gone_through(how, given, program, first, step)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    return _codes(done)


def _gone_through(
    how: str, given: Path, program: str, first: int = 1, step: int = 1
) -> subprocess.CompletedProcess[str]:
    command = [HERE / "crash_points.py", how, str(given), str(first), str(step), program]
    return subprocess.run(
        [sys.executable, *map(str, command)],
        capture_output=True,
        text=True,
        timeout=2 * HANG,
        check=False,
    )


def _codes(done: subprocess.CompletedProcess[str]) -> dict[int, int]:
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("POINT ")]
    return {int(point): int(code) for _, point, code in rows}


@pytest.mark.slow
class TestImport:
    """An import that ends at any of its steps in the file system."""

    @pytest.fixture(params=["nothing there", "an old world there"])
    def given(self, request: pytest.FixtureRequest, tmp_path: Path) -> Path:
        """A folder with a map, and perhaps the world that an earlier import reported."""
        folder = tmp_path / "given"
        folder.mkdir()
        (folder / "Room.t3d").write_text(level())
        if request.param != "nothing there":
            source = folder / "Room.t3d"
            import_map(Request(source, out=folder / "out", cache=folder / "cache/usarsim/imports"))
        return folder

    @pytest.mark.parametrize("how", ["kill", "full"])
    def test_worlds_are_whole_or_not_there(self, how: str, given: Path) -> None:
        """Both the world that is asked for and the entry of the cache; the old one stays."""
        step = 8
        codes = points(how, given, "import", random.Random(how).randint(1, step), step)
        assert len(codes) > 3
        reported = (given / "out" / "Room").exists()
        for point, code in codes.items():
            place = given.with_name(f"{how}-{point}")
            world = place / "out" / "Room"
            if world.exists() or reported or code == 0:
                load_world(world)
                json.loads((world / RECORD).read_text())
            for entry in (place / "cache/usarsim/imports").glob("[!.]*/Room"):
                load_world(entry)
                json.loads((entry / RECORD).read_text())
            assert code in ((-9, 3) if how == "kill" else (0, 2, 3)), (point, code)

    def test_the_next_import_tidies_up(self, given: Path) -> None:
        """What a killed import left in the cache is removed by the next one."""
        codes = points("kill", given, "import", 4, 7)
        place = given.with_name(f"kill-{min(codes)}")
        cache = place / "cache/usarsim/imports"
        source = place / "Room.t3d"
        import_map(Request(source, out=place / "out", cache=cache, fresh=True))
        load_world(place / "out" / "Room")
        assert not list(cache.glob(".new-*"))

    def test_importers_at_once(self, tmp_path: Path) -> None:
        """Several imports of one map into the same folders: each reports a whole world."""
        (tmp_path / "Room.t3d").write_text(level())
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
        running = [
            subprocess.Popen(
                usarsim("import", "Room.t3d", "--out", "out", "--fresh"),
                cwd=tmp_path,
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )
            for _ in range(4)
        ]
        for one in running:
            _, errors = one.communicate(timeout=HANG)
            assert (one.returncode, errors) == (0, b"")
        load_world(tmp_path / "out" / "Room")
        # While one copies its entry out of the cache, another one makes a second.
        entries = list((tmp_path / "cache/usarsim/imports").glob("[!.]*/Room"))
        assert entries
        for entry in entries:
            load_world(entry)
        assert not list(tmp_path.rglob(".new-*"))


def test_commands_write_in_one_way() -> None:
    """All that commands write goes through `files`, but for the stream of a recording."""
    found = {
        f"{path.name}: {ast.unparse(node)}"
        for path in (*(PACKAGES[0] / "cli").glob("*.py"), *PACKAGES[1].glob("*/*command.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in {"write_text", "write_bytes", "open"}
        and (node.func.attr != "open" or "w" in ast.unparse(node) or "x" in ast.unparse(node))
    }
    assert {one.partition(":")[0] for one in found} <= {"record_command.py"}, found


@pytest.mark.parametrize("how", ["kill", "full"])
def test_reports_are_old_or_new(how: str, tmp_path: Path) -> None:
    """A report that is replaced is at every moment one of the two, and whole."""
    given = tmp_path / "given"
    given.mkdir()
    (given / "report.json").write_text("old")
    if how == "kill":
        codes = points(how, given, "report")
    else:  # the program ends with an error, which is wanted
        codes = _codes(_gone_through(how, given, "report"))
    assert len(codes) >= 2
    for point, code in codes.items():
        text = (given.with_name(f"{how}-{point}") / "report.json").read_text()
        assert text in ("old", "new " * 1000)
        assert code != 0 or text != "old"


class TestRecord:
    """A recorder that dies between a client and a server."""

    @pytest.fixture
    def echo(self) -> Iterator[int]:
        """The port of a server that says everything again."""
        with socket.create_server(("127.0.0.1", 0)) as listening:

            def serve() -> None:
                try:
                    while True:
                        client = listening.accept()[0]
                        while data := client.recv(65536):
                            client.sendall(data)
                except OSError:
                    pass

            threading.Thread(target=serve, daemon=True).start()
            yield listening.getsockname()[1]
            listening.shutdown(socket.SHUT_RDWR)

    def start(self, file: Path, port: int) -> tuple[subprocess.Popen[str], socket.socket]:
        """A recorder, and a client that talks through it."""
        process = subprocess.Popen(
            usarsim("record", "--listen=0", f"--to=127.0.0.1:{port}", "--overwrite", str(file)),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        words = process.stdout.readline().split()
        proxy = int(words[1].partition("->")[0].rpartition(":")[2])
        client = socket.create_connection(("127.0.0.1", proxy), timeout=HANG)
        return process, client

    @pytest.mark.parametrize("seed", slow_but((0).__eq__, range(4)))
    def test_killed_it_keeps_all_that_it_passed_on(
        self, seed: int, echo: int, tmp_path: Path
    ) -> None:
        """Whatever the client was answered stands in the file, in order."""
        file = tmp_path / "session.rec"
        process, client = self.start(file, echo)
        after = random.Random(seed).randrange(1, 300)
        answered = b""
        with client:
            for number in range(after):
                client.sendall(b"line %d\r\n" % number)
                if number % 3 == 0:
                    answered += client.recv(65536)
            process.kill()
            process.communicate()
        recorded = b"".join(one.data for one in read(file).events if one.side == "server")
        assert recorded.startswith(answered)
        sent = b"".join(b"line %d\r\n" % number for number in range(after))
        assert sent.startswith(recorded)

    @pytest.mark.parametrize("room", [400, 1000, 5003])
    def test_on_a_full_disk_its_last_line_is_whole(
        self, room: int, echo: int, tmp_path: Path
    ) -> None:
        """It says so and ends with code 2; everything in the file can be read."""
        file = tmp_path / "session.rec"
        process, client = self.start(file, echo)
        limit = resource.RLIMIT_FSIZE
        resource.prlimit(process.pid, limit, (room, resource.getrlimit(limit)[1]))
        with client:
            for number in range(2000):
                try:
                    client.sendall(b"line %d\r\n" % number)
                    if not client.recv(65536):
                        break
                except OSError:
                    break
        output, errors = process.communicate(timeout=HANG)
        assert process.returncode == 2
        assert errors.startswith(f"error: {file}: cannot be written any further")
        assert len(errors.splitlines()) == 1
        assert output == ""
        data = file.read_bytes()
        assert len(data) <= room
        assert data.endswith(b"\n")
        assert len(read(file).events) == data.count(b"\n") - 1

    def test_an_old_recording_stays_until_a_new_one_begins(self, tmp_path: Path) -> None:
        """`--overwrite` on a port that is taken costs nothing."""
        file = tmp_path / "session.rec"
        file.write_text("old")
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            done = finished("record", f"--listen={port}", "--to=h:9", "--overwrite", str(file))
        assert done.returncode == 2
        assert [one.name for one in tmp_path.iterdir()] == ["session.rec"]
        assert file.read_text() == "old"


class TestEvents:
    """The record of the wireless simulation."""

    def test_on_a_full_disk_its_last_line_is_whole(self, tmp_path: Path) -> None:
        """In a process of its own that may write 1000 bytes."""
        file = tmp_path / "events.csv"
        program = (
            "import resource, sys; from pathlib import Path\n"
            "from usarsim_server.radio.event_log import Event, EventLog\n"
            "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))\n"
            "log = EventLog(Path(sys.argv[1]), lambda: 0.0)\n"
            "for number in range(100):\n"
            "    log.write(Event.REGISTERED, number)\n"
            "    if number % 7 == 0: log.flush()\n"
            "log.close()\n"
        )
        subprocess.run([sys.executable, "-c", program, file], check=True, timeout=HANG)
        data = file.read_bytes()
        assert 900 < len(data) <= 1000
        assert data.endswith(b"\n")
        assert [line.split(b",")[2] for line in data.splitlines()] == [
            b"%d" % number for number in range(data.count(b"\n"))
        ]

    def test_a_clock_that_jumps_loses_nothing(self, tmp_path: Path) -> None:
        """Events stand in the order in which they happened, whatever the time of day."""
        start, jumps = datetime(2026, 1, 31), iter([0, -9000, 5, 10**6, -(10**7), 3, 4, 5])
        log = EventLog(
            tmp_path / "events.csv", lambda: 1.0, lambda: start + timedelta(seconds=next(jumps))
        )
        for number in range(7):
            log.write(Event.REGISTERED, number)
        log.close()
        lines = (tmp_path / "events.csv").read_text().splitlines()
        assert [line.split(",")[2] for line in lines] == list("0123456")


STAMPS = {
    "usarsim_server/radio/event_log.py",
    "usarsim_bench/command.py",
    "usarsim_conformance/runner.py",
    "usarsim_doctor/command.py",
    "usarsim_record/recording.py",
    "usarsim_study/session/opening.py",  # the day of a participant's session
}
"""Files that write down when something happened."""


class TestClock:
    """The time of day is for people to read; nothing goes by it."""

    @pytest.mark.slow
    def test_nothing_asks_for_the_time_of_day(self) -> None:
        """But for the stamps of reports; all else uses clocks that never jump."""
        found = {
            path.relative_to(package if package.name == "tools" else package.parent).as_posix()
            for package in PACKAGES
            for path in package.rglob("*.py")
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and (node.value.id, node.attr)
            in {("time", "time"), ("time", "time_ns"), ("datetime", "now"), ("date", "today")}
        }
        assert found <= STAMPS

    def test_the_newest_world_stays_in_the_cache(self, tmp_path: Path) -> None:
        """A clock that was set back makes it look older than all others."""
        cache = tmp_path / "cache"
        cache.mkdir()
        for number in range(KEPT + 3):
            (cache / f"{number:032x}" / "Old").mkdir(parents=True)
            os.utime(cache / f"{number:032x}", (4e9, 4e9))
        (tmp_path / "Room.t3d").write_text(level())
        result = import_map(Request(tmp_path / "Room.t3d", cache=cache))
        load_world(result.folder)
        assert import_map(Request(tmp_path / "Room.t3d", cache=cache)).cached
        assert ImportCache(cache).find(result.folder.parent.name, "Room") is not None


def test_a_killed_server_leaves_whole_lines(tmp_path: Path) -> None:
    """The wireless record of a server that is killed holds only whole lines."""
    file = tmp_path / "events.csv"
    with ServerProcess("--world=empty", "--wireless-port=0", f"--wireless-log={file}") as server:
        address = "127.0.0.1", server.ports["wireless"]
        for number in range(30):
            with socket.create_connection(address, timeout=HANG) as client:
                client.sendall(b"INIT {Robot Rover%d} {Port 0};" % number)
    data = file.read_bytes()
    assert not data or data.endswith(b"\n")
