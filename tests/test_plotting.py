"""Common properties of figures, and figures of runs at every size of team.

Oracles: the boxes of what matplotlib draws; simulated colour blindness (Machado, Oliveira and Fernandes, IEEE TVCG 15,
2009) and the CIE Lab distance; the bytes of a second file.
"""

import io
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.files import FIGURE_FORMATS
from mjsheaf.show.plots import (
    _start_of_last_round,
    label_axes,
    label_ends,
    log_axis,
    log_limits,
    new_figure,
    place_names,
    settle,
    spread,
    spread_ends,
    write_figure,
)
from mjsheaf.show.style import BLUE, RED, FigureOptions, line_style, palette
from tests.pictures import is_legible, overlaps, written
from tests.strategies import slow

_BLINDNESS = {
    "none": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def seen(colour: Any, blindness: str) -> Array:
    """A colour in CIE Lab, as somebody sees it."""
    linear = np.array([c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)])
    linear = np.clip(np.array(_BLINDNESS[blindness]) @ linear, 0.0, 1.0)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ linear
    f = np.array([np.cbrt(v) if v > 0.008856 else 7.787 * v + 16 / 116 for v in xyz / [0.95047, 1.0, 1.08883]])
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("blindness", _BLINDNESS)
def test_colours_are_told_apart(blindness: str) -> None:
    """Of up to six groups, agents without one and targets; further groups differ by marker and dashes."""
    for some in (palette(6), [BLUE, RED]):
        assert min(np.linalg.norm(seen(a, blindness) - seen(b, blindness)) for a, b in combinations(some, 2)) > 15.0


def test_lines_are_told_apart_in_grey() -> None:
    assert len({(str(line_style(k)["linestyle"]), line_style(k)["marker"]) for k in range(12)}) == 12


@given(st.floats(-8.0, 8.0), st.floats(0.0, 6.0))
def test_a_logarithmic_axis_has_at_least_two_labels(exponent: float, decades: float) -> None:
    low, high = 10.0**exponent, 10.0 ** (exponent + decades)
    least, most = log_limits(low, high)
    assert least <= low
    assert high <= most
    assert most / least <= max(100.0, (high / low) * 1.001)  # no wider than it must be
    _, axis = panel()
    log_axis(axis, "y", np.array([low, 5.0 * high]))
    ticks = axis.yaxis.get_majorticklocs()
    bottom, top = axis.get_ylim()
    seen = ticks[(ticks >= bottom) & (ticks <= top)]
    assert 2 <= len(seen) <= 8
    np.testing.assert_allclose(np.log10(seen), np.round(np.log10(seen)), atol=1e-9)  # powers of 10


@given(st.lists(st.floats(-50.0, 150.0), min_size=1, max_size=12), st.floats(0.5, 8.0))
def test_names_at_ends_keep_their_distance(wanted: list[float], gap: float) -> None:
    places = spread(np.array(wanted), gap, 0.0, 100.0)
    order = np.argsort(np.array(wanted), kind="stable")
    assert (np.diff(places[order]) >= gap * (1 - 1e-9)).all()
    assert (places >= gap / 2 - 1e-9).all()
    assert (places <= 100.0 - gap / 2 + 1e-9).all()
    apart = np.diff(np.sort(wanted))
    if (apart >= gap).all() and min(wanted) >= gap / 2 and max(wanted) <= 100.0 - gap / 2:
        assert places == pytest.approx(wanted)  # nothing moves without a reason


@pytest.mark.long
@given(arrays(np.float64, (30, 2), elements=st.sampled_from([0.0, 0.001, 0.01, 0.5, 0.51, 1.0])))
def test_names_beside_points_are_never_over_another(places: Array) -> None:
    figure, axis = panel()
    axis.plot(*places.T, "o")
    settle(figure)
    place_names(axis, [f"agent{k}" for k in range(30)], places)
    assert 1 <= sum(text.text.startswith("agent") for text in written(figure)) <= 30
    assert is_legible(figure)


def panel() -> tuple[Figure, Any]:
    figure = new_figure(3.5, 3.0, "")
    axis = figure.subplots()
    label_axes(axis, "title", "x (m)", "y (m)")
    return figure, axis


def test_names_of_lines_that_end_in_one_point() -> None:
    figure, axis = panel()
    axis.plot([0, 1], [1e-3, 5.0])
    log_axis(axis, "y", np.array([1e-3, 5.0]))
    label_ends(axis, [(5.0, f"a line with the number {k}", "black") for k in range(9)] + [(np.nan, "lost", "red")])
    settle(figure)
    assert overlaps(written(figure))
    spread_ends(axis)
    assert is_legible(figure)


@pytest.mark.parametrize("form", FIGURE_FORMATS)
def test_equal_figures_give_equal_bytes(form: str) -> None:
    def drawn() -> bytes:
        figure, axis = panel()
        axis.plot([0, 1, 2], [1, 3, 2], "o-", label="$q^*$")
        axis.fill_between([0, 2], [0, 1], [1, 2], alpha=0.3)
        axis.legend()
        file = io.BytesIO()
        write_figure(figure, file, form)
        return file.getvalue()

    first = drawn()
    assert first == drawn()
    assert not any(word in first for word in (b"CreationDate", b"<dc:date", b"Matplotlib v"))


