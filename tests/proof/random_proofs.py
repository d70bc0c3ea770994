"""Random loops, worlds and boxes, with what is true of them by an integrator and equations of their own.

    python -m tests.proof.random_proofs --count 100 --seed 1

Each case demands one quantity (contact force, CoP margin, torque or decay rate) at a level just inside or just outside
its worst value, or with room for a proof. The worst value is that of the box's middle, corners and random points, by
SciPy's DOP853 while the force moves, and Radau's method after that and of stiff loops. Drawn are also boxes of
slopes around 0, sudden and uncertain ramps, jumps at the end and just before it, points after the end, scenarios cut
while the force moves, multiple poles, slow and fast ones, bodies almost without inertia, feet without mass, slopes that
load the foot, and laws that adapt.
"""

import argparse
import itertools
import json
import math
import sys
import time
import warnings
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.integrate import solve_ivp

from design.present.proving import proved_in
from design.spec.load import parse
from design.spec.setting import setting

G = 9.81
NAMES = ("M", "L", "I", "m", "ell", "slope", "ramp")
WRONG = ("FALSE PROVED", "FALSE DISPROVED", "FALSE EVERY TIME", "unknown with room")
ROOM = 0.01
"""Of the weight, the half length, the torque and the decay rate: what is to spare where a proof is expected."""
ROWS = {"contact": "contact_force_n", "cop": "cop_margin_m", "torque": "torque_nm", "decay": "decay_rate_per_s"}
OFFSETS = (-0.01, -0.001, 0.001, 0.01)
"""How far beyond the worst value a level may be, in the same parts as ``ROOM``."""
EVALUATIONS = 100_000
"""Of the equations, after which a piece is given up."""


@dataclass
class Random:
    """A loop in a world over a box: numbers by ``NAMES`` [SI, degrees], half-widths alike, corners (t, values).

    ``level`` of ``row`` is demanded; ``worst`` are the worst values by row over all times at which the force is known
    (``ever``: also after the end); ``adapt`` [s], ``aim`` is the desired angle [deg]; ``loads``: slopes load the foot.
    """

    number: dict
    half: dict
    kind: str
    corners: list
    duration: float
    start: tuple
    law: str
    gains: tuple
    step: float
    poles: list
    aim: float = 0.0
    adapt: float = math.inf
    loads: bool = False
    row: str = "contact"
    level: float = 0.0
    worst: dict = None
    until: dict | None = None
    ever: bool = True
    spare: bool = False

    def text(self):
        """The spec."""
        n, h = self.number, self.half
        lines = ["schema_version = 1", 'name = "random"', "[body]", f"mass_kg = {n['M']!r}",
                 f"com_height_m = {n['L']!r}", f"inertia_kgm2 = {n['I']!r}", "[foot]", f"mass_kg = {n['m']!r}",
                 f"half_length_m = {n['ell']!r}", *(["ground_loads = true"] if self.loads else []), "[[scenarios]]",
                 'name = "s"', f'kind = "{self.kind}"']  # fmt: skip
        last = self.corners[-1][1]
        if self.kind == "slope":
            lines += [f"angle_deg = {n['slope']!r}", f"ramp_s = {n['ramp']!r}"]
        elif self.kind == "force":
            lines += [f"fx_n = {last[0]!r}", f"fy_n = {last[1]!r}", f"ramp_s = {n['ramp']!r}"]
        else:
            key = "acceleration_mps2" if self.kind == "platform" else "points"
            lines.append(f"{key} = {json.dumps([[t, *value] for t, value in self.corners])}")
        lines += [f"duration_s = {self.duration!r}", f"initial_angle_deg = {self.start[0]!r}",
                  f"initial_rate_deg_per_s = {self.start[1]!r}", "[law]", f'kind = "{self.law}"',
                  *(f"{key} = {gain!r}" for key, gain in zip(("kp", "kd", "kf"), self.gains, strict=True)),
                  f"desired_angle_deg = {self.aim!r}",
                  *([f"adapt_s = {self.adapt!r}"] if math.isfinite(self.adapt) else []),
                  "[requirements]", f"{ROWS[self.row]} = {max(self.level, 0.0)!r}", "[simulation]",
                  f"time_step_s = {self.step!r}", "[uncertainty]"]  # fmt: skip
        keys = ("mass_kg", "com_height_m", "inertia_kgm2", "foot_mass_kg", "half_length_m", "slope_deg", "ramp_s")
        lines += [f"{key} = {h[name]!r}" for key, name in zip(keys, NAMES, strict=True) if h[name]]
        return "\n".join(lines) + "\n"


