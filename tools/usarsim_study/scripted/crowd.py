"""Scripted participants of a study: whole sessions, from the consent to the last form.

They come to a desk one after the other, each with the skill that follows from the seed of the study
and the participant's number. While a trial runs its world stands still after each row of the truth
until they have done what they do there.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import shutil
import sys
from collections.abc import AsyncIterator, Sequence
from typing import Any, Literal, cast

from usarsim_client.scene import TruthRow
from usarsim_mission.scenario.staging import Staged
from usarsim_operator.allowance import halves
from usarsim_study.errors import StudyError
from usarsim_study.folder import StudyFolder
from usarsim_study.scripted.answers import Feeling, load_of
from usarsim_study.scripted.browser_hands import SCRIPT
from usarsim_study.scripted.floor import Floor
from usarsim_study.scripted.hands import act
from usarsim_study.scripted.operator import TRIES, ScriptedOperator
from usarsim_study.scripted.seats import BrowserSeat, ProgramSeat, Seat, need_browser
from usarsim_study.scripted.skill import ADVANTAGE, SPEED, Device, Skill, careful, drawn, planted
from usarsim_study.session.attempt import Attempt, Runner
from usarsim_study.session.desk import Desk
from usarsim_study.session.leading import lead_sessions
from usarsim_study.session.staging import Options, condition_of
from usarsim_study.session.steps import Task, codes
from usarsim_study.session.web import TOKENS, Web, kept_tokens, serving

HandsKind = Literal["browser", "gateway"]
_FLAGS = ("--disable-gpu", "--disable-software-rasterizer")
"""Nobody looks at the 3D view, and software draws it slowly."""


class Crowd:
    """All scripted participants of a run.

    Attributes:
        seats: where they sit. faults: what they could not have gone on from, or only with luck.
    """

    def __init__(
        self,
        folder: StudyFolder,
        advantage: float = ADVANTAGE,
        tries: Sequence[tuple[float, str]] = TRIES,
    ) -> None:
        """advantage: of the gamepad, see `skill.planted`. tries: in everybody's first training, or
        without one in the first trial."""
        self._study, self._orders = folder.study, folder.orders
        self._advantage, self._tries = planted(self._study, advantage), tries
        self._skill, self._number = Skill(), 0
        self._desk: Desk | None = None
        self._attempt: Attempt | None = None
        self._players: list[tuple[ScriptedOperator, Seat]] = []
        self._floors: dict[tuple[str, int], Floor] = {}
        self.seats: list[Seat] = []
        self.faults: list[str] = []

    def grip(self) -> tuple[Device, float, float]:
        """What hands hold at the panel that stands there, and how fast they drive and turn."""
        task = None if self._desk is None else self._desk.step(1).task
        if task is None or task.cell is None:
            return "keyboard", SPEED, self._skill.turn
        device = _device(condition_of(self._study, task).device)
        skill = self._skill_at(task, device)
        return device, skill.speed(device), skill.turn

    def _skill_at(self, task: Task, device: Device) -> Skill:
        """Of a trial; in a training everybody is careful."""
        if task.kind == "trial":
            return self._skill
        return careful(self._skill, device)

    def begins(self, desk: Desk) -> None:
        """A session begins: somebody else sits down; nobody is waited for after it."""
        study, number = self._study, desk.book.participant.number
        self._number = number
        self._skill = drawn(study.seed, number, self._advantage)
        chance = random.Random(f"answers/{study.seed}/{number}")
        order = self._orders[number]
        speeds = {
            one.condition: self._skill.speed(_device(study.condition_named(one.condition).device))
            for one in order
        }
        best = max(speeds.values())
        names = codes(study, order) or tuple(one.name for one in study.condition)
        likes = {
            name
            for name, one in zip(names, study.condition, strict=True)
            if len(set(speeds.values())) > 1 and speeds.get(one.name) == best
        }
        for place, seat in enumerate(self.seats):
            seat.feeling = Feeling(random.Random(f"{chance.random()}/{place}"))
            seat.feeling.likes = frozenset(likes)
        self._desk = desk
        desk.another.set()

    async def meanwhile(self, attempt: Attempt, row: TruthRow) -> None:
        """What everybody does at an instant of a trial."""
        if attempt is not self._attempt:
            self._attempt = attempt
            self._players = self._sit_down(attempt)
        for operator, seat in self._players:
            hands = await seat.hands()
            if hands is None:
                continue
            try:
                await act(operator, hands, row)
            except Exception as error:  # whatever a browser cannot do; the trial goes on
                self._fault(f"{type(error).__name__}: {str(error).partition(chr(10))[0]}")

    def _fault(self, text: str) -> None:
        self.faults.append(f"participant {self._number}: {text}")
        print(self.faults[-1], file=sys.stderr)

    def _sit_down(self, attempt: Attempt) -> list[tuple[ScriptedOperator, Seat]]:
        """Operators of a trial, at the panels that stand before them."""
        staged, task = attempt.staged, attempt.task
        assert staged is not None
        condition, training = condition_of(self._study, task), task.kind == "training"
        device = _device(condition.device)
        skill = self._skill_at(task, device)
        names = [one.entry.name for one in staged.robots]
        alone = condition.unattended
        watched = frozenset(
            one.entry.name
            for one in staged.robots
            if (one.entry.unattended if training or alone == "mission" else alone) != "stop"
        )
        split = halves(names, 2) if condition.operators == "split" else {}
        found: list[tuple[ScriptedOperator, Seat]] = []
        for place, seat in enumerate(self.seats[: attempt.operators], start=1):
            seat.feeling.load = load_of(skill.speed(device), len(names))
            mine = [name for name in names if split.get(name, place) == place]
            mine = mine[place - 1 :] + mine[: place - 1] if not split else mine
            first = task.number == 1 and (training or self._study.training is None)
            operator = ScriptedOperator(
                skill, device, self._floor(staged), mine, self._seed(attempt, place), watched,
                self._tries if first and place == 1 else (),
            )  # fmt: skip
            if training:
                operator.is_told([one.pos[:2] for one in staged.referee_world().victims])
            found.append((operator, seat))
        return found

    def _seed(self, attempt: Attempt, place: int) -> int:
        text = (
            f"{self._study.seed}/{self._number}/{attempt.task.key}/{attempt.step.attempt}/{place}"
        )
        return random.Random(text).getrandbits(32)

    def _floor(self, staged: Staged) -> Floor:
        key = staged.scenario.name, staged.scenario.seed
        if key not in self._floors:
            grid = staged.referee_world().floor
            assert grid is not None
            self._floors = {key: Floor(grid)}
        return self._floors[key]


def _device(device: str) -> Device:
    """What is driven with; where the choice is free, the keyboard."""
    return cast(Device, device) if device != "any" else "keyboard"


async def run_scripted(
    folder: StudyFolder,
    options: Options,
    sessions: int,
    *,
    hands: HandsKind = "browser",
    advantage: float = ADVANTAGE,
    frames: str = "http://127.0.0.1:*",
    tries: Sequence[tuple[float, str]] = TRIES,
) -> Crowd:
    """Lead scripted participants through a study.

    Args:
        folder: of the study. options: of trials. sessions: how many participants.
        hands: whether they sit at real pages. advantage: of the gamepad.
        frames: origins of panels. tries: buttons to press, by s, when everybody begins.

    Raises:
        UsarsimError: the study cannot be run, or there is no browser.
    """
    pages = Web(kept_tokens(folder.path / TOKENS), frames)
    crowd = Crowd(folder, advantage, tries)
    runner = Runner(options, lambda: pages.hosts, crowd.meanwhile)
    count = 2 if any(one.operators != "one" for one in folder.study.condition) else 1
    async with contextlib.AsyncExitStack() as stack:
        urls = await stack.enter_async_context(serving(pages, options.host, 0))
        if hands == "browser":
            sheets = await stack.enter_async_context(_browser(count))
            crowd.seats = [
                BrowserSeat(crowd.grip, number, page) for number, page in enumerate(sheets, start=1)
            ]
        else:
            crowd.seats = [ProgramSeat(crowd.grip, number) for number in range(1, count + 1)]
        sitting = [
            asyncio.create_task(seat.run(urls[place]))
            for place, seat in enumerate(crowd.seats, start=1)
        ]
        leading = asyncio.create_task(
            lead_sessions(
                folder,
                pages,
                runner,
                sessions=sessions,
                seconds=options.seconds,
                scripted=True,
                begins=crowd.begins,
            )
        )
        try:
            done, _ = await asyncio.wait((leading, *sitting), return_when=asyncio.FIRST_COMPLETED)
            for one in done:
                one.result()
            if not leading.done():
                raise StudyError("a scripted operator has left its page")
        finally:
            for one in (leading, *sitting):
                one.cancel()
            await asyncio.gather(leading, *sitting, return_exceptions=True)
    for seat in crowd.seats:
        crowd.faults += seat.faults
    return crowd


@contextlib.asynccontextmanager
async def _browser(count: int) -> AsyncIterator[Sequence[Any]]:
    """So many pages of a Chromium, each in a profile of its own."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    async with need_browser().async_playwright() as tools:
        flags = [*_FLAGS, *(["--no-sandbox"] if os.geteuid() == 0 else [])]
        browser = await tools.chromium.launch(executable_path=program, args=flags)
        try:
            sheets = []
            for _ in range(count):
                context = await browser.new_context(viewport={"width": 1366, "height": 768})
                await context.add_init_script(SCRIPT)
                page = await context.new_page()
                page.set_default_timeout(10_000.0)
                sheets.append(page)
            yield sheets
        finally:
            await browser.close()
