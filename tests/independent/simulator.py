"""Runs of simulator.c: compiled at the first use into the user's temporary folder, called through ctypes."""

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .linear import equilibrium_angle
from .problem import KINDS

SOURCE = Path(__file__).with_name("simulator.c")
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
SIZE = 22
"""Numbers in the C code's ``worst``."""


class Run(NamedTuple):
    """The worst values along one scenario; ``*_at`` the times [s]. Angles in rad.

    ``fallen``: when |theta| reached 90 degrees, or None; ``abandoned``: when a contact force came below the level at
    which the run was to be given up, or None. ``t`` and ``angles`` are the samples.
    """

    toe_force: float
    toe_force_at: float
    heel_force: float
    heel_force_at: float
    cop_margin: float
    cop_margin_at: float
    torque: float
    torque_at: float
    torque_rate: float
    torque_rate_at: float
    friction: float
    friction_at: float
    settling: float
    settled_at: float
    overshoot: float
    overshoot_at: float
    posture_error: float
    theta: float
    omega: float
    s: float
    fallen: float | None
    abandoned: float | None
    t: np.ndarray
    angles: np.ndarray


@cache
def library():
    """The compiled simulator; raises ``RuntimeError`` where there is no C compiler."""
    if COMPILER is None:
        message = "no C compiler (cc, gcc or clang) on PATH"
        raise RuntimeError(message)
    digest = hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:16]
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"poise-independent-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if hasattr(os, "getuid") and folder.stat().st_uid != user:
        message = f"{folder} belongs to somebody else; remove it"
        raise RuntimeError(message)
    built = folder / f"simulator-{digest}.so"
    if not built.exists():
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            target = Path(scratch) / "simulator.so"
            command = [COMPILER, "-O2", "-shared", "-fPIC", "-o", str(target), str(SOURCE), "-lm"]
            subprocess.run(command, check=True, capture_output=True, text=True)
            target.replace(built)
    run = ctypes.CDLL(str(built)).simulate
    pointer = ctypes.c_void_p
    run.argtypes = [
        pointer, ctypes.c_int, pointer, ctypes.c_int, ctypes.c_int, pointer, pointer, ctypes.c_double, ctypes.c_double,
        ctypes.c_double, ctypes.c_double, pointer, pointer, pointer,
    ]  # fmt: skip
    run.restype = ctypes.c_int
    return run


def simulate(problem, scenario, gains, step=None, give_up=-np.inf):
    """The run of ``scenario`` with ``gains`` (K_p, K_d, K_f); ``step`` [s] is the spec's if left out."""
    step = step or problem.step
    room = int(scenario.duration / step) + 3 * len(scenario.pieces) + 4
    t, angles, worst = np.empty(room), np.empty(room), np.empty(SIZE)
    law = np.array([*gains, problem.theta_d, problem.target], dtype=float)
    start = np.array([scenario.theta, scenario.omega])
    rest = equilibrium_angle(problem, *final_force(problem, scenario))
    count = library()(
        problem.body.ctypes.data, KINDS.index(problem.kind), law.ctypes.data, scenario.world,
        len(scenario.pieces), scenario.pieces.ctypes.data, start.ctypes.data, step, scenario.steady_from, rest, give_up,
        worst.ctypes.data, t.ctypes.data, angles.ctypes.data,
    )  # fmt: skip
    numbers = worst.tolist()
    fallen, abandoned = (None if each < 0 else each for each in numbers[20:])
    return Run(*numbers[:20], fallen, abandoned, t[:count], angles[:count])


def final_force(problem, scenario):
    """(F_x, F_y) [N] at the end of ``scenario``."""
    first, second = scenario.pieces[-1, 4:6].tolist()
    return tuple(force_of(problem, scenario, np.array([first]), np.array([second]))[:, 0].tolist())


def force_of(problem, scenario, first, second):
    """(F_x, F_y) (2, n) [N] of signals, each (n,); (21) on a slope."""
    if not scenario.is_slope:
        return np.array([first, second])
    M, g = problem.body[0], problem.body[7]
    return M * g * np.array([np.sin(first), 1.0 - np.cos(first)])
