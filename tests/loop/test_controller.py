"""Laws in Python, on both backends: what they are shown, what comes of what they return, and what is said of errors.

Oracles: the compiled law, the team's own maps, and laws written so that the answer is known.
"""

import json
from collections.abc import Generator
from functools import partial
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest

import mjsheaf
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.law.in_python import Agent, Controller, LocalSample, PerAgent, ReadOnlyTeam, Sample
from mjsheaf.scenario.load import load_controller
from tests.builders import mixed_scenario
from tests.commands import IDEAL, RUN_FILES, answer_of, call, is_refusal
from tests.oracles.law import PaperLaw, measurement

BACKENDS = ("ideal", "physics")
SHORT = {"time": {"end": 0.3}}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "law", [lambda t, sample: -10.0 * sample.disagreement, PerAgent(partial(PaperLaw, gain=10.0))], ids=["team", "each"]
)
def test_the_papers_law_in_python_is_the_compiled_one(law: Any, backend: str) -> None:
    scenario = mjsheaf.load_scenario("paper", {"time.end": 0.5 if backend == "physics" else 3.0})
    own, ours = mjsheaf.simulate(scenario, backend, controller=law), mjsheaf.simulate(scenario, backend)
    for name in ("agent_position", "target_position"):
        np.testing.assert_allclose(own[name].values, ours[name].values, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(own["disagreement"].dims, ours["disagreement"].dims)


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_a_law_asks_for_is_recorded_and_carried_out(backend: str) -> None:
    """A term that no metric knows is in result.nc: commands are what was executed, not what eta would give."""
    scenario = mixed_scenario(**SHORT, controller={"gain": 1.0, "control_period": 0.01})
    plain = mjsheaf.simulate(scenario, backend)
    term = np.array([0.3, -0.2, 0.1])

    def law(t: float, sample: Sample) -> Array:
        return -sample.disagreement + term * np.cos(t)

    found = mjsheaf.simulate(scenario, backend, controller=law)
    time = found["time"].values
    eta = found["disagreement_vector"].values
    wanted = -eta + (term * np.cos(time)[:, None])[:, None, :]
    np.testing.assert_allclose(found["velocity_command"].values, wanted, rtol=0, atol=1e-12, equal_nan=True)
    if backend == "ideal":  # q' = command + flow + disturbance
        moved = np.nan_to_num(found["agent_velocity"].values - found["agent_flow"].values)
        np.testing.assert_allclose(moved, np.nan_to_num(wanted), rtol=0, atol=1e-12)
    assert np.abs(np.nan_to_num(found["agent_position"] - plain["agent_position"])).max() > 0.01


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_call_a_sample_and_what_it_is_shown(backend: str) -> None:
    scenario = mixed_scenario(**SHORT)
    seen: list[tuple[float, Sample]] = []

    class Law:
        def reset(self, team: Any, rng: np.random.Generator) -> None:
            self.begun = getattr(self, "begun", 0) + 1
            self.team, self.number = team, rng.random()

        def __call__(self, t: float, sample: Sample) -> Array:
            seen.append((t, sample))
            return -sample.disagreement

    law = Law()
    found = mjsheaf.simulate(scenario, backend, controller=law)
    np.testing.assert_allclose([t for t, _ in seen], found["time"].values, rtol=0, atol=1e-12)
    assert law.begun == 1
    team = scenario.system.team
    positions = np.nan_to_num(np.concatenate([found["agent_position"], found["target_position"]], axis=1))
    for k in (0, 7, 30):
        sample = seen[k][1]
        np.testing.assert_array_equal(sample.truth.positions, positions[k])
        q_star = np.nan_to_num(found["harmonic_extension"].values[k])
        np.testing.assert_allclose(sample.truth.harmonic_extension, q_star, atol=1e-9)
        assert len(sample.edges) == len(sample.measurements) == len(team.communication) + len(team.sensing)
        for e, y in zip(sample.edges, sample.measurements, strict=True):
            np.testing.assert_allclose(y, measurement(team, e, positions[k]), rtol=0, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(sample.attitude, axis=1), 1.0, rtol=0, atol=1e-9)
        np.testing.assert_allclose(sample.disagreement, np.nan_to_num(found["disagreement_vector"].values[k]))
    if backend == "physics":
        np.testing.assert_array_equal(seen[7][1].velocity, found["agent_velocity"].values[7])
    else:
        shift = (positions[7] - positions[6])[: len(team.agents)] / scenario.controller.control_period
        np.testing.assert_allclose(seen[7][1].velocity, shift, rtol=0, atol=1e-9)
    first = law.number
    mjsheaf.simulate(scenario, backend, controller=law)
    assert law.number == first  # the seed's
    mjsheaf.simulate(scenario.model_copy(update={"seed": 1}), backend, controller=law)
    assert law.number != first


def test_exchange_reaches_neighbours_alone_and_is_counted() -> None:
    """Repeated averaging over the communication graph, by agents that yield: its limit is the mean of a component."""
    scenario = mixed_scenario(**SHORT)
    team = scenario.system.team
    received: list[set[str]] = []

    class Averaging:
        def __init__(self, agent: Agent) -> None:
            self.agent = agent
            self.near = {e.head if e.tail == agent.id else e.tail for e in agent.edges} & set(team.agent_ids)

        def __call__(self, t: float, local: LocalSample) -> Generator[Any, Any, Array]:
            value = float(team.agent_ids.index(self.agent.id))
            for _ in range(40):
                theirs = yield [value]
                assert set(theirs) == self.near
                value += 0.25 * sum(float(x[0]) - value for x in theirs.values())
            received.append(self.near)
            return np.full(self.agent.dimension, 1e-3 * value)

    door = Controller(PerAgent(Averaging))
    found = mjsheaf.simulate(scenario, "ideal", controller=door)
    samples = found.sizes["time"]
    assert door.traffic.rounds == 40 * samples
    graph = nx.Graph((e.tail, e.head) for e in team.communication)
    assert door.traffic.messages == 2 * graph.number_of_edges() * 40 * samples
    command = found["velocity_command"].values[0, :, 0]
    laplacian = nx.laplacian_matrix(graph, nodelist=team.agent_ids).toarray()
    step = np.linalg.matrix_power(np.eye(len(team.agents)) - 0.25 * laplacian, 40)
    np.testing.assert_allclose(command, 1e-3 * step @ np.arange(len(team.agents)), rtol=1e-12)


class Failing:
    """Raises for one agent at one time."""

    def __init__(self, agent: Agent) -> None:
        self.id = agent.id

    def __call__(self, t: float, local: LocalSample) -> Array:
        if self.id == "front" and t > 0.1:
            raise ZeroDivisionError("by nothing")
        return np.zeros(2)


class UnprintableError(Exception):
    def __str__(self) -> str:
        raise RuntimeError("no")


def raising(error: BaseException) -> Any:
    def law(t: float, sample: Sample) -> Array:
        raise error

    return law


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("law", "said"),
    [
        (PerAgent(Failing), ["front", "t = 0.11", "ZeroDivisionError", "by nothing", "test_controller.py"]),
        (lambda t, sample: np.zeros((2, 3)), ["t = 0 s", "(2, 3)", "(3, 3)"]),
        (lambda t, sample: np.full((3, 3), np.nan), ["t = 0 s", "boat", "nan"]),
        (lambda t, sample: 1j * sample.disagreement, ["complex"]),
        (lambda t, sample: sample.nothing, ["t = 0 s", "AttributeError"]),
        (lambda t, sample: sample.exchange([1.0]), ["t = 0 s", "(1,)"]),
        (lambda t, sample: sample.exchange([1j, 1j, 1j]), ["t = 0 s", "real numbers"]),
        (lambda t, sample: None, ["t = 0 s", "real numbers", "None"]),
        (raising(SystemExit(7)), ["SystemExit: 7"]),
        (raising(ValueError("a\x1b[31mRED\x07" + "x" * 100_000)), ["ValueError: a\\x1b[31mRED\\x07xxx", "..."]),
        (raising(UnprintableError()), ["t = 0 s: UnprintableError: ", "__str__", "test_controller.py"]),
        (raising(BaseException("stop")), ["t = 0 s: BaseException: stop"]),
        (lambda t, sample: np.full((3, 3), 1e300), ["<lambda> at t = 0 s", "1.e+300", "boat", "at most 1e+09 m/s"]),
        (lambda t, sample: np.ma.masked_all((3, 3)), ["masked array"]),
        (lambda t, sample: [np.ma.array(np.ones(3), mask=row) for row in np.eye(3) > 0], ["masked array"]),
        (PerAgent(lambda agent: lambda t, local: np.ma.masked_all(2)), ["boat", "masked array"]),
        (PerAgent(lambda agent: 3), ["boat", "make(agent) returned int"]),  # type: ignore[arg-type,return-value]
        (lambda t, sample: sample.team.index.clear(), ["AttributeError", "clear"]),
        (lambda t, sample: setattr(sample.team, "index", {}), ["AttributeError", "read-only"]),
        (lambda t, sample: sample.team.remaining.index.clear(), ["AttributeError", "clear"]),
        (lambda t, sample: sample.edges[0].F_tail.fill(0), ["read-only"]),
        (lambda t, sample: sample.team.communication[0].weight.fill(0), ["read-only"]),
        (lambda t, sample: sample.team.displacement["front"].fill(0), ["read-only"]),
    ],
)  # fmt: skip
def test_a_law_that_misbehaves_is_named_in_one_line(law: Any, said: list[str], backend: str) -> None:
    with pytest.raises(InputError) as error:
        mjsheaf.simulate(mixed_scenario(**SHORT), backend, controller=law)
    message = str(error.value)
    assert message.startswith("controller ")
    assert message.isprintable()
    assert len(message) < 500
    assert all(part in message for part in said), message


