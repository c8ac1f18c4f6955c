"""Finished runs compared: what is measured, what is refused, what is written, and the page with ghosts.

Oracles: the runs' own data; what `simulate` gives.
"""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import mjsheaf
from mjsheaf.page.page import Ghost, Packer, add_ghosts
from mjsheaf.results.store import RUNS_FILES
from mjsheaf.runs.overlay import MAX_RUNS, RunsRecord, compare_runs, open_runs, publish_runs
from mjsheaf.show.played import Region
from tests.builders import approx, list_members, two_boats
from tests.checking.test_norms import errors_of, records
from tests.commands import Capture, answer_of, call, is_refusal
from tests.conftest import draw_nothing
from tests.page.pages import said_in
from tests.running import rms_error


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of two boats: ideal, on bodies, at another period and longer, of a larger team, of others, and later."""
    folder = tmp_path_factory.mktemp("runs")
    usual = two_boats("hull", "hull").model_dump(mode="json", exclude_none=True)
    larger = {
        "agents": [*usual["agents"], {"id": "A3", "position": [5, 5]}],
        "sensing": [[id, "T1"] for id in ("A1", "A2", "A3")],
    }
    others = {
        "agents": [{**a, "id": a["id"].replace("A", "B")} for a in usual["agents"]],
        "communication": [["B1", "B2"]],
        "sensing": [["B1", "T1"], ["B2", "T1"]],
        "formations": [],
    }
    for name, backend, fields in (
        ("ideal", "ideal", {}),
        ("bodies", "physics", {}),
        ("longer", "ideal", {"time": {"end": 4.0}, "controller": {"gain": 0.5, "control_period": 0.05}}),
        ("larger", "ideal", larger),
        ("others", "ideal", others),
        ("later", "ideal", {"time": {"start": 5.0, "end": 6.0}}),
        ("lost", "ideal", {"events": [{"time": 1.0, "lose": "A2"}]}),
    ):
        with pytest.MonkeyPatch.context() as without:
            draw_nothing(without)
            dataset = mjsheaf.simulate(two_boats("hull", "hull", **fields), backend)
            mjsheaf.save(dataset, folder / name, video=False)
    return folder


@pytest.fixture
def without_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Comparisons have an empty page, which takes longer than the rest; that of `compared` is looked at."""
    monkeypatch.setattr("mjsheaf.runs.overlay.page_of_runs", lambda *_: b"")


@pytest.fixture(scope="module")
def compared(runs: Path) -> RunsRecord:
    directories = [runs / name for name in ("ideal", "bodies", "longer", "larger")]
    record, _, _ = publish_runs(directories, runs.parent / "compared")
    return record


def team_error(backend: str, **fields: object) -> np.ndarray:
    return rms_error(mjsheaf.simulate(two_boats("hull", "hull", **fields), backend))


@pytest.mark.long
def test_errors_are_those_of_the_runs_and_state_their_norm(compared: RunsRecord) -> None:
    ideal, bodies = team_error("ideal"), team_error("physics")
    late = slice(75, None)
    assert approx(compared.runs[0].final.tracking_error, rel=1e-9) == ideal[-1]
    assert approx(compared.runs[1].final.tracking_error, rel=1e-9) == bodies[-1]
    assert approx(compared.runs[1].final_difference.tracking_error, rel=1e-6) == bodies[-1] - ideal[-1]
    expected = np.sqrt((bodies[late] ** 2).mean()) - np.sqrt((ideal[late] ** 2).mean())
    assert approx(compared.runs[1].late_difference.tracking_error, rel=1e-6) == expected
    held = [record for _, record in records(compared.model_dump(mode="json")) if errors_of(record)]
    assert len(held) == 4 * len(compared.runs)
    assert {record["norm"] for record in [*held, *compared.model_dump()["runs"]]} == {"per_agent_rms"}


@pytest.mark.long
def test_a_longer_run_on_another_grid_is_compared_where_all_are(compared: RunsRecord) -> None:
    longer = compared.runs[2]
    assert (compared.start_s, compared.end_s) == (0.0, 3.0)
    assert longer.end_s == 4.0
    error = team_error("ideal", time={"end": 4.0}, controller={"gain": 0.5, "control_period": 0.05})
    assert approx(longer.final.tracking_error, rel=1e-9) == error[60]
    assert any("end at different times" in note for note in compared.notes)


