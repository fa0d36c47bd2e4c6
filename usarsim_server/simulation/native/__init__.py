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
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from stat import S_ISDIR

import mujoco
import numpy as np

from usarsim_server.logs import Log
from usarsim_server.simulation.servos import HOLD_GAIN, HOLD_SPEED, WheelServos

SOURCE = Path(__file__).with_name("steps.c")
OPTIONS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""Without contraction: a product and a sum are rounded one after the other, as numpy does it."""
COMPILING = 30.0
"""s of wall time after which the compiler counts as lost."""

_NUMBERS = ("target", "increment", "decrement", "delay", "setpoint", "idle", "hold", "shift")
_ARRAYS = {**dict.fromkeys(_NUMBERS, "f8"), "engaged": "?", "angles": "i8", "dofs": "i8"}
"""The arrays of wheel servos that are worked on, and of which type they have to be."""
_FLAGS = ("wheels", "steady", "moving", "compensate", "calls")

_log = Log("simulation")


class _Work(ctypes.Structure):
    _fields_ = (
        ("data", ctypes.c_void_p),
        *((name, ctypes.c_double) for name in ("timestep", "seen", "gain", "most")),
        *((name, ctypes.c_void_p) for name in _ARRAYS),
        *((name, ctypes.c_int32) for name in _FLAGS),
    )


class NativeSteps:
    """Steps of one model generation, for batches in which nothing but wheels and contacts works."""

    def __init__(
        self, code: ctypes.PyDLL, wheels: WheelServos, timestep: float, compensation: bool
    ) -> None:
        """Look up where the servos keep their numbers.

        Raises:
            TypeError: if one of their arrays is not as the code takes it.
        """
        self._code, self._wheels = code, wheels
        self._work = work = _Work()
        self._arrays = wheels.arrays()  # which live as long as their addresses are used
        for name, kind in _ARRAYS.items():
            array = self._arrays[name]
            if array.dtype != kind or not array.flags.c_contiguous:
                raise TypeError(f"{name}: {array.dtype} where {kind} is worked on")
            setattr(work, name, array.ctypes.data)
        work.wheels = len(self._arrays["target"])
        work.timestep = timestep
        work.gain, work.most = HOLD_GAIN, HOLD_SPEED
        work.compensate = compensation
        self._address = ctypes.addressof(work)

    def step(self, model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> bool:
        """Make so many steps; False, and none is made, while MuJoCo's callback is another's.

        Raises:
            RuntimeError: if MuJoCo did not call back once in each of the steps.
        """
        work, wheels = self._work, self._wheels
        work.data, work.seen, work.calls = data._address, np.nan, 0
        work.steady, work.moving = wheels.course
        try:
            if not self._code.enter(self._address):
                return False
            mujoco.mj_step(model, data, steps)
        finally:
            self._code.enter(None)
        if work.calls != steps:
            raise RuntimeError(f"MuJoCo called back {work.calls} times in {steps} steps")
        wheels.went_on(bool(work.steady), bool(work.moving))
        return True


def native_steps(wheels: WheelServos, timestep: float, compensation: bool) -> NativeSteps | None:
    """What steps a model with these servos; None where numpy has to."""
    if type(wheels) is not WheelServos:
        return None
    code, _ = library()
    return None if code is None else NativeSteps(code, wheels, timestep, compensation)


@cache
def library() -> tuple[ctypes.PyDLL | None, str]:
    """The compiled code; or None, and why it cannot be had."""
    if os.environ.get("USARSIM_NATIVE") == "0":
        return None, "USARSIM_NATIVE is 0"
    try:
        code = ctypes.PyDLL(str(_compiled()))
        code.enter.argtypes, code.enter.restype = (ctypes.c_void_p,), ctypes.c_int
    except (OSError, RuntimeError, AttributeError, subprocess.SubprocessError) as error:
        reason = str(error)
        _log.info("steps are not compiled; numpy does the same, slower", reason=reason)
        return None, reason
    return code, ""


def _compiled() -> Path:
    """The file of the compiled code, made if it is not there yet.

    Raises:
        OSError, RuntimeError, subprocess.SubprocessError: if it cannot be had.
    """
    root = Path(mujoco.__file__).parent
    engine = next((one for one in sorted(root.glob("libmujoco*")) if one.is_file()), None)
    compiler = shutil.which("cc")
    if os.name != "posix" or engine is None or not hasattr(mujoco.MjData, "_address"):
        raise OSError("not for this system, or this version of MuJoCo")
    if compiler is None:
        raise OSError("no C compiler (cc)")
    made_of = (SOURCE.read_bytes(), *(str(one).encode() for one in (OPTIONS, engine, compiler)))
    name = hashlib.sha256(b"|".join((*made_of, platform.machine().encode()))).hexdigest()[:16]
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "usarsim", "steps")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    state = folder.lstat()
    if not S_ISDIR(state.st_mode) or state.st_uid != os.getuid() or state.st_mode & 0o022:
        raise OSError(f"{folder}: others may write there")
    file = folder / f"{name}.so"
    if not file.exists():
        with tempfile.TemporaryDirectory(dir=folder) as made:
            target = Path(made, file.name)
            words = (compiler, *OPTIONS, f"-I{root / 'include'}", str(SOURCE), str(engine))
            subprocess.run(
                (*words, "-o", str(target)), check=True, capture_output=True, timeout=COMPILING
            )
            target.replace(file)  # whole or not at all, whoever else does the same
    return file
