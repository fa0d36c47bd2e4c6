"""What each text of a page does; a table of coroutines would wait, these do not.

A handler raises `ValueError` with the reason when it refuses; otherwise the request is answered
`ok`, unless the handler returns `LATER`: then somebody else's answer is waited for.
"""

from __future__ import annotations

from collections.abc import Callable

from usarsim_client import HangupError, ProtocolError
from usarsim_client.commands import links, say
from usarsim_operator import messages
from usarsim_operator.arbiter import Outcome
from usarsim_operator.ground import Disc
from usarsim_operator.instructing import Instructing
from usarsim_operator.messages import LATER, Fields, PageError, Request
from usarsim_operator.pages import Page
from usarsim_operator.robot_link import Driven
from usarsim_operator.roles import Role
from usarsim_operator.station import Station
from usarsim_operator.timed_moves import Rotate, Travel

_SHOWN = '{"type":"shown"'  # by the page itself, dozens a second
_NO_INPUT = _SHOWN, '{"type":"ready"'  # by the page itself


class Desk:
    """Where the texts of pages arrive."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._handlers: dict[str, Callable[[Page, Fields, Request], object]] = {
            "ping": self._ping,
            "shown": self._shown,
            "ready": self._ready,
            "select": self._select,
            "take": self._take,
            "reply": self._reply,
            "hand_back": self._hand_back,
            "drive": self._drive,
            "fly": self._fly,
            "steer": self._steer,
            "rotate": self._rotate,
            "travel": self._travel,
            "enable": self._enable,
            "policy": self._policy,
            "light": self._light,
            "flippers": self._flippers,
            "camera_pose": self._camera_pose,
            "estop": self._estop,
            "estop_reset": self._estop_reset,
            "camera": self._camera,
            "laser": self._laser,
            "spawn": self._spawn,
            "remove": self._remove,
            "mark": self._mark,
            "mark_edit": self._mark_edit,
            "mark_delete": self._mark_delete,
            "avoid": self._avoid,
            "follow": self._follow,
            "acknowledge": self._acknowledge,
            "lines": self._lines,
            **Instructing(station).handlers,
        }

    def hear(self, page: Page, text: str) -> None:
        """Take a text of a page, whatever it is, if the page may say so much."""
        if self.admits(page, text):
            self.take(page, text)

    def admits(self, page: Page, text: str) -> bool:
        """Whether a page may say so much; a text beyond that is counted and nothing else."""
        wall = self._station.wall
        if not page.limits.hears(wall, len(text)):
            return False
        free = page.role is not Role.VIEWER or text.startswith(_SHOWN)
        return free or page.limits.asks(wall)

    def take(self, page: Page, text: str) -> None:
        """Take a text that was admitted; in lockstep it waits for the next tick."""
        if self._station.lockstep is not None:
            self._station.lockstep.hear(self, page, text)
        else:
            self.obey(page, text)

    def obey(self, page: Page, text: str, heard: float | None = None) -> None:
        """Let a text of a page count now.

        Args:
            page: which. text: as it was sent.
            heard: s of the gateway's clock when it came; None: now.
        """
        station, now = self._station, self._station.now
        try:
            request = messages.read(text)
        except PageError as error:
            page.limits.refuse()
            page.answer(-1 if error.id is None else error.id, False, str(error))
            return
        station.watchdog.heard(page.id, now)
        # In lockstep only the newest of a tick reaches a robot, and no clock counts.
        driving = messages.driving(request.type)
        free = station.lockstep is not None or not driving
        if not free and not page.limits.drives(now):
            page.answer(request.id, False, "too many texts that drive")
            return
        if not page.role.may(request.type):
            page.limits.refuse()
            page.answer(request.id, False, f"a page of the role {page.role.value} may not do that")
            return
        handler = self._handlers.get(request.type)
        if handler is None:
            page.answer(request.id, False, "only the first text says hello")
            return
        # What is refused up to here is counted: who keeps what pages say never sees it.
        if request.type == "ping" and not page.limits.measures(station.wall):
            self._pong(page, request)
            page.answer(request.id, True)
            return
        if not text.startswith(_NO_INPUT):
            station.observers.input(page, text, station.wall if heard is None else heard)
        try:
            result = handler(page, request.fields, request)
        except ValueError as error:
            page.answer(request.id, False, str(error))
            if request.id is None and request.type != "drive":
                page.tell({"type": "answer", "id": None, "ok": False, "why": str(error)})
            return
        if result is not LATER:
            page.answer(request.id, True, request.limited)
        if driving and request.id is None and bool(request.limited) != page.limited:
            page.limited = bool(request.limited)  # told once, not 20 times a second
            if page.limited:
                page.tell({"type": "answer", "id": None, "ok": True, "why": request.limited})

    # -- looking ------------------------------------------------------------------------------

    def _ping(self, page: Page, fields: Fields, request: Request) -> None:
        station, clock = self._station, request.clock
        now = self._pong(page, request)
        if clock is not None:
            page.clock.ping(clock, now)
        told = "answered" in fields and "round" in fields
        if told and page.clock.round(fields["answered"], fields["round"]):
            facts = {"page": page.id, "offset": page.clock.offset, "rtt": page.clock.rtt}
            station.observers.note("page_clock", facts)
        for robot, age in fields.get("ages", {}).items():
            if robot in station.robots:
                facts = {"page": page.id, "robot": robot, "age": age}
                station.observers.note("frame_age", facts)

    def _pong(self, page: Page, request: Request) -> float:
        now = self._station.wall
        page.reply({"type": "pong", "clock": request.clock, "gateway_clock": now})
        return now

    def _shown(self, page: Page, fields: Fields, request: Request) -> None:
        page.shown(fields["count"])

    def _ready(self, page: Page, fields: Fields, request: Request) -> None:
        page.ready = fields["on"]
        self._station.consider(page)

    def _robot(self, fields: Fields) -> Driven:
        found = self._station.robots.get(fields["robot"])
        if found is None:
            raise ValueError(f"there is no robot {fields['robot']}")
        return found

    def _select(self, page: Page, fields: Fields, request: Request) -> None:
        page.selected = self._robot(fields).name
        self._station.look()

    def _camera(self, page: Page, fields: Fields, request: Request) -> None:
        name = self._robot(fields).name
        (page.cameras_off.discard if fields["on"] else page.cameras_off.add)(name)
        self._station.look()

    def _laser(self, page: Page, fields: Fields, request: Request) -> None:
        name = self._robot(fields).name
        (page.lasers_off.discard if fields["on"] else page.lasers_off.add)(name)

    def _lines(self, page: Page, fields: Fields, request: Request) -> None:
        page.wants_lines, page.lines = True, fields["robot"]
        self._station.look()

    # -- locks --------------------------------------------------------------------------------

    def _take(self, page: Page, fields: Fields, request: Request) -> object:
        station, driven = self._station, self._allowed(page, fields)
        force = bool(fields.get("force"))
        if force and page.role is not Role.INSTRUCTOR:
            raise ValueError("only an instructor takes a robot by force")
        features = station.scene.features if station.scene else {}
        if not driven.own and not features.get("takeover"):
            raise ValueError(f"{driven.name} is driven by its own controller")
        decision = station.arbiter.take(driven.name, page.id, page.name, station.now, force=force)
        if decision.outcome is Outcome.REFUSED:
            raise ValueError(decision.why)
        if decision.outcome is Outcome.ASKED:
            assert decision.before is not None
            station.asked[driven.name, page.id] = request.id
            if (holder := station.pages.get(decision.before.page or 0)) is not None:
                told = {"type": "asked", "robot": driven.name, "page": page.id, "name": page.name}
                holder.tell(told)
            return LATER
        self._granted(driven, page)
        if driven.own or decision.before is not None:
            return None
        station.background(self._take_over(driven, page, request))
        return LATER

    async def _take_over(self, driven: Driven, page: Page, request: Request) -> None:
        scene = self._station.scene
        assert scene is not None
        try:
            await scene.request("take", robot=driven.name, by=page.name)
            page.answer(request.id, True)
        except (ProtocolError, HangupError) as error:
            self._station.arbiter.hand_back(driven.name, page.id)
            self._station.event(driven.name, "lock", None)
            page.answer(request.id, False, str(error))

    def _granted(self, driven: Driven, page: Page) -> None:
        self._station.stop(driven, "it has another driver")
        self._station.event(driven.name, "lock", {"page": page.id, "name": page.name})
        self._station.autonomy.tell(driven, page.name)

    def _reply(self, page: Page, fields: Fields, request: Request) -> None:
        station, driven = self._station, self._robot(fields)
        to = fields["to"]
        decision = station.arbiter.reply(driven.name, page.id, to, fields["grant"])
        asker = station.pages.get(to)
        if decision.outcome is Outcome.GRANTED and asker is not None:
            self._granted(driven, asker)
            asker.answer(station.asked.pop((driven.name, to), None), True)
        elif fields["grant"] or asker is None:
            raise ValueError(decision.why)
        else:
            asker.answer(station.asked.pop((driven.name, to), None), False, decision.why)

    def _hand_back(self, page: Page, fields: Fields, request: Request) -> None:
        name = self._robot(fields).name
        if not self._station.arbiter.hand_back(name, page.id):
            raise ValueError(f"you do not hold {name}")
        self._station.release(name, "handed back")

    # -- driving ------------------------------------------------------------------------------

    def _allowed(self, page: Page, fields: Fields) -> Driven:
        driven = self._robot(fields)
        self._station.settings.allowance.check_robot(page, driven.name)
        return driven

    def _held(self, page: Page, fields: Fields) -> Driven:
        driven = self._allowed(page, fields)
        why = self._station.arbiter.why_not(driven.name, page.id)
        if why:
            raise ValueError(why)
        return driven

    def _move(self, page: Page, driven: Driven, data: bytes, power: float) -> None:
        station = self._station
        if driven.move is not None:
            station.end_move(driven, "aborted", "driven by hand")
        changed = driven.wheels != data
        if power == 0.0:
            driven.stop()
        else:
            driven.tell_motion(data, power)
        driven.wheels = data
        station.watchdog.drove(driven.name, page.id, power == 0.0, station.now)
        if changed:
            station.observers.command(driven.name, "operator", data)
            station.event(driven.name, "wheel", power)

    def _driven(self, page: Page, fields: Fields, *wish: str) -> Driven:
        """The robot that a page drives, if it may, by the device that is allowed."""
        if any(fields[key] for key in wish):
            self._station.settings.allowance.check_device(page, fields.get("device"))
        return self._held(page, fields)

    def _drive(self, page: Page, fields: Fields, request: Request) -> None:
        driven = self._driven(page, fields, "left", "right")
        left, right = fields["left"], fields["right"]
        forward = abs(left + right) / 2.0  # a robot that turns on the spot is not stuck
        power = forward or (0.05 if left or right else 0.0)
        self._move(page, driven, driven.motion.drive(left, right), power)

    def _steer(self, page: Page, fields: Fields, request: Request) -> None:
        driven = self._driven(page, fields, "speed", "steer")
        speed, steer = fields["speed"], fields["steer"]
        self._move(page, driven, driven.motion.turn(speed, steer), max(abs(speed), abs(steer) / 20))

    def _fly(self, page: Page, fields: Fields, request: Request) -> None:
        wish = ("altitude", "linear", "lateral", "rotational")
        driven = self._driven(page, fields, *wish)
        if driven.motion.kind != "aerial":
            raise ValueError(f"{driven.name} does not fly")
        parts = [fields[key] for key in wish]
        power = max(map(abs, parts[:3])) or (0.05 if parts[3] else 0.0)
        self._move(page, driven, driven.motion.fly(*parts), power)

    def _timed(self, page: Page, fields: Fields, move: Rotate | Travel) -> None:
        station, driven = self._station, self._held(page, fields)
        able = ("ground", "aerial") if isinstance(move, Rotate) else ("ground", "aerial", "car")
        if driven.motion.kind not in able:
            raise ValueError(
                f"{driven.name} cannot do that: it is of the kind {driven.motion.kind}"
            )
        if driven.own and driven.telemetry.pose is None:
            raise ValueError(f"{driven.name} tells no pose")
        if driven.move is not None:
            station.end_move(driven, "aborted", "another move begins")
        station.watchdog.stopped(driven.name)
        driven.move, driven.mover = move, page.id
        station.look()

    def _rotate(self, page: Page, fields: Fields, request: Request) -> None:
        self._timed(page, fields, Rotate(fields["degrees"], fields.get("speed", 0.5)))

    def _travel(self, page: Page, fields: Fields, request: Request) -> None:
        self._timed(page, fields, Travel(fields["metres"], fields.get("speed", 0.5)))

    def _enable(self, page: Page, fields: Fields, request: Request) -> None:
        station, driven, on = self._station, self._allowed(page, fields), fields["on"]
        held = station.arbiter.holders.get(driven.name)
        if on and held is not None and held.page != page.id and page.role is not Role.INSTRUCTOR:
            raise ValueError(f"{held.name} holds {driven.name}")
        before = driven.name not in station.arbiter.disabled
        station.arbiter.enable(driven.name, on)
        if not on:
            station.stop(driven, "switched off")
        if before != on:
            station.event(driven.name, "enabled", on)

    def _policy(self, page: Page, fields: Fields, request: Request) -> None:
        driven = self._allowed(page, fields)
        held = self._station.arbiter.holders.get(driven.name)
        if held is not None and held.page != page.id and page.role is not Role.INSTRUCTOR:
            raise ValueError(f"{held.name} holds {driven.name}")
        self._station.autonomy.set(driven, fields["policy"], fields.get("route", ()), page.name)

    def _light(self, page: Page, fields: Fields, request: Request) -> None:
        self._held(page, fields).tell(say("DRIVE", Light=fields["on"]))

    def _flippers(self, page: Page, fields: Fields, request: Request) -> None:
        self._held(page, fields).tell(say("MULTIDRIVE", **fields["angles"]))

    def _camera_pose(self, page: Page, fields: Fields, request: Request) -> None:
        driven = self._held(page, fields)
        package, joints = driven.mounts.joints(driven.camera)
        if not package and not driven.own:  # it can be asked nothing
            package, joints = "CameraPanTilt", {"pan": (1, 1.0), "tilt": (2, 1.0)}
        lacks = [key for key in ("pan", "tilt") if key in fields and key not in joints]
        if lacks:
            raise ValueError(f"the camera of {driven.name} does not {lacks[0]}")
        asked = [(*joints[key], fields[key]) for key in ("pan", "tilt") if key in fields]
        turned = {link: sign * angle for link, sign, angle in asked}
        if turned:
            driven.tell(links(package, turned, 0))
        if "zoom" in fields:
            camera = driven.camera or None
            driven.tell(
                say("SET", Type="Camera", Name=camera, Opcode="Zoom", Params=fields["zoom"])
            )
            self._station.background(driven.look_again())

    # -- stopping everything ------------------------------------------------------------------

    def _estop(self, page: Page, fields: Fields, request: Request) -> None:
        station = self._station
        station.arbiter.stop_all(page.name, page.id, station.time)
        for driven in station.robots.values():
            if driven.own or driven.name in station.arbiter.holders:
                station.stop(driven, "emergency stop")
        station.event("", "estop", page.name)
        self._keep(page)

    def _estop_reset(self, page: Page, fields: Fields, request: Request) -> None:
        self._station.arbiter.reset(page.name, page.id)
        self._station.event("", "estop", None)
        self._keep(page)

    def _keep(self, page: Page) -> None:
        async def keep() -> None:
            try:
                self._station.arbiter.keep()
            except OSError as error:
                self._station.log.bind(page=page.id).warning(
                    f"the emergency stop cannot be kept over a restart: {error.strerror}"
                )

        self._station.background(keep())  # after the robots were told: a disk may be slow

    # -- the world ----------------------------------------------------------------------------

    def _spawn(self, page: Page, fields: Fields, request: Request) -> object:
        self._station.settings.allowance.check_fleet(page)

        async def spawn() -> None:
            try:
                driven = await self._station.spawn(
                    fields["class"], fields.get("name"), fields.get("start"), fields.get("place")
                )
                page.answer(request.id, True, robot=driven.name)
            except (ProtocolError, OSError, TimeoutError, ValueError) as error:
                page.answer(request.id, False, str(error))

        self._station.background(spawn())
        return LATER

    def _remove(self, page: Page, fields: Fields, request: Request) -> None:
        driven = self._allowed(page, fields)
        self._station.settings.allowance.check_fleet(page)
        if not driven.own:
            raise ValueError(f"{driven.name} is not a robot of this gateway")
        held = self._station.arbiter.holders.get(driven.name)
        if held is not None and held.page != page.id and page.role is not Role.INSTRUCTOR:
            raise ValueError(f"{held.name} holds {driven.name}")
        self._station.background(self._station.remove(driven.name))

    def _mark(self, page: Page, fields: Fields, request: Request) -> object:
        number = self._station.marks.set(fields, page.name, self._station.time)
        page.answer(request.id, True, mark=number)
        self._marked("mark_set", number, page)
        return LATER

    def _marked(self, kind: str, number: int, page: Page) -> None:
        row = self._station.marks.row(number)
        facts = {key: value for key, value in row.items() if key not in ("id", "time")}
        whose = {"mark": number, "page": page.id, "by": page.name}
        self._station.observers.note(kind, {**facts, **whose})

    def _mark_edit(self, page: Page, fields: Fields, request: Request) -> None:
        self._station.marks.edit(fields["mark"], fields)
        self._marked("mark_edit", fields["mark"], page)

    def _mark_delete(self, page: Page, fields: Fields, request: Request) -> None:
        self._station.marks.delete(fields["mark"])
        whose = {"mark": fields["mark"], "page": page.id, "by": page.name}
        self._station.observers.note("mark_delete", whose)

    def _avoid(self, page: Page, fields: Fields, request: Request) -> None:
        x, y, _ = fields["place"]
        ground, disc = self._station.autonomy.ground, Disc((x, y), fields["radius"])
        ground.keep_clear(fields["name"], disc, self._station.time)

    def _follow(self, page: Page, fields: Fields, request: Request) -> None:
        robot, ground = self._allowed(page, fields).name, self._station.autonomy.ground
        ground.follow(robot, fields["name"], fields["within"])

    def _acknowledge(self, page: Page, fields: Fields, request: Request) -> None:
        if not self._station.alarms.acknowledge(fields["alarm"]):
            raise ValueError(f"there is no alarm {fields['alarm']}")
