"""Parts without a model in `check` are undecided, by name.

Oracle: a field that is switched on in every structure of a law. Terms are in the linear model, which is read off the
stages that run (see `test_linear_law`); the bound of a run along the targets' path is derived term by term.
"""

import json
from collections import namedtuple
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.checking.check import examine
from mjsheaf.checking.loop.modelled import terms_without_bound, unmodelled_parts
from mjsheaf.control.law import EdgeArrays, LawArrays
from mjsheaf.control.links import LINK, LinkArrays
from mjsheaf.control.rounds import RoundArrays
from mjsheaf.control.terms import Feedforward, Newton, TermArrays, Terms, pack_terms
from mjsheaf.system import System
from tests.commands import call

SCENARIO = "steady_current"


def with_field(values: Any, name: str, value: Any) -> Any:
    """The named tuple with one more field, as if its class had it."""
    kind = type(values)
    extended: Any = namedtuple(kind.__name__, (*kind._fields, name))  # type: ignore[misc]
    for inherited in ("names", "noisy", "lossy", "random", "settling", "extended", "term_names", "without_terms"):
        if hasattr(kind, inherited):
            setattr(extended, inherited, getattr(kind, inherited))
    make: Any = extended._make
    return make((*values, value))


@pytest.fixture(scope="module")
def system() -> System:
    return mjsheaf.load_scenario(SCENARIO, {"links.all.noise": 0.01}).system


def test_every_shipped_field_is_modelled_or_the_list_is_out_of_date() -> None:
    """A field that was added without a name in `modelled` makes all shipped laws undecided where it is on."""
    from mjsheaf.checking.loop import modelled

    assert set(TermArrays._fields) == modelled._TERMS
    assert set(RoundArrays._fields) == modelled._ROUNDS
    assert set(LinkArrays._fields) == modelled._LINKS
    assert set(EdgeArrays._fields) == modelled._EDGES
    assert set(LawArrays._fields) == modelled._LAW
    assert set(LINK.names or ()) == modelled._LINK


@pytest.mark.parametrize("value", [0.5, np.array([0.0, 1.0]), True, 3])
def test_a_new_field_that_is_on_is_named(system: System, value: Any) -> None:
    law = system.law
    changed = {
        "field of the rounds robust": law._replace(
            terms=law.terms._replace(rounds=with_field(law.terms.rounds, "robust", value))
        ),
        "field of the links robust": law._replace(links=with_field(law.links, "robust", value)),
        "field of the edges robust": law._replace(edges=with_field(law.edges, "robust", value)),
        "field of the law robust": with_field(law, "robust", value),
    }
    assert unmodelled_parts(system) == []
    for name, other in changed.items():
        assert unmodelled_parts(replace(system, law=other)) == [name]
    assert terms_without_bound(law) == []
    assert terms_without_bound(law._replace(terms=with_field(law.terms, "robust", value))) == ["term robust"]


@pytest.mark.parametrize("value", [0.0, np.zeros(3), False, 0, np.zeros(0)])
def test_a_new_field_that_is_off_changes_nothing(system: System, value: Any) -> None:
    law = system.law._replace(terms=with_field(system.law.terms, "robust", value))
    assert unmodelled_parts(replace(system, law=law)) == terms_without_bound(law) == []


def test_a_limit_whose_neutral_value_is_not_zero_is_off_there(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjsheaf.checking.loop.modelled.TermArrays", lambda: with_field(TermArrays(), "width", np.inf))
    for width, parts in ((np.inf, []), (2.0, ["term width"])):
        terms = with_field(system.law.terms, "width", width)
        assert terms_without_bound(system.law._replace(terms=terms)) == parts


def test_sensors_gains_and_laws_in_python(system: System) -> None:
    law, table = system.law, system.law.links.table.copy()
    table["bearing"] = 2
    assert unmodelled_parts(replace(system, law=law._replace(links=law.links._replace(table=table)))) == [
        "sensor of a link"
    ]
    columns = np.zeros(len(table), dtype=[*((n, LINK[n]) for n in LINK.names or ()), ("skew", "f8")])
    columns["skew"] = 0.1
    assert unmodelled_parts(replace(system, law=law._replace(links=law.links._replace(table=columns)))) == [
        "field of a link skew"
    ]
    assert unmodelled_parts(replace(system, law=law._replace(supplied=2))) == ["law in Python"]
    gain = law.gain.copy()
    gain[0] *= 2.0
    assert unmodelled_parts(replace(system, law=law._replace(gain=gain))) == ["gains that differ between agents"]


def test_terms_are_found_by_name() -> None:
    assert not Terms().any
    assert Terms(newton=Newton()).any
    more = with_field(Terms(feedforward=Feedforward()), "robust", None)
    assert more._replace(feedforward=None).odometry == Terms().odometry
    extended = type("Extended", (type(more),), {"any": Terms.any})
    assert extended(*more._replace(feedforward=None, robust=1.0)).any
    assert not extended(*more._replace(feedforward=None)).any


@pytest.mark.slow
def test_no_bound_is_stated_of_a_run_with_a_new_term(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop is that of the law that runs; the bound, derived term by term, is undecided."""
    before = mjsheaf.check(mjsheaf.load_scenario(SCENARIO), trial=False)["law"]

    def packed(*args: Any, **kwargs: Any) -> Any:
        return with_field(pack_terms(*args, **kwargs), "robust", 30.0)

    monkeypatch.setattr("mjsheaf.scenario.scenario.pack_terms", packed)
    law = mjsheaf.check(mjsheaf.load_scenario(SCENARIO), trial=False)["law"]
    assert law["spectral_radius"] == before["spectral_radius"]
    assert before["radius"] is not None
    for name in ("radius", "command", "largest"):
        assert law[name] is None
    assert "with term robust" in law["reason"]


def test_a_continuous_law_with_a_new_term_is_undecided(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def packed(*args: Any, **kwargs: Any) -> Any:
        return with_field(pack_terms(*args, **kwargs), "robust", 30.0)

    changes = {"controller.integral": None, "controller.control_period": 0}
    monkeypatch.setattr("mjsheaf.scenario.scenario.pack_terms", packed)
    options = [f"--set={path}={json.dumps(value)}" for path, value in changes.items()]
    assert call("check", SCENARIO, "--no-trial", "--json", *options) == 1
    printed = capsys.readouterr()
    record = json.loads(printed.out)
    assert record["ok"] is False
    assert record["law"]["unmodelled"] == ["term robust"]
    assert record["law"]["stable"] is None
    assert record["margins"]["bodies"]["stable"] is None
    assert record["proposals"] == []
    assert "because of term robust" in record["law"]["reason"]
    assert "undecided, because of term robust" in printed.err


def test_links_are_undecided_too(monkeypatch: pytest.MonkeyPatch) -> None:
    system = mjsheaf.load_scenario(SCENARIO, {"links.all.noise": 0.1, "links.all.loss": 0.2}).system
    law = system.law._replace(links=with_field(system.law.links, "robust", 1.0))
    record = examine(replace(system, law=law)).record.model_dump(mode="json")
    links = record["links"]
    assert record["ok"] is False
    assert links["stable"] is None
    assert links["noise_rms"] is None
    assert links["delay_margin"] is None
    for part in ("delay", "noise", "loss"):
        assert "because of field of the links robust" in links[part]["reason"]
