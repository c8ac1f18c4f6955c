"""Run registered terms that remember on every face, and print what they counted; `test_custom` runs this.

Terms count their own evaluations and integrate what they receive, so that one evaluation too many is another run.
"""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

import mjsheaf
from mjsheaf.envs import dm_env, env, parallel_env, vector_env
from mjsheaf.live.live import Recorder
from mjsheaf.loop.loop import ClosedLoop
from mjsheaf.loop.session import Session
from mjsheaf.results.dataset import make_datasets
from mjsheaf.scenario import Scenario

PERIODS = 6
ENGINES = [("ideal", "mujoco"), ("physics", "mujoco"), ("physics", "fused")]
Places = list[Any]


@mjsheaf.register(parameters=["gain"], memory=4)
def leaky(residual: Any, command: Any, memory: Any, parameters: Any, period: float) -> None:
    memory[3] += 1.0
    for i in range(3):
        memory[i] += period * residual[i]
        command[i] -= parameters[0] * memory[i]


def scenario() -> Scenario:
    changes = {"time.end": PERIODS * 0.02, "controller.custom.leaky": {"parameters": {"gain": 5.0}}}
    return mjsheaf.load_scenario("midpoint", changes)


def counts(session: Session) -> Iterator[float]:
    """Yield the evaluations that the first agent counts after three periods, when observed, and at the end."""
    for _ in range(3):
        session.step()
    yield session.engine.memory.custom[0][0, 3]
    for _ in range(3):
        session.observe()
    yield session.engine.memory.custom[0][0, 3]
    list(session.engine.record(2))
    yield session.engine.memory.custom[0][0, 3]


def positions(session: Session) -> Places:
    return session.engine.positions().tolist()


def last(run: Any) -> Places:
    return np.nan_to_num(np.concatenate([run.agent_position.values[-1], run.target_position.values[-1]])).tolist()


def faces(backend: str, engine: str) -> Iterator[tuple[str, Places]]:
    """Yield the positions of all vehicles at the end of the run, by each way to get there."""
    given: dict[str, Any] = {"engine": engine, "progress": False}
    yield "simulate", last(mjsheaf.simulate(scenario(), backend, threads=1, **given))
    stepped, watched, pieces, live = (Session(scenario(), backend, engine=engine) for _ in range(4))
    for _ in range(PERIODS):
        stepped.step()
        watched.observe()
        watched.state = watched.state
        watched.step()
    yield "Session", positions(stepped)
    yield "observed", positions(watched)
    *_, piece = make_datasets(pieces.engine.record(4), backend, 0)
    yield "record", last(piece)
    recorder = Recorder(live)
    recorder.record(2)
    if isinstance(live.engine, ClosedLoop):
        live.engine.close_loop(sample=True)  # this sample counts under the law of the next phase
    recorder.do({"gain": live.scenario.controller.gain})  # an event that changes nothing
    recorder.record(PERIODS)
    yield "live", positions(live)
    (many,) = mjsheaf.simulate_many([scenario()], backend, **given)
    yield "simulate_many", last(many)
    if backend == "ideal":
        return
    alone: Any = env(scenario(), engine=engine)
    each: Any = parallel_env(scenario(), engine=engine)
    suite: Any = dm_env(scenario()) if engine == "mujoco" else vector_env(scenario(), 2)
    for one in (alone, each, suite):
        one.reset()
    for _ in range(PERIODS):
        alone.step(np.zeros(alone.action_space.shape))
        each.step({agent: np.zeros(each.action_space(agent).shape) for agent in each.agents})
        if engine == "mujoco":
            suite.step({name: np.zeros(spec.shape) for name, spec in suite.action_spec().items()})
        else:
            suite.step(np.zeros(suite.action_space.shape))
    yield "env", positions(alone.unwrapped.episode.session)
    yield "parallel_env", positions(each.unwrapped.episode.session)
    owner = suite.task if engine == "mujoco" else suite.envs[0]
    yield "dm_env or vector_env", positions(owner.episode.session)


if __name__ == "__main__":
    found = {}
    for case in ENGINES:
        name = "-".join(case)
        found[name] = {"counts": list(counts(Session(scenario(), case[0], engine=case[1]))), "ends": dict(faces(*case))}
    print(json.dumps(found))