def drawn(rng):
    """A case whose foot may stand, without a demand."""
    M, ell = float(rng.uniform(15, 110)), float(rng.uniform(0.06, 0.14))
    L = float(rng.uniform(0.35, 1.1))
    inertia = rng.uniform(1.02, 1.4) if rng.random() < 0.85 else 10 ** rng.uniform(-2.5, -0.5)
    foot = float(rng.uniform(0.2, 3.0)) if rng.random() < 0.85 else 0.0
    number = {"M": M, "L": L, "I": float(inertia) * M * L**2, "m": foot, "ell": ell, "slope": 0.0, "ramp": 0.0}
    law = str(rng.choice(["force", "force", "force", "force", "pd", "cop", "adapt"]))
    poles = _poles(rng, 2 if law == "pd" else 3)
    gains = _gains(number, poles, law)
    adapt = float(10 ** rng.uniform(0.3, 1.8)) if law == "adapt" else math.inf
    kind = str(rng.choice(["slope", "slope", "slope", "force", "platform", "profile"]))
    far = float(rng.uniform(0.2, 0.9)) * ell / L  # what a horizontal force may be, in parts of the weight, if sudden
    start = (0.0, 0.0) if rng.random() < 0.6 else (float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-3, 3)))
    aim = 0.0 if rng.random() < 0.8 else float(rng.uniform(-0.5, 0.5))
    ramp = 0.0 if rng.random() < 0.4 else float(rng.uniform(0.2, 4.0))
    corners = [(0.0, (1.0,))]
    sign = float(rng.choice([-1.0, 1.0]))
    part, degrees = float(rng.choice([0.0, 0.0, 0.005, 0.01, 0.02])), float(rng.choice([0.0, 0.5, 1.0, 2.0]))
    if kind == "slope":
        angle = sign * math.degrees(far) * (1 if ramp < 1 or law == "pd" else 2)
        number["slope"] = angle * float(rng.choice([0.0, 0.1, 1.0], p=[0.2, 0.1, 0.7])) + 0.0  # no -0.0
        number["ramp"] = ramp
    elif kind == "force":
        number["ramp"] = ramp
        corners = [(0.0, (sign * far * M * G, float(rng.uniform(-0.1, 0.1)) * M * G))]
    else:
        times = [0.0, *np.cumsum(rng.uniform(0.05, 1.5, int(rng.integers(2, 6)))).tolist()]
        if rng.random() < 0.4:
            times[2] = times[1]
        size = (far * G,) if kind == "platform" else (far * M * G, 0.05 * M * G)
        corners = [(t, tuple(float(rng.uniform(-1, 1)) * each for each in size)) for t in times]
    if kind in ("slope", "force") and ramp:
        corners = [(0.0, (0.0,) * len(corners[0][1])), (ramp, corners[0][1])]
    half = dict.fromkeys(NAMES, 0.0)
    if part:
        for name in NAMES[:5]:
            half[name] = part * number[name] if rng.random() < 0.6 else 0.0
    if kind == "slope" and (part or rng.random() < 0.3):
        half["slope"] = degrees
    if rng.random() < 0.4:
        half["ramp"] = float(rng.choice([0.005, 0.02, 0.1])) * number["ramp"]
    duration = float(corners[-1][0] + rng.uniform(0.5, 5.0))
    if kind in ("platform", "profile"):
        corners, duration = _ended(rng, corners, duration)
    elif rng.random() < 0.1 and not half["ramp"] and ramp:
        duration = float(rng.uniform(0.3, 1.0)) * ramp  # the ramp is cut off, or ends with the scenario
    return Random(
        number, half, kind, corners, duration, start, "force" if law == "adapt" else law, gains,
        float(10 ** rng.uniform(-5, -2)), poles, aim, adapt, kind == "slope" and rng.random() < 0.3,
    )  # fmt: skip