def test_what_a_team_has_computed_cannot_be_written_by_a_law() -> None:
    team = mixed_scenario().team
    for name in ("present", "slots", "first_state"):
        assert getattr(team, name).flags.writeable
        assert not vars(ReadOnlyTeam(team))[name].flags.writeable
    assert ReadOnlyTeam(team).remaining is not team


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_a_law_does_to_what_it_is_shown_reaches_nothing_else(backend: str) -> None:
    """Lists are copies, made once a phase; arrays are new at every sample; what has no mask is an array like others."""

    def vandal(t: float, sample: Sample) -> Any:
        wanted = -3.0 * sample.disagreement
        sample.team.agent_ids.clear()
        sample.attitude[:] = sample.velocity[:] = sample.displacement[:] = sample.disagreement[:] = 7.0
        for y in sample.measurements:
            y[:] = 7.0
        assert sample.truth.positions.shape == (5, 3)
        assert len(sample.exchange(np.zeros(3))) == 3
        return np.ma.array(wanted)

    first: list[Array] = []

    def plain(t: float, sample: Sample) -> Array:
        first.append(sample.attitude.copy())
        sample.attitude[:] = 7.0
        return -3.0 * sample.disagreement

    scenario = mixed_scenario(**SHORT)
    own, ours = (mjsheaf.simulate(scenario, backend, controller=law) for law in (vandal, plain))
    np.testing.assert_array_equal(own["agent_position"], ours["agent_position"])
    assert own["agent"].values.tolist() == ["boat", "front", "back"]
    assert np.abs(np.linalg.norm(first, axis=2) - 1.0).max() < 1e-6


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_blow_up_under_a_law_in_python_names_the_law(backend: str) -> None:
    def eager(t: float, sample: Sample) -> Array:
        return 1e8 * np.ones((3, 3))

    scenario = mixed_scenario(time={"end": 20.0}, controller={"gain": 1.0, "control_period": 5.0})
    result = mjsheaf.simulate(scenario, backend, controller=eager)
    assert result.attrs["status"] == "unstable"
    for part in ("likely cause: controller eager, which commands 1.", "e+08 m/s for "):
        assert part in result.attrs["message"]


