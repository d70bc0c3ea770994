"""Random loops, worlds and boxes, with what is true of them by an integrator and equations of their own.

    python -m tests.proof.random_proofs --count 100 --seed 1

Each case demands a contact force that is either some per cent of the weight below the least that sampling finds (there
is room for a proof) or one per cent above it (nothing may be proved). The least is that of the box's middle, corners
and random points, by SciPy's DOP853 while the force moves and Radau's method after that.
"""

import argparse
import itertools
import json
import math
import sys
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from design.proof.box import prove
from design.proof.certificate import confirmed
from design.spec.load import parse
from design.spec.setting import setting

G = 9.81
NAMES = ("M", "L", "I", "m", "ell", "slope", "ramp")
WRONG = ("FALSE PROVED", "FALSE DISPROVED", "unknown with room")
ROOM = 0.01
"""Of the weight: what is to spare where a proof is expected."""


@dataclass
class Random:
    """A loop in a world over a box: numbers by ``NAMES`` [SI, degrees], half-widths alike, corners (t, values)."""

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
    level: float = 0.0
    least: float = math.nan
    spare: bool = False
    stable: bool = True

    def text(self):
        """The spec."""
        n, h = self.number, self.half
        lines = ["schema_version = 1", 'name = "random"', "[body]", f"mass_kg = {n['M']!r}",
                 f"com_height_m = {n['L']!r}", f"inertia_kgm2 = {n['I']!r}", "[foot]", f"mass_kg = {n['m']!r}",
                 f"half_length_m = {n['ell']!r}", "[[scenarios]]", 'name = "s"', f'kind = "{self.kind}"']  # fmt: skip
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
                  "[requirements]", f"contact_force_n = {max(self.level, 0.0)!r}", "[simulation]",
                  f"time_step_s = {self.step!r}", "[uncertainty]"]  # fmt: skip
        keys = ("mass_kg", "com_height_m", "inertia_kgm2", "foot_mass_kg", "half_length_m", "slope_deg", "ramp_s")
        lines += [f"{key} = {h[name]!r}" for key, name in zip(keys, NAMES, strict=True) if h[name]]
        return "\n".join(lines) + "\n"


def drawn(rng):
    """A case whose foot stands, without a demand."""
    M, ell = float(rng.uniform(15, 110)), float(rng.uniform(0.06, 0.14))
    L = float(rng.uniform(0.35, 1.1))
    number = {"M": M, "L": L, "I": float(rng.uniform(1.02, 1.4)) * M * L**2, "m": float(rng.uniform(0.2, 3.0)),
              "ell": ell, "slope": 0.0, "ramp": 0.0}  # fmt: skip
    law = str(rng.choice(["force", "force", "force", "pd", "cop"]))
    poles = _poles(rng, 2 if law == "pd" else 3)
    gains = _gains(number, poles, law)
    kind = str(rng.choice(["slope", "slope", "force", "platform", "profile"]))
    far = float(rng.uniform(0.2, 0.9)) * ell / L  # what a horizontal force may be, in parts of the weight, if sudden
    start = (0.0, 0.0) if rng.random() < 0.6 else (float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-3, 3)))
    ramp = 0.0 if rng.random() < 0.4 else float(rng.uniform(0.2, 4.0))
    corners = [(0.0, (1.0,))]
    sign = float(rng.choice([-1.0, 1.0]))
    if kind == "slope":
        number["slope"], number["ramp"] = sign * math.degrees(far) * (1 if ramp < 1 or law == "pd" else 2), ramp
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
    part, degrees = float(rng.choice([0.0, 0.0, 0.005, 0.01, 0.02])), float(rng.choice([0.0, 0.5, 1.0]))
    half = dict.fromkeys(NAMES, 0.0)
    if part:
        for name in NAMES[:5]:
            half[name] = part * number[name] if rng.random() < 0.6 else 0.0
        half["ramp"] = part * number["ramp"] if rng.random() < 0.5 else 0.0
    if kind == "slope" and part and abs(number["slope"]) > 1.1 * degrees:
        half["slope"] = degrees
    duration = float(corners[-1][0] + rng.uniform(0.5, 5.0))
    return Random(number, half, kind, corners, duration, start, law, gains, float(10 ** rng.uniform(-4, -2.3)), poles)


