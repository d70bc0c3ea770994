"""A spec in SI units and radians: the records of ``design.model`` that a question is asked about."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from design.errors import BadInput
from design.model.body import Biped
from design.model.closed_loop import ClosedLoop, closed_loop
from design.model.deciding import deciding_places
from design.model.environment import Scenario, constant_force, platform, profile, slope
from design.model.laws import Gains, LawKind
from design.model.limits import Required
from design.model.sensing import Sensors
from design.model.standing import Place
from design.model.tuning import Tuning
from design.model.uncertainty import Spread, Tolerances
from design.spec.load import parse
from design.spec.schema import (
    AnyScenario,
    ForceTable,
    PlatformTable,
    RequirementsTable,
    SlopeTable,
    Spec,
)
from design.spec.study_tables import MpcTable, NoiseTable, StudyTable, Tolerance, UncertaintyTable


@dataclass(frozen=True, eq=False, kw_only=True)
class Setting:
    """What a spec says, ready to compute with.

    ``required`` maps a row's id (and ``contact-force`` for toe and heel) to its level in the row's unit. ``objective``:
    the row that gains are sought for (``design.analysis.objectives``); ``robust``: for every body within
    ``tolerances``. ``bounds`` (3, 2): lower and upper (K_p, K_d, K_f), or None. ``step`` is the Runge-Kutta step [s].
    ``decay_asked``: whether the spec itself asks for a decay rate or for settling.
    ``adapt``: the time [s] within which theta_d follows the estimated posture, infinite where it is fixed. ``known``:
    the body that the law reckons with, where ``biped`` is another. ``target``: where the CoP is to come to rest, P_d
    [m]. ``ground_loads``: slopes load the foot as well (``Biped.ground_loads``, ``under``). ``fixed_weights``: the keys
    of [mpc] that the spec writes, which a study does not tune.
    """

    name: str
    biped: Biped
    scenarios: tuple[Scenario, ...]
    law: LawKind
    theta_d: float
    adapt: float
    gains: Gains | None
    required: dict[str, Required]
    objective: str
    robust: bool
    starts: int
    bounds: np.ndarray | None
    step: float
    tuning: Tuning
    sensors: Sensors
    tolerances: Tolerances
    study: StudyTable
    known: Biped | None = None
    target: float = 0.0
    written: tuple[float | None, float | None, float | None] = (None, None, None)
    ground_loads: bool = False
    fixed_weights: frozenset[str] = frozenset()
    decay_asked: bool = True

    def loop(self) -> ClosedLoop:
        """The closed loop with the gains left open."""
        return closed_loop(self.biped, self.law, self.theta_d, self.adapt, self.known, self.target)

    def under(self, scenario: Scenario) -> Setting:
        """The setting with the foot as it is loaded in ``scenario``: also by the field, where the spec counts that."""
        return self.in_a_field() if scenario.field else self

    def in_a_field(self) -> Setting:
        """The setting with the foot as it is loaded on a slope or a moving floor."""
        if not self.ground_loads or self.biped.ground_loads:
            return self
        known = None if self.known is None else replace(self.known, ground_loads=True)
        return replace(self, biped=replace(self.biped, ground_loads=True), known=known)

    def throughout(self, what: str) -> Setting:
        """The setting with one foot for all scenarios; raises ``BadInput`` where ``what`` has no such."""
        fields = {scenario.field for scenario in self.scenarios}
        if self.ground_loads and len(fields) > 1:
            message = f"is true, and only some scenarios are slopes or floors; {what} needs all or none to be"
            raise BadInput(message, key="foot.ground_loads")
        return self.in_a_field() if fields == {True} else self

    def must_not_load_the_foot(self, what: str) -> None:
        """Raise ``BadInput`` where slopes load the foot: ``what`` is for the paper's (5) and (6)."""
        if self.ground_loads:
            message = f"is true; {what} is for the paper's contact forces (5) and (6): leave it out"
            raise BadInput(message, key="foot.ground_loads")

    def felt(self, gains: Gains) -> Gains:
        """The gains as they act on this body: law (20) has a factor (M + m) g of the body that it knows."""
        if self.law != "cop" or self.known is None:
            return gains
        return gains._replace(K_f=gains.K_f * self.known.weight / self.biped.weight)

    def places(self, scenario: Scenario) -> list[Place]:
        """The environments of ``scenario`` that decide the linear stability of the loop."""
        biped = self.under(scenario).biped
        F = scenario.operating_forces(biped)
        return deciding_places(biped, self.law, F, self.adapt, self.target)

    @property
    def plain(self) -> bool:
        """Whether foot and target are the paper's: toe and heel equally far, the ankle on the ground, P_d = 0."""
        return self.biped.plain and self.target == 0.0

    @property
    def unlike(self) -> str:
        """What of foot and target is not the paper's, in words; empty where all is."""
        foot = self.biped
        said = [f"toe {foot.toe:g} m and heel {foot.heel:g} m from the ankle"] if foot.skew else []
        said += [f"an ankle {foot.height:g} m high"] if foot.height else []
        said += [f"a CoP target of {self.target:g} m"] if self.target else []
        return ", ".join(said)

    def must_be_plain(self, what: str) -> None:
        """Raise ``BadInput`` unless foot and target are the paper's, as ``what`` needs them."""
        if not self.plain:
            message = (
                f"has {self.unlike}; {what} needs toe and heel equally far from an ankle on the ground, and"
                " law.cop_target_m = 0; ask simulate or report"
            )
            raise BadInput(message, key="foot")

    def scenario(self, name: str) -> Scenario:
        """The scenario of that name; raises ``BadInput`` with the names there are."""
        for scenario in self.scenarios:
            if scenario.name == name:
                return scenario
        known = ", ".join(scenario.name for scenario in self.scenarios)
        message = f"no scenario {name!r}; the spec has: {known}"
        raise BadInput(message, key="--scenario")

    def given_gains(self) -> Gains:
        """The gains of the spec; raises ``BadInput`` if it has none."""
        if self.gains is None:
            message = "gains are missing; give law.kp, law.kd and (unless the law is pd) law.kf, or --gains KP,KD,KF"
            raise BadInput(message, key="law")
        return self.gains

    def with_law(self, kind: LawKind | None = None, gains: Gains | None = None) -> Setting:
        """The same setting under another law or other gains; under pd K_f is 0; only law force adapts."""
        kind = kind or self.law
        if gains is None:
            gains = self.gains if kind == self.law else _usable(self.written, kind)
        elif kind == "pd":
            gains = Gains(gains.K_p, gains.K_d, 0.0)
        return replace(self, law=kind, gains=gains, adapt=self.adapt if kind == "force" else math.inf)