def test_text_stays_text_that_journals_take() -> None:
    figure, _ = panel()
    svg, pdf = io.BytesIO(), io.BytesIO()
    write_figure(figure, svg, "svg")
    write_figure(figure, pdf, "pdf")
    assert b">title</text>" in svg.getvalue()
    assert b"/Type3" not in pdf.getvalue()
    assert b"/FontFile2" in pdf.getvalue()  # TrueType


@pytest.mark.parametrize("formats", [(), ("gif",), ("png", "png"), ("",)])
def test_what_is_no_format_is_refused(formats: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match="png, svg, pdf"):
        FigureOptions(formats)


def plots_of(name: str, overrides: dict[str, Any], options: FigureOptions = FigureOptions()) -> None:  # noqa: B008
    from mjsheaf import load_scenario, simulate
    from mjsheaf.results.store import thinned
    from mjsheaf.runs.publish import _plots_of

    scenario = load_scenario(name, overrides)
    data = thinned(simulate(scenario, "ideal"))
    theorem = SimpleNamespace(applies=True, approximate=True, at=lambda time: np.full(len(time), 30.0))
    bounds: Any = [(theorem, SimpleNamespace(samples=None))]
    _plots_of(scenario, scenario.phases, data, bounds, options, lambda *_: None)


@pytest.mark.parametrize("size", [13, *map(slow, (1, 2, 60, 500))])
def test_plots_of_a_run_are_legible(size: int, drawn: list[Figure]) -> None:
    plots_of("swarm", {"swarm.size": size, "time.end": 1.0})
    assert len(drawn) == 3
    assert all(map(is_legible, drawn))
    names = {text.text for figure in drawn[1:] for text in written(figure)}
    assert "leader" in names
    if size <= 13:
        assert {f"S{k + 1}" for k in range(size)} <= names
    worst = [text.text for text in written(drawn[0]) if text.text.startswith("S")]
    assert len(set(worst)) >= min(size, 3)  # a stranger can tell which agent is worst


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["midpoint", "harbour", "harbour_lost_hexarotor", "noisy_harbour", "tetrahedron", "certified", "quads"]
)
def test_plots_of_other_teams_are_legible(name: str, drawn: list[Figure]) -> None:
    plots_of(name, {"time.end": 60.0 if "lost" in name else 3.0})
    assert all(map(is_legible, drawn))


@pytest.mark.long
def test_plots_of_awkward_teams_are_legible(drawn: list[Figure]) -> None:
    """Very long names, more groups than colours, all in one place, and many events at nearly one time."""
    groups = 30
    ids = [[f"agent-of-group-{g}-with-a-very-long-name-{'x' * 50}-{k}" for k in range(2)] for g in range(groups)]
    plots_of(
        "midpoint",
        {
            "time.end": 2.0,
            "agents": [{"id": name, "position": [0.0, 0.0]} for pair in ids for name in pair],
            "communication": ids,
            "sensing": [[name, "T1"] for pair in ids for name in pair],
            "formations": [
                {"name": f"group-{g}-{'y' * 60}", "shape": "line", "members": pair, "spacing": 1.0, "about": "T1"}
                for g, pair in enumerate(ids)
            ],
            "events": [{"time": 0.02 * k, "set": {"controller.gain": 2.0 + 0.1 * k}} for k in range(40)],
        },
    )
    assert all(map(is_legible, drawn))


@pytest.mark.long
def test_a_plot_without_title_has_all_else(drawn: list[Figure]) -> None:
    for title in (True, False):
        plots_of("midpoint", {"time.end": 0.1}, FigureOptions(("pdf",), title))
    for with_title, without in zip(drawn[:3], drawn[3:], strict=True):
        both = [{text.text for text in written(figure)} for figure in (with_title, without)]
        lost = [text for text in both[0] - both[1] if not text.replace("−", "").replace(".", "").isdigit()]
        assert len(lost) == 1  # next to numbers on axes, because panels are larger
        assert "midpoint" in lost[0]


def test_the_last_round_of_a_team_begins_where_it_was_a_period_before() -> None:
    """Of a team that drifts while it goes round and round; a team that goes somewhere has no rounds."""
    t = np.linspace(0.0, 50.0, 1501)
    circle = np.array([20.0 * np.cos(t) + 0.2 * t, 20.0 * np.sin(t), np.zeros_like(t)])
    tracks = np.stack([circle, circle + np.array([5.0, 3.0, np.nan])[:, None]])
    assert 50.0 - t[_start_of_last_round(tracks)] == pytest.approx(2.0 * np.pi, abs=0.5)
    away = np.stack([np.array([t, 0.0 * t, 0.0 * t])])
    assert _start_of_last_round(away) == 0
    assert _start_of_last_round(0.0 * away) == 0
