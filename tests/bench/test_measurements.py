"""Rows of measurements have verdicts that follow from their numbers. Speed itself is not tested."""

import json
import sys
from importlib import import_module
from pathlib import Path

import pytest

from benchmarks import counting, hardware, peers, processes, simulations
from benchmarks.measuring import TOPICS, Row, at_least, at_most, best, informs, run_bench, swarm
from mjsheaf.errors import InputError
from mjsheaf.loop.session import ENGINES
from mjsheaf.vectors import rotation
from tests.builders import refused


def well_formed(rows: list[Row], topic: str) -> None:
    assert rows
    for row in rows:
        assert row.topic == topic
        assert row.ours is not None
        assert row.ours > 0.0
        assert (row.met is None) == (row.wanted == "")
        if row.wanted:
            assert row.ratio is not None
            kind, bound = row.wanted.rsplit(" ", 1)
            assert row.met == {"at most": row.ratio <= float(bound), "at least": row.ratio >= float(bound)}[kind]


def test_a_row_says_whether_its_bound_holds() -> None:
    assert at_most("t", "w", 1.0, 2.0, 0.5, 0.5).met
    assert not at_most("t", "w", 1.0, 2.0, 0.51, 0.5).met
    assert at_least("t", "w", 1.0, 2.0, 4.0, 4.0).met
    assert not at_least("t", "w", 1.0, 2.0, 3.9, 4.0).met
    assert informs("t", "w", 1.0, 4.0).ratio == 0.25
    assert informs("t", "w", None).ratio is None


def test_a_clock_calls_what_it_times_so_often() -> None:
    calls: list[int] = []
    assert best(lambda: calls.append(0), 3) >= 0.0
    assert len(calls) == 3


def test_loop() -> None:
    rows = simulations.loop(short=True, sizes=(2, 4))
    well_formed(rows, "loop")
    assert [row.what.split(", ")[1] for row in rows[:3]] == ["17 vehicles", "3 vehicles", "5 vehicles"]
    assert rows[3].ratio == pytest.approx((rows[2].ours or 0.0) / 5 / ((rows[1].ours or 0.0) / 3))


@pytest.mark.long
def test_fused() -> None:
    rows = simulations.fused(short=True, sizes=(20, 40, 60))
    well_formed(rows, "fused")
    assert [row.what.split()[0] for row in rows if "tilted" in row.what] == ["21", "41"]
    (run,) = [row for row in rows if row.what.startswith("published")]
    assert "49980 steps" in run.what


@pytest.mark.long
def test_threads_give_the_same_bits() -> None:
    rows = simulations.threads(short=True, sizes=(20, 40), ends=(0.11, 0.11))
    well_formed(rows, "threads")
    assert not any("DIFFER" in row.note for row in rows)


@pytest.mark.slow(first=True)
def test_assembly_counts_every_vehicle() -> None:
    (row,) = simulations.assembly(size=5)
    well_formed([row], "assembly")
    assert "6 vehicles" in row.what


@pytest.mark.long
def test_peers_measured_elsewhere_stand_next_to_every_engine() -> None:
    rows = peers.peers(short=True, sizes=(13,))
    well_formed(rows, "peers")
    assert {row.note for row in rows} == {f"{peer}, measured elsewhere" for peer in peers.PEERS}
    assert {row.what.split()[3].rstrip(",") for row in rows} == set(ENGINES)


def test_peers_that_another_python_has_are_measured_in_the_same_run(tmp_path: Path) -> None:
    """It is handed the sizes; one that is none, or fails, is an error in one line."""
    python = tmp_path / "python"
    python.write_text("""#!/bin/sh\necho '{"crazyflow": {"13": 1.0}}'\n""")
    python.chmod(0o755)
    assert peers.measured_peers(str(python), (13,), True) == {"crazyflow": {13: 1.0}}
    assert peers.measured_peers(sys.executable, (13,), True) == {}
    with refused(InputError, "no-such-python"):
        peers.measured_peers("no-such-python", (13,), True)
    for silent in ("/bin/false", "/bin/true", "/bin/echo"):
        with refused(InputError, silent):
            peers.measured_peers(silent, (13,), True)
    with refused(InputError, "--peers", "topic"):
        run_bench(["hardware"], peers=sys.executable)


@pytest.mark.long
def test_operations_are_counted() -> None:
    """Operations of a rotation matrix as counted by hand; those of a step are hundreds, the same in both counts."""
    found = hardware.operations(hardware._settled(3))
    assert 300 < sum(found["step"].values()) < 3000
    assert found == hardware.operations(hardware._settled(3))
    counting.counted.clear()
    rotation.py_func(*map(counting.Number, (1.0, 0.0, 0.0, 0.0)))
    assert counting.counted == {"sums": 12, "products": 27}


@pytest.mark.long
def test_startup() -> None:
    well_formed(processes.startup(short=True), "startup")


def test_a_swarm_has_the_size_and_the_fields_that_are_asked_for() -> None:
    system = swarm(10, "quadrotor", physics__timestep=0.004).system
    assert system.bodies.vehicle == ["quadrotor"] * 10 + ["x500"]
    assert system.bodies.timestep == 0.004
    assert system.team.dirichlet.unique


@pytest.mark.long
def test_the_table_gathers_topics_in_order() -> None:
    seen: list[tuple[str, int, int]] = []
    found = run_bench(["ideal"], progress=lambda *report: seen.append(report))
    assert seen == [("measuring", 0, 1), ("measuring", 1, 1)]
    assert found["figures"] == {"ideal": {row["what"]: row["ours"] for row in found["rows"]}}
    assert {row["topic"] for row in found["rows"]} == {"ideal"}
    assert found["machine"]["processors"] >= 1
    json.dumps(found)
    assert all(callable(getattr(import_module(module), topic)) for topic, module in TOPICS.items())
