"""Several steps in one call: MuJoCo calls servos and compensation in C between its halves.

Where there is a C compiler (`cc`), `steps.c` is compiled once against the headers that MuJoCo's
wheel brings, in a tenth of a second, and kept in the user's cache; elsewhere, on Windows, and with
`USARSIM_NATIVE=0`, numpy does the same between two calls. Both give the same numbers to the bit.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from usarsim_server.logs import Log
from usarsim_server.simulation.servos import HOLD_GAIN, HOLD_SPEED, JointServos, WheelServos

SOURCE = Path(__file__).with_name("steps.c")
OPTIONS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""Without contraction: a product and a sum are rounded one after the other, as numpy does it."""
COMPILING = 30.0
"""s of wall time after which the compiler counts as lost."""

_ARRAYS = ("target", "increment", "decrement", "delay", "setpoint", "idle", "hold", "shift")
_POINTERS = (*_ARRAYS, "engaged", "angles", "dofs")
_FLAGS = ("wheels", "steady", "moving", "compensate", "calls")

_log = Log("simulation")


class _Work(ctypes.Structure):
    _fields_ = (
        ("data", ctypes.c_void_p),
        *((name, ctypes.c_double) for name in ("timestep", "seen", "gain", "most")),
        *((name, ctypes.c_void_p) for name in _POINTERS),
        *((name, ctypes.c_int32) for name in _FLAGS),
    )


class NativeSteps:
    """Steps of one model generation, for batches in which nothing but wheels and contacts works."""

    def __init__(
        self, code: ctypes.PyDLL, wheels: WheelServos, timestep: float, compensation: bool
    ) -> None:
        self._code, self._wheels = code, wheels
        self._work = work = _Work()
        self._arrays = wheels.arrays()
        for name, array in self._arrays.items():
            setattr(work, name, array.ctypes.data)
        work.wheels = len(self._arrays["target"])
        work.timestep = timestep
        work.gain, work.most = HOLD_GAIN, HOLD_SPEED
        work.compensate = compensation
        self._address = ctypes.addressof(work)

    def step(self, model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> None:
        """Make so many steps.

        Raises:
            RuntimeError: if somebody else took MuJoCo's `mjcb_control`.
        """
        work, wheels = self._work, self._wheels
        work.data, work.seen, work.calls = data._address, np.nan, 0
        work.steady, work.moving = wheels.course
        self._code.enter(self._address)
        try:
            mujoco.mj_step(model, data, steps)
        finally:
            self._code.enter(None)
        if work.calls != steps:
            raise RuntimeError("MuJoCo did not call back: something else has set mjcb_control")
        wheels.went_on(bool(work.steady), bool(work.moving))


def native_steps(
    wheels: WheelServos, joints: JointServos, timestep: float, compensation: bool
) -> NativeSteps | None:
    """What steps a model with these servos; None if there is no compiler, or other servos."""
    if type(wheels) is not WheelServos or joints.count:
        return None
    code = library()
    return None if code is None else NativeSteps(code, wheels, timestep, compensation)


@cache
def library() -> ctypes.PyDLL | None:
    """The compiled code, set as MuJoCo's callback of this process; None where it cannot be had."""
    if os.environ.get("USARSIM_NATIVE") == "0" or os.name != "posix":
        return None
    try:
        code = ctypes.PyDLL(str(_compiled()))
    except (OSError, subprocess.SubprocessError) as error:
        _log.info("steps are not compiled; numpy does the same, slower", reason=str(error))
        return None
    code.enter.argtypes, code.enter.restype = (ctypes.c_void_p,), None
    mujoco.set_mjcb_control(code.control)
    return code


def _compiled() -> Path:
    """The file of the compiled code, made if it is not there yet."""
    root = Path(mujoco.__file__).parent
    engine = next((one for one in sorted(root.glob("libmujoco*")) if one.is_file()), None)
    compiler = shutil.which("cc")
    if compiler is None or engine is None:
        raise OSError("no C compiler" if compiler is None else "MuJoCo's library is not found")
    made_of = (SOURCE.read_bytes(), *(str(one).encode() for one in (OPTIONS, engine, compiler)))
    name = hashlib.sha256(b"|".join((*made_of, platform.machine().encode()))).hexdigest()[:16]
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "usarsim")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    state = folder.stat()
    if state.st_uid != os.getuid() or state.st_mode & 0o022:
        raise OSError(f"{folder}: others may write there")
    file = folder / f"steps-{name}.so"
    if not file.exists():
        with tempfile.TemporaryDirectory(dir=folder) as made:
            target = Path(made, file.name)
            words = (compiler, *OPTIONS, f"-I{root / 'include'}", str(SOURCE), str(engine))
            subprocess.run(
                (*words, "-o", str(target)), check=True, capture_output=True, timeout=COMPILING
            )
            target.replace(file)
    return file