@pytest.mark.parametrize(
    ("make", "wrong", "said"),
    [
        (Controller, Failing, "Failing is a class; expected an object, such as Failing()"),
        (Controller, "law.py:Law", "not str; load_controller"),
        (PerAgent, None, "PerAgent: expected a callable make(agent)"),
        (load_controller, Path("law.py:Law"), "FILE.py:NAME as a str, not PosixPath"),
        (load_controller, "", "--controller '': expected FILE.py:NAME"),
    ],
)
def test_arguments_of_a_wrong_type_are_named(make: Any, wrong: Any, said: str) -> None:
    with pytest.raises(InputError) as error:
        make(wrong)
    assert said in str(error.value)


def test_a_law_in_python_needs_samples() -> None:
    scenario = mixed_scenario(controller={"gain": 1.0, "control_period": 0.0})
    for backend in BACKENDS:
        with pytest.raises(InputError, match=r"controller\.control_period"):
            mjsheaf.simulate(scenario, backend, controller=lambda t, sample: -sample.disagreement)


def test_loading_a_law_from_a_file(tmp_path: Any) -> None:
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    def __call__(self, t, sample):\n        return -sample.disagreement\n"
    )
    (tmp_path / "broken.py").write_text("x = 1\nraise ValueError('oh no')\n")
    assert type(load_controller(f"{tmp_path}/mine.py:Mine").law).__name__ == "Mine"
    for source, said in (
        (f"{tmp_path}/mine.py:mine", "did you mean Mine"),
        (f"{tmp_path}/broken.py:Law", "ValueError: oh no (broken.py, line 2)"),
    ):
        with pytest.raises(InputError) as error:
            load_controller(source)
        assert said in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "def law(t, s): raise ValueError('a\\x1b[31mRED\\x07' + 'x' * 100000)\n",
        "raise BaseException('x')\n",
        "raise SystemExit(5)\n",
        "import sys\ndef law(t, s): sys.exit(0)\n",
    ],
    ids=["escapes", "base", "leaves", "exits"],
)
def test_a_bad_law_on_the_command_line_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(text)
    law = f"{tmp_path}/mine.py:law"
    answer = answer_of("run", "midpoint", *IDEAL, "--controller", law, "--out", tmp_path / "never")
    assert is_refusal(answer, "controller", "mine.py")
    assert answer.err.removesuffix("\n").isprintable()
    assert len(answer.err) < 800
    assert not (tmp_path / "never").exists()


