"""Simulating a scenario: from what a person wrote to data."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.scenario import Scenario
from mjsheaf.team import Team

if TYPE_CHECKING:
    import xarray as xr

    from mjsheaf.backends.system import System

BACKENDS = ("physics", "ideal")


def simulate(
    scenario: Scenario,
    backend: str = "physics",
    *,
    allow_drift: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> "xr.Dataset":
    """Run a scenario and return its data, as result.nc holds them.

    Args:
        scenario: from `load_scenario`.
        backend: 'physics' or 'ideal'.
        allow_drift: simulate a team whose harmonic extension is not unique too, against the q* of minimum norm; the
            result's attrs['free_directions'] then say what is free.
        progress: called now and then with (samples done, samples in all).

    Returns:
        The dataset. Where the run blew up, attrs['status'] is 'unstable', attrs['message'] says why, and the data
        end with the last good sample.

    Raises:
        InputError: unknown backend, a vehicle that does not fit its agent, or a g that is not of full row rank.
        NotUniqueError: the harmonic extension is not unique, and drift is not allowed.
    """
    from mjsheaf.results import make_dataset

    if backend not in BACKENDS:
        raise InputError(f"unknown backend {backend!r}; legal are {', '.join(BACKENDS)}")
    system = scenario.system()
    require_full_row_rank(system)
    if not allow_drift:
        require_unique(system.team)
    if backend == "ideal":
        from mjsheaf.backends.ideal import run_ideal

        trajectory = run_ideal(system, progress)
    else:
        from mjsheaf.backends.physics import run_physics

        trajectory = run_physics(system, progress)
    return make_dataset(system, trajectory, backend, scenario.seed)


def require_full_row_rank(system: "System") -> None:
    """Refuse an agent whose given control effectiveness makes g g^+ = I impossible (Assumption 2).

    Raises:
        InputError: naming the agent.
    """
    from mjsheaf.dynamics.effectiveness import without_full_row_rank

    agents = system.team.agents
    for i in without_full_row_rank(system.effectiveness, [a.dimension for a in agents]):
        raise InputError(
            f"agents.{agents[i].id}.effectiveness: g is not of full row rank {agents[i].dimension} (Assumption 2): "
            "no input makes every velocity"
        )


def require_unique(team: Team) -> None:
    """Refuse a team whose harmonic extension is not unique (the paper's assumption on relative cohomology).

    Raises:
        NotUniqueError: with the free directions in the words of the team.
    """
    if team.dirichlet.unique:
        return
    from mjsheaf.team.freedom import free_directions

    free = free_directions(team)
    raise NotUniqueError(
        f"the harmonic extension is not unique: H^0(G, G_p; F) has dimension {len(free)}: "
        f"{'; '.join(free[:4])}{'; ...' if len(free) > 4 else ''}; sense or share the free coordinates"
    )
