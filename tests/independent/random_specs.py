"""Random specs by seed: most can be met, few trivially.

Bodies are those of children, adults, humanoid robots and persons in exoskeletons; feet the paper's or unequal; one to
four scenarios of all kinds, each within what the foot can bear. The levels of the requirements are taken from gains
that keep contact: mostly a little less than these reach, at times a little more. Some bounds of the gains are far too
wide.
"""

import math
import tomllib

import numpy as np

from . import linear
from .judge import judge
from .problem import AT_MOST, ROW_OF_KEY, parse

BODIES = {  # mass [kg], height of the centre of gravity [m], half the length of the foot [m]
    "child": ((15.0, 35.0), (0.5, 0.75), (0.07, 0.10)),
    "adult": ((50.0, 100.0), (0.8, 1.05), (0.10, 0.14)),
    "humanoid": ((20.0, 50.0), (0.4, 0.7), (0.07, 0.12)),
    "exoskeleton": ((90.0, 160.0), (0.85, 1.05), (0.12, 0.16)),
}
OBJECTIVES = (
    ("maximise", "contact-force"),
    ("maximise", "decay-rate"),
    ("maximise", "cop-margin"),
    ("maximise", "delay-margin"),
    ("minimise", "torque"),
)
KEYS = {
    "contact_force_n": 3.0,
    "decay_rate_per_s": 3.0,
    "torque_nm": 2.0,
    "delay_margin_s": 2.0,
    "cop_margin_m": 1.0,
    "settling_s": 1.5,
    "overshoot_deg": 1.0,
    "posture_error_deg": 0.5,
}
"""What may be required, and how often as against the others."""


def random_spec(seed):
    """The text of a spec file."""
    rng = np.random.default_rng([seed, 20260])
    who = str(rng.choice(list(BODIES)))
    body = _body(rng, who)
    ability = _ability(body)
    scenarios = [_scenario(rng, body, ability, k) for k in range(int(rng.choice([1, 2, 3, 4], p=[0.4, 0.3, 0.2, 0.1])))]
    verb, objective = OBJECTIVES[int(rng.integers(len(OBJECTIVES)))]
    kind = str(rng.choice(["force", "cop", "pd"], p=[0.68, 0.27, 0.05]))
    bounds = _bounds(rng, body, ability, kind)
    text = _text(seed, who, body, scenarios, kind, f'{verb} = "{objective}"', bounds)
    return text.replace("[requirements]\n", "[requirements]\n" + _requirements(rng, text, objective))


def _rounded(value, digits=3):
    return float(f"{value:.{digits}g}")


def _body(rng, who):
    mass, height, half = (rng.uniform(*ends) for ends in BODIES[who])
    unequal = rng.random() < 0.35
    body = {"mass": _rounded(mass), "height": _rounded(height), "foot": _rounded(mass * rng.uniform(0.02, 0.06))}
    body["inertia"] = _rounded(body["mass"] * body["height"] ** 2 * rng.uniform(1.05, 1.4), 4)
    share = rng.uniform(0.55, 0.75) if unequal else 0.5
    body["toe"], body["heel"] = _rounded(2 * half * share), _rounded(2 * half * (1 - share))
    body["ankle"] = _rounded(rng.uniform(0.03, 0.1)) if unequal else 0.0
    body["target"] = _rounded(0.5 * (body["toe"] - body["heel"]) * rng.uniform(0.3, 1.1)) if unequal else 0.0
    return body


def _ability(body):
    """Lever of the foot [m] about the target, Omega [1/s]; lean [rad], force [N] and push [N s] that it just bears."""
    lever = min(body["toe"] - body["target"], body["heel"] + body["target"])
    Omega = math.sqrt(body["mass"] * 9.81 * body["height"] / body["inertia"])
    lean = lever / body["height"]
    return {
        "lever": lever,
        "Omega": Omega,
        "lean": lean,
        "force": body["mass"] * 9.81 * lean,
        "push": body["inertia"] / body["height"] * Omega * lean,
    }


def _scenario(rng, body, ability, index):
    """The lines of one scenario."""
    kind = str(rng.choice(["slope", "force", "platform", "profile", "start"], p=[0.35, 0.15, 0.2, 0.2, 0.1]))
    sign = float(rng.choice([-1.0, 1.0]))
    part = sign * rng.uniform(0.1, 0.5)
    lines = [f'name = "{kind}-{index}"', f'kind = "{"force" if kind == "start" else kind}"']
    duration = _rounded(rng.uniform(5.0, 9.0), 2)
    if kind == "slope":
        ramp = 0.0 if rng.random() < 0.3 else _rounded(rng.uniform(1.5, 4.0), 2)
        angle = math.degrees(part * ability["lean"]) if ramp == 0 else sign * rng.uniform(3.0, 9.0) * ramp / 2.0
        lines += [f"angle_deg = {_rounded(angle)}", f"ramp_s = {ramp}"]
    elif kind == "force":
        ramp = 0.0 if rng.random() < 0.4 else _rounded(rng.uniform(0.5, 3.0), 2)
        fy = _rounded(rng.uniform(-0.1, 0.1) * body["mass"] * 9.81) if rng.random() < 0.3 else 0.0
        lines += [f"fx_n = {_rounded(part * ability['force'] * (1 + ramp))}", f"fy_n = {fy}", f"ramp_s = {ramp}"]
    elif kind == "platform":
        rise, hold, fall = rng.uniform(0.4, 1.2), rng.uniform(0.5, 2.0), rng.uniform(0.4, 1.2)
        a = _rounded(1.4 * part * 9.81 * ability["lean"])
        times = [0.0, _rounded(rise, 2), _rounded(rise + hold, 2), _rounded(rise + hold + fall, 2)]
        lines.append(f"acceleration_mps2 = [[0.0, 0.0], [{times[1]}, {a}], [{times[2]}, {a}], [{times[3]}, 0.0]]")
    elif kind == "profile":
        start, width = _rounded(rng.uniform(0.2, 1.0), 2), _rounded(rng.uniform(0.05, 0.4), 2)
        f = _rounded(part * ability["push"] / width)
        f = math.copysign(min(abs(f), 2.5 * ability["force"]), f)
        t0, t1 = start, _rounded(start + width)
        if rng.random() < 0.5:  # a pulse with jumps
            points = [[t0, 0.0], [t0, f], [t1, f], [t1, 0.0]]
        else:
            points = [[t0, 0.0], [t1, f], [_rounded(t1 + width), 0.0]]
        lines.append("points = [" + ", ".join(f"[{t}, {_rounded(x)}, 0.0]" for t, x in points) + "]")
    else:
        lines.append("fx_n = 0.0")
        lines.append(f"initial_angle_deg = {_rounded(math.degrees(part * ability['lean']))}")
        rate = rng.uniform(-0.3, 0.3) * ability["Omega"] * ability["lean"]
        lines.append(f"initial_rate_deg_per_s = {_rounded(math.degrees(rate))}")
    return ["[[scenarios]]", *lines, f"duration_s = {duration}"]


