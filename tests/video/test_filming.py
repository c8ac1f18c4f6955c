"""From a run's data to what is drawn."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mjsheaf.video
from mjsheaf import simulate
from mjsheaf.filming import film_run
from mjsheaf.scenario import scenario_from_mapping
from mjsheaf.video import Film, VideoOptions


@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_the_film_knows_where_the_surface_is(backend: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Boats float on it, and stems end on it."""
    films: list[Film] = []

    def draw_video(film: Film, *_: Any) -> int:
        films.append(film)
        return 0

    monkeypatch.setattr(mjsheaf.video, "draw_video", draw_video)
    scenario = scenario_from_mapping(
        {
            "name": "lake",
            "time": {"end": 0.05},
            "agents": [{"id": "A", "position": [0, 0]}],
            "targets": [{"id": "T", "position": [5, 0]}],
            "sensing": [["A", "T"]],
            "scene": {"surface": "water", "height": 12.0},
        }
    )
    film_run(scenario, simulate(scenario, backend=backend), tmp_path / "video.mp4", VideoOptions())
    assert (films[0].surface, films[0].surface_height) == ("water", 12.0)
    np.testing.assert_allclose(films[0].positions[..., 2], 12.0, atol=1e-6)
