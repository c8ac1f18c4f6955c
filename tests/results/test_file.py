"""A run written piece by piece: the same data as in memory, and memory that does not grow.

Oracles: the whole run in memory; tracemalloc.
"""

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import simulate
from mjsheaf.results import store
from mjsheaf.results.dataset import join, make_datasets
from mjsheaf.results.store import open_dataset, pieces_of, thinned, write_dataset
from mjsheaf.runs import simulate as running
from mjsheaf.runs.simulate import stream
from mjsheaf.scenario import Scenario
from tests.builders import boat_and_drone, build_scenario
from tests.running import run_physics

BACKENDS = ("ideal", "physics")


PAIR = {"name": "pair", "members": ["A", "B"], "about": "T", "shape": "line", "spacing": 2}


def scenario(end: float = 0.5, **fields: Any) -> Scenario:
    """A formation of a boat and a drone."""
    return boat_and_drone(end, formations=[PAIR], **fields)


@pytest.fixture
def piece(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Sets the length of pieces."""
    return lambda samples: monkeypatch.setattr(running, "samples_in_piece", lambda system: samples)


def written(of: Scenario, backend: str, path: Path) -> xr.Dataset:
    write_dataset(stream(of.phases, backend, of.seed), path)
    with open_dataset(path) as dataset:
        return dataset.load()


EVENTS = [{"time": 0.2, "lose": "B"}, {"time": 0.3, "set": {"controller.gain": 1.5}}]


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("samples", [7, 17, 51, 1000])  # 51 samples: 3 x 17 leaves nothing, 7 x 7 leaves two
@pytest.mark.parametrize("events", [EVENTS, []], ids=["events", "plain"])
def test_pieces_on_disk_are_the_run_in_memory(
    events: list[Any], backend: str, samples: int, piece: Callable[[int], None], tmp_path: Path
) -> None:
    piece(samples)
    run = scenario(disturbance={"agents": {"bound": 0.5}}, events=events)
    whole = simulate(run, backend)
    assert whole.sizes["time"] == 51
    on_disk = written(run, backend, tmp_path / "a.nc")
    xr.testing.assert_identical(on_disk, whole)
    assert set(on_disk.coords) == set(whole.coords)
    piece(1000)
    at_once = simulate(run, backend)
    np.testing.assert_array_equal(whole["agent_position"], at_once["agent_position"])
    xr.testing.assert_allclose(whole, at_once, rtol=1e-13, atol=1e-13)
    written(run, backend, tmp_path / "b.nc")
    written(run, backend, tmp_path / "c.nc")
    assert (tmp_path / "b.nc").read_bytes() == (tmp_path / "c.nc").read_bytes()


@pytest.mark.long
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_run_that_blows_up_at_any_place_of_a_piece(
    backend: str, piece: Callable[[int], None], tmp_path: Path
) -> None:
    run = scenario(end=20.0, controller={"gain": 250.0})
    piece(10_000)
    whole = simulate(run, backend)
    assert whole.attrs["status"] == "unstable"
    last = whole.sizes["time"]
    for samples in {last - 1, last, last + 1, max(last // 2, 1)} - {0}:
        piece(samples)
        found = written(run, backend, tmp_path / f"{samples}.nc")
        assert found.sizes["time"] == last
        assert found.attrs == whole.attrs
        np.testing.assert_array_equal(found["agent_position"], whole["agent_position"])


@pytest.mark.long
@pytest.mark.parametrize("positions", [1, 2**14, 2**18])
def test_thinned_keeps_the_ends_and_reads_what_it_says(
    positions: int, piece: Callable[[int], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "_POSITIONS_READ", positions)
    piece(1000)
    run = scenario(end=90.0)
    whole = simulate(run, "ideal")
    write_dataset(stream(run.system, "ideal", 0), tmp_path / "a.nc")
    with open_dataset(tmp_path / "a.nc") as dataset:
        few = thinned(dataset)
        xr.testing.assert_identical(join(pieces_of(dataset, map(str, dataset.variables))), whole)
    assert few.sizes["time"] == 4000 < whole.sizes["time"] == 9001
    assert float(few["time"][0]) == 0.0
    assert float(few["time"][-1]) == float(whole["time"][-1])
    xr.testing.assert_identical(few, whole.sel(time=few["time"]))


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_memory_does_not_grow_with_the_run(backend: str, piece: Callable[[int], None], tmp_path: Path) -> None:
    piece(100)

    def peak(end: float) -> int:
        run = scenario(end=end)
        tracemalloc.start()
        write_dataset(stream(run.system, backend, 0), tmp_path / f"{end}.nc")
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(1.0)  # imports and compiles
    # What happens once, such as loading code that Python has carried out so far, counts in one of two runs only.
    short, long = (min(peak(end), peak(end)) for end in (5.0, 15.0))
    assert long <= 1.2 * short, (short, long)


def test_thrusters_of_stand_ins_have_their_own_names() -> None:
    """With underactuation off, a boat has other thrusters than its file: its commands have their names."""
    boats = {"A": {"position": [0, 0], "vehicle": "otter"}, "B": [3, 0]}
    physics = {"effects": {"underactuation": False}}
    sensing = [["A", "T"], ["B", "T"]]
    system = build_scenario(boats, {"T": [5, 1]}, sensing, time={"end": 0.1}, physics=physics).system
    found = run_physics(system)
    dataset = next(make_datasets([found], "physics", 0))
    names = [list(vehicle.thrusters) for vehicle in system.vehicles]
    first = 0
    for v, own in enumerate(names[:2]):
        here = dataset["thruster"].values[v]
        assert [name for name in here if name] == own
        np.testing.assert_array_equal(
            dataset["command"].values[:, v, : len(own)], found.log.thruster_command[:, first : first + len(own)]
        )
        first += len(own)