@pytest.mark.usefixtures("without_plots")
def test_a_law_that_goes_elsewhere_does_not_take_the_results_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("wanders.py").write_text(
        "import os\nos.chdir('/')\ndef law(t, s):\n    os.chdir('/')\n    return -s.disagreement\n"
    )
    answer = answer_of("run", "midpoint", *IDEAL, "--controller", "wanders.py:law", "--out", "mine")
    assert (answer.code, answer.err) == (0, "")
    theorem = json.loads((tmp_path / "mine" / "summary.json").read_text())["theorem"]
    assert theorem["applies"] is False
    assert "law of its own" in theorem["reason"]
    assert RUN_FILES >= {path.name for path in (tmp_path / "mine").iterdir()} >= {"result.nc", "summary.json"}
    assert Path.cwd() == tmp_path


@pytest.mark.slow
def test_a_file_name_is_no_formula(tmp_path: Path) -> None:
    """A run that is finished is not lost to its title."""
    law = tmp_path / r"$\frac{a}{b$.py"
    law.write_text("def law(t, sample):\n    return -sample.disagreement\n")
    out = tmp_path / "out"
    short = ("--backend", "ideal", "--no-video", "--set", "time.end=0.2", "--out", out)
    assert call("run", "midpoint", *short, "--controller", f"{law}:law") == 0
    assert (out / "errors.png").is_file()