def _poles(rng, n):
    slow = 10 ** (rng.uniform(math.log10(0.002), math.log10(0.07)) if rng.random() < 0.5 else rng.uniform(-0.3, 0.6))
    omega = 10 ** rng.uniform(0.5, 1.6)
    if rng.random() < 0.5:
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


def least(case, points, watch):
    """The least contact force [N] at each of the ``points`` (w, 7) of the box, and whether all bodies stay up."""
    v = {name: case.number[name] + case.half[name] * points[:, k] for k, name in enumerate(NAMES)}
    K_p, K_d, K_f = case.gains
    weight = (case.number["M"] + case.number["m"]) * G
    w = len(points)

    def parts(x, signal):
        theta, omega, s = x
        tau = -K_p * theta - K_d * omega + K_f * s
        if case.kind == "slope":
            alpha = np.radians(v["slope"]) * signal[0]
            across, down = v["M"] * G * np.sin(theta + alpha), v["M"] * G * np.cos(alpha)
        else:
            F_x = -v["M"] * signal[0] if case.kind == "platform" else signal[0]
            down = v["M"] * G - (0.0 if case.kind == "platform" else signal[1])
            across = down * np.sin(theta) + F_x * np.cos(theta)
        turning = (v["L"] * across + tau) / v["I"]
        load = v["m"] * G + down - v["M"] * v["L"] * (turning * np.sin(theta) + omega**2 * np.cos(theta))
        grows = {"pd": 0.0 * tau, "force": tau / v["ell"], "cop": tau / v["ell"] * weight / load}[case.law]
        return np.array([omega, turning, grows]), 0.5 * (load - np.abs(tau) / v["ell"])

    x = np.zeros((3, w))
    x[0], x[1] = np.radians(case.start)[:, None]
    found = np.full(w, np.inf)
    times = sorted({0.0, case.duration, *(t for t, _ in case.corners if t < case.duration)})
    stretch = v["ramp"] / case.number["ramp"] if case.half["ramp"] else np.ones(w)
    for begin, end in [*itertools.pairwise(times), (case.duration, case.duration + watch)]:
        at = [max(k for k, (t, _) in enumerate(case.corners) if t <= begin)]
        ends = [np.array(_value(case.corners, at[0], t)) for t in (begin, end)]
        length = (end - begin) * (stretch if end <= case.number["ramp"] else np.ones(w))

        def rate(share, flat, ends=ends, length=length):
            return (length * parts(flat.reshape(3, w), ends[0] + share * (ends[1] - ends[0]))[0]).ravel()

        shares = np.linspace(0, 1, 2 + int(min(max((end - begin) * 300, 100), 1500)))
        if begin >= case.duration:
            shares = np.append(0.0, np.geomspace(1e-6, 1, 400))
        try:
            run = solve_ivp(rate, (0, 1), x.ravel(), "DOP853" if begin < case.duration else "Radau", t_eval=shares,
                            rtol=1e-9, atol=1e-9, events=_fallen)  # fmt: skip
        except ValueError:  # states that are no longer numbers
            return np.full(w, -np.inf)
        if run.status != 0 or not np.isfinite(run.y).all() or np.abs(run.y[:w]).max() > 1.4:
            return np.full(w, -np.inf)
        for share, state in zip(run.t, run.y.T, strict=True):
            found = np.minimum(found, parts(state.reshape(3, w), ends[0] + share * (ends[1] - ends[0]))[1])
        x = run.y[:, -1].reshape(3, w)
    return found


