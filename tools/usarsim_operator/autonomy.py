"""Lets robots that nobody drives follow their policies.

A policy is asked at each pose that its robot reports. It rests while somebody holds the robot,
while that is switched off or everything is stopped, and goes on afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from usarsim_client import readings
from usarsim_operator import policies
from usarsim_operator.evasion import Powers
from usarsim_operator.ground import Ground
from usarsim_operator.navigation import Place
from usarsim_operator.policies import Policy
from usarsim_operator.view import View

if TYPE_CHECKING:
    from usarsim_operator.robot_link import Driven
    from usarsim_operator.station import Station

OFTEN = 0.1
"""Simulated s between two decisions, at least."""
KINDS = ("ground", "car")
"""Kinds of robots that can follow a policy other than to stop."""
_SPACING = 2.0  # m between places of a way that is patrolled


@dataclass(slots=True)
class _Unattended:
    policy: Policy
    scan: readings.LaserScan | None = None
    asked: float = -1.0
    acted: bool = False
    told: Powers = (0.0, 0.0)
    why: str = ""


class Autonomy:
    """The policies of all robots of one station.

    Attributes:
        ground: what robots that follow one know beside the map.
    """

    def __init__(self, station: Station) -> None:
        self._station = station
        self.ground = Ground()
        self._robots: dict[str, _Unattended] = {}

    def policy(self, robot: str) -> str:
        """Name of the policy of a robot."""
        found = self._robots.get(robot)
        return policies.Stop.name if found is None else found.policy.name

    def mode(self, driven: Driven) -> str:
        """`operator`, `controller`, `autonomous`, or `stopped`: nobody drives, it stands."""
        if self._station.arbiter.holders.get(driven.name) is not None:
            return "operator"
        if not driven.own:
            return "controller"
        return "autonomous" if self.acts(driven.name) else "stopped"

    def acts(self, robot: str) -> bool:
        """Whether a robot has a policy other than to stop."""
        return robot in self._robots

    def set(self, driven: Driven, name: str, route: Sequence[Place] = (), by: str = "") -> None:
        """Give a robot a policy.

        Args:
            driven: which. name: of the policy. by: who wants it.
            route: of a patrol; empty: the way that the robot has come so far.

        Raises:
            ValueError: with the reason, if it cannot follow that.
        """
        if not driven.own:
            raise ValueError(f"{driven.name} is driven by its own controller")
        if name == policies.Patrol.name and not route:
            route = driven.telemetry.path[:: max(1, round(_SPACING / 0.1))]
            if len(route) < 2:
                raise ValueError("drive the round first that it is to patrol, or name a route")
        found = policies.make(name, route)
        if name == policies.Stop.name:
            self._robots.pop(driven.name, None)
        elif driven.motion.kind not in KINDS:
            raise ValueError(f"a robot of the kind {driven.motion.kind} follows no policy")
        else:
            self._robots[driven.name] = _Unattended(found)
        if self._station.arbiter.holders.get(driven.name) is None:
            self._station.stop(driven, f"its policy is {name}")
        self._station.look()
        self.tell(driven, by)

    def tell(self, driven: Driven, by: str = "") -> None:
        """Tell pages and the recording who or what drives a robot from now on."""
        facts = {"mode": self.mode(driven), "policy": self.policy(driven.name)}
        self._station.event(driven.name, "mode", facts, by=by)

    def carried(self, robot: str) -> bool:
        """Whether a lift has a robot: what it scans is not what the map is of."""
        return (found := self._robots.get(robot)) is not None and found.policy.carried

    def forget(self, robot: str) -> None:
        """A robot has left."""
        self._robots.pop(robot, None)
        self.ground.forget(robot)

    def stopped(self, robot: str) -> None:
        """A robot was told to stand, by somebody else than its policy."""
        if (found := self._robots.get(robot)) is not None:
            found.told = 0.0, 0.0

    def scan(self, robot: str, scan: readings.LaserScan) -> None:
        """Take a flat scan of a robot."""
        if (found := self._robots.get(robot)) is not None:
            found.scan = scan

    def step(self, driven: Driven) -> None:
        """Ask the policy of a robot that has just reported its pose."""
        found, arbiter = self._robots.get(driven.name), self._station.arbiter
        pose, time = driven.telemetry.pose, driven.telemetry.pose_time
        if pose is not None:
            self.ground.stand(driven.name, (pose[0], pose[1]), time)
        if found is None or pose is None or time - found.asked < OFTEN - 1e-9:
            return
        found.asked = time
        held = driven.name in arbiter.holders or driven.name in arbiter.disabled
        if held or arbiter.stop is not None or driven.move is not None:
            if found.acted:
                found.acted, found.told = False, (0.0, 0.0)
                found.policy.resume()
            return
        goals = {
            name: one.policy.goal
            for name, one in self._robots.items()
            if one.policy.goal is not None and name != driven.name
        }
        here, lean = (pose[0], pose[1], pose[5]), (pose[3], pose[4])
        ground = self.ground
        ground.mark(self._station.marks.places())
        view = View(
            time,
            here,
            found.scan,
            self._station.map,
            goals,
            ground,
            driven.name,
            lean,
            driven.telemetry.height,
        )
        left, right = found.policy.powers(view)
        if found.policy.why != found.why:
            found.why = found.policy.why
            self._station.observers.note("stands", {"robot": driven.name, "why": found.why})
        left, right = round(left, 3), round(right, 3)
        found.acted = True
        if (left, right) != found.told:
            found.told = left, right
            data = driven.motion.drive(left, right) if left or right else driven.motion.stop
            driven.tell_motion(data, abs(left + right) / 2.0)
            self._station.observers.command(driven.name, "autonomy", data)
