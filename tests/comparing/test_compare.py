"""The comparison as a whole: its record, its directory, the command.

Oracles: the contract on DIR and exit codes; the record's own identities.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import jsonschema
import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure

from mjsheaf.comparing import CompareRecord, compare
from mjsheaf.comparing.figures import plot_budget, plot_convergence, plot_rungs
from mjsheaf.comparing.page import MAX_LINES, SCREEN_WIDTH, summary
from mjsheaf.comparing.variants import ladder_of, run_ablation
from mjsheaf.results.store import COMPARISON_FILES
from mjsheaf.scenario import load_scenario
from mjsheaf.video.film import Frames, VideoOptions, both_films, half_options
from mjsheaf.video.gl import available_backend
from mjsheaf.video.overlay import Overlay
from tests.builders import REPOSITORY, require, two_boats
from tests.commands import Capture, answer_of, call, is_refusal, one_line
from tests.pictures import is_legible

DATA = set(COMPARISON_FILES) - {"compare.mp4"}
SHORT = ["--set", "time.end=1"]


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], CompareRecord, Path]:
    """Return what `compare` prints, without its progress, its record, and where it is."""
    out = tmp_path_factory.mktemp("compare") / "out"
    answer = answer_of("compare", "midpoint", "--no-video", *SHORT, "--out", out)
    assert answer.code == 0
    record = CompareRecord.model_validate(json.loads((out / "compare.json").read_text()))
    lines = answer.out.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("midpoint: "))
    return lines[first:], record, out


@pytest.mark.long
def test_no_real_vehicle_follows_what_is_too_fast() -> None:
    """The paper's targets go at 28 m/s; the fastest boat is named, and by how much to slow."""
    told = " ".join(compare(load_scenario("paper", {"time.end": 2.0})).record.verdict)
    assert "targets of kind submersible" in told
    assert "slow motion and gain" in told
    assert "x500" in told


@pytest.mark.slow
def test_a_boat_that_a_bow_thruster_moves_abeam_is_named_with_that_speed() -> None:
    """50 N against 150 N s/m; its formula once gave 0, by which the command was divided."""
    cat = str(REPOSITORY / "tests" / "data" / "catamaran.yaml")
    told = [s for s in compare(two_boats(cat, cat)).record.verdict if "beyond their" in s]
    assert "beyond their 0.333 m/s" in told[0]


@pytest.mark.slow
def test_command_publishes_and_replaces_its_own(
    published: tuple[list[str], CompareRecord, Path], tmp_path: Path, capsys: Capture
) -> None:
    out = shutil.copytree(published[2], tmp_path / "out")
    assert {p.name for p in out.iterdir()} == DATA
    (out / "report.txt").write_text("of an earlier comparison")
    assert call("compare", "midpoint", "--no-video", *SHORT, "--out", out) == 0
    assert {p.name for p in out.iterdir()} == DATA
    printed = capsys.readouterr().out
    assert (out / "report.txt").read_text().splitlines()[0].strip() in printed
    found = json.loads((out / "compare.json").read_text())
    record = CompareRecord.model_validate(found)
    assert record.video is None
    assert record.time_s == pytest.approx(1.0)
    assert record.phases == []
    assert yaml.safe_load((out / "scenario.yaml").read_text())["time"]["end"] == 1
    assert call("schema", "--compare") == 0
    jsonschema.validate(found, json.loads(capsys.readouterr().out))