def _fallen(_, flat):
    return 1.4 - float(np.abs(flat[: len(flat) // 3]).max())


_fallen.terminal = True


def slowest(case, points):
    """The least decay rate [1/s] of the loops at rest at the ``points`` (w, 7), under all that the signal comes to."""
    K_p, K_d, K_f = case.gains
    weight = (case.number["M"] + case.number["m"]) * G
    found = math.inf
    signals = [np.array(value) for t, value in case.corners if t <= case.duration]
    signals += [a + share * (b - a) for a, b in itertools.pairwise(signals) for share in np.linspace(0, 1, 9)]
    for point in points:
        v = {name: case.number[name] + case.half[name] * point[k] for k, name in enumerate(NAMES)}
        for signal in signals:
            side, down, load = 0.0, v["M"] * G, (v["M"] + v["m"]) * G
            if case.kind == "slope":
                load += v["M"] * G * (math.cos(math.radians(v["slope"] * signal[0])) - 1)
            elif case.kind == "platform":
                side = -v["M"] * signal[0]
            else:
                side, down, load = signal[0], down - signal[1], load - signal[1]
            turned = (math.hypot(side, down) * v["L"] - K_p) / v["I"]
            A = np.array([[0.0, 1.0, 0.0], [turned, -K_d / v["I"], K_f / v["I"]], [-K_p, -K_d, K_f]])
            A[2] *= {"pd": 0.0, "force": 1.0, "cop": weight / load}[case.law] / v["ell"]
            n = 2 if case.law == "pd" else 3
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
        watched = 8 / min(-pole.real for pole in case.poles)
        case.stable = slowest(case, points) > 0
        case.least = float(least(case, np.array(points), watched).min()) if case.stable else -math.inf
        weight = (case.number["M"] + case.number["m"]) * G
        if case.least > 1.5 * ROOM * weight:
            case.spare = bool(rng.random() < 0.7)
            case.level = case.least - float(rng.uniform(1, 4)) * ROOM * weight if case.spare else (
                case.least + ROOM * weight)  # fmt: skip
            case.spare = case.spare or case.level < case.least - ROOM * weight
            if case.level < 0:
                continue
            return case


def judged(case, seconds=20.0):
    """The prover's answer, a word for it, and its CPU time [s]."""
    problem = setting(parse(case.text(), origin="random.toml").spec)
    began = time.process_time()
    proof = prove(problem, problem.gains, "s", seconds=seconds)
    took = time.process_time() - began
    word = proof.answer
    if proof.answer == "proved":
        shown = min(proof.value["toe-force"], proof.value["heel-force"])
        if case.level > case.least + 1e-3 or shown > case.least + 1e-3:
            word = "FALSE PROVED"
    elif proof.answer == "disproved":
        broken = proof.counterexample
        at = np.zeros((1, 7))
        for k, name in enumerate(NAMES):
            if case.half[name]:
                value = math.degrees(broken.at[name]) if name == "slope" else broken.at[name]
                at[0, k] = (value - case.number[name]) / case.half[name]
        if broken.row == "decay-rate":
            wrong = slowest(case, at) > 0
        else:
            watched = 8 / min(-pole.real for pole in case.poles)
            wrong = least(case, at, watched)[0] > case.level + 1e-3
        if np.abs(at).max() > 1 + 1e-9 or wrong:
            word = "FALSE DISPROVED"
    elif case.spare:
        word = "unknown with room"
    return proof, word, took


def certified(case, proof, seconds=120.0):
    """Whether what is proved is certified, and the certificate confirmed."""
    origin = parse(case.text(), origin="random.toml")
    problem = setting(origin.spec)
    answer = confirmed(origin, problem, problem.gains, proof, seconds=seconds)[1]
    claims = answer.claims["s"]
    assert min(claims["toe-force"], claims["heel-force"]) <= case.least + 1e-3
    return answer.confirmed


def main():
    """Run, and print counts."""
    reading = argparse.ArgumentParser()
    reading.add_argument("--count", type=int, default=100)
    reading.add_argument("--seed", type=int, default=1)
    reading.add_argument("--seconds", type=float, default=20.0)
    reading.add_argument("--certify", action="store_true", help="also write and check certificates")
    given = reading.parse_args()
    words, times, room = Counter(), [], 0
    for k in range(given.count):
        case = posed(np.random.default_rng([given.seed, k]))
        proof, word, took = judged(case, given.seconds)
        words[word] += 1
        if given.certify and word == "proved" and case.law != "cop":
            try:
                words["certified" if certified(case, proof) else "certificate refused"] += 1
            except Exception as error:
                words["not certified"] += 1
                sys.stdout.write(f"{k}: not certified: {type(error).__name__} {error}\n")
        times.append(took)
        room += case.spare
        if word in WRONG or took > 5:
            box = sum(half > 0 for half in case.half.values())
            poles = ", ".join(f"{pole:.3g}" for pole in case.poles)
            line = f"{k}: {word}: {case.law} {case.kind}, {box} uncertain, poles {poles}, demands {case.level:.5g}"
            line += f" of {case.least:.5g} N, {proof.parts} parts, {100 * proof.share:.3g} %, {took:.1f} s: {proof.why}"
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
    spent = f"mean {np.mean(times):.2f}, median {np.median(times):.2f}, largest {max(times):.1f}"
    sys.stdout.write(f"{dict(words)}; {room} with room; CPU s each: {spent}\n")


if __name__ == "__main__":
    main()
