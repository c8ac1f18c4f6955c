"""Files of a study: the table, the plots and the page; failed runs are reported, and repeated on request."""

import csv
import io
import json
import re
import shlex
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mjsheaf.results.metrics import MEASURES
from mjsheaf.show.style import FigureOptions
from mjsheaf.studies.figures import plot_study, swept_axes
from mjsheaf.studies.plan import Plan, StudyFile, load_plan, points_of
from mjsheaf.studies.study import RESULT_FILES, csv_of, make_table, results_of, run_study, sealed
from mjsheaf.studies.workers import JobResult, new_record, run_job
from tests.builders import FACTS, IN_THREADS, small_plan
from tests.commands import answer_of, contents
from tests.page.pages import Elements
from tests.pictures import is_legible


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Good runs, a point that is no scenario, and one that diverges."""
    directory = tmp_path_factory.mktemp("mixed") / "study"
    plan = load_plan(
        "midpoint",
        grid={"controller.gain": [2, -1, 1e7], "spread.position": [0.5, 1.0]},
        seeds=(0, 2),
        overrides={"time.end": 1},
        backend="ideal",
    )
    run_study(plan, directory, IN_THREADS)
    return directory


def rows(directory: Path) -> list[dict[str, str]]:
    with (directory / "table.csv").open() as file:
        return list(csv.DictReader(file))


@pytest.mark.slow(first=True)
def test_the_table_has_a_row_a_run_in_order(mixed: Path) -> None:
    found = rows(mixed)
    columns = ["run", "controller.gain", "spread.position", "seed", "status", *MEASURES]
    late = [f"late_{measure}" for measure in MEASURES]
    others = ["ending", "settled", "bound_ratio", "late_bound_ratio", "numbers_per_agent_second", "law", "message"]
    assert list(found[0]) == [*columns, *late, *others]
    assert [row["run"] for row in found] == [str(k) for k in range(12)]
    assert [row["seed"] for row in found] == 6 * ["0", "1"]
    assert [row["status"] for row in found] == 4 * ["finished"] + 4 * ["invalid"] + 4 * ["unstable"]
    for row in found:
        record = json.loads((mixed / "runs" / f"{int(row['run']):06d}.json").read_text())
        assert float(row["controller.gain"]) == record["parameters"]["controller.gain"]
        assert row["message"] == record["message"]
        if row["status"] == "finished":
            assert float(row["tracking_error"]) == record["final"]["tracking_error"]
            assert row["settled"] == str(row["ending"] == "settled").lower()
            assert row["ending"] in ("settled", "not settled", "diverging")
            assert float(row["late_tracking_error"]) == record["late"]["tracking_error"]
            assert record["late"]["norm"] == record["final"]["norm"] == "per_agent_rms"
            assert row["formation_error"] == ""  # one boat has no formation
    assert "above 0" in found[4]["message"]
    assert found[8]["message"]
    assert found[8]["settled"] == "false"
    assert found[8]["ending"] == found[8]["late_tracking_error"] == ""


def test_parquet_and_csv_are_one_table(mixed: Path) -> None:
    table = pq.read_table(mixed / "table.parquet")
    for row, text in zip(table.to_pylist(), rows(mixed), strict=True):
        for name, value in row.items():
            shown = "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
            assert text[name] == shown


def test_columns_have_the_type_of_their_values() -> None:
    points: list[dict[str, Any]] = [{"a": 1, "b": 1, "c": "x", "d": True, "e": [1, 2]}, {"b": 2.5, "e": 3}]
    study = StudyFile(scenario="midpoint", points=points)
    plan = Plan("x", "x", study, {"name": "x"}, Path(), {}, list(points_of(study)))
    table = make_table(plan, [new_record(p, None, "failed", 'a\nb, "c"') for p in plan.points])
    written = pq.read_table(io.BytesIO(table.to_parquet()))
    types = {name: str(written.schema.field(name).type) for name in ("a", "b", "c", "d", "e", "seed")}
    assert types == {"a": "int64", "b": "double", "c": "string", "d": "bool", "e": "string", "seed": "int64"}
    assert written.column("a").to_pylist() == [1, None]
    assert written.column("e").to_pylist() == ["[1, 2]", "3"]
    found = list(csv.reader(csv_of(table).decode().splitlines()))
    assert [found[1][-1], found[1][4], found[2][1]] == ['a b, "c"', "true", ""]
    assert table.to_parquet() == table.to_parquet()


@pytest.mark.long
def test_only_what_did_not_finish_is_retried(tmp_path: Path) -> None:
    plan, out = small_plan(gains=(1.0, -1.0)), tmp_path / "study"
    run_study(plan, out, IN_THREADS)
    before = contents(out)
    assert run_study(plan, out, IN_THREADS, retry_failed=True).begun == 2
    assert contents(out) == before  # as nothing has changed, neither do they
    # What failed for want of something may finish now.
    path = out / "runs" / "000000.json"
    good = path.read_bytes()
    record = json.loads(good)
    lost = JobResult(new_record(plan.points[0], 0, "lost", "its worker died"), 0.0)
    path.write_text(json.dumps(sealed(lost)))
    assert record["status"] == "finished"
    assert run_study(plan, out, IN_THREADS).begun == 0
    assert rows(out)[0]["status"] == "lost"
    assert run_study(plan, out, IN_THREADS, retry_failed=True).begun == 3
    assert contents(out) == before


def test_bytes_that_differ_by_accident_are_written_again(monkeypatch: pytest.MonkeyPatch) -> None:
    layouts = iter(["usual", "odd", "usual", "usual", "never"])
    monkeypatch.setattr("mjsheaf.studies.workers.dataset_bytes", lambda _: next(layouts).encode())
    plan = small_plan(gains=(1.0,), seeds=None, trajectories=True)
    assert run_job(plan.job(plan.points[0])).dataset == b"usual"
    assert next(layouts) == "never"


# -- plots and page --------------------------------------------------------------------------------------------------


def made_up(study: StudyFile, failing: bool = False) -> list[dict[str, Any]]:
    rng = np.random.default_rng(1)
    records = []
    for point in points_of(study):
        if failing and point.number % 3 == 0:
            records.append(new_record(point, 0, "unstable", "blew up"))
        else:
            final = {"mean_disagreement": float(rng.uniform(1, 100)), "tracking_error": 1.0, "formation_error": None}
            records.append(new_record(point, 0, "finished", final=final, settled=point.number % 2 == 0))
    return records


STUDIES: list[dict[str, Any]] = [
    {},
    {"seeds": {"stop": 5}},
    {"grid": {"a": [0.01, 0.1, 1, 10]}},
    {"grid": {"a": ["ring", "small_world", [1, 2]]}, "seeds": {"stop": 4}},
    {"grid": {"a": [1, 2, 3], "b": ["x", "y"]}, "seeds": {"stop": 2}},
    {"grid": {"a": list(range(60)), "b": [1, 2]}},
    {"grid": {"a": [1, 2], "b": [1, 2], "c": [True, False]}},
    {"paired": {"a": [1, 2, 3, 4, 5], "b": [5, 4, 3, 2, 1]}, "measure": "tracking_error"},
    {"points": [{"a": 1}, {"a": 2, "b": 3}]},
    {"draws": {"count": 30, "values": {"a": {"kind": "uniform", "low": 0, "high": 1}}}},
    {"grid": {"a": [2]}},
    {"grid": {"a": ["$\\frac$", "$x", "a" * 60 + ".yaml"]}, "labels": {"a": "what $\\this$ costs (m)"}},
    {"grid": {"a": list(range(14)), "b": [x / 7 for x in range(14)]}},
]


@pytest.mark.slow
@pytest.mark.parametrize("failing", [False, True])
@pytest.mark.parametrize("fields", STUDIES)
def test_every_kind_of_study_is_drawn_and_legible(fields: dict[str, Any], failing: bool, drawn: list[Figure]) -> None:
    study = StudyFile.model_validate({"scenario": "midpoint", **fields})
    records = made_up(study, failing)
    for record in records:
        record["numbers_per_agent_second"] = 10.0 * record["run"]
        if len(records) < 10 and record["status"] == "finished":
            record["series"] = {"time": [0.0, 1.0, 2.0]} | {m: [3.0, 2.0, 1.0 + record["run"]] for m in MEASURES}
    plots = plot_study(study, "name", records)
    assert ("error.png" in plots) == any(record["status"] == "finished" for record in records)
    assert ("success.png" in plots) == failing
    assert drawn
    assert all(map(is_legible, drawn))
    for figure in drawn:
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        picture = np.asarray(canvas.buffer_rgba())[..., :3]
        assert min(picture.shape[:2]) > 400
        assert len(np.unique(picture)) > 20  # not blank


@pytest.mark.slow
def test_a_page_has_its_pictures_whatever_the_files_are() -> None:
    plan = small_plan()
    records = [new_record(p, 0, "finished", final=dict.fromkeys(MEASURES, 1.0), settled=True) for p in plan.points]
    files = results_of(plan, records, FigureOptions(("pdf",), title=False))
    assert "error.pdf" in files
    assert not any(name.endswith((".png", ".svg")) for name in files)
    assert b"data:image/png;base64," in files["index.html"]


@pytest.mark.slow
@pytest.mark.parametrize("ratios", [[0.4], [0.9472] * 30, [0.5, 0.9, 1.0, 1.01, 1.2]])
def test_runs_are_counted_against_the_bound(ratios: list[float], drawn: list[Figure]) -> None:
    """Every run in one bar, on its side of the bound; without a ratio nothing is drawn."""
    study = StudyFile.model_validate({"scenario": "midpoint", "seeds": {"stop": len(ratios) + 1}})
    records = made_up(study)
    plot_study(study, "name", records)
    without = len(drawn)
    for record, ratio in zip(records, ratios, strict=False):  # of the last it is not known
        record["bound_ratio"] = record["late_bound_ratio"] = ratio
    assert set(plot_study(study, "name", records)) <= RESULT_FILES
    (figure,) = [f for f in drawn[without:] if len(f.axes) == 2 and "bound" in f.axes[0].get_xlabel()]
    beyond = sum(ratio > 1.0 for ratio in ratios)
    for panel in figure.axes:
        assert panel.get_title() == f"{len(ratios)} runs, {beyond} beyond the bound"
        bars = [(bar.get_x(), bar.get_width(), bar.get_height()) for group in panel.containers for bar in group]
        assert sum(height for _, _, height in bars) == pytest.approx(1.0)
        assert sum(h for x, w, h in bars if x + w > 1.0 + 1e-5) == pytest.approx(beyond / len(ratios))
        assert all(x >= 1.0 or x + w <= 1.0 + 1e-5 for x, w, _ in bars)
    assert is_legible(figure)


def test_axes_are_logarithmic_where_values_span_decades() -> None:
    study = StudyFile(
        scenario="x", grid={"a": [0.1, 1, 10], "b": [1, 2, 3], "c": [-1, 1, 100], "d": ["p", "q"], "e": [1]}
    )
    axes = {axis.path: axis for axis in swept_axes(study, made_up(study))}
    assert {path: axis.log for path, axis in axes.items()} == {"a": True, "b": False, "c": False, "d": False}


def test_the_page_stands_alone(mixed: Path) -> None:
    text = (mixed / "index.html").read_bytes()
    page = Elements(text)
    assert not page.open
    assert [tag for tag, _ in page.found].count("tr") == 1 + 12
    assert b"4 finished, 4 unstable, 4 invalid" in text
    links = [value or "" for _, attributes in page.found for key, value in attributes.items() if key in ("src", "href")]
    assert [link[:22] for link in links] == 3 * ["data:image/png;base64,"] + ["table.csv", "table.parquet"]
    assert not re.search(rb"https?://|<script", text)


@pytest.mark.slow
def test_the_report_names_the_first_that_did_not_finish(tmp_path: Path) -> None:
    asked = ["--backend", "ideal", "--set", "time.end=1", "--grid", "controller.gain=1,1e7,2e7", "--threads"]
    answer = answer_of("sweep", "midpoint", *asked, "--workers", "1", "--out", tmp_path / "out")
    assert answer.code == 0, answer.err
    told = [line for line in answer.out.splitlines() if not line.endswith(" s since the start")]
    assert told[0] == "3 runs: 1 finished, 2 unstable"
    assert told[1].startswith("  run 1: unstable: A1 at t = ")
    assert told[2].startswith("  and 1 more that did not finish; see ")


@pytest.mark.slow
@pytest.mark.usefixtures("without_plots")
def test_the_command_of_the_page_does_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With what is set for all runs, text that YAML would take for something else, lists and a seed."""
    (tmp_path / "own.yaml").write_text(
        "scenario: midpoint\nbackend: ideal\nset: {time.end: 0.5, summary: \"it's 'no' & <b>\", name: 'null0'}\n"
        "points: [{controller.gain: -1}, {controller.gain: 3, spread.position: 1.5, agents.A1.position: [1, 2.5]}]\n"
        "seeds: {start: 7, stop: 8}\n"
    )
    out = tmp_path / "out"
    run_study(load_plan(str(tmp_path / "own.yaml")), out, IN_THREADS)
    page = unescape((out / "index.html").read_text())
    found = re.search(r"here run (\d+): <code>(mjsheaf .*?)</code>", page)
    assert found
    assert found[1] == "1"
    words = shlex.split(found[2])
    monkeypatch.chdir(out)
    answer = answer_of(*words[1:], "--no-video", "--out", tmp_path / "alone")
    assert answer.code == 0, answer.err
    record = json.loads((out / "runs" / "000001.json").read_text())
    summary = json.loads((tmp_path / "alone" / "summary.json").read_text())
    for measure in MEASURES:
        assert summary["final"][measure] == record["final"][measure]


