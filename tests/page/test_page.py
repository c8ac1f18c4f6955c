"""Content of a page. Oracles: the run's own data, a separate decoder, and an HTML parser."""

import base64
import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mjsheaf.errors import InputError
from mjsheaf.page.page import Packer
from mjsheaf.results.store import open_run
from mjsheaf.runs.publish import execute
from mjsheaf.scenario import load_scenario
from mjsheaf.video.film import film_of
from tests.commands import answer_of, call, is_refusal
from tests.oracles.law import residuals_of
from tests.page.pages import Elements, Made, make_page, positions_of, said_in, series_in

HOSTILE = "</script><script>document.title='broken'</script><!--<b>&amp;&lt;\u202egnol\u2028\u2029'\"`${1}{{ data }}"


@pytest.fixture(scope="module")
def lost() -> Made:
    return make_page("harbour_lost_hexarotor", "ideal", {"time.end": 63})


@pytest.fixture(scope="module")
def small() -> Made:
    return make_page("midpoint", "ideal", {"time.end": 0.1})


@given(
    arrays(np.float64, (7, 3), elements=st.floats(-1e6, 1e6) | st.just(np.nan)),
    arrays(np.float64, (5, 2), elements=st.floats(width=32)),
)
def test_arrays_come_back_as_near_as_is_said(fixed: np.ndarray, loose: np.ndarray) -> None:
    packer = Packer()
    returned = packer.add_fixed("fixed", fixed, 0.01)
    packer.add_float("loose", loose)
    said = json.dumps({"arrays": packer.index})
    page = f'<script id="said">{said}</script><script id="data">{packer.packed()}</script>'.encode()
    found = series_in(page)
    np.testing.assert_allclose(found["fixed"], fixed, atol=0.0050001)
    np.testing.assert_array_equal(found["fixed"], returned)
    np.testing.assert_array_equal(np.isnan(found["loose"]), np.isnan(loose))
    usual = np.abs(loose) < 3e38  # what is larger may round to infinity
    np.testing.assert_allclose(found["loose"][usual], loose[usual], rtol=2.0**-12, atol=1e-38)
    np.testing.assert_array_equal(found["loose"][np.isinf(loose)], loose[np.isinf(loose)])


@pytest.mark.slow
def test_no_vehicle_is_farther_off_than_is_said(lost: Made) -> None:
    """At every sample of the run, also those that the page leaves out; and what is said is not much too large."""
    said, found = said_in(lost.page), series_in(lost.page)
    every, time = lost.dataset["time"].values, np.array(said["time"])
    assert len(time) < len(every)
    there = positions_of(lost.dataset).reshape(len(every), -1)
    shown = np.column_stack([np.interp(every, time, column) for column in found["position"].T])
    away = np.linalg.norm((shown - there).reshape(len(every), -1, 3), axis=2).max()
    assert away == pytest.approx(said["largest_error"], rel=1e-3, abs=1e-6)
    assert away < 1e-3 * said["size"]


@pytest.mark.slow
def test_samples_on_both_sides_of_events_are_kept(lost: Made) -> None:
    time, period = said_in(lost.page)["time"], lost.scenario.system.grid.period
    for event in (45.0, 50.0):
        assert min(abs(t - event) for t in time) < 1e-9
        assert min(abs(t - (event - period)) for t in time) < 1e-9


@pytest.mark.slow
def test_links_carry_their_residuals_while_they_are_there(lost: Made) -> None:
    """NaN before the spare link is restored, and once H3 is lost."""
    said, found = said_in(lost.page), series_in(lost.page)
    names = [edge["name"] for edge in said["edges"]]
    time, residual = np.array(said["time"]), found["residual"]
    assert np.isnan(residual[time < 49.99, names.index("H2-H4")]).all()
    assert not np.isnan(residual[time > 50.01, names.index("H2-H4")]).any()
    assert np.isnan(residual[time > 45.01, names.index("H3-W2")]).all()
    k = int(np.searchsorted(time, 20.0))
    expected = residuals_of(lost.scenario.phases[0].system.team, found["position"].reshape(len(time), -1, 3)[k])
    for name, off in expected.items():
        assert residual[k, names.index(name)] == pytest.approx(off, rel=1e-2, abs=0.02), name


@pytest.mark.parametrize("name", ["range_formation", "bearing_formation"])
def test_links_that_measure_ranges_and_bearings_are_off_by_what_they_measure(name: str) -> None:
    """The distance from the desired length, or that from the place in the desired direction: 0 in formation."""
    made = make_page(name, "ideal", {"time.end": 2})
    names = [drawn["name"] for drawn in said_in(made.page)["edges"]]
    found = series_in(made.page)["residual"][-1]
    for edge, off in residuals_of(made.scenario.system.team, positions_of(made.dataset)[-1]).items():
        assert found[names.index(edge)] == pytest.approx(off, rel=1e-3, abs=1e-6), edge


