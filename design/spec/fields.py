"""What the fields of a spec file are made of: finite numbers, names, closed tables, levels of requirements."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema


def _plain_number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        kind = {bool: "a boolean", str: "a string"}.get(type(value), f"a {type(value).__name__}")
        hint = f"; write {value} without quotes" if isinstance(value, str) and _is_plain(value) else ""
        message = f"is {kind}; needs a number{hint}"
        raise ValueError(message)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        message = f"is {number}; needs a finite number"
        raise ValueError(message)
    if number == 0.0 and math.copysign(1.0, number) < 0:
        message = "is -0.0; write 0.0"
        raise ValueError(message)
    return number


def _is_plain(text: str) -> bool:
    """Whether ``text`` would be accepted without its quotes."""
    try:
        _plain_number(float(text))
    except ValueError:
        return False
    return len(text) < 20


Number = Annotated[float, BeforeValidator(_plain_number)]
Inertia = Annotated[float, Field(ge=1e-6, le=1e9), BeforeValidator(_plain_number)]
Gain = Annotated[float, Field(ge=0, le=1e9), BeforeValidator(_plain_number)]
Bounded = Annotated[float, Field(ge=-1e6, le=1e6), BeforeValidator(_plain_number)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_. -]{0,63}$")]


class Table(BaseModel):
    """A table of the spec file: frozen, and closed to unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


def _number_or(table: JsonSchemaValue) -> JsonSchemaValue:
    return {"anyOf": [{"type": "number", "minimum": 0}, table]}


def _level_table(value: object, key: str) -> object:
    return value if isinstance(value, dict) else {key: value}


class AtLeast(Table):
    """A requirement from below: a number, or ``{ min = 20.0, soft = true }``."""

    min: Number = Field(ge=0, description="the level, a number")
    soft: bool = Field(default=False, description="a soft requirement is shown when broken, and fails nothing")

    @model_validator(mode="before")
    @classmethod
    def _number(cls, value: object) -> object:
        return _level_table(value, "min")

    @property
    def level(self) -> float:
        """The required value, in the unit of its key."""
        return self.min

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """A number, or the table."""
        return _number_or(handler(core))


class AtMost(Table):
    """A requirement from above: a number, or ``{ max = 40.0, soft = true }``."""

    max: Number = Field(ge=0, description="the level, a number")
    soft: bool = Field(default=False, description="a soft requirement is shown when broken, and fails nothing")

    @model_validator(mode="before")
    @classmethod
    def _number(cls, value: object) -> object:
        return _level_table(value, "max")

    @property
    def level(self) -> float:
        """The allowed value, in the unit of its key."""
        return self.max

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """A number, or the table."""
        return _number_or(handler(core))
