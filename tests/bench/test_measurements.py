"""What the measurements return, on small sizes: well formed figures and rows. How fast things are is no test."""

import json
from importlib import import_module
from typing import Any

import pytest

from mjsheaf.bench import assembly, ideal, loop, peers, startup, threads
from mjsheaf.bench.clock import best_cpu, best_wall, cpu_time
from mjsheaf.bench.rows import Row, at_least, at_most, informs
from mjsheaf.bench.sheaf import rows as sheaf_rows
from mjsheaf.bench.swarm import swarm
from mjsheaf.bench.table import TOPICS, run_bench
from mjsheaf.errors import InputError
from tests.builders import refused


def well_formed(rows: list[Row], topic: str) -> None:
    assert rows
    for row in rows:
        assert row.topic == topic
        assert row.what
        assert row.ours is not None
        assert row.ours > 0.0
        assert (row.met is None) == (row.wanted == "")
        if row.wanted:
            assert row.ratio is not None
            kind, bound = row.wanted.rsplit(" ", 1)
            assert row.met == {"at most": row.ratio <= float(bound), "at least": row.ratio >= float(bound)}[kind]
    json.dumps([row.as_dict() for row in rows])


# -- rows and clocks -----------------------------------------------------------------------------------------------


def test_a_row_says_whether_its_bound_holds() -> None:
    assert at_most("t", "w", 1.0, 2.0, 0.5, 0.5).met
    assert not at_most("t", "w", 1.0, 2.0, 0.51, 0.5).met
    assert at_least("t", "w", 1.0, 2.0, 4.0, 4.0).met
    assert not at_least("t", "w", 1.0, 2.0, 3.9, 4.0).met
    assert informs("t", "w", 1.0, 4.0).ratio == 0.25
    assert informs("t", "w", None).ratio is None
    assert at_least("t", "w", 1.0, 2.0, 4.0, 4.0).wanted == "at least 4"


def test_clocks_call_what_they_time_so_often() -> None:
    calls: list[int] = []
    for clock, times in ((best_wall, 3), (best_cpu, 4)):
        assert clock(lambda: calls.append(0), times) >= 0.0
    assert cpu_time(lambda: calls.append(0)) >= 0.0
    assert len(calls) == 8


# -- each measurement ----------------------------------------------------------------------------------------------


def test_loop() -> None:
    figures = loop.measure(short=True, sizes=(2, 4))
    assert [world["vehicles"] for world in figures["worlds"]] == [17, 3, 5]
    assert [world["thrusters"] for world in figures["worlds"][1:]] == [2 * 6 + 4, 4 * 6 + 4]
    for world in figures["worlds"]:
        assert world["step_us"] > 0.0 < world["bare_us"]
    well_formed(loop.rows(figures), "loop")


def test_ideal() -> None:
    figures = ideal.measure(short=True, end=0.11)
    assert figures["steps"] == 10
    assert 0.0 < figures["run_s"] < figures["simulate_s"]
    well_formed(ideal.rows(figures), "ideal")
    with_default_end = figures | {"steps": 4998}
    assert "4998" in ideal.rows(with_default_end)[0].what


@pytest.mark.slow
def test_threads() -> None:
    figures = threads.measure(short=True, ends=(0.11, 0.11))
    assert [b["backend"] for b in figures["backends"]] == ["ideal", "physics"]
    assert all(b["identical"] for b in figures["backends"])
    well_formed(threads.rows(figures), "threads")
    assert threads.rows(figures | {"threads": 1})[0].met is None
    for b in figures["backends"]:
        b["identical"] = False
    assert "DIFFER" in threads.rows(figures | {"threads": 2})[0].note


@pytest.mark.slow
def test_startup() -> None:
    figures = startup.measure(short=True)
    assert figures["python_s"] < figures["version_s"]
    well_formed(startup.rows(figures), "startup")


def test_assembly() -> None:
    figures = assembly.measure(size=5)
    assert figures["vehicles"] == 6
    assert figures["total_s"] == pytest.approx(sum(figures[f"{s}_s"] for s in ("scenario", "system", "world")))
    well_formed(assembly.rows(figures), "assembly")


def test_peers_are_those_measured_here_or_the_known_figures() -> None:
    figures: dict[str, Any] = {"mjsheaf": {"13": 1e6, "100": 2e6}, "bare": {"13": 1.1e6, "100": 2.2e6}}
    rows = peers.rows(figures)
    well_formed(rows, "peers")
    assert {row.note for row in rows if row.wanted} == {
        "crazyflow, measured elsewhere",
        "gym_pybullet_drones, measured elsewhere",
    }
    rows = peers.rows(figures | {"crazyflow": {"13": 5e5}})
    here = next(row for row in rows if row.note == "crazyflow, measured here")
    assert (here.reference, here.ratio, here.met) == (5e5, 2.0, False)


def test_our_rate_counts_every_vehicle() -> None:
    figures = peers.measure(short=True, sizes=(3,))
    assert figures["mjsheaf"]["3"] > 0.0
    assert figures["bare"]["3"] > 0.0


def test_sheaf_rows() -> None:
    small = [
        {"graph": "path", "operation": "coboundary", "ms": 0.1, "published_ms": 0.34, "ratio": 3.4},
        {"graph": "path", "operation": "build", "ms": 0.1, "published_ms": None, "ratio": None},
    ]
    grid = {"vertices": 10_000, "assembly_s": 2.0, "extension_s": 11.0, "peak_memory_gb": 1.0}
    figures = {"small": small, "grids": [grid], "growth_exponent": 1.05}
    rows = sheaf_rows(figures)
    well_formed(rows, "sheaf")
    assert [row.met for row in rows] == [True, None]
    rows = sheaf_rows(figures | {"grids": [grid, grid | {"vertices": 1_000_000}]})
    well_formed(rows, "sheaf")
    assert [row.met for row in rows] == [True, True, True, False, True]


# -- the swarm and the table ---------------------------------------------------------------------------------------


def test_a_swarm_has_the_size_and_the_fields_that_are_asked_for() -> None:
    system = swarm(10, "quadrotor", physics__timestep=0.004).system()
    assert system.bodies.vehicle == ["quadrotor"] * 10 + ["x500"]
    assert system.bodies.timestep == 0.004
    assert system.team.dirichlet.unique


def test_the_table_gathers_topics_in_order() -> None:
    seen: list[tuple[str, int, int]] = []
    found = run_bench(["ideal"], progress=lambda *report: seen.append(report))
    assert seen == [("measuring", 0, 1), ("measuring", 1, 1)]
    assert list(found["figures"]) == ["ideal"]
    assert {row["topic"] for row in found["rows"]} == {"ideal"}
    assert found["machine"]["processors"] >= 1
    json.dumps(found)
    for topic in TOPICS:
        module = import_module(f"mjsheaf.bench.{topic}")
        assert callable(module.measure)
        assert callable(module.rows)
    with refused(InputError, "'speed'", "startup", "ideal"):
        run_bench(["speed"])