@pytest.mark.long
def test_the_heading_has_the_law_of_every_phase() -> None:
    """Once where events leave it as it is."""
    events = [{"time": time, "set": {"controller.gain": gain}} for time, gain in ((0.2, 5), (0.4, 3))]
    page = make_page("midpoint", "ideal", {"time.end": 0.5, "events": events}).page
    assert said_in(page)["facts"]["law"] == (
        "sheaf law, gain 3 1/s; from 0.2 s on sheaf law, gain 5 1/s; from 0.4 s on sheaf law, gain 3 1/s"
    )
    page = make_page("paper", "ideal", {"time.end": 0.5, "events": [{"time": 0.2, "lose": "A1"}]}).page
    assert said_in(page)["facts"]["law"] == "sheaf law, gain 10 1/s"


def test_bounds_are_drawn_in_every_phase_and_lie_above_the_error() -> None:
    """Over sqrt(N), as the error is the RMS over agents."""
    made = make_page("certified", "ideal", {"time.end": 12, "events": [{"time": 6, "cut": ["A1", "A2"]}]})
    said, found = said_in(made.page), series_in(made.page)
    team = np.sqrt(np.nanmean(found["tracking_error"] ** 2, axis=1))
    assert said["bounds"] == ["Theorem 1"]
    bound = found["bound0"][:, 0]
    k = said["time"].index(6.0)
    assert not np.isnan(bound).any()
    assert (team <= bound * 1.001).all()
    assert bound[0] == pytest.approx(team[0], rel=1e-3)
    assert bound[k] == pytest.approx(team[k], rel=1e-3)  # each phase begins with its own error


@pytest.mark.slow
def test_links_that_hear_nothing_are_told_from_others() -> None:
    """Recorded reception decides whether a link is drawn; without records, its range."""
    overrides = {"time.end": 2, "links.record": True, "links.all.loss": 0.5}
    made = make_page("midpoint", "ideal", overrides)
    residual = series_in(made.page)["residual"]
    heard = made.dataset["heard"].values
    assert len(residual) == len(heard)
    np.testing.assert_array_equal(residual < 0, heard == 0)
    near = series_in(make_page("midpoint", "ideal", {"time.end": 2, "links.all.range": 14.0}).page)
    agent, first, second = (near["position"][:, 3 * v : 3 * v + 3] for v in range(3))
    apart = np.column_stack([np.linalg.norm(agent - target, axis=1) for target in (first, second)])
    clear = abs(apart - 14) > 0.1
    assert set((apart > 14)[clear].tolist()) == {True, False}
    np.testing.assert_array_equal((near["residual"] < 0)[clear], (apart > 14)[clear])


def test_a_page_has_the_scales_and_the_view_of_the_video() -> None:
    """Oracle: the video of the same run."""
    drawn = {"time.end": 0.1, "scene.vehicle_scales": {"W1": 2.5}, "video.azimuth": 30, "video.elevation": -50}
    made = make_page("harbour", "ideal", drawn)
    said = said_in(made.page)
    film, _ = film_of(made.scenario, made.dataset)
    np.testing.assert_allclose(said["scales"], film.scales)
    assert said["scales"][4] == 2.5
    assert [[scale, *names] for scale, names in said["larger"] if "W1" in names] == [[2.5, "W1"]]
    assert said["view"] == [-150.0, 50.0]
    assert [(flow["name"], flow["top"]) for flow in said["flow"]] == [(m.name, m.top) for m in film.media]


def test_text_of_a_scenario_cannot_leave_its_element(small: Made) -> None:
    made = make_page("midpoint", "ideal", {"time.end": 0.1, "summary": HOSTILE}, notes=[HOSTILE, {"text": HOSTILE}])
    tags = [[tag for tag, _ in Elements(page).found] for page in (made.page, small.page)]
    assert tags[0] == tags[1]
    said = said_in(made.page)
    assert said["facts"]["summary"] == HOSTILE
    assert [note["text"] for note in said["notes"]] == [HOSTILE] * 2


def test_the_policy_allows_the_script_and_the_style_and_nothing_else(small: Made) -> None:
    elements = Elements(small.page)
    policy = next(a["content"] for _, a in elements.found if a.get("http-equiv") == "Content-Security-Policy") or ""
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules.pop("default-src") == "'none'"
    assert set(rules) == {"script-src", "style-src", "base-uri", "form-action"}
    digests = [f"'sha256-{base64.b64encode(hashlib.sha256(t.encode()).digest()).decode()}'" for t in elements.texts]
    style, _, _, script = digests
    assert (rules["style-src"], rules["script-src"]) == (style, script)
    outside = [a for _, a in elements.found for key in a if key in ("src", "href", "srcset", "action")]
    assert not outside


