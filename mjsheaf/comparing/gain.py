"""How far the gain may be raised before bodies, lag or the law's hold make the team ring."""

from math import sqrt

from mjsheaf.backends.physics import vehicles_of
from mjsheaf.backends.system import System
from mjsheaf.comparing.inertia import inertial_tau
from mjsheaf.comparing.ringing import Ringing

_LEAST_DAMPING = 0.3


def usable_gain(system: System, ringing: Ringing | None) -> float | None:
    """The gain at which the least damped mode's damping ratio falls to 0.3 or the held law begins to ring, 1/s.

    With inertia alone the damping ratio of a mode falls as zeta / sqrt(k), k the gain as a share of the present one.
    A delay l, such as the hold's h / 2 or a thruster's lag, takes about omega l / 2 of it, which grows as sqrt(k):

        zeta / sqrt(k) - delta sqrt(k) = 0.3

    where delta is the larger of the hold's and of what the experiment on the scenario's bodies lacks beside zeta.

    Args:
        system: the scenario's system.
        ringing: prediction and experiments; None for a team of too many states, where the largest eigenvalue and the
            slowest agent bound the damping of every mode.

    Returns:
        It, which may be below the present gain; None where any gain will do.
    """
    stiffest = system.largest_eigenvalue
    if system.gain <= 0.0 or stiffest <= 0.0:
        return None
    measured = None
    if ringing is not None:
        damping, frequency = ringing.mode.damping, ringing.mode.frequency
        measured = ringing.releases[0].damping
    else:
        slowest = max(float(inertial_tau(v).max()) for v in vehicles_of(system)[: len(system.team.agents)])
        frequency = sqrt(system.gain * stiffest / slowest)
        damping = 0.5 / (frequency * slowest)
    period = 0.0 if system.grid.continuous else system.grid.period
    delta = frequency * period / 4.0
    if measured is not None:
        delta = max(delta, damping - measured)
    # The root sqrt(k) of delta k + 0.3 sqrt(k) - damping = 0, in the form that knows delta = 0.
    root = 2.0 * damping / (_LEAST_DAMPING + sqrt(_LEAST_DAMPING**2 + 4.0 * delta * damping))
    found = system.gain * root**2
    return min(found, 1.0 / (period * stiffest)) if period > 0.0 else found
