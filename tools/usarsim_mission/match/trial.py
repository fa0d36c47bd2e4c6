"""One trial: a mission, a team, a server of its own, and the referee that watches.

Everything is fed by the truth channel: each of its rows is the time of what happens until the next
one. So the log is in order, and the referee reads it live as it will be read again later.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import tomllib
from dataclasses import replace
from typing import Any

from usarsim_client import ProtocolError
from usarsim_client.scene import LiveScene, TruthRow, connect_scene
from usarsim_mission.errors import MissionError
from usarsim_mission.grid import Grid
from usarsim_mission.hand_in import refuse_old_hand_in, take_handed_in
from usarsim_mission.live import LiveRun
from usarsim_mission.match.conditions import Conditions as Conditions  # for who imports Trial
from usarsim_mission.match.injects import Injects, inject_of
from usarsim_mission.match.scribe import Scribe
from usarsim_mission.match.synthetic import SyntheticOperator
from usarsim_mission.match.team import Team
from usarsim_mission.referee import Referee
from usarsim_mission.runlog import RunWriter
from usarsim_mission.scenario.staging import Staged
from usarsim_mission.sharing.scenery import keep_scenery
from usarsim_operator.impairment import read_plan
from usarsim_operator.observers import MissionRow
from usarsim_operator.occupancy import CELL
from usarsim_operator.pages import Page
from usarsim_operator.program_page import program_page
from usarsim_operator.programs import Programs, running
from usarsim_operator.pulse import Pulse
from usarsim_operator.requests import Desk
from usarsim_operator.roles import Role
from usarsim_operator.serving import served
from usarsim_operator.station import Settings, Station
from usarsim_server import __version__
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import write_text
from usarsim_server.base.toml import read_text, toml_text

MAP_EVERY = 10.0
"""Simulated s between two maps that are logged, beside the last one."""
GATHERING = 30.0
"""Simulated s after the first robot came in which a team's others may come."""
PATIENCE = 300.0
"""s of wall time that a team has to bring its first robot."""
IMPAIR = "impair.toml"
_HOST = "127.0.0.1"
_LOOK = 0.1  # s of wall time between two looks whether pages are ready
_EVERY = 0.1  # simulated s between two rows of truth
_PICTURES = 0.25  # per simulated s of each camera, where time goes by too quickly to look at more
_TICK_OF_PEOPLE = 0.05  # simulated s from what a person does to what a robot does, at most