def parse_gains(text: str, kind: LawKind) -> Gains:
    """Gains written as ``KP,KD,KF``, or ``KP,KD`` for law pd; raises ``BadInput``."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 2 and kind == "pd":
        numbers.append(0.0)
    if len(numbers) != 3 or not all(0 <= number <= 1e9 for number in numbers):
        message = f"is {text[:60]!r}; needs three numbers from 0 to 1e9, as in --gains 3500,1200,1"
        raise BadInput(message, key="--gains")
    return Gains(*numbers)


def setting_of(text: str) -> Setting:
    """The setting of a spec's ``text``, which may begin with a byte-order mark; raises ``BadInput``."""
    return setting(parse(text.removeprefix("\ufeff"), origin="the certificate's spec").spec)


def setting(spec: Spec) -> Setting:
    """Convert a checked spec to SI units."""
    body, foot = spec.body, spec.foot
    inertia = body.inertia_kgm2
    if inertia is None:
        inertia = 4.0 / 3.0 * body.mass_kg * body.com_height_m**2
    toe, heel = foot.levers
    biped = Biped(
        M=body.mass_kg, L=body.com_height_m, I=inertia, m=foot.mass_kg, ell=0.5 * (toe + heel),
        g=spec.simulation.gravity_mps2, skew=(toe - heel) / (toe + heel), height=foot.ankle_height_m,
    )  # fmt: skip
    bounds = spec.synthesis.bounds
    tolerances = _tolerances(spec.uncertainty, biped)
    _check_ramps(spec, tolerances)
    written = (spec.law.kp, spec.law.kd, spec.law.kf)
    return Setting(
        name=spec.name,
        biped=biped,
        scenarios=tuple(_scenario(biped, table) for table in spec.scenarios),
        law=spec.law.kind,
        theta_d=math.radians(spec.law.desired_angle_deg),
        adapt=math.inf if spec.law.adapt_s is None else spec.law.adapt_s,
        target=spec.law.cop_target_m,
        ground_loads=foot.ground_loads,
        gains=_usable(written, spec.law.kind),
        written=written,
        required=_required(spec.requirements),
        decay_asked=bool({"decay_rate_per_s", "settling_s"} & spec.requirements.model_fields_set),
        objective=spec.synthesis.maximise or spec.synthesis.minimise or "decay-rate",
        robust=spec.synthesis.robust,
        starts=spec.synthesis.starts,
        bounds=None if bounds is None else np.array([bounds.kp, bounds.kd, bounds.kf or [np.nan] * 2], dtype=float),
        step=spec.simulation.time_step_s,
        tuning=_tuning(spec.mpc),
        fixed_weights=frozenset(spec.mpc.model_fields_set),
        sensors=_sensors(spec.noise),
        tolerances=tolerances,
        study=spec.study,
    )


def _usable(written: tuple[float | None, float | None, float | None], kind: LawKind) -> Gains | None:
    """The gains that are written, if they are all that law ``kind`` needs."""
    K_p, K_d, K_f = written
    if kind == "pd":
        K_f = 0.0
    return None if K_p is None or K_d is None or K_f is None else Gains(K_p, K_d, K_f)


