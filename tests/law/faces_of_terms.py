"""Run registered terms that remember on every face, and print what they counted; `test_custom` runs this.

Terms count their own evaluations and integrate what they receive, so that one evaluation too many is another run.
"""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

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
    """Count, and integrate."""
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


def faces(backend: str, engine: str) -> Iterator[tuple[str, Places]]:
    """Yield the positions of all vehicles at the end of the run, by each way to get there."""
    whole = mjsheaf.simulate(scenario(), backend, engine=engine, threads=1, progress=False)
    last = np.concatenate([whole.agent_position.values[-1], whole.target_position.values[-1]])
    yield "simulate", np.nan_to_num(last).tolist()
    stepped = Session(scenario(), backend, engine=engine)
    watched = Session(scenario(), backend, engine=engine)
    for _ in range(PERIODS):
        stepped.step()
        watched.observe()
        watched.state = watched.state
        watched.step()
    yield "Session", positions(stepped)
    yield "observed", positions(watched)
    pieces = Session(scenario(), backend, engine=engine)
    *_, piece = make_datasets(pieces.engine.record(4), backend, 0)
    yield "record", np.nan_to_num(np.concatenate([piece.agent_position[-1], piece.target_position[-1]])).tolist()
    live = Session(scenario(), backend, engine=engine)
    recorder = Recorder(live)
    recorder.record(2)
    if isinstance(live.engine, ClosedLoop):
        live.engine.close_loop(sample=True)  # this sample counts under the law of the next phase
    recorder.do({"gain": live.scenario.controller.gain})  # an event that changes nothing
    recorder.record(PERIODS)
    yield "live", positions(live)
    (many,) = mjsheaf.simulate_many([scenario()], backend, engine=engine, progress=False)
    assert isinstance(many, xr.Dataset)
    yield "simulate_many", np.nan_to_num(np.concatenate([many.agent_position[-1], many.target_position[-1]])).tolist()
    if backend == "ideal":
        return
    alone: Any = env(scenario(), engine=engine)
    alone.reset()
    each: Any = parallel_env(scenario(), engine=engine)
    each.reset()
    suite: Any = dm_env(scenario()) if engine == "mujoco" else None
    together: Any = vector_env(scenario(), 2) if engine == "fused" else None
    for one in (suite, together):
        if one is not None:
            one.reset()
    for _ in range(PERIODS):
        alone.step(np.zeros(alone.action_space.shape))
        each.step({agent: np.zeros(each.action_space(agent).shape) for agent in each.agents})
        if suite is not None:
            suite.step({name: np.zeros(spec.shape) for name, spec in suite.action_spec().items()})
        if together is not None:
            together.step(np.zeros(together.action_space.shape))
    yield "env", positions(alone.unwrapped.episode.session)
    yield "parallel_env", positions(each.unwrapped.episode.session)
    if suite is not None:
        yield "dm_env", positions(suite.task.episode.session)
    if together is not None:
        yield "vector_env", positions(together.envs[0].episode.session)


if __name__ == "__main__":
    found = {}
    for case in ENGINES:
        name = "-".join(case)
        found[name] = {"counts": list(counts(Session(scenario(), case[0], engine=case[1]))), "ends": dict(faces(*case))}
    print(json.dumps(found))
