"""Units of data made by others, as CF and UDUNITS write them: 'm s-1', 'm/s', 'knots', 'millibars'; pint reads them."""

import re

from mjsheaf.errors import InputError, shortened

_OF_NO_LENGTH = re.compile(r"(common_|leap_)?(months?|years?|yr?)$", re.IGNORECASE)


def factor(unit: object, into: str) -> float:
    """Return what values in a unit are multiplied by to be in another.

    Months and years are none, as they have no fixed length.

    Raises:
        InputError: It is no unit, or one of something else.
    """
    from cf_xarray.units import units  # slow to import

    text = " ".join(str(unit).split())
    if into == "m s-1" and text.lower() in ("m/s", "ms-1"):  # the second would be 1/ms
        text = into
    try:
        if not text or "since" in text or isinstance(unit, int | float) or _OF_NO_LENGTH.match(text):
            raise ValueError
        return float(units.Quantity(1.0, units.Unit(text)).to(into).magnitude)
    except Exception:  # of the parser, which raises many kinds on what is no unit
        raise InputError(f"the unit is {shortened(repr(unit), 50)}; expected {into} or what converts to it") from None


def converts(unit: object, into: str) -> bool:
    """Return True if values in a unit can be converted to another; see `factor`."""
    try:
        return factor(unit, into) > 0.0
    except InputError:
        return False
