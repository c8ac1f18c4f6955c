"""What the results of a check are made of: frozen pydantic models, which `check --json` prints as they are."""

import math
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict


class Record(BaseModel):
    """Base of all results; `mjsheaf schema --check` is their JSON Schema."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_by_name=True, serialize_by_alias=True)


def _finite(x: float | None) -> float | None:
    return None if x is None or not math.isfinite(x) else float(x)


Finite = Annotated[float | None, BeforeValidator(_finite)]
"""A finite number; what is infinite or not a number becomes None, null in JSON."""
