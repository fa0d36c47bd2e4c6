"""Other simulators are compared with ours, or it is said why not."""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from usarsim_bench.figures import Plan, Report, Section, describe_machine
from usarsim_bench.peers import comparing
from usarsim_bench.peers.comparing import Measured, compare, own_section, peer_section
from usarsim_bench.peers.own import HUMANOID, OwnSide
from usarsim_bench.peers.simulators import PEERS, Environments, NotInstalledError, Peer
from usarsim_bench.peers.work import ROVER, Outcome, Work, plan_work
from usarsim_bench.report import as_json, as_markdown, as_text
from usarsim_bench.server import BenchError
from usarsim_bench.suite import MEASUREMENTS
from usarsim_server.cli import main

ROVERS = Peer(
    name="wheels",
    title="Wheels",
    home="https://wheels.example",
    packages=("wheels>=1,<2",),
    python=(11, 14),
    workload="pybullet_rovers.py",
    against="rovers",
    same="Wheels are compared.",
    different="Legs are not.",
)
PLAYERS = replace(
    ROVERS, name="legs", title="Legs", against="humanoids", most=3, most_because="3 fit on it"
)
COUNTS = {"scans": 100.0, "beams": 18100.0, "reach": 36200.0, "metres": 5.0, "messages": 400.0}
THEIRS = Outcome("1.5", simulated=10.0, wall=4.0, cpu=2.0, counts=COUNTS)
OURS = Outcome("0.1", simulated=10.0, wall=1.0, cpu=0.5, counts=COUNTS)


def values(section: Section) -> dict[str, float]:
    """The figures of a section by name."""
    return {figure.name: figure.value for figure in section.figures}


class FakeOwnSide(OwnSide):
    """Answers instead of measuring; remembers what it was asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[int, str]] = []

    def in_process(self, work: Work) -> Outcome:
        """A made-up outcome."""
        self.asked.append((work.robots, "in process"))
        return OURS

    def bare(self, work: Work) -> Outcome:
        """A made-up outcome."""
        return replace(OURS, cpu=0.25)

    def over_sockets(self, work: Work, robot_class: str = ROVER) -> Outcome:
        """A made-up outcome."""
        self.asked.append((work.robots, robot_class))
        return OURS


class FakeEnvironments(Environments):
    """Has every peer but those called `absent`."""

    def python(self, peer: Peer) -> str:
        """A name, or the reason why there is none."""
        if peer.name == "absent":
            raise NotInstalledError("installing absent>=1 failed: ERROR: No matching distribution")
        return f"/{peer.name}/python"


def theirs(command: Sequence[str], work: str, timeout: float) -> Outcome:
    """The outcome of every run."""
    return THEIRS


def compared(
    *peers: Peer,
    robots: int | None = 4,
    own: Callable[[], OwnSide] = FakeOwnSide,
    run: Callable[[Sequence[str], str, float], Outcome] = theirs,
    only: Sequence[str] = (),
) -> Report:
    """A comparison in which nothing is installed or run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparing, "PEERS", {peer.name: peer for peer in peers})
        patch.setattr(comparing, "Environments", FakeEnvironments)
        patch.setattr(comparing, "OwnSide", own)
        patch.setattr(comparing, "run_workload", run)
        return compare(Plan(robots=robots, seconds=10.0), "0.1", only)


class TestRegistry:
    @pytest.mark.parametrize("peer", PEERS.values(), ids=lambda peer: peer.name)
    def test_each_says_everything(self, peer: Peer) -> None:
        """Its program is there, versions have both bounds, and words say what is compared."""
        assert peer.script.is_file()
        assert all(">=" in package for package in peer.packages)
        assert "," in peer.packages[0]
        assert peer.python[0] <= peer.python[1]
        assert peer.same.endswith(".")
        assert "ot compared" in peer.different or "not physics" in peer.different
        assert peer.home.startswith("https://")
        assert bool(peer.most) == bool(peer.most_because)

    @pytest.mark.parametrize("peer", PEERS.values(), ids=lambda peer: peer.name)
    def test_programs_know_nothing_of_ours(self, peer: Peer) -> None:
        """A workload runs where nothing of ours is installed, so it may not import it."""
        tree = list(ast.walk(ast.parse(peer.script.read_text(encoding="utf-8"))))
        imports = [node for node in tree if isinstance(node, ast.Import)]
        names = [alias.name for node in imports for alias in node.names]
        names += [str(node.module) for node in tree if isinstance(node, ast.ImportFrom)]
        assert names
        assert not [name for name in names if name.startswith("usarsim")]


