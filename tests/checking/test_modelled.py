"""Parts without a model in `check` are undecided, by name.

Terms are in the linear model, which is read off the stages that run (see `test_linear_law`); the bound of a run along
the targets' path is derived term by term, so that it is undecided with registered terms (`tests/law/test_custom`).
"""

from dataclasses import replace

import pytest

import mjsheaf
from mjsheaf.checking import examine
from mjsheaf.checking.loop.linear_law import unmodelled_parts
from mjsheaf.law.edges import LINK, LinkArrays
from mjsheaf.law.law import EdgeArrays, LawArrays
from mjsheaf.law.terms import RoundArrays, TermArrays
from mjsheaf.loop.system import System
from tests.builders import require

SCENARIO = "steady_current"


@pytest.fixture(scope="module")
def system() -> System:
    return mjsheaf.load_scenario(SCENARIO, {"links.all.noise": 0.01}).system


FIELDS: dict[str, tuple[tuple[str, ...], str]] = {
    "law": (LawArrays._fields, "edges gain limit supplied terms links custom safety seed"),
    "edges": (EdgeArrays._fields, "tail head listens first F_tail F_head P_tail P_head b kinds ramp"),
    "terms": (
        TermArrays._fields,
        "present agents dimension period sensing eigenvalues steepest fresh feedforward newton measured drift lead "
        "settled integral largest noise bias streams rounds",
    ),
    "rounds": (RoundArrays._fields, "present delay loss streams range lift own inverse stiffest"),
    "links": (LinkArrays._fields, "present table of lift facing size odometry start period record"),
    "link": (
        LINK.names or (),
        "edge place width moves delay hold random lossy bursts bearing noise bias range_noise bearing_noise range "
        "to_bad to_good bad loss_good loss_bad stream",
    ),
}


@pytest.mark.parametrize("structure", FIELDS)
def test_check_knows_every_field_of_a_law(structure: str) -> None:
    """Whoever adds a field decides whether `check` models it, in `unmodelled_parts`, and names it here."""
    fields, known = FIELDS[structure]
    assert set(fields) == set(known.split())


def test_sensors_gains_and_laws_in_python(system: System) -> None:
    law, table = system.law, system.law.links.table.copy()
    table["bearing"] = 2
    assert unmodelled_parts(replace(system, law=law._replace(links=law.links._replace(table=table)))) == [
        "sensor of a link"
    ]
    assert unmodelled_parts(replace(system, law=law._replace(supplied=2))) == ["law in Python"]
    gain = law.gain.copy()
    gain[0] *= 2.0
    assert unmodelled_parts(replace(system, law=law._replace(gain=gain))) == ["gains that differ between agents"]


def test_links_are_undecided_too() -> None:
    system = mjsheaf.load_scenario(SCENARIO, {"links.all.noise": 0.1, "links.all.loss": 0.2}).system
    gain = system.law.gain.copy()
    gain[0] *= 2.0
    record = examine(replace(system, law=system.law._replace(gain=gain))).record.model_dump(mode="json")
    links = record["links"]
    assert record["ok"] is False
    require(links, {"stable": None, "noise_rms": None, "delay_margin": None})
    for part in ("delay", "noise", "loss"):
        assert "because of gains that differ between agents" in links[part]["reason"]
