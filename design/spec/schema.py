"""The spec file as pydantic models: every key with its unit, its range and what it means.

One statement serves the loader's checks, the messages, and the JSON Schema with which an editor completes and
checks a spec. Numbers are finite, and neither booleans nor strings; unknown keys are errors.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from design.spec.fields import AtLeast, AtMost, Bounded, Gain, Inertia, Name, Number, Table
from design.spec.study_tables import MpcTable, NoiseTable, StudyTable, UncertaintyTable

SCHEMA_VERSION = 1
"""The version of the spec file that this Poise reads."""

MAX_STEPS = 2_000_000
"""The largest number of integration steps of one scenario."""
MAX_TOTAL_STEPS = 20_000_000
"""The largest number of integration steps of all scenarios together; each is kept in memory while it is judged."""


class BodyTable(Table):
    """The body: one rigid link on the ankle."""

    mass_kg: Number = Field(ge=1e-3, le=1000, description="mass M of the body, without the foot [kg]")
    com_height_m: Number = Field(
        ge=1e-4, le=1000, description="distance L from the ankle to the body's centre of gravity [m]"
    )
    inertia_kgm2: Inertia | None = Field(
        default=None,
        description="inertia I about the ankle (left out: 4/3 M L², a uniform rod of length 2 L) [kg m²]",
    )


class FootTable(Table):
    """The foot: flat, in contact at toe and heel only; ``half_length_m``, or both ``toe_m`` and ``heel_m``."""

    mass_kg: Number = Field(ge=0, le=100, description="mass m of the foot [kg]")
    half_length_m: Number | None = Field(
        default=None, ge=1e-4, le=10, description="distance ℓ from the ankle to the toe, and to the heel [m]"
    )
    toe_m: Number | None = Field(
        default=None, ge=1e-4, le=10, description="distance from the ankle to the toe, where it is another than [m]"
    )
    heel_m: Number | None = Field(
        default=None, ge=1e-4, le=10, description="the distance from the ankle to the heel [m]"
    )
    ankle_height_m: Number = Field(default=0.0, ge=0, le=10, description="height of the ankle above the ground [m]")
    ground_loads: bool = Field(
        default=False,
        strict=True,
        description="whether slopes load the foot as well: it weighs m g cos α there; false: m g, as in (5) and (6)",
    )

    @model_validator(mode="after")
    def _one_length(self) -> FootTable:
        parts = {key: getattr(self, key) for key in ("toe_m", "heel_m") if getattr(self, key) is not None}
        if self.half_length_m is not None and parts:
            message = f"half_length_m: is given, and so is {' and '.join(parts)}; leave one of the two out"
            raise ValueError(message)
        if self.half_length_m is None and len(parts) < 2:
            missing = "half_length_m" if not parts else "heel_m" if "toe_m" in parts else "toe_m"
            message = f"{missing}: is missing; needs half_length_m (ankle to toe and to heel), or both toe_m and heel_m"
            raise ValueError(message)
        return self

    @property
    def levers(self) -> tuple[float, float]:
        """Ankle to toe and ankle to heel [m]."""
        return self.toe_m or self.half_length_m or 0.0, self.heel_m or self.half_length_m or 0.0


class ScenarioTable(Table):
    """What every scenario has."""

    name: Name = Field(description="name of the scenario, used in results")
    duration_s: Number = Field(ge=1e-3, le=3600, description="how long it is watched [s]")
    initial_angle_deg: Number = Field(default=0.0, ge=-90, le=90, description="ankle angle θ at t = 0 [deg]")
    initial_rate_deg_per_s: Number = Field(default=0.0, ge=-3600, le=3600, description="its rate at t = 0 [deg/s]")


class SlopeTable(ScenarioTable):
    """Ground that tilts: (21), (22)."""

    kind: Literal["slope"]
    angle_deg: Number = Field(ge=-180, le=180, description="final slope α, downhill on the toe side if > 0 [deg]")
    ramp_s: Number = Field(
        default=0.0, ge=0, le=3600, description="time in which α grows from 0; 0 is a sudden slope at t = 0 [s]"
    )


class ForceTable(ScenarioTable):
    """A constant force on the centre of gravity, e.g. wind, reached linearly."""

    kind: Literal["force"]
    fx_n: Number = Field(ge=-1e6, le=1e6, description="final horizontal force F_x, forward if > 0 [N]")
    fy_n: Number = Field(default=0.0, ge=-1e6, le=1e6, description="final vertical force F_y, up if > 0 [N]")
    ramp_s: Number = Field(default=0.0, ge=0, le=3600, description="time in which it grows from 0 [s]")


def _rising(points: list[list[float]]) -> list[list[float]]:
    for (before, *_), (after, *_) in pairwise(points):
        if after < before:
            message = f"times must not fall: {after} comes after {before}; sort the points by time"
            raise ValueError(message)
    if points[0][0] < 0:
        message = f"first time is {points[0][0]}; needs >= 0"
        raise ValueError(message)
    return points


Pair = Annotated[list[Bounded], Field(min_length=2, max_length=2)]
Triple = Annotated[list[Bounded], Field(min_length=3, max_length=3)]


class PlatformTable(ScenarioTable):
    """A vehicle's floor that accelerates: F_x = -M a."""

    kind: Literal["platform"]
    acceleration_mps2: list[Pair] = Field(
        min_length=1,
        max_length=100_000,
        description="[[t, a], ...]: acceleration of the floor, piecewise linear, held at its end; equal times: a jump",
    )

    @model_validator(mode="after")
    def _check(self) -> PlatformTable:
        _rising(self.acceleration_mps2)
        return self