class TestArithmetic:
    def test_peer_beside_ours(self) -> None:
        """Speed is simulated over wall time; ratios are ours over theirs."""
        told = values(peer_section(ROVERS, {1: THEIRS}, {1: OURS}))
        assert told["1 robot: simulated s per s"] == pytest.approx(2.5)
        assert told["1 robot: processor s per simulated s"] == pytest.approx(0.2)
        assert told["1 robot: speed, ours / Wheels"] == pytest.approx(4.0)
        assert told["1 robot: processor time, ours / Wheels"] == pytest.approx(0.25)

    def test_that_the_work_was_done_is_shown(self) -> None:
        """Scans due are ten a simulated second and robot; ranges and ways are means."""
        told = values(peer_section(ROVERS, {2: THEIRS}, {2: OURS}))
        assert told["2 robots: scans / scans due"] == pytest.approx(0.5)
        assert told["2 robots: mean range seen"] == pytest.approx(2.0)
        assert told["2 robots: way of a robot"] == pytest.approx(0.25)

    def test_servers_are_compared_by_messages(self) -> None:
        """Message rates are those of wall time and of simulated time."""
        told = values(peer_section(PLAYERS, {2: THEIRS}, {2: OURS}))
        assert told["2 robots: messages to clients"] == pytest.approx(100.0)
        assert told["2 robots: messages per simulated s"] == pytest.approx(40.0)
        assert not [name for name in told if "scans" in name]

    def test_a_processor_time_of_nothing(self) -> None:
        """What is too short for the clock gives no ratio instead of an error."""
        told = values(peer_section(ROVERS, {1: replace(THEIRS, cpu=0.0)}, {1: OURS}))
        assert math.isnan(told["1 robot: processor time, ours / Wheels"])

    def test_bare_engine_beside_ours(self) -> None:
        """The engine's share of our processor time is a reference for both."""
        bare = {1: replace(OURS, cpu=0.25)}
        section = own_section(Measured({1: OURS}, bare, {1: OURS}), {1: plan_work(1, 10.0, 1.0)})
        told = values(section)
        name = "1 robot, in process: bare mj_step of the scene, processor time / all of ours"
        assert told[name] == pytest.approx(0.5)


class TestReport:
    def test_words_versions_and_home(self) -> None:
        """A section says who, which version, what is the same, what is not, and where it lives."""
        section = compared(ROVERS).sections[1]
        assert section.title == "Wheels 1.5"
        for words in ("Wheels are compared.", "Legs are not.", "https://wheels.example"):
            assert words in section.setting

    def test_what_cannot_be_installed_is_no_failure(self) -> None:
        """It becomes a line with the reason, and the others are compared."""
        report = compared(replace(ROVERS, name="absent", title="Absent"), ROVERS)
        assert report.failed == []
        line = "Not compared: installing absent>=1 failed: ERROR: No matching distribution."
        assert f"Absent\n{line}\n\nWheels 1.5\n" in as_text(report)
        assert f"## Absent\n\n{line}\n\n## Wheels 1.5\n" in as_markdown(report)
        sections = json.loads(as_json(report))["sections"]
        assert [one["key"] for one in sections] == ["own", "absent", "wheels"]
        assert (sections[1]["failure"], sections[1]["figures"]) == (None, [])

    def test_what_fails_to_run_is_told(self) -> None:
        """A program of another simulator that ends in error is a reason, too."""

        def fail(command: Sequence[str], work: str, timeout: float) -> Outcome:
            raise BenchError("it ended with code 1: ImportError: wheels")

        section = compared(ROVERS, run=fail).sections[1]
        assert "Not compared: 4 robots: it ended with code 1: ImportError" in section.setting
        assert section.failure is None

    def test_too_many_for_it(self) -> None:
        """Sizes that a peer cannot take are left out, with the reason; the others are there."""
        asked: list[int] = []

        def run(command: Sequence[str], work: str, timeout: float) -> Outcome:
            asked.append(json.loads(work)["robots"])
            return THEIRS

        section = compared(PLAYERS, robots=None, run=run).sections[1]
        assert set(asked) == {1}
        assert "Not compared: 16 robots: 3 fit on it." in section.setting
        assert "1 robot: simulated s per s" in values(section)

    def test_humanoids_only_for_those_that_have_them(self) -> None:
        """Ours are measured with as many as some peer can take."""
        made: list[FakeOwnSide] = []

        def own() -> FakeOwnSide:
            made.append(FakeOwnSide())
            return made[-1]

        compared(ROVERS, PLAYERS, robots=None, own=own)
        assert {size for size, what in made[0].asked if what == HUMANOID} == {1}
        compared(ROVERS, robots=1, own=own)
        assert HUMANOID not in [what for _, what in made[1].asked]

    def test_programs_run_isolated(self) -> None:
        """The environment's Python runs the peer's own script, cut off from our paths."""
        commands: list[tuple[str, ...]] = []

        def run(command: Sequence[str], work: str, timeout: float) -> Outcome:
            commands.append(tuple(command))
            return THEIRS

        compared(ROVERS, run=run)
        assert set(commands) == {("/wheels/python", "-I", str(ROVERS.script))}

    def test_of_several_runs_the_fastest_counts(self) -> None:
        """Other programs of the machine can only slow a run down, on either side."""
        walls = iter([4.0, 2.5, 5.0])

        def run(command: Sequence[str], work: str, timeout: float) -> Outcome:
            return replace(THEIRS, wall=next(walls))

        told = values(compared(ROVERS, run=run).sections[1])
        assert told["4 robots: simulated s per s"] == pytest.approx(4.0)

    def test_our_own_failure_is_one(self) -> None:
        """Without our own figures there is nothing to compare with."""

        class Broken(FakeOwnSide):
            def bare(self, work: Work) -> Outcome:
                raise BenchError("the server died")

        report = compared(ROVERS, own=Broken)
        assert report.failed == ["own"]
        assert "FAILED: the server died" in as_text(report)

    def test_unknown_names_are_refused(self) -> None:
        """The error lists those that are known."""
        with pytest.raises(BenchError, match=r"'gazebo' \(known: wheels\)"):
            compared(ROVERS, only=("gazebo",))

    def test_more_than_the_hall_holds(self) -> None:
        """There is one free cell for each robot and no more."""
        with pytest.raises(BenchError, match="65 robots: the hall has room for 64"):
            compared(ROVERS, robots=65)


