"""Several steps in one call: MuJoCo calls servos and compensation in C between its halves.

Where there is a C compiler (`cc`), `steps.c` is compiled once against the headers that MuJoCo's
wheel brings, in a tenth of a second, and kept in the user's cache; elsewhere, on Windows, and with
`USARSIM_NATIVE=0`, numpy does the same between two calls. Both give the same numbers to the bit.

It is a callback of MuJoCo's, which is one of the whole process, because only what MuJoCo's own
package calls can fail without ending the process. Steps that are not made by `NativeSteps` it
leaves alone: those of other threads, of other states, of other users of MuJoCo.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import mujoco

from usarsim_server.base.logs import Log
from usarsim_server.simulation.divergence import SPEED_LIMIT
from usarsim_server.simulation.joint_servos import (
    ARRIVED_SPEED,
    DEAD_SPEED,
    GAIN,
    HOLD_STEPS,
    SETTLED_SPEED,
    STALLED,
    JointServos,
)
from usarsim_server.simulation.native.compiling import load
from usarsim_server.simulation.servos import HOLD_GAIN, HOLD_SPEED, WheelServos

SOURCE = Path(__file__).with_name("steps.c")

_NUMBERS = ("target", "increment", "decrement", "delay", "setpoint", "idle", "hold", "shift")
_ARRAYS = {**dict.fromkeys(_NUMBERS, "f8"), "engaged": "?", "angles": "i8", "dofs": "i8"}
"""The arrays of wheel servos that are worked on, and of which type they have to be."""
_POINTERS = ("model", "data", "joints")
_VALUES = ("timestep", "seen", "gain", "most", "limit")
_FLAGS = ("wheels", "steady", "moving", "compensate", "calls")
_STEADY, _MOVING, _SOUND = 1, 2, 4

_JOINT_VALUES = {
    "gain": GAIN,
    "settled_speed": SETTLED_SPEED,
    "arrived_speed": ARRIVED_SPEED,
    "stalled": STALLED,
    "dead_speed": DEAD_SPEED,
}
_JOINT_NUMBERS = (
    *("low", "high", "max_speed", "slew", "target", "rate", "speed", "here", "shift"),
)
_JOINT_ARRAYS = {
    **dict.fromkeys(_JOINT_NUMBERS, "f8"),
    **dict.fromkeys(("positioned", "under_way"), "?"),
    **dict.fromkeys(("coordinates", "dofs"), "i8"),
}
_JOINT_FLAGS = ("count", "hold_steps", "waited", "holding", "settled", "moving")

_log = Log("simulation")


class _Joints(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_double) for name in _JOINT_VALUES),
        *((name, ctypes.c_void_p) for name in _JOINT_ARRAYS),
        *((name, ctypes.c_int32) for name in _JOINT_FLAGS),
    )


class _Work(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in _POINTERS),
        *((name, ctypes.c_double) for name in _VALUES),
        *((name, ctypes.c_void_p) for name in _ARRAYS),
        *((name, ctypes.c_int32) for name in _FLAGS),
    )


class NativeSteps:
    """Steps of one model generation, for batches in which nothing but servos and contacts works."""

    def __init__(
        self,
        code: ctypes.CDLL,
        wheels: WheelServos,
        joints: JointServos,
        timestep: float,
        compensation: bool,
    ) -> None:
        """Look up where the servos keep their numbers.

        Raises:
            TypeError: if one of their arrays is not as the code takes it.
        """
        self._enter, self._leave, self._wheels = code.enter, code.leave, wheels
        self._work = work = _Work()
        self._arrays = wheels.arrays(_ARRAYS), joints.arrays(_JOINT_ARRAYS)
        """They live as long as their addresses are used."""
        _point(work, _ARRAYS, self._arrays[0])
        self._joints = None if joints.empty else joints
        self._joint_work = limbs = _Joints(**_JOINT_VALUES)
        _point(limbs, _JOINT_ARRAYS, self._arrays[1])
        limbs.count, limbs.hold_steps = len(self._arrays[1]["target"]), HOLD_STEPS
        work.joints = None if joints.empty else ctypes.addressof(limbs)
        work.wheels = len(self._arrays[0]["target"])
        work.timestep = timestep
        work.gain, work.most, work.limit = HOLD_GAIN, HOLD_SPEED, SPEED_LIMIT
        work.compensate = compensation
        self._address = ctypes.addressof(work)

    def step(self, model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> bool | None:
        """Make so many steps, one or more.

        Returns:
            Whether the state is sound afterwards, see `is_sound`; None, and no step is made, while
            MuJoCo's callback is another's.

        Raises:
            RuntimeError: if MuJoCo did not call back once in each of the steps.
        """
        wheels, joints, limbs = self._wheels, self._joints, self._joint_work
        if not self._enter(self._address, data._address, *wheels.course):
            return None
        if joints is not None:
            joints.before(data)
            limbs.waited, limbs.holding, limbs.settled, limbs.moving = joints.course
        try:
            mujoco.mj_step(model, data, steps)
        finally:
            found = int(self._leave(steps))
        if found < 0:
            raise RuntimeError(f"MuJoCo called back {self._work.calls} times in {steps} steps")
        wheels.went_on(found & _STEADY != 0, found & _MOVING != 0)
        if joints is not None:
            flags = limbs.holding, limbs.settled, limbs.moving
            joints.went_on(limbs.waited, *map(bool, flags))
        return found & _SOUND != 0


def _point(work: ctypes.Structure, kinds: Mapping[str, str], arrays: Mapping[str, Any]) -> None:
    """Have a record point to arrays.

    Raises:
        TypeError: if one of them is not as the code takes it.
    """
    for name, kind in kinds.items():
        array = arrays[name]
        if array.dtype != kind or not array.flags.c_contiguous:
            raise TypeError(f"{name}: {array.dtype} where {kind} is worked on")
        setattr(work, name, array.ctypes.data)


def native_steps(
    wheels: WheelServos, joints: JointServos, timestep: float, compensation: bool
) -> NativeSteps | None:
    """What steps a model with these servos; None where numpy has to."""
    if type(wheels) is not WheelServos:
        return None
    code, _ = library()
    return None if code is None else NativeSteps(code, wheels, joints, timestep, compensation)


@cache
def library() -> tuple[ctypes.CDLL | None, str]:
    """The compiled code; or None, and why it cannot be had."""
    root = Path(mujoco.__file__).parent
    engine = next((one for one in sorted(root.glob("libmujoco*")) if one.is_file()), None)
    try:
        if engine is None or not hasattr(mujoco.MjData, "_address"):
            raise OSError("not for this system, or this version of MuJoCo")
        code = load(ctypes.PyDLL, SOURCE, f"-I{root / 'include'}", str(engine))
        pointer, number = ctypes.c_void_p, ctypes.c_int
        code.enter.argtypes, code.leave.argtypes = (pointer, pointer, number, number), (number,)
    except (OSError, AttributeError) as error:
        reason = str(error)
        _log.info("steps are not compiled; numpy does the same, slower", reason=reason)
        return None, reason
    return code, ""