class ProfileTable(ScenarioTable):
    """Any force over time."""

    kind: Literal["profile"]
    points: list[Triple] = Field(
        min_length=1,
        max_length=100_000,
        description="[[t, fx, fy], ...]: force on the body, piecewise linear, held at its end; equal times: a jump",
    )

    @model_validator(mode="after")
    def _check(self) -> ProfileTable:
        _rising(self.points)
        return self


AnyScenario = Annotated[SlopeTable | ForceTable | PlatformTable | ProfileTable, Field(discriminator="kind")]


class LawTable(Table):
    """The control law and its gains."""

    kind: Literal["pd", "force", "cop"] = Field(
        description="pd: K_f = 0; force: law (8); cop: law (20) with K_F = kf (M+m) g / half the foot's length"
    )
    kp: Gain | None = Field(default=None, description="gain K_p on the angle [N m/rad]")
    kd: Gain | None = Field(default=None, description="gain K_d on the rate [N m s/rad]")
    kf: Gain | None = Field(default=None, description="gain K_f on the force integral [m/s]")
    desired_angle_deg: Number = Field(default=0.0, ge=-90, le=90, description="θ_d of (8) [deg]")
    cop_target_m: Number = Field(
        default=0.0,
        ge=-10,
        le=10,
        description="P_d: where the centre of pressure is to come to rest, from the ankle, toe side > 0 [m]",
    )
    adapt_s: Number | None = Field(
        default=None,
        ge=1e-3,
        le=3600,
        description="law force: θ_d follows the posture that the estimated force asks for, within this time [s]",
    )

    @model_validator(mode="after")
    def _adapts(self) -> LawTable:
        if self.adapt_s is not None and self.kind != "force":
            message = f'adapt_s = {self.adapt_s:g} goes with kind = "force", not {self.kind!r}; leave one of them out'
            raise ValueError(message)
        return self


class RequirementsTable(Table):
    """What the closed loop must keep; contact and stability are always required."""

    contact_force_n: AtLeast = Field(
        default=AtLeast(min=0.0), description="F_T and F_H at least this, everywhere along every scenario [N]"
    )
    decay_rate_per_s: AtLeast = Field(
        default=AtLeast(min=0.0), description="every pole's real part at most minus this, over each scenario [1/s]"
    )
    cop_margin_m: AtLeast = Field(
        default=AtLeast(min=0.0), description="distance of the CoP from the nearer end of the foot at least this [m]"
    )
    torque_nm: AtMost | None = Field(default=None, description="|τ| at most this [N m]")
    torque_rate_nm_per_s: AtMost | None = Field(default=None, description="|dτ/dt| at most this [N m/s]")
    friction: AtMost | None = Field(default=None, description="coefficient of friction that there is; |f_x| / load [1]")
    settling_s: AtMost | None = Field(
        default=None, description="time from the last corner of the force until θ stays near its final θ_f [s]"
    )
    overshoot_deg: AtMost | None = Field(default=None, description="how far θ goes past its final θ_f [deg]")
    posture_error_deg: AtMost | None = Field(default=None, description="|θ - θ_f| at the end [deg]")
    gain_margin_up: AtLeast | None = Field(default=None, description="factor by which the loop gain may rise [1]")
    gain_margin_down: AtMost | None = Field(default=None, description="factor to which the loop gain may fall [1]")
    phase_margin_deg: AtLeast | None = Field(default=None, description="phase margin at the actuator [deg]")
    delay_margin_s: AtLeast | None = Field(default=None, description="delay at the actuator [s]")
    force_delay_margin_s: AtLeast | None = Field(default=None, description="delay of the force measurement alone [s]")
    angle_delay_margin_s: AtLeast | None = Field(default=None, description="delay of the angle measurement alone [s]")
    disk_margin: AtLeast | None = Field(default=None, description="disk margin α in the form of S - T [1]")
    sample_time_s: AtLeast | None = Field(default=None, description="sampling period that the loop bears [s]")
    step_slope_deg: AtLeast | None = Field(default=None, description="sudden slope survived from rest [deg]")
    push_ns: AtLeast | None = Field(default=None, description="push at the centre of gravity survived from rest [N s]")
    slope_rate_deg_per_s: AtLeast | None = Field(
        default=None, description="slope rate up to which any slope profile keeps the CoP within the foot [deg/s]"
    )


