"""The tables of a spec file that a study reads: the predictive controllers, noise, uncertainty, and the trials."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from design.spec.fields import Number, Table

ControllerName = Literal[
    "pd", "force", "cop", "pd-synthesized", "force-synthesized", "cop-synthesized",
    "lqr", "mpc", "nmpc", "mpc-oracle", "mpc-preview",
]  # fmt: skip
Weight = Annotated[Number, Field(ge=0, le=1e6)]
Deviation = Annotated[Number, Field(ge=0, le=1e6)]


class MpcTable(Table):
    """The predictive controllers: cost (e/1 rad)² + w_rate (ω/Ω)² + w_torque (τ/(A L))² a step, e = θ - θ_f."""

    step_s: Number = Field(default=0.02, ge=1e-4, le=1.0, description="step of the prediction [s]")
    horizon: int = Field(default=50, ge=2, le=1000, description="number of steps that are predicted")
    rate_weight: Weight = Field(
        default=0.02, description="weight of (ω/Ω)², Ω² = A L/I; the angle's is 1 (left out: a study tunes it)"
    )
    torque_weight: Annotated[Number, Field(ge=1e-9, le=1e6)] = Field(
        default=0.0135, description="weight of (τ/(A L))² (left out: a study tunes it)"
    )
    contact_margin_percent: Number = Field(
        default=1.0, ge=0, le=100, description="toe and heel force planned above what is required [% of the weight]"
    )
    preview_torque_weight: Annotated[Number, Field(ge=1e-9, le=1e6)] = Field(
        default=100.0,
        description="torque_weight of mpc-preview: who sees the future need not hurry (left out: a study tunes it)",
    )
    force_walk_percent_per_sqrt_s: Annotated[Number, Field(gt=0, le=1e4)] = Field(
        default=1.0, description="how fast the observer lets the external force change [% of the weight per √s]"
    )
    real_time_iteration: bool = Field(
        default=False, description="nonlinear: one iteration a period from the previous plan, instead of to convergence"
    )


class NoiseTable(Table):
    """What the sensors add: standard deviations of white noise, resolution, and a delay; 0 is none."""

    angle_deg: Deviation = Field(default=0.0, description="of the angle [deg]")
    rate_deg_per_s: Deviation = Field(default=0.0, description="of the rate [deg/s]")
    force_n: Deviation = Field(default=0.0, description="of toe and heel force, each [N]")
    angle_step_deg: Deviation = Field(default=0.0, description="resolution of the angle [deg]")
    rate_step_deg_per_s: Deviation = Field(default=0.0, description="resolution of the rate [deg/s]")
    force_step_n: Deviation = Field(default=0.0, description="resolution of toe and heel force [N]")
    delay_s: Number = Field(default=0.0, ge=0, le=1.0, description="age of a measurement, whole control periods [s]")


class Tolerance(Table):
    """A half-width: a number in the unit of its key, or ``{ percent = 2.0 }`` of the nominal value."""

    absolute: Annotated[Number, Field(ge=0, le=1e6)] | None = Field(default=None, description="in the unit of the key")
    percent: Annotated[Number, Field(ge=0, lt=100)] | None = Field(default=None, description="of the nominal value [%]")

    @model_validator(mode="before")
    @classmethod
    def _number(cls, value: object) -> object:
        return value if isinstance(value, dict) else {"absolute": value}

    @model_validator(mode="after")
    def _one(self) -> Tolerance:
        if (self.absolute is None) == (self.percent is None):
            message = "needs one of: a number, { absolute = ... }, { percent = ... }"
            raise ValueError(message)
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """A number, or the table."""
        return {"anyOf": [{"type": "number", "minimum": 0}, handler(core)]}


def _exactly() -> Any:
    return Tolerance(absolute=0.0)


class UncertaintyTable(Table):
    """How far the real body and world may be from the nominal ones, which the controllers keep."""

    mass_kg: Tolerance = Field(default_factory=_exactly, description="± of the body's mass [kg]")
    com_height_m: Tolerance = Field(default_factory=_exactly, description="± of the centre of gravity's height [m]")
    inertia_kgm2: Tolerance = Field(default_factory=_exactly, description="± of the inertia about the ankle [kg m²]")
    foot_mass_kg: Tolerance = Field(default_factory=_exactly, description="± of the foot's mass [kg]")
    half_length_m: Tolerance = Field(
        default_factory=_exactly, description="± of the foot's half length, toe and heel alike [m]"
    )
    slope_deg: Tolerance = Field(default_factory=_exactly, description="± of a slope's final angle [deg]")
    ramp_s: Tolerance = Field(default_factory=_exactly, description="± of the time in which a slope or force grows [s]")


class StudyTable(Table):
    """How controllers are compared."""

    trials: int = Field(default=20, ge=1, le=1_000_000, description="trials of each controller in each scenario")
    seed: int = Field(default=0, ge=0, le=2**63 - 1, description="seed of noise and uncertainty")
    control_period_s: Number = Field(default=0.005, ge=1e-4, le=1.0, description="period of every controller [s]")
    controllers: list[ControllerName] | None = Field(
        default=None, min_length=1, max_length=20, description="which controllers; left out: all"
    )