def _ended(rng, corners, duration):
    """Corners and duration of a scenario that ends in one of several ways."""
    (last, value), way = corners[-1], rng.choice(["rests", "jumps", "just before", "after", "same after", "cut", "at"])
    other = tuple(0.5 * each for each in corners[0][1])
    if way == "jumps":
        return [*corners, (duration, value), (duration, other)], duration
    if way == "just before":
        before = duration - float(10 ** rng.uniform(-6, -2))
        return [*corners, (before, value), (before, other)], duration
    if way == "after":
        return [*corners, (duration, value), (duration + float(rng.choice([1e-9, 0.5])), other)], duration
    if way == "same after":
        return [*corners, (duration + 1.0, value), (duration + 2.0, value)], duration
    if way == "cut":
        return corners, float(corners[-2][0] + 0.6 * (last - corners[-2][0])) or duration
    return corners, last if way == "at" else duration


def _poles(rng, n):
    slow = 10 ** (rng.uniform(math.log10(0.002), math.log10(0.07)) if rng.random() < 0.5 else rng.uniform(-0.3, 0.6))
    omega = 10 ** (rng.uniform(0.5, 1.6) if rng.random() < 0.85 else rng.uniform(1.6, 2.5))
    kind = rng.random()
    if kind < 0.2:  # multiple, or almost
        pair = [-omega, -omega * (1 + float(rng.choice([0.0, 1e-9, 1e-6, 1e-3])))]
        slow = omega if rng.random() < 0.4 else slow
    elif kind < 0.6:
        damping = rng.uniform(0.3, 1.0)
        pair = [-omega * complex(damping, s * math.sqrt(1 - damping**2)) for s in (1, -1)]
    else:
        pair = [-omega, -omega * 10 ** rng.uniform(0, 1)]
    return [complex(p) for p in ([-slow, *pair] if n == 3 else pair if rng.random() < 0.5 else [-slow, pair[0].real])]


def _gains(n, poles, law):
    p = np.real(np.poly(poles))
    AL = n["M"] * G * n["L"]
    if law == "pd":
        return float(p[2] * n["I"] + AL), float(p[1] * n["I"]), 0.0
    K_f = p[3] * n["I"] * n["ell"] / AL
    return float(p[2] * n["I"] + AL), float((p[1] + K_f / n["ell"]) * n["I"]), float(K_f)


def rests(case):
    """Whether the force keeps after the end the value that it has there."""
    at = _signal(case, case.duration - 1e-12), _signal(case, case.duration)
    return all(value == tuple(at[1]) for t, value in case.corners if t >= case.duration) and np.allclose(*at, rtol=1e-9)


def _signal(case, t):
    return _value(case.corners, max(k for k, (time, _) in enumerate(case.corners) if time <= max(t, 0.0)), t)


