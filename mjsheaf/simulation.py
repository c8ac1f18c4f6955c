"""Simulating a scenario: from what a person wrote to data."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.scenario import Scenario
from mjsheaf.team import Team

if TYPE_CHECKING:
    import xarray as xr

BACKENDS = ("physics", "ideal")


def simulate(
    scenario: Scenario, backend: str = "physics", *, progress: Callable[[int, int], None] | None = None
) -> "xr.Dataset":
    """Run a scenario and return its data, as result.nc holds them.

    Args:
        scenario: from `load_scenario`.
        backend: 'physics' or 'ideal'.
        progress: called now and then with (samples done, samples in all).

    Returns:
        The dataset. Where the run blew up, attrs['status'] is 'unstable', attrs['message'] says why, and the data
        end with the last good sample.

    Raises:
        InputError: unknown backend, or a vehicle does not fit its agent.
        NotUniqueError: the harmonic extension is not unique, so that there is nothing to track.
    """
    from mjsheaf.results import make_dataset

    if backend not in BACKENDS:
        raise InputError(f"unknown backend {backend!r}; legal are {', '.join(BACKENDS)}")
    system = scenario.system()
    require_unique(system.team)
    if backend == "ideal":
        from mjsheaf.backends.ideal import run_ideal

        trajectory = run_ideal(system, progress)
    else:
        from mjsheaf.backends.physics import run_physics

        trajectory = run_physics(system, progress)
    return make_dataset(system, trajectory, backend, scenario.seed)


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
