"""Recordings of known truth in five formats, for tests.

The truth is made here: forces and CoP of each plate, moments by the cross product, the CoP of all by their sum.
"""

import io

import numpy as np
import pytest
from c3d_writer import c3d

from design.model.body import Biped

BODY = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12)
RATE, N = 50.0, 500
T = np.arange(N) / RATE
SWAY = np.sin(2 * np.pi * T)
SHARES = {
    "1": [1 + 0 * T], "2": [0.45 + 0.2 * np.sin(0.7 * T), 0.55 - 0.2 * np.sin(0.7 * T)],
    "3": [0.3 + 0.1 * np.sin(T), 0.3 - 0.1 * np.sin(T), 0.4 + 0 * T],
    "empty first": [0 * T, 0.4 + 0.1 * np.sin(T), 0.6 - 0.1 * np.sin(T)],
    "empty last": [0.4 + 0.1 * np.sin(T), 0.6 - 0.1 * np.sin(T), 0 * T],
}  # fmt: skip
AXES = {"z up, x forward": ("z", "x"), "z up, y forward": ("z", "y"), "z up, -x forward": ("z", "-x"),
        "y up, x forward": ("y", "x"), "y up, z forward": ("y", "z")}  # fmt: skip
UNIT = {axis: np.eye(3)["xyz".index(axis)] for axis in "xyz"}
ORIGINS = [0.4, 0.5, 0.45]
TOTAL = 687 + 3 * np.sin(1.3 * T)


def direction(axis):
    return (-1 if axis.startswith("-") else 1) * UNIT[axis[-1]]


class Truth:
    """Forces, CoPs and moments (3, n) of each plate, and the vertical force, CoP and forward force of all."""

    def __init__(self, plates, up, forward):
        u, f = direction(up), direction(forward)
        s = np.cross(u, f)
        self.F, self.P, self.M, self.O = [], [], [], []
        load, moment, push = 0.0, 0.0, 0.0
        for k, share in enumerate(SHARES[plates]):
            empty = not share.any()
            fz = np.where(empty, 0.3, share * TOTAL)
            x = 0.45 + 0.03 * k + 0.01 * SWAY + 0.004 * np.cos(0.4 * T)
            side = -0.1 + 0.2 * k + 0 * T
            fx = np.where(empty, 0.1, share * -5 * SWAY + (3 if k % 2 else -3) * (plates != "1"))
            F = u[:, None] * fz + f[:, None] * fx + s[:, None] * (0.5 * share)
            P = f[:, None] * x + s[:, None] * side
            O = f * ORIGINS[k] + s * side[0]
            self.F.append(F)
            self.P.append(P * (not empty))
            self.M.append(np.cross(P - O[:, None], F, axis=0))
            self.O.append(O)
            if not empty:
                load, moment, push = load + fz, moment + fz * x, push + fx
        self.load, self.cop, self.push = load, moment / load, push
        self.loaded = sum(share.any() for share in SHARES[plates])


def columns(truth, sign, names):
    """Names and values of a table with the forces on the foot (``sign`` 1) or on the plate (-1)."""
    listed = {"Time": T}
    for k, (F, P, M) in enumerate(zip(truth.F, truth.P, truth.M, strict=True), start=1):
        for a, axis in enumerate("xyz"):
            listed[names["force"].format(k, axis)] = sign * F[a]
            listed[names["cop"].format(k, axis)] = P[a]
            if "moment" in names:
                listed[names["moment"].format(k, axis)] = sign * M[a]
    return listed


PLAIN = {"force": "F{1}{0}", "cop": "COP{1}{0}", "moment": "M{1}{0}"}
OPENSIM = {"force": "{0}_ground_force_v{1}", "cop": "{0}_ground_force_p{1}"}


def as_csv(truth, sign):
    table = columns(truth, sign, PLAIN)
    rows = "".join(",".join(f"{x:.9g}" for x in row) + "\n" for row in zip(*table.values(), strict=True))
    return (",".join(table) + "\n" + rows).encode(), PLAIN, "trial.csv"


def as_mot(truth, sign):
    table = columns(truth, sign, OPENSIM)
    rows = "".join("\t".join(f"{x:.9g}" for x in row) + "\n" for row in zip(*table.values(), strict=True))
    return ("grf.mot\nversion=1\nendheader\n" + "\t".join(table).lower() + "\n" + rows).encode(), OPENSIM, "trial.mot"


def as_npz(truth, sign):
    out = io.BytesIO()
    np.savez(out, **columns(truth, sign, PLAIN))
    return out.getvalue(), PLAIN, "trial.npz"


def as_xlsx(truth, sign):
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl is not installed")
    workbook, out, table = openpyxl.Workbook(), io.BytesIO(), columns(truth, sign, PLAIN)
    workbook.active.append(list(table))
    for row in zip(*table.values(), strict=True):
        workbook.active.append([float(x) for x in row])
    workbook.save(out)
    return out.getvalue(), PLAIN, "trial.xlsx"


def as_c3d(truth, sign, **form):
    pytest.importorskip("ezc3d", reason="ezc3d is not installed")
    square = np.array([[0.3, -0.3, -0.3, 0.3], [0.2, 0.2, -0.2, -0.2], [0, 0, 0, 0]])
    analog = np.concatenate([np.concatenate([sign * F, 1e3 * sign * M]) for F, M in zip(truth.F, truth.M, strict=True)])
    count = len(truth.F)
    content = c3d(
        analog, rate=RATE, labels=[f"{q}{a}{k}" for k in range(count) for q in "FM" for a in "xyz"],
        units=(["N"] * 3 + ["Nmm"] * 3) * count, corners=[1e3 * (square + O[:, None]) for O in truth.O],
        origins=[[0, 0, 0]] * count, **form,
    )  # fmt: skip
    return content, {key: name if count > 1 else name.replace("{0}", "") for key, name in PLAIN.items()}, "trial.c3d"


FORMATS = {"csv": as_csv, "OpenSim": as_mot, "npz": as_npz, "xlsx": as_xlsx, "C3D": as_c3d}
