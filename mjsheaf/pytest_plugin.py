"""A pytest plugin that turns scenarios into tests: `pytest --mjsheaf scenarios/`.

Every YAML file with an `expect:` block gives a test for each backend that has bounds in it, or one test, `refused`. It
passes where the runs are as expected. In a directory, scenarios without the block are skipped and other files ignored;
a file that is named itself fails if it is broken or expects nothing. Without --mjsheaf nothing is collected,
and nothing of mjsheaf but this module is imported. A block with a field `controller` is for that law in Python;
--controller FILE.py:NAME replaces it.
"""

import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mjsheaf.runs.expecting import Trial
    from mjsheaf.scenario import Scenario

_SUFFIXES = (".yaml", ".yml")
_RECORDS = ("summary.json", "compare.json", "runs.json", "study.json")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --mjsheaf and the setting mjsheaf_tight."""
    group = parser.getgroup("mjsheaf")
    group.addoption("--mjsheaf", action="store_true", help="collect scenarios with an `expect:` block as tests")
    _add_controller(group)
    parser.addini(
        "mjsheaf_tight",
        "fail where a bound of an `expect:` block is more than this many times what was found, such as 1.1",
        default="",
    )


def _add_controller(group: Any) -> None:
    """Add --mjsheaf-controller, and --controller unless another plugin has it."""
    about: dict[str, Any] = {
        "metavar": "FILE.py:NAME",
        "dest": "mjsheaf_controller",
        "help": "run scenarios under this law in Python instead of the one that their `expect:` block names",
    }
    group.addoption("--mjsheaf-controller", **about)
    with suppress(ValueError):
        group.addoption("--controller", **about)


def pytest_configure(config: pytest.Config) -> None:
    """Refuse a setting that is not a number before anything runs."""
    text = config.getini("mjsheaf_tight")
    try:
        valid = not text or float(text) >= 1.0
    except ValueError:
        valid = False
    if not valid:
        raise pytest.UsageError(f"mjsheaf_tight is {text!r}; expected a number of at least 1, such as 1.1")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> "ScenarioFile | None":
    """Collect a scenario, recognised by its text: other YAML files are ignored."""
    if not parent.config.getoption("--mjsheaf") or file_path.suffix not in _SUFFIXES:
        return None
    named = parent.session.isinitpath(file_path)
    if not named and any((file_path.parent / record).exists() for record in _RECORDS):
        return None  # what a run left: a record, not a test
    expects = _expects(file_path)
    if expects is None and not named:
        return None
    collected: ScenarioFile = ScenarioFile.from_parent(parent, path=file_path)
    collected.expects, collected.named = bool(expects), named
    return collected


def _expects(path: Path) -> bool | None:
    """Return True if a scenario has an `expect:` block, and None for other files, which are ignored."""
    from mjsheaf.errors import ScenarioError
    from mjsheaf.files import read_yaml

    try:
        text = path.read_bytes().decode("utf-8", errors="replace")
        if re.search(r"\b(expect|targets)\b", text) is None:
            return None
        raw = read_yaml(path)
    except OSError:
        return None
    except ScenarioError:
        return True if re.search(r"(?m)^expect\s*:", text) else None  # most likely one that is broken
    return "expect" in raw if raw.keys() & {"agents", "swarm", "targets"} else None


class ScenarioFile(pytest.File):
    """A scenario file.

    Attributes:
        expects: True if it has an `expect:` block.
        named: True if the user named this file. It then fails where a file from a directory is skipped.
    """

    expects = True
    named = False

    def collect(self) -> Iterator[pytest.Item]:
        """One test for each backend with bounds, or one for a refusal, or one that fails with what is wrong."""
        from mjsheaf.errors import MjsheafError
        from mjsheaf.runs.expecting import expected_backends

        tests: dict[str, Callable[[Expectation], None]] = {}
        nothing = f"no `expect:` block; mjsheaf expect {self.path.name} --update writes one into a scenario"
        if self.expects or self.named:
            try:
                scenario = self.load()
            except MjsheafError as error:
                tests = {"load": partial(_fail, str(error))}
            else:
                backends = expected_backends(scenario)
                tests = {backend: partial(_compare, [backend]) for backend in backends}
                if scenario.expect.refused is not None:
                    tests = {"refused": partial(_compare, backends)}
        if not tests:
            tests = {"expect": partial(_fail, f"{self.path}: {nothing}") if self.named else partial(_skip, nothing)}
        for name, test in tests.items():
            yield Expectation.from_parent(self, name=name, test=test)

    def load(self) -> "Scenario":
        """The scenario."""
        from mjsheaf.scenario import load_scenario

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return load_scenario(self.path)


class Expectation(pytest.Item):
    """A test of a scenario file."""

    parent: ScenarioFile

    def __init__(self, *, test: "Callable[[Expectation], None]", **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._test = test

    def runtest(self) -> None:
        """Pass, fail or skip."""
        self._test(self)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return the location of the item: pytest writes scenarios/paper.yaml::physics."""
        return self.path, None, self.name

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """A missed expectation by its own message, anything else as pytest reports it."""
        if isinstance(excinfo.value, _MissedError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)


class _MissedError(Exception):
    """A failure whose message is all of the test's report."""


def _fail(reason: str, item: Expectation) -> None:
    raise _MissedError(reason)


def _skip(reason: str, item: Expectation) -> None:
    pytest.skip(reason)


def _compare(backends: list[str], item: Expectation) -> None:
    """Pass where the scenario runs as it expects on these backends; properties of the report take what was found."""
    from mjsheaf.runs.expecting import expected_law, try_scenario
    from mjsheaf.scenario.load import find_law

    scenario = item.parent.load()
    start = item.config.invocation_params.dir
    place = str(item.path.relative_to(start) if item.path.is_relative_to(start) else item.path)  # as a command takes it
    named = item.config.getoption("mjsheaf_controller")
    with _missing(place):
        law = expected_law(scenario, item.path.parent) if named is None else find_law(named)
    for backend in backends:
        with _missing(f"{place} on {backend}: cannot be simulated"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a run says what matters of them
            trial = try_scenario(scenario, backend, law=law)
        item.user_properties += [(name, value) for name, value in trial.final.items() if value is not None]
        _require_met(trial, place, item.config.getini("mjsheaf_tight"))


@contextmanager
def _missing(place: str) -> Iterator[None]:
    """Report an error of mjsheaf as a failure without a traceback, which begins with the place."""
    from mjsheaf.errors import MjsheafError

    try:
        yield
    except MjsheafError as error:
        raise _MissedError(f"{place}: {error}") from None


def _require_met(trial: "Trial", place: str, tight: str) -> None:
    """Fail where a trial misses a bound or, unless `tight` is empty, meets one that is wider than that many times."""
    from mjsheaf.runs.expecting import describe, loose, missed

    table = describe(trial, place, place)
    if not trial.met:
        raise _MissedError(f"{', '.join(missed(trial.checks))}\n{table}")
    slack = loose(trial, float(tight)) if tight else []
    if slack:
        names = ", ".join(check["measure"] for check in slack)
        update = f"  tighten them: mjsheaf expect {place} --update"
        raise _MissedError(f"loose bounds, of more than {tight} times what is found: {names}\n{table}\n{update}")
