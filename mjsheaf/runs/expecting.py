"""Comparison of runs with the expectations of their scenario, and expectations derived from runs.

The pytest plugin and `mjsheaf expect` both use this.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import ROUND_CEILING, Context
from pathlib import Path
from typing import Any

from mjsheaf.errors import InputError, NotUniqueError, RankError
from mjsheaf.results.metrics import MEASURES, ROUNDING_ERROR, check_expectation, safety_of, summarize, summarize_phases
from mjsheaf.runs.simulate import simulate
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import LawFile, find_law

BACKEND_ORDER = ("ideal", "physics")
"""Backends in the order in which `expect` tries them."""

_AT_LEAST = "smallest_separation"  # the one measure with a lower bound

SMALLEST_BOUND = ROUNDING_ERROR
"""Smallest bound on an error, m."""


@dataclass(frozen=True)
class Trial:
    """One scenario run on one backend and compared with its `expect:` block.

    Attributes:
        backend: 'ideal' or 'physics'.
        status: 'finished', 'unstable' or 'refused'.
        message: Reason why it was refused or blew up; else empty.
        final: Final errors by measure, m, and errors at the end of each phase of a run with events by
            phases.NUMBER.MEASURE; empty if it was refused.
        checks: Checks of summary.json, records of measure, bound, found and met.
        law: Law in Python that controlled the agents, or None.
    """

    backend: str
    status: str
    message: str
    final: Mapping[str, float | None] = field(default_factory=dict)
    checks: list[dict[str, Any]] = field(default_factory=list)
    law: LawFile | None = None

    @property
    def met(self) -> bool | None:
        """True if all expectations are met; None if there are none."""
        return all(check["met"] for check in self.checks) if self.checks else None


def expected_law(scenario: Scenario, directory: Path, controller: str | None = None) -> LawFile | None:
    """Find the law in Python that a scenario's bounds are for; None for its own law.

    Args:
        scenario: Scenario with the bounds.
        directory: Directory of its file, which must contain the law's file.
        controller: Law, FILE.py:NAME from the working directory, that takes the place of that of the bounds.

    Raises:
        InputError: There is no such law.
    """
    if controller is not None:
        return find_law(controller)
    label = scenario.expect.controller
    return None if label is None else find_law(label, "expect.controller", directory)


def try_scenario(
    scenario: Scenario,
    backend: str,
    *,
    law: LawFile | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Trial:
    """Run a scenario on a backend and compare the result with its expectations.

    A team that violates the theory's assumptions (harmonic extension not unique, or g not of full row rank) is refused
    before it runs. A scenario may expect this.

    Args:
        scenario: Scenario to run.
        backend: 'ideal' or 'physics'.
        law: Law in Python that controls the agents, constructed anew; None for the scenario's own.
        progress: See `simulate`.

    Raises:
        InputError: The scenario cannot be simulated for another reason, such as a vehicle that does not fit.
    """
    try:
        dataset = simulate(scenario, backend, controller=law.load(scenario.seed) if law else None, progress=progress)
    except (NotUniqueError, RankError) as error:
        # A refused team misses every bound because it has no errors.
        checks = check_expectation(scenario.expect, backend, "refused", dict.fromkeys(MEASURES))["checks"]
        for check in checks:
            if check["measure"] == "refused":
                check |= {"met": check["bound"] in str(error), "found": str(error)}
        return Trial(backend, "refused", str(error), {}, checks)
    status = dataset.attrs["status"]
    final = summarize(scenario.team, dataset)
    phases = summarize_phases(scenario.team, dataset)
    safety = safety_of(dataset)
    checks = check_expectation(scenario.expect, backend, status, final, phases, safety)["checks"]
    errors = {name: final[name] for name in MEASURES}
    if safety is not None:
        errors[_AT_LEAST] = safety["smallest_separation"]
    for k, phase in enumerate(phases):
        errors |= {f"phases.{k}.{name}": (phase["final"] or {}).get(name) for name in MEASURES}
    return Trial(backend, status, dataset.attrs["message"], errors, checks, law)


def expected_backends(scenario: Scenario) -> list[str]:
    """List the backends with expectations in a scenario; a refusal is expected on both."""
    if scenario.expect.refused is not None:
        return list(BACKEND_ORDER)
    expect = scenario.expect.model_dump(exclude_none=True)
    return [name for name in BACKEND_ORDER if expect.get(name)]


def loose(trial: Trial, factor: float) -> list[dict[str, Any]]:
    """Return the checks of a trial with bounds above `factor` times the measured error, which miss regressions."""
    return [
        check
        for check in trial.checks
        if check["measure"] not in ("refused", _AT_LEAST)
        and check["met"]
        and check["bound"] > max(factor * check["found"], SMALLEST_BOUND)
    ]


def bounds_from(trial: Trial, margin: float) -> dict[str, Any]:
    """Compute bounds that a trial meets with a margin, such as 0.05, rounded up to three significant digits, m.

    For a run with events, the list `phases` has the bounds at the end of each phase except the last.
    """
    bounds: dict[str, Any] = {}
    for name, found in trial.final.items():
        *phase, measure = name.split(".")
        own = bounds
        if phase:
            phases = bounds.setdefault("phases", [])
            phases += [{} for _ in range(int(phase[1]) + 1 - len(phases))]
            own = phases[int(phase[1])]
        if found is not None and measure == _AT_LEAST:
            # The margin of a separation below a millimetre is that of a millimetre.
            own[measure] = max(round(found - margin * max(abs(found), 1e-3), 6), 0.0)
        elif found is not None:
            own[measure] = round_up(max(found * (1.0 + margin), SMALLEST_BOUND))
    if "phases" in bounds:
        bounds["phases"].pop()  # the last phase ends with the run
    return bounds


def expectation_from(trials: Sequence[Trial], margin: float, old: Mapping[str, Any]) -> dict[str, Any]:
    """Make an `expect:` block that runs meet.

    Args:
        trials: Trials of one scenario, on one backend each.
        margin: Margin of the bounds above the measured values.
        old: Previous block as a mapping. Its bounds for backends that were not tried stay, and so does the text of a
            refusal that still matches.

    Returns:
        {"refused": ...} if the team is refused, else bounds by backend.

    Raises:
        InputError: Vehicles came closer in a trial than `safety` allows: no bound should accept that.
    """
    for trial in trials:
        gap = trial.final.get(_AT_LEAST)
        if gap is not None and gap < -ROUNDING_ERROR:
            raise InputError(
                f"expect.{trial.backend}.{_AT_LEAST}: a distance on {trial.backend} is {-gap:.3g} m below the required "
                "one, and a bound is not negative; nothing is written. Take a lower velocity_limit, a smaller "
                "safety.rate, or initial positions that are farther apart, or leave out the section safety"
            )
    refusals = [trial.message for trial in trials if trial.status == "refused"]
    if refusals:
        text = old.get("refused")
        return {"refused": text if text is not None and all(text in why for why in refusals) else refusals[0]}
    kept = {name: old.get(name) for name in ("controller", *BACKEND_ORDER)}
    block = kept | {trial.backend: bounds_from(trial, margin) for trial in trials}
    tried = {trial.backend for trial in trials}
    return {name: bound for name, bound in block.items() if bound or name in tried}


def round_up(value: float) -> float:
    """Round a positive number up to three significant digits."""
    return float(Context(prec=3, rounding=ROUND_CEILING).create_decimal(str(value)))


def missed(checks: Iterable[Mapping[str, Any]]) -> list[str]:
    """Explain each check that is not met."""
    sentences = []
    for check in checks:
        measure, bound, found = check["measure"], check["bound"], check["found"]
        if check["met"]:
            continue
        if measure == "refused":
            what = "it ran" if found is None else "its refusal says something else"
            sentences.append(f"{what}, expected a refusal that says {bound!r}")
        else:
            is_found = "has no value" if found is None else f"is {found:.4g}"
            side = "at least" if measure == _AT_LEAST else "at most"
            sentences.append(f"{measure} {is_found}, expected {side} {bound:g}")
    return sentences


def describe(trial: Trial, name: str, watch: str) -> str:
    """Format expected and measured values line by line, and the command that repeats the run of scenario `watch`."""
    verdict = {True: "as expected", False: "NOT as expected", None: "nothing is expected"}[trial.met]
    law = f" --controller {trial.law.here}" if trial.law else ""
    under = f" under {trial.law.label}" if trial.law else ""
    lines = [f"{name} on {trial.backend}{under}: {trial.status}, {verdict}"]
    if trial.message:
        lines.append(f"  {trial.message}")
    bounds = {check["measure"]: check for check in trial.checks}
    if "refused" in bounds:
        lines.append(f"  expected a refusal that says {bounds.pop('refused')['bound']!r}")
    names = dict.fromkeys([*MEASURES, *trial.final, *bounds])
    shown = (*MEASURES, _AT_LEAST)
    measures = [m for m in names if m in bounds or (m in shown and trial.final.get(m) is not None)]
    width = max(18, *(len(m) + 1 for m in measures), 0)
    if measures:
        lines.append(f"  {'measure (m)':<{width}}{'expected':>12}{'found':>12}")
    for measure in measures:
        check = bounds.get(measure)
        found = trial.final.get(measure)
        side = ">=" if measure == _AT_LEAST else "<="
        expected = "-" if check is None else f"{side} {check['bound']:g}"
        why = "" if check is None or check["met"] else _why_missed(measure, check["bound"], found, trial.status)
        number = "-" if found is None else f"{found:.4g}"
        lines.append(f"  {measure:<{width}}{expected:>12}{number:>12}{f'  {why}' if why else ''}")
    return "\n".join([*lines, f"  watch it: mjsheaf run {watch} --backend {trial.backend}{law}"])


def _why_missed(measure: str, bound: float, found: float | None, status: str) -> str:
    """Return how far a measured value is from its bound, or why it does not count."""
    if found is None:
        return "has no value"
    at_least = measure == _AT_LEAST
    if found >= bound if at_least else found <= bound:
        return f"but the run is {status}"
    if at_least:
        return f"{bound - found:.3g} m below"
    return f"{100.0 * (found / bound - 1.0):.3g} % above" if bound > 0.0 else "above"