def worst(case, points, watch):
    """The least contact force [N] and CoP margin [m] and the largest torque [N m] at each of the ``points`` (w, 7).

    By row, twice: until the end, and also after it, where the force rests. Infinitely bad of bodies that fall.
    """
    v = {name: case.number[name] + case.half[name] * points[:, k] for k, name in enumerate(NAMES)}
    K_p, K_d, K_f = case.gains
    n, w = case.number, len(points)
    weight, aim = (n["M"] + n["m"]) * G, math.radians(case.aim)

    def parts(x, signal):
        theta, omega, s, desired = x
        tau = -K_p * (theta - desired) - K_d * omega + K_f * s
        foot = v["m"] * G
        if case.kind == "slope":
            alpha = np.radians(v["slope"]) * signal[0]
            across, down = v["M"] * G * np.sin(theta + alpha), v["M"] * G * np.cos(alpha)
            foot = foot * (np.cos(alpha) if case.loads else 1.0)
        else:
            F_x = -v["M"] * signal[0] if case.kind == "platform" else signal[0]
            down = v["M"] * G - (0.0 if case.kind == "platform" else signal[1])
            across = down * np.sin(theta) + F_x * np.cos(theta)
        turning = (v["L"] * across + tau) / v["I"]
        load = foot + down - v["M"] * v["L"] * (turning * np.sin(theta) + omega**2 * np.cos(theta))
        grows = {"pd": 0.0 * tau, "force": tau / v["ell"], "cop": tau / v["ell"] * weight / load}[case.law]
        follows = 0.0 * tau
        if math.isfinite(case.adapt):  # the law knows the nominal body
            lever = n["M"] * G * n["L"]
            follows = (theta - desired + (n["ell"] * grows - n["I"] * turning) / lever) / case.adapt
        row = {"contact": 0.5 * (load - np.abs(tau) / v["ell"]), "cop": v["ell"] - np.abs(tau) / load,
               "torque": np.abs(tau)}  # fmt: skip
        return np.array([omega, turning, grows, follows]), row

    x = np.zeros((4, w))
    x[0], x[1] = np.radians(case.start)[:, None]
    x[3] = aim
    fallen = {"contact": np.full(w, -np.inf), "cop": np.full(w, -np.inf), "torque": np.full(w, np.inf)}
    found, until = {row: -value for row, value in fallen.items()}, None
    times = sorted({0.0, case.duration, *(t for t, _ in case.corners if t < case.duration)})
    stretch = v["ramp"] / case.number["ramp"] if case.half["ramp"] else np.ones(w)
    stiff = max(abs(pole) for pole in case.poles) > 300
    after = [(case.duration, case.duration + watch)] if case.ever else []
    for begin, end in [*itertools.pairwise(times), *after]:
        if begin >= case.duration:
            until = dict(found)
        if found["contact"].min() <= 0:  # what a lifted foot does is not asked
            return fallen, fallen
        evaluated = itertools.count()
        at = max(k for k, (t, _) in enumerate(case.corners) if t <= begin)
        ends = [np.array(_value(case.corners, at, t)) for t in (begin, end)]
        if begin >= case.duration:
            ends = [np.array(_signal(case, case.duration))] * 2
        length = (end - begin) * (stretch if end <= case.number["ramp"] else np.ones(w))

        def rate(share, flat, ends=ends, length=length, evaluated=evaluated):
            if next(evaluated) > EVALUATIONS:
                raise ValueError
            return (length * parts(flat.reshape(4, w), ends[0] + share * (ends[1] - ends[0]))[0]).ravel()

        shares = np.append(0.0, np.geomspace(1e-6, 1, 600))  # a fast pole is seen after a corner, a slow one later
        if begin < case.duration:
            shares = np.union1d(shares, np.linspace(0, 1, 2 + int(min(max((end - begin) * 300, 100), 1500))))
        method, options = "DOP853", {}
        if begin >= case.duration or stiff:
            method, options = "Radau", {"jac_sparsity": sparse.kron(np.ones((4, 4)), sparse.eye(w))}
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):  # bodies that fall
                run = solve_ivp(rate, (0, 1), x.ravel(), method, t_eval=shares, rtol=1e-9, atol=1e-9, events=_fallen,
                                **options)  # fmt: skip
        except ValueError:  # states that are no longer numbers, or swing without end
            return fallen, fallen
        if run.status != 0 or not np.isfinite(run.y).all() or np.abs(run.y[:w]).max() > 1.4:
            return fallen, fallen
        for share, state in zip(run.t, run.y.T, strict=True):
            values = parts(state.reshape(4, w), ends[0] + share * (ends[1] - ends[0]))[1]
            for row, value in values.items():
                found[row] = (np.maximum if row == "torque" else np.minimum)(found[row], value)
        x = run.y[:, -1].reshape(4, w)
    return (until or found), found


