"""A comparison that several modules look at."""

import pytest

from mjsheaf.comparing import CompareRecord, compare
from tests.builders import two_boats


@pytest.fixture(scope="session")
def record() -> CompareRecord:
    """The comparison of two Otters about a hull, at a gain of 1 1/s."""
    return compare(two_boats("otter", "hull")).record
