"""Remarks on numbers that are allowed but look like a slip: another unit, or a body that cannot exist.

They are warnings; ``--strict`` makes them errors. Each says the value in both units.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from design.spec.schema import ForceTable, PlatformTable, SlopeTable, Spec


def remarks(spec: Spec) -> Iterator[str]:
    """Sentences of the form ``key = value: why it is odd; what was perhaps meant``."""
    yield from _body(spec)
    for index, scenario in enumerate(spec.scenarios):
        key = f"scenarios[{index}]"
        if isinstance(scenario, SlopeTable) and 0 < abs(scenario.angle_deg) < 0.6:
            turned = math.degrees(scenario.angle_deg)
            yield (
                f"{key}.angle_deg = {scenario.angle_deg:g}: {scenario.angle_deg:g}° is hardly a slope;"
                f" if it was meant in radians, write {turned:.4g}"
            )
        if isinstance(scenario, ForceTable):
            weight = spec.body.mass_kg * spec.simulation.gravity_mps2
            if abs(scenario.fx_n) > weight:
                yield f"{key}.fx_n = {scenario.fx_n:g} N: more than the body's weight of {weight:.4g} N"
        if isinstance(scenario, PlatformTable):
            worst = max(abs(a) for _, a in scenario.acceleration_mps2)
            if worst > 10:
                yield f"{key}.acceleration_mps2 reaches {worst:g} m/s² ({worst / 9.81:.2g} g): no vehicle starts so"
    if spec.simulation.time_step_s > 0.02:
        step = spec.simulation.time_step_s
        yield f"simulation.time_step_s = {step:g}: {1e3 * step:g} ms is coarse; if meant in ms, write {step / 1e3:g}"
    if not 1 <= spec.simulation.gravity_mps2 <= 30:
        yield f"simulation.gravity_mps2 = {spec.simulation.gravity_mps2:g}: 9.81 m/s² on Earth"


def _body(spec: Spec) -> Iterator[str]:
    M, L, I = spec.body.mass_kg, spec.body.com_height_m, spec.body.inertia_kgm2
    if L > 3:
        yield f"body.com_height_m = {L:g}: {L:g} m is taller than any body; if it was meant in cm, write {L / 100:g}"
    if L < 0.02:
        yield f"body.com_height_m = {L:g}: only {1000 * L:g} mm; if it was meant in another unit, write metres"
    if M > 300:
        yield f"body.mass_kg = {M:g}: {M:g} kg; if it was meant in g, write {M / 1000:g}; in N, write {M / 9.81:.4g}"
    for key in ("half_length_m", "toe_m", "heel_m", "ankle_height_m"):
        length = getattr(spec.foot, key)
        if length is not None and length > 0.5:
            kind = "a high ankle" if key == "ankle_height_m" else "a long foot"
            yield f"foot.{key} = {length:g}: {length:g} m is {kind}; if meant in cm, write {length / 100:g}"
        if length is not None and length > L:
            yield f"foot.{key} = {length:g} m is more than body.com_height_m = {L:g} m"
    if spec.foot.mass_kg > M:
        yield f"foot.mass_kg = {spec.foot.mass_kg:g} kg is more than body.mass_kg = {M:g} kg"
    if I is not None and I < M * L**2 * (1 - 1e-12):
        yield (
            f"body.inertia_kgm2 = {I:g}: by the parallel-axis theorem a body whose centre of gravity is {L:g} m from"
            f" the ankle has at least M L² = {M * L**2:.6g} kg m² about it; no real body has these numbers"
        )
    if I is not None and I > 10 * M * L**2:
        yield f"body.inertia_kgm2 = {I:g}: over ten times M L² = {M * L**2:.4g} kg m²"