class TestCommand:
    @pytest.fixture
    def asked(self, monkeypatch: pytest.MonkeyPatch) -> list[tuple[Plan, tuple[str, ...], object]]:
        """Nothing is compared; what would be is remembered."""
        calls: list[tuple[Plan, tuple[str, ...], object]] = []

        def fake(plan: Plan, version: str, only: tuple[str, ...], keep: object) -> Report:
            calls.append((plan, only, keep))
            return Report(describe_machine(version), datetime.now(UTC), (_section(),))

        monkeypatch.setattr(comparing, "compare", fake)
        return calls

    def test_options_arrive(
        self, asked: list[tuple[Plan, tuple[str, ...], object]], tmp_path: Path
    ) -> None:
        """Numbers, names and the folder reach the comparison; files are written."""
        page = tmp_path / "r.md"
        words = ["--robots", "4", "--seconds", "2", "--only", "ir-sim", "--only", "pybullet"]
        words += ["--keep", str(tmp_path), "--markdown", str(page)]
        assert main(["bench", "peers", *words]) == 0
        plan, only, keep = asked[0]
        assert (plan.robots, plan.seconds, only) == (4, 2.0, ("ir-sim", "pybullet"))
        assert keep == tmp_path
        assert "Not compared: no wheel" in page.read_text()

    def test_all_by_default(self, asked: list[tuple[Plan, tuple[str, ...], object]]) -> None:
        """Without options all peers and sizes are taken, nothing is kept."""
        assert main(["bench", "peers"]) == 0
        plan, only, keep = asked[0]
        assert (plan.robots, plan.seconds, only, keep) == (None, None, (), None)

    @pytest.mark.parametrize(
        ("words", "told"),
        [
            (["peers", "--only", "gazebo"], "no simulator is called 'gazebo'"),
            (["--world", "empty", "peers"], "--world: all simulators get the same hall"),
        ],
    )
    def test_one_clear_error(
        self, words: list[str], told: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """What cannot be asked for ends with code 2 and one line."""
        assert main(["bench", *words]) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ")
        assert told in error
        assert error.count("\n") == 1

    def test_it_is_no_part_of_all(self) -> None:
        """What needs the network is measured only if asked for."""
        assert "peers" not in MEASUREMENTS


def _section() -> Section:
    return comparing.refusal(ROVERS, "no wheel")