def test_the_bundle_carries_the_licences_of_what_is_in_it(small: Made) -> None:
    script = Elements(small.page).texts[-1]
    for words in ("three.js authors", "Leon Sorokin", "Permission is hereby granted, free of charge"):
        assert words in script
    assert re.search(r"three \d+\.\d+\.\d+", script)


@pytest.mark.long
def test_a_page_is_written_again_from_the_directory_alone(tmp_path: Path) -> None:
    """To the byte, also from a directory that was moved, as its plots are; one that is damaged is refused."""
    scenario = load_scenario("midpoint", {"time.end": 0.5})
    execute(scenario, "physics", tmp_path / "run", video=None)
    first = (tmp_path / "run" / "report.html").read_bytes()
    moved = (tmp_path / "run").rename(tmp_path / "moved")
    (moved / "report.html").write_text("broken")
    assert call("report", moved) == 0
    assert (moved / "report.html").read_bytes() == first
    assert call("report", moved, "--out", tmp_path / "other.html") == 0
    assert (tmp_path / "other.html").read_bytes() == first
    for wrong in ("page.txt", "moved/other.html"):
        assert call("report", moved, "--out", tmp_path / wrong) == 2
        assert not (tmp_path / wrong).exists()
    plots = ("configurations.png", "errors.png", "trajectories.png")
    drawn = [(moved / name).read_bytes() for name in plots]
    assert call("plot", moved, "--format", "png,pdf", "--out", tmp_path / "plots") == 0
    assert len(list((tmp_path / "plots").glob("*.pdf"))) == len(plots)
    assert call("plot", moved, "--no-title") == 0
    assert all((moved / name).read_bytes() != data for name, data in zip(plots, drawn, strict=True))
    for wrong in ("moved/plots", "other.html"):
        assert call("plot", moved, "--out", tmp_path / wrong) == 2
    data = bytearray((moved / "result.nc").read_bytes())
    data[len(data) // 2] ^= 1
    (moved / "result.nc").write_bytes(data)
    assert is_refusal(answer_of("report", moved), "result.nc")


def test_what_theory_says_is_there_for_every_phase(lost: Made) -> None:
    first, second, third = said_in(lost.page)["facts"]["theory"]
    assert [phase["time"] for phase in (first, second, third)] == [0.0, 45.0, 50.0]
    assert second["events"] == ["lose H3"]
    assert [a["number"] for a in second["assumptions"]] == [a["number"] for a in first["assumptions"]]


@pytest.mark.parametrize("backend", ["ideal", pytest.param("physics", marks=pytest.mark.slow)])
def test_far_from_zero_a_page_keeps_its_digits(backend: str) -> None:
    """Distant positions refer to an origin near them."""
    static = {"motion": {"kind": "static"}}
    far = {"agents.A1.position": [5e5, 5.5e6], "time.end": 1}
    far |= {f"targets.T{k}": {"id": f"T{k}", "position": [5e5 + 2, 5.5e6 + k], **static} for k in (1, 2)}
    made = make_page("midpoint", backend, far)
    said, shown = said_in(made.page), series_in(made.page)["position"]
    assert said["largest_error"] < 0.01
    assert said["origin"] == [5e5, 5.5e6, 0.0]
    there = positions_of(made.dataset)[0]
    np.testing.assert_allclose(shown[0].reshape(-1, 3) + said["origin"], there, atol=0.01)


def test_limits_are_those_of_the_phase() -> None:
    events = [{"time": 0.2, "set": {"controller.velocity_limit": 2}}, {"time": 0.3, "join": "Q2"}]
    made = make_page("quads", "ideal", {"time.end": 0.5, "controller.velocity_limit": 5, "events": events})
    assert [one["limit"][:2] for one in said_in(made.page)["limits"]] == [[5.0, None], [2.0, None], [2.0, 2.0]]


@pytest.mark.parametrize("wrong", [{"notes": 5}, {"final": {"groups": {"a": 3}}}, {"expect": {"checks": 5}}])
def test_a_summary_that_is_not_one_is_refused(wrong: dict[str, Any], tmp_path: Path) -> None:
    for name in ("result.nc", "scenario.yaml"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "summary.json").write_text(json.dumps({"mjsheaf_version": "0", **wrong}))
    with pytest.raises(InputError, match=r"summary\.json cannot be read"), open_run(tmp_path):
        pass


def test_long_runs_are_read_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the same page."""
    whole = make_page("midpoint", "ideal", {"time.end": 1.0}).page
    monkeypatch.setattr("mjsheaf.show.played.length_of_piece", lambda _: 7)
    monkeypatch.setattr("mjsheaf.results.store.length_of_piece", lambda _: 7)
    assert make_page("midpoint", "ideal", {"time.end": 1.0}).page == whole


def test_a_comparison_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "compare.json").write_text('{"mjsheaf_version": ""}')
    assert is_refusal(answer_of("report", tmp_path), "holds a comparison")
