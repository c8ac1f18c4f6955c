"""Types of single fields of a scenario file: ids, bounded numbers, points, matrices."""

from typing import Annotated

from pydantic import Field

Id = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=100, description="letters, digits, _ and -")]
LARGEST = 1e9
"""Of every number in a file: a blow-up begins here, and products of what is larger would overflow."""

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Duration = Annotated[float, Field(ge=1e-9, le=LARGEST)]
Point = Annotated[list[Number], Field(min_length=2, max_length=3)]
Matrix = Annotated[list[Annotated[list[Number], Field(min_length=1)]], Field(min_length=1)]
