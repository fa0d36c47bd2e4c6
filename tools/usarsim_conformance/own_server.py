"""Our own server in a process of its own, for `usarsim conformance --self`; judged with one robot
class after another if several are named."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from usarsim_client.blocking import Closing
from usarsim_conformance.registry import SERVICES, Check, Severity, Verdict
from usarsim_conformance.report import Report
from usarsim_conformance.reports import SIGNS
from usarsim_conformance.runner import judge_all
from usarsim_conformance.stage import FOLDER
from usarsim_conformance.survey import Target
from usarsim_server.children import python

_USARSIM = python("-m", "usarsim_server.cli")
_PORTS = ("", "image-", "groundtruth-", "wireless-", "comserver-", "truth-")
_MOST_ROBOTS = 32
_PATIENCE = 10.0
"""s to end after a signal."""
_WORDS = 20_000
"""Characters of the last words: the stacks of some dozen threads."""


class StartError(RuntimeError):
    """The server did not become ready; with what it said."""


class OwnServer(Closing):
    """`usarsim serve` on free ports; a context manager.

    Attributes:
        ports: of all services, by the names of `registry.SERVICES`.
    """

    def __init__(self, *options: str, folder: Path | None = None) -> None:
        """Start it and wait until it is ready.

        Args:
            options: further ones of `usarsim serve`.
            folder: where another copy of the server lies, to be taken instead of this one.

        Raises:
            StartError: if it does not become ready.
        """
        ports = [f"--{name}port=0" for name in _PORTS]
        command = [*_USARSIM, "serve", "--world", str(FOLDER / "world")]
        command += ["--robots", str(FOLDER / "robots")]
        # On a busy machine robots that have left may be counted a little longer.
        command += ["--max-robots", str(_MOST_ROBOTS)]
        environment = {**os.environ, "PYTHONFAULTHANDLER": "1"}
        if folder is not None:
            environment["PYTHONPATH"] = str(folder)
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115  (closed by `stop`)
        self._process = subprocess.Popen(
            [*command, *ports, *options],
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            cwd=folder,
            env=environment,
        )
        assert self._process.stdout is not None
        ready = self._process.stdout.readline()
        found = {name: int(port) for name, port in re.findall(r"(\w+)=\S+:(\d+)", ready)}
        self.ports = {name: found[name] for name in SERVICES if name in found}
        if "control" not in self.ports:
            self._process.kill()
            self._process.wait()
            raise StartError(f"the server did not start: {self.said}")

    @property
    def said(self) -> str:
        """The end of what it wrote to standard error."""
        self._errors.seek(0)
        return self._errors.read()[-2000:].strip() or "it said nothing"

    @property
    def died(self) -> bool:
        """Whether it has ended by itself."""
        return self._process.poll() is not None

    def last_words(self) -> str:
        """End a server that hangs: the end of what it wrote, then where each thread stands."""
        self._end(signal.SIGABRT)
        self._errors.seek(0)
        return self._errors.read()[-_WORDS:]

    def stop(self) -> None:
        """End it."""
        self._end(signal.SIGTERM)
        assert self._process.stdout is not None
        self._process.stdout.close()
        self._errors.close()

    def close(self) -> None:
        """See `stop`."""
        self.stop()

    def _end(self, how: signal.Signals) -> None:
        self._process.send_signal(how)
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def robot_classes() -> list[str]:
    """All classes that `usarsim robots` lists.

    Raises:
        StartError: if it does not.
    """
    listing = subprocess.run([*_USARSIM, "robots"], capture_output=True, text=True)
    if listing.returncode:
        raise StartError(f"`usarsim robots` failed: {listing.stderr.strip()}")
    return [line.split()[0] for line in listing.stdout.splitlines()[1:] if line.strip()]


def judge_classes(
    classes: Sequence[str],
    checks: Sequence[Check],
    target: Target,
    *,
    options: Sequence[str] = (),
    name: str = "",
    tell: Callable[[str, Report], None] = lambda robot, report: None,
) -> dict[str, Report]:
    """A report for every class, each of a server of its own; as many at a time as processors.

    Args:
        classes: of robots.
        checks: from `registry.all_checks`.
        target: what else is asked for; ports and robot are filled in.
        options: of `usarsim serve`.
        name: of the server in the reports.
        tell: what is told when a class has been judged.

    Raises:
        StartError: if a server does not start, or dies.
        Failed: if one cannot be reached.
    """

    async def judge(robot: str) -> Report:
        async with slots:
            server = await asyncio.to_thread(OwnServer, *options)
            try:
                asked = replace(target, ports=dict(server.ports), robot=robot)
                report = await judge_all(asked, checks, name=f"{name} {robot}".strip())
                if server.died:
                    raise StartError(f"the server died while {robot} was judged: {server.said}")
            finally:
                await asyncio.to_thread(server.stop)
        tell(robot, report)
        return report

    async def judge_every_one() -> list[Report]:
        return await asyncio.gather(*map(judge, classes))

    slots = asyncio.Semaphore(os.cpu_count() or 1)
    return dict(zip(classes, asyncio.run(judge_every_one()), strict=True))


def as_table(reports: dict[str, Report]) -> str:
    """A line for each class, and below it the rules that it breaks or that could not be judged."""
    width = max(map(len, reports))
    lines = [" " * width + "".join(SIGNS[verdict].rjust(7) for verdict in Verdict)]
    for robot, report in reports.items():
        counts = "".join(str(report.counts[verdict] or "").rjust(7) for verdict in Verdict)
        lines.append(f"{robot:{width}}{counts}  {'' if report.conforms else 'does NOT conform'}")
        for result in report.results:
            severity = report.rule(result.check).severity
            informative = severity is Severity.INFORMATIVE and result.verdict is Verdict.FAIL
            if result.verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE) and not informative:
                where = f"{result.check} [{result.dialect}]" if result.dialect else result.check
                reason = result.reason.partition("\n")[0]
                lines.append(f"    {SIGNS[result.verdict]:4}  {where}  {reason}"[:160])
    wrong = [robot for robot, report in reports.items() if not report.conforms]
    ending = f"; not with {', '.join(wrong)}" if wrong else ""
    lines.append(f"conforms with {len(reports) - len(wrong)} of {len(reports)} classes{ending}")
    return "\n".join(line.rstrip() for line in lines)
