"""Figures and the page of a run in Python.

Oracles: the files that `mjsheaf run` leaves; pyplot's own list of figures; an HTML parser.
"""

import base64
import json
import re
import shutil
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import mjsheaf
from mjsheaf.errors import InputError
from mjsheaf.runs.publish import plot_again
from mjsheaf.show.plots import write_figure
from tests.page.pages import Elements

NAMES = ["errors", "trajectories", "configurations"]


@pytest.fixture(scope="module")
def result() -> xr.Dataset:
    return mjsheaf.simulate(mjsheaf.load_scenario("midpoint", {"time.end": 2.0}), "ideal")


@pytest.fixture(scope="module")
def directory(result: xr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return mjsheaf.save(result, tmp_path_factory.mktemp("saved") / "run", video=False).directory


@pytest.mark.long
def test_figures_are_those_that_a_run_writes(result: xr.Dataset, directory: Path, tmp_path: Path) -> None:
    settings = dict(mpl.rcParams)
    before = plt.get_fignums()
    for source in (result, directory, str(directory)):
        figures = mjsheaf.plot(source)
        assert list(figures) == NAMES
        for name, figure in figures.items():
            assert isinstance(figure, Figure)
            write_figure(figure, tmp_path / "own.png", "png")
            assert (tmp_path / "own.png").read_bytes() == (directory / f"{name}.png").read_bytes()
    assert plt.get_fignums() == before
    assert dict(mpl.rcParams) == settings


@pytest.mark.slow
@pytest.mark.parametrize("eye", [(0.0, 30.0), (90.0, 30.0), (-60.0, 35.0)])
def test_the_view_in_space_is_that_of_the_video(eye: tuple[float, float]) -> None:
    """The arrows of the axes, in the view's right and up: matplotlib's own projection."""
    looking = {"video.azimuth": eye[0] - 180.0, "video.elevation": -eye[1]}
    own = mjsheaf.load_scenario("harbour", {"time.end": 0.2, **looking})
    assert own.video.eye == pytest.approx(eye)
    figure = mjsheaf.plot(mjsheaf.simulate(own, "ideal"))["trajectories"]
    (panel,) = (axis for axis in figure.axes if axis.get_title() == "in space")
    places = {text.get_text(): np.array(text.get_position()) for text in panel.texts}
    axes: Any = Figure().add_subplot(projection="3d", proj_type="ortho")
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(azim=eye[0], elev=eye[1])
    axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    projection = axes.get_proj()
    for name, direction in zip("xyz", np.eye(3), strict=True):
        seen = (projection @ [*direction, 0.0])[:2]
        drawn = places[name] - [0.16, 0.06]
        assert drawn[0] * seen[1] == pytest.approx(drawn[1] * seen[0], abs=1e-6)
        assert drawn @ seen >= 0.0


@pytest.mark.slow
def test_a_notebook_shows_all_figures(result: xr.Dataset) -> None:
    shown = mjsheaf.plot(result, title=False)._repr_html_()
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', shown)
    assert len(pictures) == len(NAMES)
    assert all(base64.b64decode(picture).startswith(b"\x89PNG") for picture in pictures)


@pytest.mark.slow
@pytest.mark.parametrize("source", ["result", "directory"])
def test_a_notebook_shows_the_page_in_a_frame(
    source: str, directory: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    page = mjsheaf.replay(request.getfixturevalue(source), height=500)
    assert source == "result" or page.html.encode() == (directory / "report.html").read_bytes()
    ((tag, frame),) = Elements(page._repr_html_().encode()).found
    assert (tag, frame["srcdoc"]) == ("iframe", page.html)
    assert "500px" in str(frame["style"])
    assert page.save(tmp_path / "page.html") == tmp_path / "page.html"
    assert (tmp_path / "page.html").read_text() == page.html
    assert len(repr(page)) < 200
    outside = [to for to in re.findall(r"""(?:src|href)=["'](\w+:[^"']+)""", page.html) if not to.startswith("data:")]
    assert outside == []  # needs no network


def test_what_is_no_run_is_refused(result: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a Dataset as `simulate` returns it, or the directory"):
        mjsheaf.plot(3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="has no scenario"):
        mjsheaf.replay(xr.Dataset())
    with pytest.raises(InputError, match="holds no result"):
        mjsheaf.plot(tmp_path)
    with pytest.raises(InputError, match="cannot be written"):
        mjsheaf.replay(result).save(tmp_path / "none" / "page.html")


@pytest.mark.slow
def test_a_run_without_a_checksum_is_not_said_to_have_changed(directory: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(directory, tmp_path / "run")
    summary = json.loads((copy / "summary.json").read_text())
    del summary["result_sha256"]
    (copy / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(InputError, match=r"summary.json has no checksum of result.nc; run the scenario again"):
        mjsheaf.plot(copy)


@pytest.mark.slow
def test_plots_are_drawn_again_one_by_one_and_a_refusal_leaves_nothing(directory: Path, tmp_path: Path) -> None:
    reported: list[tuple[str, int, int]] = []
    for place in (tmp_path / "typo", tmp_path / "a" / "plots"):
        with pytest.raises(InputError, match="holds no result"):
            plot_again(tmp_path / "typo", place, progress=lambda *step: reported.append(step))
    assert not reported
    assert list(tmp_path.iterdir()) == []
    found = plot_again(directory, tmp_path / "plots", progress=lambda *step: reported.append(step))
    assert found == sorted(tmp_path / "plots" / f"{name}.png" for name in NAMES)
    assert all(file.read_bytes() == (directory / file.name).read_bytes() for file in found)
    assert reported == [("plotting", done, len(NAMES)) for done in range(len(NAMES) + 1)]