def _fallen(_, flat):
    return 1.4 - float(np.abs(flat[: len(flat) // 3]).max())


_fallen.terminal = True


def slowest(case, points):
    """The least decay rate [1/s] of the loops at rest at the ``points`` (w, 7), under all that the signal comes to."""
    K_p, K_d, K_f = case.gains
    nominal = case.number
    weight = (nominal["M"] + nominal["m"]) * G
    found = math.inf
    edges = sorted({0.0, case.duration, *(t for t, _ in case.corners if t < case.duration)})
    signals = [value for t, value in case.corners if t < case.duration or (t == case.duration and case.ever)]
    for begin, end in itertools.pairwise(edges):
        at = max(k for k, (t, _) in enumerate(case.corners) if t <= begin)
        signals += [_value(case.corners, at, begin + share * (end - begin)) for share in np.linspace(0, 1, 9)]
    signals = list(dict.fromkeys(map(tuple, signals)))
    for point in points:
        v = {name: case.number[name] + case.half[name] * point[k] for k, name in enumerate(NAMES)}
        for signal in signals:
            side, down, load = 0.0, v["M"] * G, (v["M"] + v["m"]) * G
            if case.kind == "slope":
                carried = v["M"] + (v["m"] if case.loads else 0.0)
                load += carried * G * (math.cos(math.radians(v["slope"] * signal[0])) - 1)
            elif case.kind == "platform":
                side = -v["M"] * signal[0]
            else:
                side, down, load = signal[0], down - signal[1], load - signal[1]
            torque = np.array([-K_p, -K_d, K_f, K_p])
            turned = (torque + np.array([math.hypot(side, down) * v["L"], 0.0, 0.0, 0.0])) / v["I"]
            grows = torque * {"pd": 0.0, "force": 1.0, "cop": weight / load}[case.law] / v["ell"]
            lever = nominal["M"] * G * nominal["L"]
            follows = np.array([1.0, 0.0, 0.0, -1.0]) + (nominal["ell"] * grows - nominal["I"] * turned) / lever
            A = np.array([[0.0, 1.0, 0.0, 0.0], turned, grows, follows / case.adapt])
            n = 4 if math.isfinite(case.adapt) else 2 if case.law == "pd" else 3
            found = min(found, -float(np.linalg.eigvals(A[:n, :n]).real.max()))
    return found


def _value(corners, at, t):
    begin, value = corners[at]
    if at + 1 == len(corners):
        return value
    end, after = corners[at + 1]
    return [a + (t - begin) / (end - begin) * (b - a) for a, b in zip(value, after, strict=True)]


def posed(rng):
    """A case with a demand, and what is true of it."""
    while True:
        case = drawn(rng)
        moving = [k for k, name in enumerate(NAMES) if case.half[name]]
        points = [np.zeros(7)]
        if moving:
            some = rng.permutation(list(itertools.product((-1.0, 1.0), repeat=len(moving))))[:16]
            for part in [*some, *rng.uniform(-1, 1, (8, len(moving)))]:
                points.append(np.zeros(7))
                points[-1][moving] = part
        case.ever = rests(case)
        decay = slowest(case, points)
        if decay <= 0:
            continue
        weight = (case.number["M"] + case.number["m"]) * G
        units = {"contact": weight, "cop": case.number["ell"], "decay": decay}
        for values in worst(case, np.array(points), 8 / decay):
            case.worst = {row: float(value.max() if row == "torque" else value.min()) for row, value in values.items()}
            case.worst["decay"], units["torque"] = decay, case.worst["torque"]
            case.until = case.until or case.worst
            if case.worst["contact"] <= 1.5 * ROOM * weight:
                break
        else:
            case.row = str(rng.choice(list(ROWS), p=[0.5, 0.2, 0.15, 0.15]))
            beyond = float(rng.choice([*OFFSETS, *(-rng.uniform(1, 4, 6) * ROOM)])) * units[case.row]
            case.level = case.worst[case.row] + (-beyond if case.row == "torque" else beyond)
            case.spare = -beyond >= (1 - 1e-9) * ROOM * units[case.row] and case.worst["cop"] > ROOM * units["cop"]
            if case.level > 1e-6:
                return case


def judged(case, seconds=20.0):
    """The prover's answer, a word for it, and its CPU time [s]."""
    source = parse(case.text(), origin="random.toml")
    problem = setting(source.spec)
    began = time.process_time()
    (proof,), _ = proved_in(source, problem, problem.gains, ["s"], seconds=seconds)
    took = time.process_time() - began
    weight = (case.number["M"] + case.number["m"]) * G
    near = {"contact": 1e-3 + 1e-6 * weight, "cop": 1e-6, "torque": 1e-6 * weight, "decay": 3e-5 * case.worst["decay"]}
    word = proof.answer
    if proof.answer == "proved":
        true = case.worst if proof.every_time else case.until  # what is claimed until the end is held against that
        shown = {"contact": min(proof.value["toe-force"], proof.value["heel-force"]),
                 "cop": proof.value["cop-margin"], "decay": proof.value["decay-rate"]}  # fmt: skip
        shown |= {"torque": proof.value["torque"]} if case.row == "torque" else {}
        shown = {row: [value] for row, value in shown.items()}
        shown[case.row].append(case.level)
        if any(_better(row, value, true[row], near[row]) for row in shown for value in shown[row]):
            word = "FALSE PROVED"
        elif proof.every_time and not case.ever:
            word = "FALSE EVERY TIME"
    elif proof.answer == "disproved":
        broken = proof.counterexample
        at = np.zeros((1, 7))
        for k, name in enumerate(NAMES):
            if case.half[name]:
                value = math.degrees(broken.at[name]) if name == "slope" else broken.at[name]
                at[0, k] = (value - case.number[name]) / case.half[name]
        row = {"toe-force": "contact", "heel-force": "contact", "cop-margin": "cop", "torque": "torque",
               "decay-rate": "decay"}[broken.row]  # fmt: skip
        true = slowest(case, at) if row == "decay" else worst(case, at, 8 / case.worst["decay"])[1][row][0]
        level = case.level if row == case.row else 0.0
        if np.abs(at).max() > 1 + 1e-9 or _better(row, true, level, near[row]):
            word = "FALSE DISPROVED"
    elif case.spare:
        word = "unknown with room"
    return proof, word, took


def _better(row, value, other, near):
    """Whether ``value`` is better than the ``other`` by more than ``near``."""
    return value < other - near if row == "torque" else value > other + near


def main():
    """Run, and print counts."""
    reading = argparse.ArgumentParser()
    reading.add_argument("--count", type=int, default=100)
    reading.add_argument("--first", type=int, default=0)
    reading.add_argument("--seed", type=int, default=1)
    reading.add_argument("--seconds", type=float, default=20.0)
    arguments = reading.parse_args()
    words, times, room = Counter(), [], 0
    time.monotonic = time.process_time  # limits of time are kept in CPU time, however busy the machine is
    for k in range(arguments.first, arguments.first + arguments.count):
        case = posed(np.random.default_rng([arguments.seed, k]))
        proof, word, took = judged(case, arguments.seconds)
        words[word] += 1
        times.append(took)
        room += case.spare
        if word in WRONG or took > 5:
            box = sum(half > 0 for half in case.half.values())
            poles = ", ".join(f"{pole:.3g}" for pole in case.poles)
            line = f"{k}: {word}: {case.law} {case.kind}, {box} uncertain, poles {poles}, demands {case.row}"
            line += f" {case.level:.6g} of {case.worst[case.row]:.6g}, {proof.parts} parts, {100 * proof.share:.3g} %,"
            sys.stdout.write(f"{line} {took:.1f} s: {proof.why}\n")
            sys.stdout.flush()
    spent = f"mean {np.mean(times):.2f}, median {np.median(times):.2f}, 99 % {np.quantile(times, 0.99):.1f}"
    sys.stdout.write(f"{dict(words)}; {room} with room; CPU s each: {spent}, largest {max(times):.1f}\n")


if __name__ == "__main__":
    main()