def _bounds(rng, body, ability, kind):
    """Upper bounds of the gains: sensible, and now and then far too wide."""
    gravity, Omega = body["mass"] * 9.81 * body["height"], ability["Omega"]
    upper = {
        "kp": gravity * rng.uniform(3.0, 8.0),
        "kd": body["inertia"] * Omega * rng.uniform(3.0, 8.0),
        "kf": 0.5 * (body["toe"] + body["heel"]) * Omega * rng.uniform(2.0, 10.0),
    }
    wide = rng.random()
    if wide < 0.12:
        upper = {key: value * 100.0 for key, value in upper.items()}
    elif wide < 0.24:
        key = str(rng.choice(list(upper)))
        upper[key] *= 10.0 ** rng.uniform(1.0, 4.0)
    if kind == "pd":
        del upper["kf"]
    return {key: _rounded(value, 2) for key, value in upper.items()}


def _text(seed, who, body, scenarios, kind, objective, bounds):
    lines = ["schema_version = 1", f'name = "random-{seed}"', f'source = "a random {who}, seed {seed}"', "[body]"]
    lines += [f"mass_kg = {body['mass']}", f"com_height_m = {body['height']}", f"inertia_kgm2 = {body['inertia']}"]
    lines += ["[foot]", f"mass_kg = {body['foot']}"]
    if body["toe"] == body["heel"]:
        lines.append(f"half_length_m = {body['toe']}")
    else:
        lines += [f"toe_m = {body['toe']}", f"heel_m = {body['heel']}", f"ankle_height_m = {body['ankle']}"]
    for scenario in scenarios:
        lines += scenario
    lines += ["[law]", f'kind = "{kind}"']
    if body["target"]:
        lines.append(f"cop_target_m = {body['target']}")
    lines += ["[requirements]", "[synthesis]", objective, "[synthesis.bounds]"]
    lines += [f"{key} = [0.0, {value}]" for key, value in bounds.items()]
    return "\n".join(lines) + "\n"


def _requirements(rng, text, objective):
    """Up to three levels, by what gains reach that keep contact; none where no such gains are met with."""
    problem = parse(tomllib.loads(text))
    reached = _reached(rng, problem)
    count = int(rng.choice([0, 1, 2, 3], p=[0.1, 0.3, 0.35, 0.25]))
    keys = [key for key in KEYS if ROW_OF_KEY[key] != objective]
    chance = np.array([KEYS[key] for key in keys])
    keys = [str(key) for key in rng.choice(keys, size=count, replace=False, p=chance / chance.sum())]
    if objective != "decay-rate" and "decay_rate_per_s" not in keys and rng.random() < 0.85:
        keys.append("decay_rate_per_s")  # without, the best gains often hardly settle
    lines = []
    for key in keys:
        value = reached.get(ROW_OF_KEY[key])
        ease = rng.uniform(1.01, 1.15) if rng.random() < 0.1 else rng.uniform(0.6, 0.97)
        if value is not None and math.isfinite(value) and value > 0:
            lines.append(f"{key} = {_rounded(value / ease if ROW_OF_KEY[key] in AT_MOST else value * ease)}")
    return "".join(line + "\n" for line in lines)


def _reached(rng, problem):
    """Rows of the best of some random gains: stable, with contact, and not slow."""
    gravity = problem.body[0] * problem.body[7] * problem.body[1]
    Omega = math.sqrt(gravity / problem.body[2])
    points = linear.operating_points(problem, 9)
    best, rows = -math.inf, {}
    for _ in range(120):
        K_p = gravity * rng.uniform(1.1, 4.0)
        K_d = 2.0 * rng.uniform(0.3, 1.5) * math.sqrt(K_p * problem.body[2])
        K_f = 0.0 if problem.kind == "pd" else problem.ell * Omega * 10.0 ** rng.uniform(-1.5, 0.3)
        gains = np.minimum([K_p, K_d, K_f], problem.bounds[:, 1])
        answer = judge(problem, gains, points, step=4e-3, exact=False, give_up=0.0)
        if not 0 < answer.violation < 10.0 and "torque" in answer.rows:
            score = answer.rows["contact-force"] / problem.weight + 0.1 * answer.rows["decay-rate"] / Omega
            if score > best:
                best, rows = score, answer.rows | {"delay-margin": linear.delay_margin(problem, gains, points)}
    return rows
