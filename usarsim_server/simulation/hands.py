"""Taking hold of things: fingers, suction cups and tool couplings of all robots.

What a hand holds is tied to it by a weld constraint, as the original did. Friction alone would be
the more natural way to hold a thing between fingers, but it lets go by and by. So fingers close by
force until all of them touch one body, which is then tied; it slips away when it is pulled harder
than the hand is strong. The same constraint keeps anchored robots in their place.

Only bodies that can move and belong to no robot are held. Used by the physics thread.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.articulation import (
    Grip,
    HandModel,
    HandState,
    ToolModel,
    anchor_name,
    tie_name,
)
from usarsim_server.simulation.frames import Pose, Quaternion, Vector, pose_of
from usarsim_server.simulation.model import WAKE, CompiledWorld, root_qpos
from usarsim_server.simulation.parts import Part

SLIP_TIME = 0.04
"""s for which a pull has to be too strong; a knock is not a pull."""
SEARCH_INTERVAL = 0.02
"""s between two looks of a closed, empty hand for something to hold."""
SKIN = 1e-3
"""m by which a suction ray starts outside the cup."""


@dataclass(slots=True)
class _Hand:
    """One hand of one slot."""

    model: HandModel
    slot: int
    tie: int
    body: int
    fingers: tuple[int, ...]
    closed: bool = False
    held: int = -1
    lost: bool = False
    """What it held slipped away; it has to be told to close again."""
    strained: float = 0.0
    searched: float = -math.inf


HandsState = tuple[tuple[tuple[bool, int, bool], ...], NDArray[Any], NDArray[Any], NDArray[Any]]
"""Closed, body held and lost of every hand; then pose, second body and activity of every tie."""


class Hands(Part):
    """All hands and anchors of one model generation."""

    def __init__(self, world: CompiledWorld) -> None:
        self._model = model = world.model
        self._tools: dict[int, tuple[ToolModel, ...]] = {}
        self._anchors: dict[int, int] = {}
        self._hands: dict[int, list[_Hand]] = {}
        bodies: set[int] = set()
        for slot, (robot, layout) in enumerate(zip(world.slots, world.layouts, strict=True)):
            prefix = f"robot{slot}:"
            if robot.robot:
                bodies |= layout.bodies
            if robot.tools:
                self._tools[slot] = robot.tools
            if robot.anchored:
                self._anchors[slot] = model.equality(anchor_name(prefix)).id
            if robot.hands:
                self._hands[slot] = [self._hand(slot, hand) for hand in robot.hands]
        self._bases = [layout.base for layout in world.layouts]
        tools = {self._body(slot, tool.body) for slot in self._tools for tool in self._tools[slot]}
        movable = (model.body_weldid != 0) & (model.body_treeid >= 0)
        movable[sorted(bodies | tools)] = False
        self._movable = movable
        self._all = [hand for hands in self._hands.values() for hand in hands]
        self._ties = np.array(
            [*(hand.tie for hand in self._all), *self._anchors.values()], dtype=np.intp
        )
        self.empty = not self._ties.size

    def _hand(self, slot: int, hand: HandModel) -> _Hand:
        return _Hand(
            model=hand,
            slot=slot,
            tie=self._model.equality(tie_name(f"robot{slot}:", hand.name)).id,
            body=self._body(slot, hand.body),
            fingers=tuple(self._body(slot, finger) for finger in hand.fingers),
        )

    def _body(self, slot: int, name: str) -> int:
        return int(self._model.body(f"robot{slot}:{name}").id)

    # -- coming and going --------------------------------------------------------------------

    def place(self, slot: int, data: mujoco.MjData, pose: Pose) -> None:
        """A slot goes to a new pose: its hands let go, others let go of it, its tools go along."""
        self.drop(int(self._model.body_treeid[self._bases[slot]]), data)
        for hand in self._hands.get(slot, ()):
            self._let_go(data, hand)
            hand.closed = hand.lost = False
        if slot in self._anchors:
            here, turn = pose.position, pose.inverse().quaternion
            self._tie(data, self._anchors[slot], 0, here, (0.0, 0.0, 0.0), turn)
        for tool in self._tools.get(slot, ()):
            body = self._body(slot, tool.body)
            self._put(data, body, pose @ tool.pose)
            for hand in self._hands.get(slot, ()):
                if hand.model.name == tool.holder:
                    self._hold_at_tip(data, hand, body)
                    hand.closed = True

    def drop(self, tree: int, data: mujoco.MjData) -> None:
        """Let go of a body that is about to be put somewhere else."""
        for hand in self._all:
            if hand.held >= 0 and self._model.body_treeid[hand.held] == tree:
                self._let_go(data, hand)

    def state(self, data: mujoco.MjData) -> HandsState:
        """A copy of everything that changes, for `restore`."""
        model, ties = self._model, self._ties
        hands = tuple((hand.closed, hand.held, hand.lost) for hand in self._all)
        return hands, model.eq_data[ties], model.eq_obj2id[ties], data.eq_active[ties]

    def restore(self, data: mujoco.MjData, state: HandsState) -> None:
        """Go back to a copied state of this generation."""
        model, ties = self._model, self._ties
        hands, values, bodies, active = state
        for hand, (closed, held, lost) in zip(self._all, hands, strict=True):
            hand.closed, hand.held, hand.lost, hand.strained = closed, held, lost, data.time
        model.eq_data[ties] = values
        model.eq_obj2id[ties] = bodies
        data.eq_active[ties] = active

    def inherit(
        self, older: Hands, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Take over slots, which are the same there and here, from another generation."""
        for slot in slots:
            pairs = zip(self._hands.get(slot, ()), older._hands.get(slot, ()), strict=True)
            for hand, former in pairs:
                hand.closed, hand.lost = former.closed, former.lost
                hand.strained, hand.searched = former.strained, former.searched
                hand.held = -1
                if former.held >= 0:
                    # Scenery comes first and keeps its numbers; nameless bodies are scenery.
                    name = older._model.body(former.held).name
                    hand.held = int(self._model.body(name).id) if name else former.held
                    self._model.eq_obj2id[hand.tie] = hand.held
                self._copy(data, hand.tie, older, former.tie, old)
            if slot in older._anchors:
                self._copy(data, self._anchors[slot], older, older._anchors[slot], old)

    def _copy(
        self, data: mujoco.MjData, tie: int, older: Hands, former: int, old: mujoco.MjData
    ) -> None:
        self._model.eq_data[tie] = older._model.eq_data[former]
        data.eq_active[tie] = old.eq_active[former]

    def states(self) -> dict[int, dict[str, HandState]]:
        """What all hands are doing, by slot and name."""
        return {
            slot: {
                hand.model.name: HandState(hand.closed, self._name(hand.held, slot))
                for hand in hands
            }
            for slot, hands in self._hands.items()
        }

    def _name(self, body: int, slot: int) -> str | None:
        """Name of a body for users: tools as the robot calls them, something in any case."""
        if body < 0:
            return None
        name = str(self._model.body(body).name) or f"body{body}"
        return name.removeprefix(f"robot{slot}:")

    # -- orders ------------------------------------------------------------------------------

    def operate(self, data: mujoco.MjData, slot: int, name: str, close: bool) -> bool:
        """Close or open a hand of a slot.

        Returns:
            Whether it obeyed: a coupling closes only on a tool, and opens only if it has one;
            false as well if there is no such hand.
        """
        hands = self._hands.get(slot, ())
        hand = next((one for one in hands if one.model.name == name), None)
        if hand is None:
            return False
        if hand.model.grip is Grip.COUPLING:
            return self._couple(data, hand) if close else self._uncouple(data, hand)
        if not close:
            self._let_go(data, hand)
        hand.closed, hand.lost = close, False
        hand.searched = -math.inf
        return True

    def _couple(self, data: mujoco.MjData, hand: _Hand) -> bool:
        if hand.held >= 0:
            return False
        place = _pose(data, hand.body) @ hand.model.tip
        for tool in hand.model.tools:
            body = self._body(hand.slot, tool)
            if any(other.held == body for other in self._hands[hand.slot]):
                continue
            if _fits(place, _pose(data, body), *hand.model.tolerance):
                self._put(data, body, place)
                self._hold_at_tip(data, hand, body)
                hand.closed = True
                return True
        return False

    def _uncouple(self, data: mujoco.MjData, hand: _Hand) -> bool:
        if hand.held < 0:
            return False
        self._let_go(data, hand)
        hand.closed = False
        return True

    # -- between steps -----------------------------------------------------------------------

    def end(self, data: mujoco.MjData) -> None:
        """Let closed hands catch what they meet, and let go what is pulled too hard."""
        for hand in self._all:
            if not hand.closed:
                continue
            if hand.held >= 0:
                self._feel(data, hand)
            elif not hand.lost and data.time - hand.searched >= SEARCH_INTERVAL:
                hand.searched = data.time
                self._search(data, hand)

    def _feel(self, data: mujoco.MjData, hand: _Hand) -> None:
        rows = np.flatnonzero(
            (data.efc_type[: data.ne] == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY))
            & (data.efc_id[: data.ne] == hand.tie)
        )
        force = data.efc_force[rows[:3]] if rows.size else np.zeros(3)
        if hand.model.grip is Grip.SUCTION:
            # What is pushed against a cup stays there.
            ahead = np.array((_pose(data, hand.body) @ hand.model.tip).rotate((1.0, 0.0, 0.0)))
            force = force - min(0.0, float(force @ ahead)) * ahead
        if float(np.linalg.norm(force)) <= hand.model.strength:
            hand.strained = data.time
        elif data.time - hand.strained > SLIP_TIME:
            self._let_go(data, hand)
            hand.lost = True
            # A cup that lost its thing has lost its vacuum; fingers stay closed.
            hand.closed = hand.model.grip is Grip.PINCH

    def _search(self, data: mujoco.MjData, hand: _Hand) -> None:
        if hand.model.grip is Grip.PINCH:
            body = self._pinched(data, hand)
        elif hand.model.grip is Grip.SUCTION:
            body = self._sucked(data, hand)
        else:
            return
        if body >= 0:
            self._hold_where_it_is(data, hand, body)

    def _pinched(self, data: mujoco.MjData, hand: _Hand) -> int:
        """The body that every finger touches, -1 if there is none."""
        if not data.ncon:
            return -1
        pairs = self._model.geom_bodyid[data.contact.geom]
        common: set[int] | None = None
        for finger in hand.fingers:
            touched = set(pairs[pairs[:, 0] == finger, 1].tolist())
            touched |= set(pairs[pairs[:, 1] == finger, 0].tolist())
            common = touched if common is None else common & touched
        found = sorted(body for body in common or () if self._movable[body])
        return found[0] if found else -1

    def _sucked(self, data: mujoco.MjData, hand: _Hand) -> int:
        """The body in front of the cup, -1 if there is none within reach."""
        tip = _pose(data, hand.body) @ hand.model.tip
        ahead = np.array(tip.rotate((1.0, 0.0, 0.0)))
        origin = np.array(tip.position) + SKIN * ahead
        geom = np.full(1, -1, dtype=np.int32)
        distance = mujoco.mj_ray(self._model, data, origin, ahead, None, 1, hand.body, geom, None)
        if geom[0] < 0 or not 0.0 <= distance <= hand.model.reach:
            return -1
        body = int(self._model.geom_bodyid[geom[0]])
        return body if self._movable[body] else -1

    # -- ties --------------------------------------------------------------------------------

    def _hold_at_tip(self, data: mujoco.MjData, hand: _Hand, body: int) -> None:
        """Hold a tool with its origin at the tip."""
        tip = hand.model.tip
        self._tie(data, hand.tie, body, (0.0, 0.0, 0.0), tip.position, tip.quaternion)
        hand.held, hand.strained = body, data.time

    def _hold_where_it_is(self, data: mujoco.MjData, hand: _Hand, body: int) -> None:
        """Hold a thing at the tip, but as it happens to be."""
        carrier, place, tip = _pose(data, hand.body), _pose(data, body), hand.model.tip
        anchor = (place.inverse() @ carrier @ tip).position
        turn = (carrier.inverse() @ place).quaternion
        self._tie(data, hand.tie, body, anchor, tip.position, turn)
        hand.held, hand.strained = body, data.time

    def _tie(
        self,
        data: mujoco.MjData,
        tie: int,
        other: int,
        anchor: Vector,
        point: Vector,
        turn: Quaternion,
    ) -> None:
        """Make a tie hold; the first body of the constraint is what holds.

        Args:
            data, tie: live state, and the constraint.
            other: what is held; 0, the world, for anchors.
            anchor, point: what is held, in the frame of the other body and of the first one.
            turn: orientation of the other body seen from the first one.
        """
        model = self._model
        model.eq_data[tie, 0:3] = anchor
        model.eq_data[tie, 3:6] = point
        model.eq_data[tie, 6:10] = turn
        model.eq_obj2id[tie] = other
        data.eq_active[tie] = 1

    def _let_go(self, data: mujoco.MjData, hand: _Hand) -> None:
        if hand.held < 0:
            return
        data.eq_active[hand.tie] = 0
        self._model.eq_obj2id[hand.tie] = 0
        self._wake(data, hand.held)
        hand.held = -1

    def _put(self, data: mujoco.MjData, body: int, pose: Pose) -> None:
        joint = self._model.body_jntadr[body]
        start = self._model.jnt_qposadr[joint]
        data.qpos[start : start + 7] = root_qpos(pose)
        self._wake(data, body)

    def _wake(self, data: mujoco.MjData, body: int) -> None:
        """Let a body that is held no more, or is elsewhere, notice it."""
        dofs = self._model.dof_treeid == self._model.body_treeid[body]
        data.qvel[dofs & (data.qvel == 0.0)] = WAKE


def _pose(data: mujoco.MjData, body: int) -> Pose:
    return pose_of(data.xpos[body], data.xquat[body])


def _fits(place: Pose, tool: Pose, distance: float, angle: float) -> bool:
    """Whether a tool is near enough: origin, and direction of its x and y axes each."""
    if math.dist(place.position, tool.position) > distance:
        return False
    axes: Sequence[Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    for axis in axes:
        cosine = float(np.dot(place.rotate(axis), tool.rotate(axis)))
        if math.acos(min(1.0, max(-1.0, cosine))) > angle:
            return False
    return True