def _required(table: RequirementsTable) -> dict[str, Required]:
    ids = {
        "contact_force_n": "contact-force",
        "decay_rate_per_s": "decay-rate",
        "cop_margin_m": "cop-margin",
        "torque_nm": "torque",
        "torque_rate_nm_per_s": "torque-rate",
        "friction": "friction",
        "settling_s": "settling",
        "overshoot_deg": "overshoot",
        "posture_error_deg": "posture-error",
        "gain_margin_up": "gain-margin-up",
        "gain_margin_down": "gain-margin-down",
        "phase_margin_deg": "phase-margin",
        "delay_margin_s": "delay-margin",
        "force_delay_margin_s": "force-delay-margin",
        "angle_delay_margin_s": "angle-delay-margin",
        "disk_margin": "disk-margin",
        "sample_time_s": "sample-time",
        "step_slope_deg": "step-slope",
        "push_ns": "push",
        "slope_rate_deg_per_s": "slope-rate",
    }
    found = {}
    for key, row in ids.items():
        wish = getattr(table, key)
        if wish is not None:
            found[row] = Required(level=wish.level, soft=wish.soft)
    return found


def _scenario(biped: Biped, table: AnyScenario) -> Scenario:
    rest = {
        "name": table.name,
        "duration": table.duration_s,
        "theta0": math.radians(table.initial_angle_deg),
        "omega0": math.radians(table.initial_rate_deg_per_s),
    }
    if isinstance(table, SlopeTable):
        return slope(biped, angle=math.radians(table.angle_deg), ramp=table.ramp_s, **rest)  # type: ignore[arg-type]
    if isinstance(table, ForceTable):
        return constant_force(F_x=table.fx_n, F_y=table.fy_n, ramp=table.ramp_s, **rest)  # type: ignore[arg-type]
    if isinstance(table, PlatformTable):
        return platform(biped, points=np.array(table.acceleration_mps2), **rest)  # type: ignore[arg-type]
    return profile(points=np.array(table.points), **rest)  # type: ignore[arg-type]


def _tuning(table: MpcTable) -> Tuning:
    return Tuning(
        step=table.step_s,
        horizon=table.horizon,
        rate=table.rate_weight,
        torque=table.torque_weight,
        contact=table.contact_margin_percent / 100,
        preview_torque=table.preview_torque_weight,
        walk=table.force_walk_percent_per_sqrt_s / 100,
        real_time=table.real_time_iteration,
    )


def _sensors(table: NoiseTable) -> Sensors:
    return Sensors(
        angle=math.radians(table.angle_deg), rate=math.radians(table.rate_deg_per_s), force=table.force_n,
        angle_step=math.radians(table.angle_step_deg), rate_step=math.radians(table.rate_step_deg_per_s),
        force_step=table.force_step_n, delay=table.delay_s,
    )  # fmt: skip


def _tolerances(table: UncertaintyTable, biped: Biped) -> Tolerances:
    def spread(tolerance: Tolerance, unit: float = 1.0) -> Spread:
        return Spread(absolute=unit * (tolerance.absolute or 0.0), part=(tolerance.percent or 0.0) / 100)

    found = Tolerances(
        M=spread(table.mass_kg), L=spread(table.com_height_m), I=spread(table.inertia_kgm2),
        m=spread(table.foot_mass_kg), ell=spread(table.half_length_m),
        slope=spread(table.slope_deg, math.radians(1.0)), ramp=spread(table.ramp_s),
    )  # fmt: skip
    for name, key in (("M", "mass_kg"), ("L", "com_height_m"), ("I", "inertia_kgm2"), ("ell", "half_length_m")):
        least = getattr(found, name).around(getattr(biped, name), -1.0)
        if not least > 0:
            message = f"leaves {least:g} of {getattr(biped, name):g}; needs a tolerance less than that"
            raise BadInput(message, key=f"uncertainty.{key}")
    if found.m.around(biped.m, -1.0) < 0:
        message = f"is more than the mass itself, {biped.m:g}; needs at most that"
        raise BadInput(message, key="uncertainty.foot_mass_kg")
    return found


def _check_ramps(spec: Spec, tolerances: Tolerances) -> None:
    """Raise ``BadInput`` where the box holds a ramp that takes no time, or less."""
    for table in spec.scenarios:
        if not isinstance(table, SlopeTable | ForceTable) or table.ramp_s == 0.0:
            continue
        least, most = (tolerances.ramp.around(table.ramp_s, share) for share in (-1.0, 1.0))
        if least <= 0:
            message = (
                f"lets the ramp of scenario {table.name!r} last from {least:g} to {most:g} s; needs a tolerance less"
                f" than its {table.ramp_s:g} s"
            )
            raise BadInput(message, key="uncertainty.ramp_s")