class Trial:
    """Runs once.

    Attributes:
        result: what `score.json` tells; empty before the end.
    """

    def __init__(self, staged: Staged, team: Team, conditions: Conditions) -> None:
        self.result: dict[str, Any] = {}
        self._staged, self._team, self._conditions = conditions.applied(staged), team, conditions
        self._time = 0.0
        self._row: TruthRow | None = None
        self._mapped = float("-inf")
        self._asked: tuple[str, str] | None = None
        self._unasked = True
        self._operator: SyntheticOperator | None = None
        self._injects = Injects(self._staged.events)
        self._live: LiveRun
        self._station: Station
        self._desk: Desk
        self._pulse: Pulse
        self._page: Page

    async def run(self) -> dict[str, Any]:
        """From the first program to `score.json`.

        Raises:
            UsarsimError: if it cannot begin; once it has begun it ends with a result, and why.
        """
        staged, folder = self._staged, self._conditions.folder
        if (left := self._team.hand_in_folder(folder)) is not None:
            refuse_old_hand_in(left)
        mission = replace(staged.referee_mission(), operators=self._operators())
        world = staged.referee_world()
        referee = Referee(mission, staged.rules, world)
        log = RunWriter(folder, staged.mission_text(), mission, staged.rules, world)
        self._live = LiveRun(log, referee)
        if text := self._impairment():
            write_text(folder / IMPAIR, text)
        settings = folder / "server.toml"
        staged.write_world(folder / "world")
        served = staged.server_settings("./world")
        write_text(settings, toml_text(served))
        try:
            options = f"--config={settings}", *self._pace()
            async with running(*options, usual_ports=self._team.wait) as run:
                await self._with_server(run)
        finally:
            self._take_hand_in()
            # Seconds, after a long run; pages of whoever leads it are answered meanwhile.
            self.result = await asyncio.to_thread(self._live.close)
        return self.result

    def _take_hand_in(self) -> None:
        """Tell the referee what the team's programs have left; trouble with it is told, too."""
        folder = self._conditions.folder
        if (left := self._team.hand_in_folder(folder)) is None:
            return
        try:
            for kind, facts in take_handed_in(left, folder, self._team.hand_in_frame):
                self._tell(kind, **facts)
        except MissionError as error:
            self._tell("error", text=str(error))

    def end(self, why: str, text: str = "") -> None:
        """End it at the next row of the truth, or before it begins.

        Args:
            why: `operator` or `aborted`. text: in words.
        """
        self._asked = self._asked or (why, text)

    @property
    def waits_for(self) -> int:
        """Operators who are not ready yet, and without whom it does not begin."""
        missing = self._conditions.pages - len(set(self._station.ready.values()))
        return max(0, missing) if self._unasked else 0

    def begin(self) -> bool:
        """Wait for nobody any more; False if it has begun, or does not wait yet."""
        waited, self._unasked = self._unasked and self._station.waits, False
        return waited

    def tell(self, kind: str, **facts: Any) -> None:
        """Log something that happens now, such as a probe."""
        self._tell(kind, **facts)

    def _pace(self) -> tuple[str, ...]:
        """Options of the server; robots of the gateway go in lockstep, so that runs repeat."""
        if self._team.brings_robots:
            return (f"--speed={self._conditions.speed}",)
        looked_at = self._team.console or self._conditions.meanwhile is not None
        pictures: tuple[str, ...] = ()
        if not looked_at:
            pictures = ("--image-port=off",)  # nobody has to be able to draw
        elif self._conditions.speed == "max":
            pictures = (f"--camera-rate={_PICTURES}",)
        return "--lockstep", f"--tick={self._tick_length}", "--lockstep-patience=0", *pictures

    @property
    def _tick_length(self) -> float:
        return _TICK_OF_PEOPLE if self._team.console else _EVERY

    def _operators(self) -> int:
        told = self._conditions.operators
        return (told or self._team.operators) if self._team.console else 1

    def _impairment(self) -> str:
        """What links to pages are like, as a file says it; of the conditions, or the mission's."""
        if (path := self._conditions.impair) is None:
            return self._staged.impairment()
        read_plan(path)  # else the error would name the copy
        return read_text(path, MissionError)

    async def _with_server(self, programs: Programs) -> None:
        ports = programs.ports
        scene = _HOST, ports["scene"]
        images = ports.get("images", 0)
        where = Settings(_HOST, ports["control"], images, scene, programs.token)
        impair = self._conditions.folder / IMPAIR
        bad = read_plan(impair) if impair.exists() else None
        radio = ports["wireless"] if self._staged.scenario.radio else None
        speed = self._conditions.speed
        station = Station(
            replace(
                where,
                patience=PATIENCE,
                impairment=bad,
                wireless=radio,
                lockstep=not self._team.brings_robots,
                pace=math.inf if speed == "max" else float(speed),
                allowance=self._conditions.allowance,
            )
        )
        self._station, self._desk, self._pulse = station, Desk(station), Pulse(station)
        async with contextlib.AsyncExitStack() as stack:
            stack.push_async_callback(station.close)
            await station.open()
            if station.lockstep is not None:
                station.lockstep.loses = self._team.console  # a program's page is never silent
                station.lockstep.watches = False
            else:
                pulse = asyncio.create_task(self._pulse.run())
                stack.callback(pulse.cancel)
            truth = await connect_scene(*scene, token=programs.token, channels=("truth",))
            stack.push_async_callback(truth.close)
            self._tell(
                "session",
                mission=self._staged.scenario.name,
                team=self._team.name,
                seed=self._staged.scenario.seed,
                software=__version__,
                gateway_clock=round(station.wall - self._live.log.began, 6),
                level=self._staged.base.level,
                tick=None if station.lockstep is None else self._tick_length,
                policy=self._team.policy,
                console=self._team.console,
                device=self._conditions.device if self._conditions.tells_device else None,
                split=dict(self._conditions.split or {}),
                operators=self._operators(),
                robots=[
                    {
                        "name": one.entry.name,
                        "class": one.description.name,
                        "drives": one.description.kind != "static",
                    }
                    for one in self._staged.robots
                ],
                **self._conditions.facts,
            )
            if bad is not None:
                self._tell("impairment", **tomllib.loads(self._impairment()))
            station.observers.add(Scribe(self._tell, self._tick, self._live.log.began))
            if self._team.brings_robots:
                await self._start_controllers(programs)
            else:
                await self._bring_robots()
            station.waits = self._conditions.pages > 0
            await self._let_in(stack)
            failed = asyncio.create_task(programs.failed())
            stack.callback(failed.cancel)
            while self.waits_for > 0 and not failed.done():
                if self._asked is not None:
                    break
                if station.lockstep is not None:
                    await station.lockstep.attend(self._pulse)
                await asyncio.sleep(_LOOK)
            station.waits = self._unasked = False
            await self._judge(truth, failed)

    async def _let_in(self, stack: contextlib.AsyncExitStack) -> None:
        """Let those in who drive, until the stack is closed."""
        if self._team.console:
            serving = replace(self._conditions.console, seats=self._operators())
            await stack.enter_async_context(served(self._station, serving))

    async def inject(self, do: str, **facts: object) -> str:
        """Make something happen, as an instructor at a page does; why it did not.

        In lockstep it counts at the next tick, so `Conditions.meanwhile` must not wait for it.

        Args:
            do: of `usarsim_operator.injects.WHOM`. facts: `robot`, `victim`, `text`, `lasts` (s),
                `name`.
        """
        async with program_page(self._station, self._desk, "Experimenter", Role.INSTRUCTOR) as page:
            answer = await page.ask("inject", do=do, **facts)
        return str(answer["why"])

    # -- the team -----------------------------------------------------------------------------

    async def _bring_robots(self) -> None:
        """Robots of the gateway: for people at pages, and for policies."""
        for robot in self._staged.robots:
            entry = robot.entry
            try:
                await self._station.spawn(entry.kind, entry.name, robot.start.tag)
            except (ProtocolError, OSError, TimeoutError, ValueError) as error:
                raise MissionError(f"{entry.name} cannot come: {error}") from None

    def _set_policies(self) -> None:
        """Robots of the gateway begin what they do while nobody drives them."""
        for robot in self._staged.robots:
            policy = self._team.policy or robot.entry.unattended
            driven = self._station.robots.get(robot.entry.name)
            moves = driven is not None and driven.motion.kind != "fixed"  # else it is a base
            if policy != "stop" and driven is not None and driven.own and moves:
                route = [(x, -y) for x, y in robot.entry.route]
                self._station.autonomy.set(driven, policy, route, self._team.name)

    async def _start_controllers(self, programs: Programs) -> None:
        if not self._team.command:
            return
        ports = programs.ports
        names = ",".join(robot.entry.name for robot in self._staged.robots)
        places = {
            "host": _HOST,
            "port": ports["control"],
            "image_port": ports["images"],
            "wireless_port": ports.get("wireless", 0),
            "truth_port": ports.get("truth", 0),
            "robots": names,
            "run": str(self._conditions.folder.absolute()),
        }
        words = [word.format(**places) for word in self._team.command]
        folder = self._team.path.parent / self._team.folder
        more = {key: str(value) for key, value in self._team.environment.items()}
        await programs.control(words, folder, more)

    # -- the referee --------------------------------------------------------------------------

    def _tick(self) -> int | None:
        return None if self._station.lockstep is None else self._station.lockstep.tick

    def _tell(self, kind: str, **facts: Any) -> None:
        """Log something that happens now, and what follows from it."""
        for record in self._live.tell(kind, self._time, **facts):
            self._injects.hear(record)
            self._conditions.watch(record)

    async def _next_row(
        self, truth: LiveScene, failed: asyncio.Task[UsarsimError]
    ) -> TruthRow | UsarsimError:
        """The next row, or why there is none; in lockstep the world goes on to it."""
        lockstep = self._station.lockstep
        while True:
            due = lockstep is None or self._time + _EVERY <= lockstep.time + 1e-6
            if due or lockstep is None:
                step: asyncio.Task[Any] = asyncio.create_task(truth.truth())
            else:
                step = asyncio.create_task(lockstep.round(self._pulse))
            try:
                await asyncio.wait((step, failed), return_when=asyncio.FIRST_COMPLETED)
                if failed.done():
                    return failed.result()
                found = step.result()
            except (ProtocolError, OSError) as error:
                return UsarsimError(f"the truth of the server has ended: {error}")
            finally:
                step.cancel()
            if isinstance(found, TruthRow):
                return found

    async def _judge(self, truth: LiveScene, failed: asyncio.Task[UsarsimError]) -> None:
        """Feed the referee until the trial is over."""
        referee, first = self._live.referee, None
        names = {robot.entry.name for robot in self._staged.robots}
        while self._asked is None:
            row = await self._next_row(truth, failed)
            if isinstance(row, UsarsimError):
                text, _, more = str(row).partition("\n")  # the rest may name addresses
                self._tell("error", text=text)
                self._tell("trial_end", why="error", text=text)
                self._station.log.error(text, said=more.strip())
                break
            self._time, self._row = row.time, row
            self._station.truth.time = max(self._station.truth.time, row.time)
            self._station.injects.beat()
            if self._station.lockstep is not None:
                self._station.lockstep.see(row)
            there = {one.name for one in row.robots}
            first = row.time if first is None and there else first
            if referee.began is None and (
                names <= there or (first is not None and row.time - first >= GATHERING)
            ):
                self._tell("trial_start", limit=self._staged.scenario.time_limit)
                self._set_policies()
                self._injects.begin(self._time)
                await self._keep_scenery()
            facts = {key: value for key, value in row.fields.items() if key not in ("type", "time")}
            self._tell("truth", **facts)
            self._show()
            self._watch(row)
            if self._conditions.meanwhile is not None and referee.running:
                await self._conditions.meanwhile(row)
            for event in self._injects.due(self._time) if referee.running else ():
                await self._station.injects.do(inject_of(event))
            if row.time - self._mapped >= MAP_EVERY:
                self._log_map()
            if referee.over is not None:
                break
        for driven in self._station.robots.values():
            self._station.stop(driven, "the trial is over")
        if referee.over is None and self._asked is not None:
            self._tell("trial_end", why=self._asked[0], text=self._asked[1])
        elif referee.over is not None and referee.over not in ("error",):
            self._tell("trial_end", why=referee.over, text="")
        self._log_map()

    async def _keep_scenery(self) -> None:
        """What the world looks like; one that waits for nobody goes on meanwhile."""
        settings = self._station.settings
        assert settings.scene is not None
        where = *settings.scene, settings.scene_token
        keeping = keep_scenery(self._conditions.folder, self._time, *where)
        if self._station.lockstep is None:
            self._station.background(keeping)
        else:
            await keeping

    def _watch(self, row: TruthRow) -> None:
        """Let a synthetic operator see, and say what it says as its page."""
        skill = self._team.synthetic
        if skill is None or not self._live.referee.running:
            return
        if self._operator is None:
            names = [robot.entry.name for robot in self._staged.robots]
            rules, seed = self._staged.rules.victims, self._staged.scenario.seed
            self._operator = SyntheticOperator(skill, names, seed, rules)
            page = Page(self._station.new_id(), "Synthetic", Role.OPERATOR, None, 0.0)
            page.cameras_off.update(names)  # it sees what is true
            page.lasers_off.update(names)
            self._station.join(page)
            self._page = page
        page = self._page
        self._station.watchdog.heard(page.id, self._station.now)
        for said in self._operator.see(row):
            self._desk.hear(page, json.dumps({**said, "clock": row.time}))

    def _log_map(self) -> None:
        """What the team's scanners have seen, in MuJoCo's frame: y to the left."""
        self._mapped = self._time
        if (part := self._station.map.part()) is not None:
            (x, y), cells = part
            grid = Grid(x, -(y + len(cells) * CELL), CELL, cells[::-1])
            self._tell("map", **grid.packed())

    def _show(self) -> None:
        """Tell pages how it goes: people what the mission reveals, instructors all."""
        referee, scenario = self._live.referee, self._staged.scenario
        left = scenario.time_limit
        if referee.ends_at is not None:
            left = max(0.0, referee.ends_at - self._time)
        values = referee.score["values"]
        whole = {
            "name": scenario.title,
            "remaining": round(left, 2),
            "score": referee.score["total"],
            "found": values["VF"],
            "victims": values["V"],
        }
        shown = {"name": whole["name"], "remaining": None}
        if "clock" in scenario.reveal:
            shown["remaining"] = whole["remaining"]
        for key in ("score", "found"):
            if key in scenario.reveal:
                shown[key] = whole[key]
        self._station.mission = MissionRow(shown, whole)
