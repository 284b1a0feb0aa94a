"""Base class and value types of the tables of motors and machines."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from gantrysim.base.errors import InputError

_LARGEST_VALUE = 1e9
Positive = Annotated[float, Field(gt=0, le=_LARGEST_VALUE)]
NotNegative = Annotated[float, Field(ge=0, le=_LARGEST_VALUE)]
Count = Annotated[int, Field(ge=1, le=100_000)]


class Table(BaseModel):
    """A table of a TOML file: unknown keys are refused, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _reject_booleans(cls, values: Any) -> Any:
        for name, value in values.items() if isinstance(values, dict) else ():
            if isinstance(value, bool):
                raise InputError(f"{name} = {str(value).lower()}: must not be a boolean")
        return values


def key(description: str, default: Any = ...) -> Any:
    """Return a key of a table with its description; without a default it must be given."""
    return Field(default, description=description)
