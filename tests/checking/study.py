"""Certificates of a version of the package, compared with the oracle.

`judge` holds one scenario's certificates against the oracle. As a command this module measures the version of the
package that is on the path and writes the record that later versions are held against:

    python -m tests.checking.study tests/checking/adversarial_baseline.json

The stored baseline is that of version 9e02b52, the last one before the certificate was made sound: check it out, copy
`tests/checking/{adversarial,oracle,study}.py` of this version into it, and run the command there (some 20 minutes).
"""

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

import mjsheaf
from mjsheaf.checking.theorem.of_run import RunBound, bound_of_run
from mjsheaf.checking.theorem.targets import follow_targets
from mjsheaf.scenario import scenario_from_mapping
from tests.checking.adversarial import FAMILIES, TEAMS, adversarial_scenario, family_of
from tests.checking.oracle import Truth, solve

Array = NDArray[np.float64]

BASELINE = Path(__file__).with_name("adversarial_baseline.json")
BROKEN = 1.0 + 1e-6
"""A measured error beyond this multiple of the bound breaks it."""

_ORACLE_ERROR = 1e-8  # of the oracle, relative to the size of the positions


@dataclass(frozen=True)
class Claim:
    """Certificate compared with the oracle.

    Attributes:
        applies, approximate: Claims of the certificate.
        ratio: Maximum of |e| / bound over all steps of the oracle, infinite if the solution diverges; None if nothing
            is claimed.
        reason: Reason why nothing is claimed.
    """

    applies: bool
    approximate: bool
    ratio: float | None
    reason: str

    @property
    def exact(self) -> bool:
        """True if the theorem is claimed to hold exactly."""
        return self.applies and not self.approximate

    @property
    def broken(self) -> bool:
        """True if a claim is false."""
        return self.ratio is not None and self.ratio > BROKEN


@dataclass(frozen=True)
class Judgement:
    """One scenario.

    Attributes:
        before: Certificate of `check`.
        after: Certificate of the run, or None if the run did not finish.
        ok: Field `ok` of the record of `check`.
        verdicts: Verdicts on the numbered assumptions.
        status: Status of the oracle.
        path_error: Largest distance between the targets of the check and those of the oracle, m; None if the check
            has no path over the whole span, or claims nothing exactly.
    """

    before: Claim
    after: Claim | None
    ok: bool
    verdicts: tuple[str, ...]
    status: str
    path_error: float | None


def judge(raw: dict[str, Any], truth: Truth | None = None) -> Judgement:
    """Hold the certificates of a scenario against the oracle."""
    truth = truth or solve(raw)
    scenario = scenario_from_mapping(raw)
    record = mjsheaf.check(scenario, trial=False)
    theorem = record["theorem"]
    result = mjsheaf.simulate(scenario, "ideal")
    after = None
    if result.attrs["status"] == "finished":
        after = _claim_of_run(bound_of_run(scenario.system, result), truth)
    return Judgement(
        before=claim_of_check(record, truth),
        after=after,
        ok=record["ok"],
        verdicts=tuple(a["verdict"] for a in record["assumptions"]),
        status=truth.status,
        path_error=_path_error(scenario, truth) if theorem["applies"] and not theorem["approximate"] else None,
    )


def claim_of_check(record: dict[str, Any], truth: Truth) -> Claim:
    """The claim of a record of `check`, held against the oracle."""
    theorem, ratio = record["theorem"], None
    if theorem["applies"]:
        elapsed = truth.time - truth.time[0]
        decay = np.exp(-2.0 * theorem["lambda_V"] * elapsed)
        share = -np.expm1(-2.0 * theorem["lambda_V"] * elapsed)
        bound = np.sqrt(decay * theorem["initial_error"] ** 2 + theorem["mu"] / theorem["lambda_V"] * share)
        ratio = _ratio(truth, bound)
    return Claim(theorem["applies"], theorem["approximate"], ratio, theorem["reason"])


def _claim_of_run(run: RunBound, truth: Truth) -> Claim:
    ratio = _ratio(truth, run.at(truth.time)) if run.applies else None
    return Claim(run.applies, run.approximate, ratio, run.reason)


def _ratio(truth: Truth, bound: Array) -> float:
    if truth.status == "blew up":
        return float(np.inf)
    size = max(1.0, float(np.abs(truth.agents).max()), float(np.abs(truth.targets).max()))
    excess = np.maximum(truth.error - _ORACLE_ERROR * size, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(excess > 0.0, excess / bound, 0.0)
    return float(ratios.max())


def _path_error(scenario: mjsheaf.Scenario, truth: Truth) -> float | None:
    if truth.status != "finished":
        return None
    system = scenario.system
    path = follow_targets(system)
    start, end = float(system.grid.samples[0]), float(system.grid.samples[-1])
    if path.warning or path.time[-1] < end - 1e-9 * (end - start):
        return None
    targets = path.positions[:, len(system.team.agents) :]
    chosen = np.unique(np.linspace(0, len(path.time) - 1, 2000).astype(int))
    exact = CubicHermiteSpline(truth.time, truth.targets, truth.target_velocities)
    return float(np.linalg.norm(targets[chosen] - exact(path.time[chosen]), axis=2).max())


# -- the record of a version ---------------------------------------------------------------------------------------


def record_adversarial() -> list[list[Any]]:
    """[seed, whether `check` applies, exactly, and its ratio] of every team; progress on stderr."""
    rows = []
    for seed in range(TEAMS):
        begin = time.perf_counter()
        raw = adversarial_scenario(seed)
        truth = solve(raw)
        solved = time.perf_counter()
        rows.append([seed, *row_of(claim_of_check(mjsheaf.check(scenario_from_mapping(raw), trial=False), truth))])
        took = f"{solved - begin:.2f} s + {time.perf_counter() - solved:.2f} s"
        print(*rows[-1], family_of(seed), truth.status, took, file=sys.stderr, flush=True)
    return rows


def row_of(claim: Claim) -> list[Any]:
    """A claim as the record keeps it: applies, exactly, ratio (1e300 for infinity)."""
    ratio = None if claim.ratio is None else float(f"{min(claim.ratio, 1e300):.6g}")
    return [claim.applies, claim.exact, ratio]


def record_random() -> list[float]:
    """The gain at which each team of `test_theorem` is certified."""
    from tests.checking.test_theorem import CERTIFIED, certified_run

    return [certified_run(seed).certificate.theorem.gain for seed in range(CERTIFIED)]


def table(rows: list[list[Any]]) -> str:
    """Counts of each family: teams, and of exact and of approximate claims how many, how many broken, the worst."""
    lines = [f"{'family':26} teams  exact broken      worst  approx broken      worst"]
    for family in [*FAMILIES, "all"]:
        own = [row for row in rows if family in ("all", family_of(row[0]))]
        line = f"{family:26} {len(own):5}"
        for exactly in (True, False):
            claims = [ratio for _, applies, exact, ratio in own if applies and exact == exactly]
            line += f" {len(claims):6} {sum(x > BROKEN for x in claims):6} {max(claims, default=0.0):10.3g}"
        lines.append(line)
    return "\n".join(lines)


def main() -> None:
    """Measure the version of the package that is on the path."""
    rows = record_adversarial()
    print(table(rows))
    found = {"adversarial": rows, "random_gains": record_random()}
    text = json.dumps(found, separators=(",", ":")).replace("],[", "],\n[")
    Path(sys.argv[1]).write_text(text + "\n")


if __name__ == "__main__":
    main()
