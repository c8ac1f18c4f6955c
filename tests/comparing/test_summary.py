"""The answer of `compare` in a few lines.

Oracle: compare.json.
"""

import json
from pathlib import Path

import pytest

from mjsheaf.comparing.causes import CompareRecord
from mjsheaf.comparing.page import MAX_LINES, SCREEN_WIDTH, summary
from tests.commands import answer_of

MAX_PRINTED = 20
SHORT = ("--no-video", "--set", "time.end=1")


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], CompareRecord]:
    """Return what `compare` prints, without its progress, and its record."""
    out = tmp_path_factory.mktemp("compare") / "out"
    answer = answer_of("compare", "midpoint", *SHORT, "--out", out)
    assert answer.code == 0
    record = CompareRecord.model_validate(json.loads((out / "compare.json").read_text()))
    lines = answer.out.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("midpoint: "))
    return lines[first:], record


@pytest.mark.slow
def test_the_answer_is_a_few_lines_with_both_errors(published: tuple[list[str], CompareRecord]) -> None:
    lines, record = published
    assert len(lines) <= MAX_PRINTED
    ideal, bodies = (record.rung(key).errors["team"].late.tracking_error for key in ("ideal", "all"))
    assert f"{ideal:.3g} m on ideal kinematics, {bodies:.3g} m on bodies (RMS over agents" in lines[1]
    assert " ".join(record.verdict[0].split()) in " ".join(" ".join(lines).split())
    assert sum("report.txt" in line for line in lines) >= 1


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 1, 9])
def test_a_long_verdict_is_cut_between_sentences(count: int, published: tuple[list[str], CompareRecord]) -> None:
    sentences = [f"sentence {k} " + "is one of many " * 15 for k in range(count)]
    lines = summary(published[1].model_copy(update={"verdict": sentences}))
    assert len(lines) <= MAX_LINES
    assert max(map(len, lines)) <= SCREEN_WIDTH
    shown = sum(line.startswith("- sentence") for line in lines)
    assert shown == count or lines[-1] == f"  and {count - shown} more sentences in report.txt"


@pytest.mark.slow
def test_full_prints_the_whole_report(tmp_path: Path) -> None:
    out = tmp_path / "out"
    answer = answer_of("compare", "midpoint", *SHORT, "--full", "--out", out)
    assert "ladder: errors in m" in answer.out
    assert len(answer.out.splitlines()) > len((out / "report.txt").read_text().splitlines())
