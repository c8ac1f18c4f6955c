"""The final errors of a run, and whether they are what the scenario expects."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from mjsheaf.results.errors import evaluate_errors
from mjsheaf.team import Team

if TYPE_CHECKING:
    from mjsheaf.scenario.schema import Expect

MEASURES = ("mean_disagreement", "tracking_error", "formation_error", "centering_error")


def summarize(team: Team, dataset: xr.Dataset) -> dict[str, Any]:
    """Errors at the last sample, of the team and of each group, in m; None where a measure has no meaning."""
    positions = np.concatenate(
        [np.nan_to_num(dataset[name].values[-1:]) for name in ("agent_position", "target_position")], axis=1
    )
    errors = evaluate_errors(team, positions)
    eta = np.linalg.norm(np.nan_to_num(errors.disagreement[0]), axis=1)
    number = {a: i for i, a in enumerate(team.agent_ids)}

    def measures(members: list[int], formation: float, centering: float) -> dict[str, float | None]:
        values = (
            eta[members].mean(),
            np.sqrt((errors.tracking[0, members] ** 2).mean()),
            formation,
            centering,
        )
        return {name: _plain(value) for name, value in zip(MEASURES, values, strict=True)}

    groups = {
        f.name: measures([number[m] for m in f.members], errors.formation_rms(f.name)[0], errors.centering[f.name][0])
        for f in team.formations
    }
    everyone = measures(list(number.values()), errors.formation_rms()[0], errors.largest_centering()[0])
    return {"time": float(dataset["time"][-1]), **everyone, "groups": groups}


def late_errors(team: Team, dataset: xr.Dataset) -> dict[str, float | None]:
    """RMS of the team's errors over the last half of a run, in m; None where a measure has no meaning."""
    time = dataset["time"].values
    late = dataset.isel(time=slice(int(np.searchsorted(time, 0.5 * (time[0] + time[-1]) - 1e-9)), None))
    positions = np.concatenate([np.nan_to_num(late[n].values) for n in ("agent_position", "target_position")], axis=1)
    errors = evaluate_errors(team, positions)
    values = (
        np.linalg.norm(np.nan_to_num(errors.disagreement), axis=2).mean(axis=1),
        np.sqrt((errors.tracking**2).mean(axis=1)),
        errors.formation_rms(),
        errors.largest_centering(),
    )
    return {name: _plain(np.sqrt((x**2).mean())) for name, x in zip(MEASURES, values, strict=True)}


def check_expectation(expect: "Expect", backend: str, status: str, final: dict[str, Any]) -> dict[str, Any]:
    """Compare final errors with the scenario's `expect:` block for a backend.

    Returns:
        {"met": True, False, or None where nothing is expected; "checks": one record for each bound}. A run that should
        have been refused misses that, by having run.
    """
    bounds = getattr(expect, backend)
    checks: list[dict[str, Any]] = []
    if expect.refused is not None:
        checks.append({"measure": "refused", "bound": expect.refused, "found": None, "met": False})
    if bounds is not None:
        for name in MEASURES:
            bound, found = getattr(bounds, name), final[name]
            if bound is not None:
                met = status == "finished" and found is not None and found <= bound
                checks.append({"measure": name, "bound": bound, "found": found, "met": met})
    return {"met": all(c["met"] for c in checks) if checks else None, "checks": checks}


def _plain(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
