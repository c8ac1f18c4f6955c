"""Invalid options are refused with a line that names them and says what is expected."""

import re
from typing import Any

import pytest

from mjsheaf.errors import InputError
from mjsheaf.video.film import VideoOptions

OUT_OF_BOUNDS: dict[str, list[Any]] = {
    "width": [0, 1281, 100.5, 62, float("inf")],
    "height": [7682, -720],
    "fps": [0.5, 241],
    "speed": [0, -1, float("nan"), float("inf")],
    "azimuth": [float("nan")],
    "elevation": [91],
    "distance": [0],
    "trail": [-1],
    "quality": ["best"],
}


@pytest.mark.parametrize(
    ("option", "value"), [(option, value) for option, values in OUT_OF_BOUNDS.items() for value in values]
)
def test_option_out_of_bounds(option: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"\b{option}: .*{re.escape(repr(value))}"):
        VideoOptions(**{option: value})


@pytest.mark.parametrize(
    "options", [{}, {"width": 64, "height": 64}, {"width": 7680, "height": 4320}, {"elevation": -90}, {"trail": 0}]
)
def test_options_at_their_bounds(options: dict[str, Any]) -> None:
    VideoOptions(**options)
