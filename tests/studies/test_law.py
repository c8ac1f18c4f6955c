"""Studies of the law: named points, errors over time, and what agents send against what it brings.

Oracles: plain runs; the study that ships; counts in closed form.
"""

import numpy as np
import pytest
from matplotlib.figure import Figure

from mjsheaf import simulate
from mjsheaf.results.metrics import late_errors
from mjsheaf.scenario import load_scenario
from mjsheaf.studies.figures import plot_study, swept_axes
from mjsheaf.studies.plan import StudyFile, load_plan, points_of
from mjsheaf.studies.study import results_of
from mjsheaf.studies.workers import new_record, run_job
from tests.pictures import is_legible


@pytest.mark.long
def test_the_study_of_terms_draws_errors_over_time(drawn: list[Figure]) -> None:
    """Each term at its worst is better than what came before it; the figure is that of plain runs."""
    plan = load_plan("terms", overrides={"time.end": 12})
    records = [run_job(plan.job(point)).record for point in plan.points]
    late = [record["late"]["tracking_error"] for record in records]
    assert late == sorted(late, reverse=True)
    assert late[0] / late[-1] > 200.0
    paper = load_scenario("paper", {"time.end": 12})
    plain = simulate(paper, "ideal")
    assert late[0] == late_errors(paper.team, plain)["tracking_error"]
    series = records[0]["series"]
    assert len(series["time"]) == len(series["tracking_error"]) == 500
    own = np.sqrt((plain["tracking_error"].sel(time=series["time"]).values ** 2).mean(axis=1))
    np.testing.assert_allclose(series["tracking_error"], own, rtol=1e-12)
    files = results_of(plan, records)
    assert {"over_time.png", "error.png", "messages.png"} <= files.keys()
    assert all(map(is_legible, drawn))
    (axis,) = swept_axes(plan.study, records)
    assert axis.labels == plan.study.names


def test_what_agents_send_is_rounds_by_edges() -> None:
    """3 + 3 rounds of 100 periods a second over 18 edges of 2 numbers, both ways, by 13 agents."""
    plan = load_plan("law", overrides={"time.end": 1})
    point = next(p for p in plan.points if p.parameters["controller.newton.rounds"] == 3)
    record = run_job(plan.job(point)).record
    assert record["numbers_per_agent_second"] == pytest.approx(6 * 100 * 18 * 2 * 2 / 13)
    assert record["series"] is None
    assert len(plan.points) == 30


def test_fields_that_go_together_are_one_axis() -> None:
    rounds, gains = [1, 2, 5], [1.0, 10.0]
    together = {"controller.feedforward.rounds": rounds, "controller.newton.rounds": rounds}
    given = {"scenario": "paper", "paired": together, "grid": {"controller.gain": gains}, "measure": "tracking_error"}
    study = StudyFile.model_validate(given)
    records = [
        new_record(p, 0, "finished", final={"tracking_error": 1.0 / (p.number + 1)}, settled=True,
                   numbers_per_agent_second=100.0 * p.parameters["controller.newton.rounds"])
        for p in points_of(study)
    ]  # fmt: skip
    assert [axis.path for axis in swept_axes(study, records)] == ["controller.feedforward.rounds", "controller.gain"]
    assert sorted(plot_study(study, "name", records)) == ["error.png", "messages.png"]
    for record in records:
        record["numbers_per_agent_second"] = 0.0
    assert sorted(plot_study(study, "name", records)) == ["error.png"]


def test_plots_may_show_the_last_half() -> None:
    study = {"scenario": "midpoint", "grid": {"controller.gain": [1, 2]}, "measure": "tracking_error"}
    records = [
        new_record(p, 0, "finished", final={"tracking_error": 1.0}, late=None if p.number else {"tracking_error": 9.0})
        for p in points_of(StudyFile.model_validate(study))
    ]
    final, late = (plot_study(StudyFile.model_validate(study | {"late": x}), "name", records) for x in (False, True))
    assert final["error.png"] != late["error.png"]
