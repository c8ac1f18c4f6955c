"""Variables are declared once: an entry of the list is all that a new one takes; sinks get what the list says.

Oracles: the law's own residual, and the dataset that `simulate` returns.
"""

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import mjsheaf
from mjsheaf import simulate
from mjsheaf.compile.jit import inline_jit
from mjsheaf.errors import InputError
from mjsheaf.loop.engine import READERS
from mjsheaf.results import dataset
from mjsheaf.results.dataset import COORDINATES, VARIABLES, Variable, fault_of
from mjsheaf.results.store import Memory, Sink, dataset_bytes, open_dataset, send, write_dataset
from mjsheaf.runs.simulate import stream
from tests.builders import REPOSITORY, boat_and_drone

sys.path.append(str(REPOSITORY / "docs" / "_ext"))
import fields

BACKENDS = ("ideal", "physics")
SPEED = Variable(
    "agent_speed",
    ("time", "agent"),
    "m s-1",
    "speed over ground of each agent",
    lambda s: np.linalg.norm(s.log.velocity, axis=2),
    rows="agent",
)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("backend", BACKENDS)
def test_one_entry_is_in_the_file_and_in_the_reference(
    backend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset, "VARIABLES", [*VARIABLES, SPEED])
    run = boat_and_drone(0.3)
    write_dataset(stream(run.system, backend, 0, samples=7), tmp_path / "result.nc")
    with open_dataset(tmp_path / "result.nc") as found:
        assert found["agent_speed"].attrs == {"units": "m s-1", "long_name": "speed over ground of each agent"}
        expected = np.linalg.norm(np.nan_to_num(found["agent_velocity"].values), axis=2)
        np.testing.assert_allclose(found["agent_speed"].values, expected, rtol=1e-12, atol=1e-3)
        assert found["agent_speed"].dims == ("time", "agent")
    assert "`agent_speed` | time, agent | m s-1 | speed over ground of each agent" in fields.variables()


@pytest.mark.long
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_compiled_reader_writes_while_the_loop_runs(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two entries side by side, of unlike widths, are what the law had at each sample."""

    def residual(run, memory, v, out):
        for i in range(3):
            out[i] = memory.residual[v, i]

    def first(run, memory, v, out):
        out[0] = memory.command[v, 0]

    agents: dict[str, Any] = {"rows": "agent"}
    added = [
        Variable(
            "heading_east", ("time", "agent"), "m s-1", "command", lambda s: s.recorded("first")[..., 0], **agents
        ),
        Variable("as_heard", ("time", "agent", "axis"), "m", "eta", lambda s: s.recorded("residual"), **agents),
    ]
    monkeypatch.setitem(READERS, "first", (inline_jit(first), 1))
    monkeypatch.setitem(READERS, "residual", (inline_jit(residual), 3))
    monkeypatch.setattr(dataset, "VARIABLES", [*VARIABLES, *added])
    found = simulate(boat_and_drone(0.3), backend)
    np.testing.assert_array_equal(found["as_heard"][..., :2], found["disagreement_vector"][..., :2])
    np.testing.assert_array_equal(found["heading_east"], found["velocity_command"][..., 0])


class Counting(Sink):
    """Sink that stores its arguments."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        self.told.append("open")
        self.variables, self.scenario = {name: v.attrs for name, v in variables.items()}, attrs["scenario"]

    def write(self, chunk: xr.Dataset) -> None:
        self.told.append(f"write {chunk.sizes['time']}")

    def close(self) -> None:
        self.told.append("close")


def test_sinks_get_chunks_of_a_tenth_of_a_second_and_the_same_run() -> None:
    run, counting, memory = boat_and_drone(0.3), Counting(), Memory()
    send(stream(run.system, "ideal", run.seed, samples=10), counting, memory)
    assert counting.told == ["open", "write 10", "write 10", "write 10", "write 1", "close"]
    assert counting.scenario == "boat_and_drone"
    whole = simulate(run, "ideal")
    assert dataset_bytes(memory.dataset) == dataset_bytes(whole)
    for name, attrs in counting.variables.items():
        assert attrs == whole[name].attrs


@pytest.mark.parametrize("before", [0, 1])
def test_every_sink_is_closed_whatever_fails(before: int) -> None:
    run, sinks = boat_and_drone(0.3), (Counting(), Counting())

    def failing() -> Any:
        for number, chunk in enumerate(stream(run.system, "ideal", 0, samples=10)):
            if number == before:
                raise KeyboardInterrupt
            yield chunk

    with pytest.raises(KeyboardInterrupt):
        send(failing(), *sinks)
    for sink in sinks:
        assert sink.told == [*["open", "write 10"][: 2 * before], "close"]


@pytest.mark.parametrize("links", [{}, {"record": True}, {"sensing": {"loss": 0.2}}])
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_run_has_what_the_lists_say(backend: str, links: dict[str, Any]) -> None:
    found = simulate(boat_and_drone(0.3, links=links), backend)
    declared = {entry.name: entry for entry in (*VARIABLES, *COORDINATES)}
    assert set(found.variables) - set(declared) == {"time", "phase"}
    for name in set(map(str, found.variables)) & set(declared):
        assert found[name].dims == declared[name].dimensions
    for shown in found.data_vars:
        assert f"`{shown}`" in fields.variables()


@pytest.fixture(scope="module")
def whole() -> xr.Dataset:
    return simulate(boat_and_drone(0.3), "ideal")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (
            lambda d: d.assign(disagreement=d["disagreement"].transpose()),
            "disagreement over (agent, time) and not (time, agent)",
        ),
        (lambda d: d.assign(agent_velocity=d["agent_velocity"].astype(str)), "agent_velocity of the type"),
        (lambda d: d.isel(axis=0), "has axis over () and not (axis)"),
        (lambda d: d.isel(axis=[0, 1]), "has not three axes"),
        (lambda d: d.isel(agent=[0]), "has other agents than its scenario"),
        (lambda d: d.isel(target=[]), "has other targets than its scenario"),
        (lambda d: d.isel(time=[]), "has no samples"),
        (lambda d: d.isel(time=0), "has time over () and not (time)"),
        (lambda d: d.assign_attrs(backend="other"), "has the backend 'other'"),
        (lambda d: d.assign_attrs(status=3), "has a wrong attribute status"),
        (lambda d: d.drop_attrs(deep=False), "has no attribute backend"),
    ],
)
@pytest.mark.parametrize("doing", ["plot", "replay", "save"])
def test_a_damaged_dataset_is_refused_by_name(
    doing: str, damage: Any, said: str, whole: xr.Dataset, tmp_path: Path
) -> None:
    broken = damage(whole)
    broken.encoding["scenario"] = whole.encoding["scenario"]
    arguments = [tmp_path / "run"] if doing == "save" else []
    with pytest.raises(InputError, match=re.escape(said)):
        getattr(mjsheaf, doing)(broken, *arguments)


@pytest.mark.parametrize("name", ["midpoint", "paper_safe", "paper_delay"])
def test_a_dataset_without_one_of_its_variables_is_refused(name: str) -> None:
    """Also where only some runs have the variable."""
    run = mjsheaf.load_scenario(name, {"time.end": 0.1})
    whole = simulate(run, "ideal")
    assert fault_of(whole) == ""
    optional = {entry.name for entry in VARIABLES if entry.present == "without links"}
    for variable in {str(found) for found in whole.variables} - optional:
        broken = whole.drop_vars(variable)
        broken.encoding["scenario"] = whole.encoding["scenario"]
        with pytest.raises(InputError, match=f"the result has no {variable}"):
            mjsheaf.replay(broken)