@pytest.mark.slow
def test_distances_are_those_of_agents_in_common(compared: RunsRecord) -> None:
    scenario = two_boats("hull", "hull")
    ideal, bodies = (mjsheaf.simulate(scenario, backend)["agent_position"].values for backend in ("ideal", "physics"))
    apart = np.linalg.norm(np.nan_to_num(bodies - ideal), axis=2)
    assert approx(compared.runs[1].largest_distance_m) == apart.max()
    assert approx(compared.runs[1].distance_m) == np.sqrt((apart[75:] ** 2).mean())
    assert compared.runs[1].farthest == f"A{1 + int(apart.max(axis=0).argmax())}"
    assert (compared.runs[0].distance_m, compared.runs[3].agents_in_common) == (0.0, 2)
    assert any("larger has A3 in addition" in note for note in compared.notes)


@pytest.mark.slow
def test_an_absent_agent_has_no_distance(runs: Path, tmp_path: Path) -> None:
    """A2 is lost after 1 s and A1 then sees the target alone; A2 counts up to then."""
    with open_runs([runs / "ideal", runs / "lost"]) as opened:
        record = compare_runs(opened, tmp_path)
    scenario = two_boats("hull", "hull")
    lost = mjsheaf.simulate(two_boats("hull", "hull", events=[{"time": 1.0, "lose": "A2"}]), "ideal")
    plain = mjsheaf.simulate(scenario, "ideal")
    apart = np.linalg.norm(np.nan_to_num((lost["agent_position"] - plain["agent_position"]).values), axis=2)
    apart[50:, 1] = np.nan
    assert approx(record.runs[1].distance_m) == np.sqrt(np.nanmean(apart[75:] ** 2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["ideal"], "expected 2 to"),
        (["ideal", "ideal"], "given twice"),
        (["ideal", "others"], "has no agent in common with"),
        (["ideal", "later"], "covers 5 to 6 s"),
        (["ideal", "missing"], "holds no result.nc"),
        (["ideal", "../compared"], "holds a comparison of runs"),
        (["ideal"] * (MAX_RUNS + 1), "expected 2 to"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_line(
    runs: Path, compared: RunsRecord, names: list[str], words: str, tmp_path: Path
) -> None:
    assert is_refusal(answer_of("compare-runs", *(runs / name for name in names), "--out", tmp_path / "out"), words)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("without_page")
def test_the_command_writes_and_replaces_its_own(
    runs: Path, compared: RunsRecord, tmp_path: Path, capsys: Capture
) -> None:
    out = shutil.copytree(runs.parent / "compared", tmp_path / "out")
    assert {path.name for path in out.iterdir()} == set(RUNS_FILES)
    assert call("compare-runs", runs / "ideal", runs / "bodies", "--out", out) == 0
    assert {path.name for path in out.iterdir()} == set(RUNS_FILES)
    printed = capsys.readouterr().out
    assert "replaced the run" in printed
    assert "RMS over agents" in printed
    record = RunsRecord.model_validate_json((out / "runs.json").read_text())
    assert [run.name for run in record.runs] == ["ideal", "bodies"]
    assert [run.law for run in record.runs] == ["paper's law", "paper's law"]
    rows = list(csv.DictReader((out / "runs.csv").open()))
    assert [row["name"] for row in rows] == ["ideal", "bodies"]
    assert float(rows[1]["late_tracking_error"]) == approx(record.runs[1].late.tracking_error)
    (out / "notes.txt").write_text("mine")
    assert call("compare-runs", runs / "ideal", runs / "bodies", "--out", out) == 2
    answer = answer_of("compare-runs", runs / "ideal", runs / "bodies", "--out", runs / "ideal")
    assert is_refusal(answer, "directory of one of the runs")
    assert (runs / "ideal" / "result.nc").exists()


@pytest.mark.long
def test_runs_of_one_name_are_told_apart_and_no_number_is_cut(runs: Path, tmp_path: Path, capsys: Capture) -> None:
    other = tmp_path / "of another place" / "bodies"
    shutil.copytree(runs / "bodies", other)
    assert call("compare-runs", runs / "ideal", runs / "bodies", other, "--out", tmp_path / "out") == 0
    record = RunsRecord.model_validate_json((tmp_path / "out" / "runs.json").read_text())
    assert [run.name for run in record.runs] == ["ideal", f"{runs.name}/bodies", "of another place/bodies"]
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert f"({record.runs[2].final_difference.tracking_error:+.2g})" in printed


@pytest.mark.long
@pytest.mark.usefixtures("without_page")
def test_the_plot_has_a_line_for_each_run(runs: Path, drawn: list[Figure], tmp_path: Path) -> None:
    """Names of directories are not mathematics, and one that begins with an underscore is in the legend, too."""
    names = [r"$\frac{a$", "_later"]
    for name, run in zip(names, ("lost", "bodies"), strict=True):
        shutil.copytree(runs / run, tmp_path / name)
    publish_runs([tmp_path / name for name in names], tmp_path / "out")
    (figure,) = drawn
    legend = [text.get_text().replace(r"\$", "$") for text in figure.legends[0].get_texts()]
    for name in names:
        assert any(name in words for words in legend)
    tracking = figure.axes[0]
    data = [line for line in tracking.lines if "gain" in str(line.get_label())]
    assert len(data) == 2
    np.testing.assert_allclose(np.asarray(data[1].get_ydata(), dtype=float), team_error("physics"))
    assert "RMS over agents" in tracking.get_ylabel()
    assert "events of " in figure.axes[-1].get_xlabel()
    assert "lose A2" in figure.axes[-1].get_xlabel()


def test_the_page_has_the_other_runs_as_ghosts(runs: Path, compared: RunsRecord) -> None:
    assert json.loads((runs.parent / "compared" / "runs.json").read_text())["mjsheaf_version"] == mjsheaf.__version__
    said = said_in((runs.parent / "compared" / "report.html").read_bytes())
    assert [ghost["name"] for ghost in said["ghosts"]] == ["bodies", "longer", "larger"]
    assert {"ghost0", "ghost_quaternion0", "ghost_error2"} <= set(said["arrays"])
    assert len({ghost["colour"] for ghost in said["ghosts"]}) == 3
    assert "translucent: bodies, longer, larger" in said["facts"]["summary"]
    assert any("bodies: tracking error" in note["text"] for note in said["notes"])


def test_ghosts_are_where_their_run_has_them(runs: Path) -> None:
    """At the page's samples, by id; nothing where the other run has no such agent, or is over."""
    agents = list_members({"A0": [5, 5], "A1": {"position": [-4, 1], "heading": 20}, "A2": [-3, -2]})
    sensing = [[f"A{k}", "T1"] for k in range(3)]
    page = mjsheaf.simulate(two_boats("hull", "hull", agents=agents, sensing=sensing), "ideal")
    other = mjsheaf.simulate(two_boats("hull", "hull", time={"end": 2.0}), "ideal")
    captured: dict[str, np.ndarray] = {}

    class Capture(Packer):
        def add_fixed(self, name: str, values: np.ndarray, step: float) -> np.ndarray:
            captured[name] = values
            return values

        def add_float(self, name: str, values: np.ndarray) -> None:
            captured[name] = values

    time = page["time"].values[::10]
    ghost = Ghost("other", "#123456", other, 0.0)
    ids, positions = page["agent"].values.tolist(), np.zeros((len(time), page.sizes["agent"] + page.sizes["target"], 3))
    told = add_ghosts(Capture(), [ghost], ids, positions, time, Region(np.zeros(3), 10.0), np.zeros(3))
    assert told == [{"name": "other", "colour": "#123456"}]
    places = captured["ghost0"]
    assert np.isnan(places[:, 0]).all()  # A0 is not in the other run
    assert np.isnan(places[:, 3]).all()  # targets are not drawn
    within = time <= 2.0 + 1e-9
    np.testing.assert_allclose(places[within, 1, :2], other["agent_position"].values[::10, 0, :2], atol=1e-12)
    assert np.isnan(places[~within]).all()
    np.testing.assert_allclose(captured["ghost_error0"][within, 0], rms_error(other)[::10])