def test_command_leaves_what_is_not_its_own(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert is_refusal(answer_of("compare", "midpoint", "--no-video", *SHORT, "--out", tmp_path), "notes.txt")
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(("name", "code"), [("air_tracks_surface", 1), ("nowhere", 2)])
def test_command_refuses_in_one_line(name: str, code: int, tmp_path: Path) -> None:
    answer = answer_of("compare", name, "--no-video", "--out", tmp_path / "out")
    assert answer.code == code
    assert one_line(answer.err)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_blow_up_is_published_with_exit_code_3(tmp_path: Path, capsys: Capture) -> None:
    out = tmp_path / "out"
    diverging = ["--set", "controller.gain=200", "--set", "controller.control_period=0.02"]
    assert call("compare", "midpoint", "--no-video", *SHORT, *diverging, "--out", out) == 3
    assert "unstable" in capsys.readouterr().err
    assert {p.name for p in out.iterdir()} == DATA
    record = CompareRecord.model_validate_json((out / "compare.json").read_text())
    assert record.rung("all").status == "unstable"
    assert record.rung("all").errors["team"].late.tracking_error is None


@pytest.mark.long
def test_everything_else_is_there_before_the_video(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """The video is a draft unless asked otherwise; compare.json names it once it is there."""
    out = tmp_path / "out"
    asked: list[str] = []

    def draw(films: object, path: Path, options: VideoOptions, progress: object) -> int:
        assert {p.name for p in out.iterdir()} == DATA
        assert CompareRecord.model_validate_json((out / "compare.json").read_text()).video is None
        assert "report.html in any browser" in capsys.readouterr().out
        asked.append(options.quality)
        path.touch()
        return 1

    monkeypatch.setattr("mjsheaf.video.draw.available_backend", lambda: ("none", ""))
    monkeypatch.setattr("mjsheaf.video.draw.draw_video", draw)
    for quality in ("draft", "good"):
        option = ["--quality", quality] * (quality != "draft")
        assert call("compare", "midpoint", *SHORT, *option, "--out", out) == 0
        assert CompareRecord.model_validate_json((out / "compare.json").read_text()).video == "compare.mp4"
    assert asked == ["draft", "good"]


@pytest.mark.long
@pytest.mark.skipif(available_backend()[0] is None, reason="nothing can be drawn here")
def test_video_has_both_side_by_side(tmp_path: Path) -> None:
    out = tmp_path / "out"
    small = ["--set", "video.width=160", "--set", "video.height=120", "--set", "video.fps=4"]
    assert call("compare", "midpoint", *SHORT, *small, "--out", out) == 0
    assert {p.name for p in out.iterdir()} == set(COMPARISON_FILES)
    meta = next(imageio_ffmpeg.read_frames(str(out / "compare.mp4")))
    require(meta, {"size": (2 * 160 + 4, 120), "fps": 4})


def test_both_curves_of_the_video_have_one_axis() -> None:
    """Equal errors lie in equal rows. Oracle: the rows of one error in both videos."""
    scenario = two_boats("otter", "hull", time={"end": 4.0})
    runs = run_ablation(scenario.phases, [rung for rung in ladder_of(scenario.phases) if rung.key in ("ideal", "all")])
    data = [runs[key].dataset for key in ("ideal", "all")]
    options = half_options(scenario)
    films = [film for film, _ in both_films(scenario, data[0], data[1], options)]
    low, high = films[0].error_range or (0.0, 0.0)
    assert films[1].error_range == (low, high)
    assert films[0].span == films[1].span
    surveys = [Frames(film, options).extent.survey for film in films]
    errors = [survey.error for survey in surveys]
    assert high == max(error.max() for error in errors)
    assert low == max(min(error.min() for error in errors), high / 1e6)
    assert errors[0].min() != pytest.approx(errors[1].min(), rel=0.1)  # axes of their own would differ
    same = replace(surveys[0], error=np.geomspace(low, high, len(surveys[0].time)))
    films[1] = replace(films[1], subtitle=f"{films[1].subtitle}, feedforward, newton, drift")  # a wider plate
    overlays = [Overlay(film, options, same) for film in films]
    columns, rows = zip(*(overlay._curve for overlay in overlays), strict=True)
    np.testing.assert_array_equal(rows[0], rows[1])
    np.testing.assert_array_equal(columns[0], columns[1])
    assert rows[0][0] - rows[0][-1] > 30  # pixels: it fills the axis


@pytest.mark.long
@pytest.mark.parametrize("name", ["quads", "otters", "harbour"])
def test_plots_are_legible(name: str, drawn: list[Figure]) -> None:
    """Also where nine lines end in nearly one point, and with a panel for each group."""
    comparison = compare(load_scenario(name, {"time.end": 4.0}))
    plot_rungs(comparison.record, comparison.runs, Path("errors"))
    plot_budget(comparison.record, Path("budget"))
    plot_convergence(comparison.record, Path("convergence"))
    assert len(drawn) == 3
    assert all(map(is_legible, drawn))
    lines = [line for line in drawn[0].axes[0].lines if np.size(line.get_xdata()) > 10]
    looks = {(str(x.get_color()), str(x.get_linestyle()), str(x.get_marker()), str(x.get_linewidth())) for x in lines}
    assert len(looks) == len(lines) >= 7
    for axis in drawn[0].axes:
        named = [text.get_text() for text in axis.texts]
        assert {"all: as given"} <= set(named)


@pytest.mark.slow
def test_formats_and_title_are_given_on_the_command_line(drawn: list[Figure], tmp_path: Path) -> None:
    """Files are named by their formats. Oracle: what is asked to be written."""
    assert call("compare", "midpoint", "--format", "gif", "--no-video", "--out", tmp_path / "a") == 2
    assert (
        call("run", "midpoint", *SHORT, "--format", "svg,pdf", "--no-title", "--no-video", "--out", tmp_path / "b") == 0
    )
    assert len(drawn) == 6
    assert not any(figure.get_suptitle() for figure in drawn)


@pytest.mark.long
def test_a_run_in_other_formats_may_be_replaced(tmp_path: Path) -> None:
    run = ["run", "midpoint", "--backend", "ideal", *SHORT, "--no-video", "--out", str(tmp_path / "a")]
    assert call(*run, "--format", "svg") == 0
    assert call(*run) == 0
    assert not list((tmp_path / "a").glob("*.svg"))
    assert len(list((tmp_path / "a").glob("*.png"))) == 3


@pytest.mark.slow
def test_the_answer_is_a_few_lines_with_both_errors(published: tuple[list[str], CompareRecord, Path]) -> None:
    lines, record, _ = published
    assert len(lines) <= 20
    ideal, bodies = (record.rung(key).errors["team"].late.tracking_error for key in ("ideal", "all"))
    assert f"{ideal:.3g} m on ideal kinematics, {bodies:.3g} m on bodies (RMS over agents" in lines[1]
    assert " ".join(record.verdict[0].split()) in " ".join(" ".join(lines).split())
    assert sum("report.txt" in line for line in lines) >= 1


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 1, 9])
def test_a_long_verdict_is_cut_between_sentences(count: int, published: tuple[list[str], CompareRecord, Path]) -> None:
    sentences = [f"sentence {k} " + "is one of many " * 15 for k in range(count)]
    lines = summary(published[1].model_copy(update={"verdict": sentences}))
    assert len(lines) <= MAX_LINES
    assert max(map(len, lines)) <= SCREEN_WIDTH
    shown = sum(line.startswith("- sentence") for line in lines)
    assert shown == count or lines[-1] == f"  and {count - shown} more sentences in report.txt"


@pytest.mark.long
def test_full_prints_the_whole_report(tmp_path: Path) -> None:
    out = tmp_path / "out"
    answer = answer_of("compare", "midpoint", "--no-video", *SHORT, "--full", "--out", out)
    assert "ladder: errors in m" in answer.out
    assert len(answer.out.splitlines()) > len((out / "report.txt").read_text().splitlines())