@pytest.mark.slow
def test_the_page_shows_text_as_text(tmp_path: Path) -> None:
    nasty = "<script>alert(1)</script>"
    (tmp_path / "own.yaml").write_text(
        f"summary: {nasty}\nscenario: midpoint\nbackend: ideal\nset: {{time.end: 0.5}}\n"
        f"points: [{{summary: {nasty}}}, {{scene.surface: {nasty}}}]\n"
    )
    run_study(load_plan(str(tmp_path / "own.yaml")), tmp_path / "out", IN_THREADS)
    assert "<script" not in (tmp_path / "out" / "index.html").read_text()


# -- the paper's gain study ------------------------------------------------------------------------------------------


def test_the_gain_study_is_the_paper_s() -> None:
    """At the published gain its error is the published one; gains go from 0.01 to 30."""
    plan = load_plan("gain")
    gains = [point.parameters["controller.gain"] for point in plan.points]
    assert (min(gains), max(gains)) == (0.01, 30)
    assert sorted(set(gains)) == gains
    assert max(np.diff(np.log10(gains))) < 0.25
    record = run_job(plan.job(plan.points[gains.index(10)])).record
    assert record["final"]["time"] == pytest.approx(49.99)
    published = FACTS["checkpoints_gain_10"]["mean_disagreement"]["49.99"]
    assert record["final"]["mean_disagreement"] == pytest.approx(published, abs=1e-8)
    records = [{**record, "run": k, "parameters": p.parameters} for k, p in enumerate(plan.points)]
    assert list(plot_study(plan.study, plan.name, records)) == ["error.png"]  # one plot