class BoundsTable(Table):
    """Lower and upper bound of each gain; equal ones fix it."""

    kp: list[Gain] = Field(min_length=2, max_length=2, description="[N m/rad]")
    kd: list[Gain] = Field(min_length=2, max_length=2, description="[N m s/rad]")
    kf: Annotated[list[Gain], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="left out for law pd [m/s]"
    )

    @model_validator(mode="after")
    def _ordered(self) -> BoundsTable:
        for key in ("kp", "kd", "kf"):
            low, high = getattr(self, key) or (0.0, 0.0)
            if low > high:
                message = f"{key} = [{low}, {high}]: the lower bound is above the upper one; swap them"
                raise ValueError(message)
        return self


Maximised = Literal[
    "decay-rate", "contact-force", "cop-margin", "routh-margin", "gain-margin-up", "phase-margin", "delay-margin",
    "force-delay-margin", "angle-delay-margin", "disk-margin", "sample-time", "step-slope", "push", "slope-rate",
]  # fmt: skip
Minimised = Literal[
    "goals", "torque", "torque-rate", "friction", "settling", "overshoot", "posture-error", "gain-margin-down"
]


class SynthesisTable(Table):
    """What ``synthesize`` looks for, and where."""

    maximise: Maximised | None = Field(default=None, description="the row to make large; decay-rate if left out")
    minimise: Minimised | None = Field(
        default=None, description="the row to make small instead; goals: the largest of the soft requirements"
    )
    starts: int = Field(default=3, ge=1, le=1000, description="number of starting points")
    robust: bool = Field(default=True, description="for every body and world within [uncertainty]; false: the nominal")
    bounds: BoundsTable | None = Field(default=None, description="bounds of the gains")

    @model_validator(mode="after")
    def _one(self) -> SynthesisTable:
        if self.maximise is not None and self.minimise is not None:
            message = (
                f"maximise = {self.maximise!r} and minimise = {self.minimise!r}: a design has one objective; keep one"
            )
            raise ValueError(message)
        return self


class SimulationTable(Table):
    """How trajectories are computed."""

    time_step_s: Number = Field(default=0.001, gt=0, le=1.0, description="step of the Runge-Kutta method [s]")
    gravity_mps2: Number = Field(default=9.81, ge=1e-3, le=1000, description="gravitational acceleration g [m/s²]")


class Spec(Table):
    """A whole spec file."""

    schema_version: Literal[1] = Field(description="version of this format: 1")
    name: Name = Field(description="name of the problem, used in results")
    source: str = Field(default="", max_length=2000, description="where its numbers come from")
    body: BodyTable
    foot: FootTable
    scenarios: list[AnyScenario] = Field(min_length=1, max_length=1000, description="what the biped stands through")
    law: LawTable
    requirements: RequirementsTable = RequirementsTable()
    synthesis: SynthesisTable = SynthesisTable()
    simulation: SimulationTable = SimulationTable()
    mpc: MpcTable = MpcTable()
    noise: NoiseTable = NoiseTable()
    uncertainty: UncertaintyTable = UncertaintyTable()
    study: StudyTable = StudyTable()

    @model_validator(mode="after")
    def _consistent(self) -> Spec:
        names = [scenario.name for scenario in self.scenarios]
        for index, name in enumerate(names):
            if name in names[:index]:
                message = f"scenarios[{index}].name = {name!r} is taken by scenarios[{names.index(name)}]; rename one"
                raise ValueError(message)
        toe, heel = self.foot.levers
        if not -heel < self.law.cop_target_m < toe:
            message = (
                f"law.cop_target_m = {self.law.cop_target_m:g} is not within the foot; needs more than {-heel:g} (the"
                f" heel) and less than {toe:g} (the toe)"
            )
            raise ValueError(message)
        for index, scenario in enumerate(self.scenarios):
            steps = scenario.duration_s / self.simulation.time_step_s
            if steps > MAX_STEPS:
                message = (
                    f"scenarios[{index}] needs {steps:.3g} steps of simulation.time_step_s; at most {MAX_STEPS:,};"
                    " shorten duration_s or lengthen the step"
                )
                raise ValueError(message)
        total = sum(scenario.duration_s for scenario in self.scenarios) / self.simulation.time_step_s
        if total > MAX_TOTAL_STEPS:
            message = (
                f"scenarios need {total:.3g} steps of simulation.time_step_s together; at most {MAX_TOTAL_STEPS:,};"
                " shorten or split the spec, or lengthen the step"
            )
            raise ValueError(message)
        return self


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of the spec file, for editors."""
    schema = Spec.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "Poise spec file"}
