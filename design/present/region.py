"""`poise region`: the states from which recovery is proved, in words and JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from design.model.laws import Gains
from design.present import store
from design.present.text import Paint, Style, gains_line, number, wrapped
from design.spec.load import Source
from design.spec.setting import Setting

Facts = Mapping[str, Any]

ASSUMPTIONS = (
    "the two-link model with a rigid foot that does not slip, the law in continuous time, no delay, no noise; the force"
    " that the scenario ends with, for good; numbers hold both as floats and as the decimals that they print as"
)


def none(scenario: str, why: str, seconds: float) -> dict[str, Any]:
    """The facts of a scenario without a region."""
    return {"scenario": scenario, "status": "none", "why": why, "seconds": seconds}


def document(source: Source, problem: Setting, gains: Gains, facts: Sequence[Facts]) -> dict[str, Any]:
    """The JSON of the command."""
    verdict = "proved" if facts and all(each["status"] == "proved" for each in facts) else "unknown"
    return store.document(
        "region", source, status=verdict, verdict=verdict, law=problem.law, gains=store.gains_json(gains),
        states=["e [rad]", "omega [rad/s]", "w [N m]"], assumptions=ASSUMPTIONS, regions=list(facts),
    )  # fmt: skip


def title(source: Source, problem: Setting, gains: Gains) -> str:
    """Above a picture."""
    return f"{source.spec.name}, law {problem.law}, {gains_line(gains, problem.law)}"


def as_text(document: Facts, paint: Paint) -> str:
    """What each region reaches, and the assumptions."""
    its = document["gains"]
    gains = gains_line(Gains(its["kp"], its["kd"], its["kf"]), document["law"])
    lines = [*wrapped(f"{document['spec']['name']}, law {document['law']}, {gains}"), ""]
    for each in document["regions"]:
        lines += [*(_region(each, paint) if each["status"] == "proved" else _none(each, paint)), ""]
    lines += wrapped(f"Assumes {document['assumptions']}.")
    return "\n".join(lines) + "\n"


def _none(each: Facts, paint: Paint) -> list[str]:
    return [paint(f"{each['scenario']}: NONE FOUND", Style.DOUBT), *wrapped(each["why"], "  ")]


def _region(each: Facts, paint: Paint) -> list[str]:
    start = "inside" if each["start"]["inside"] else "outside"
    tried = number(each["largest_turn_simulated_deg"], 4)
    rows = [
        ("sudden turn of the ground", each["largest_turn_deg"], "deg", f"from rest; {tried} in simulation"),
        ("push from rest", each["largest_push_deg_per_s"], "deg/s", "a sudden rate"),
        ("tilt, the integral at rest", each["largest_angle_deg"], "deg", "w = 0"),
        ("capturable strip", each["strip_deg"], "deg", "of |e + omega/Omega|"),
        ("share of it reached", 100 * each["share_of_strip"], "%", "by the region's farthest state"),
        ("decay", each["decay_rate_per_s"], "1/s", f"of {number(each['linear_decay_rate_per_s'])} of the linear loop"),
        ("volume", each["volume"], "", "rad² N m/s"),
        ("against Lyapunov's equation", each["volume_over_lyapunov"], "", "times its ellipsoid's volume"),
    ]
    head = f"about theta_f = {number(each['stationary_angle_deg'])} deg, F_T and F_H >= {each['contact_force_n']:g} N"
    return [
        paint(f"{each['scenario']}: PROVED", Style.GOOD) + f" {head}",
        *(f"  {name:<28} {number(value, 5):>9} {unit:<6} {note}".rstrip() for name, value, unit, note in rows),
        *wrapped(
            f"Were its force there at once, the scenario's own start would be {start} (V ="
            f" {number(each['start']['value'], 4)}). From every state of the region, whatever the direction, contact"
            f" is kept for all times and the body comes to rest ({each['seconds']:.1f} s).",
            "  ",
        ),
    ]
