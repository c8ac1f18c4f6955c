"""`mjsheaf expect`."""

from pathlib import Path

from mjsheaf.cli.progress import progress_bars
from mjsheaf.cli.run import ExpectationMissedError
from mjsheaf.errors import InputError, UnstableError
from mjsheaf.runs.expecting import (
    BACKEND_ORDER,
    Trial,
    describe,
    expectation_from,
    expected_backends,
    miss,
    missed,
    try_scenario,
)
from mjsheaf.scenario import Scenario, load_scenario
from mjsheaf.scenario.editing import replace_file, require_writable, with_field
from mjsheaf.scenario.load import find_scenario
from mjsheaf.simulation.run import BACKENDS


def expect_command(source: str, update: bool, backends: list[str], margin: float) -> None:
    """Run a scenario, print what it expects and what is found, and raise what the exit code says."""
    for backend in backends:
        if backend not in BACKENDS:
            raise InputError(f"--backend {backend}: expected {', '.join(BACKENDS)}")
    if not 0.0 <= margin <= 10.0:
        raise InputError(f"--margin {margin:g}: expected 0 to 10; 0.05 is 5 %")
    scenario = load_scenario(source)
    path = find_scenario(source)
    data = path.read_bytes() if update else b""
    if update:
        require_writable(path)
    wanted = [name for name in BACKEND_ORDER if name in (backends or BACKEND_ORDER)]
    if not update:
        known = expected_backends(scenario)
        missing = [name for name in wanted if name not in known] if backends else [] if known else wanted
        if missing:
            raise InputError(f"{source}: expect.{missing[0]}: missing; --update writes it from a run")
        wanted = [name for name in wanted if name in known]
    trials = [_try(scenario, source, backend) for backend in wanted]
    if update:
        _update(scenario, source, path, data, trials, margin)
        return
    misses = [f"{miss(check)} on {trial.backend}" for trial in trials for check in missed(trial)]
    if misses:
        raise ExpectationMissedError(f"{source}: {', '.join(misses)}")


def _try(scenario: Scenario, source: str, backend: str) -> Trial:
    try:
        with progress_bars() as progress:
            what = f"simulating ({backend})"
            trial = try_scenario(scenario, backend, progress=lambda done, total: progress(what, done, total))
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    print(describe(trial, scenario.name, source))
    return trial


def _update(scenario: Scenario, source: str, path: Path, data: bytes, trials: list[Trial], margin: float) -> None:
    """Write the `expect:` block; a run that blew up is none to expect."""
    for trial in trials:
        if trial.status == "unstable":
            raise UnstableError(f"{source}: blew up on {trial.backend}: {trial.message}; nothing is written")
    expect = expectation_from(trials, margin, scenario.expect.model_dump(exclude_none=True))
    comment = "" if "refused" in expect else f"at most {100.0 * margin:g} % above what was found"
    text = with_field(data.decode("utf-8"), "expect", expect, source, comment)
    replace_file(path, text.encode("utf-8"), expected=data)
    print(f"wrote expect: of {path}")
