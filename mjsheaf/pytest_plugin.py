"""A pytest plugin that turns scenarios into tests: `pytest --mjsheaf scenarios/`.

Every YAML file with an `expect:` block gives a test for each backend that has bounds in it, or one test, `refused`. It
passes where the runs are as expected. In a directory, scenarios without the block are skipped and other files ignored;
a file that is named itself fails if it is broken or expects nothing. Without --mjsheaf nothing is collected,
and nothing of mjsheaf but this module is imported.
"""

import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mjsheaf.runs.expecting import Trial
    from mjsheaf.scenario import Scenario

_SUFFIXES = (".yaml", ".yml")
_RECORDS = ("summary.json", "compare.json", "study.json")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --mjsheaf and the setting mjsheaf_tight."""
    group = parser.getgroup("mjsheaf")
    group.addoption("--mjsheaf", action="store_true", help="collect scenarios with an `expect:` block as tests")
    parser.addini(
        "mjsheaf_tight",
        "fail where a bound of an `expect:` block is more than this many times what was found, such as 1.1",
        default="",
    )


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
    """Whether a scenario has an `expect:` block; None for other files, which are ignored."""
    from mjsheaf.errors import ScenarioError
    from mjsheaf.io.yaml import read_yaml

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
        expects: whether it has an `expect:` block.
        named: whether the user named this very file: then it fails where a file that was only found is skipped.
    """

    expects = True
    named = False

    def collect(self) -> Iterator[pytest.Item]:
        """One test for each backend with bounds, or one for a refusal, or one that fails with what is wrong."""
        from mjsheaf.errors import MjsheafError
        from mjsheaf.runs.expecting import expected_backends

        if not self.expects and not self.named:
            yield Nothing.from_parent(self, name="expect")
            return
        try:
            scenario = self.load()
        except MjsheafError as error:
            yield Broken.from_parent(self, name="load", reason=str(error))
            return
        backends = expected_backends(scenario)
        if scenario.expect.refused is not None:
            yield Expectation.from_parent(self, name="refused", backends=backends)
            return
        for backend in backends:
            yield Expectation.from_parent(self, name=backend, backends=[backend])
        if not backends and self.named:
            yield Broken.from_parent(self, name="expect", reason=f"{self.path}: {nothing(self.path)}")
        elif not backends:
            yield Nothing.from_parent(self, name="expect")

    def load(self) -> "Scenario":
        """The scenario."""
        from mjsheaf.scenario import load_scenario

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return load_scenario(self.path)


class _Item(pytest.Item):
    """A test of a scenario file."""

    parent: ScenarioFile

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Where it is: pytest writes scenarios/paper.yaml::physics."""
        return self.path, None, self.name

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """A missed expectation by its own message, anything else as pytest reports it."""
        if isinstance(excinfo.value, _MissedError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)


class Expectation(_Item):
    """Passes where a scenario runs as it expects.

    Attributes:
        backends: on which it is tried.
    """

    def __init__(self, *, backends: list[str], **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.backends = backends

    def runtest(self) -> None:
        """Run the scenario and compare."""
        from mjsheaf.errors import MjsheafError
        from mjsheaf.runs.expecting import describe, loose, miss, missed, try_scenario

        scenario = self.parent.load()
        place = self._place()
        tight = self.config.getini("mjsheaf_tight")
        for backend in self.backends:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # a run says what matters of them
                    trial = try_scenario(scenario, backend)
            except MjsheafError as error:
                raise _MissedError(f"{place} on {backend}: cannot be simulated: {error}") from None
            self._record(trial)
            table = describe(trial, place, place)
            if not trial.met:
                raise _MissedError(f"{', '.join(map(miss, missed(trial)))}\n{table}")
            slack = loose(trial, float(tight)) if tight else []
            if slack:
                names = ", ".join(check["measure"] for check in slack)
                update = f"  tighten them: mjsheaf expect {place} --update"
                raise _MissedError(
                    f"loose bounds, of more than {tight} times what is found: {names}\n{table}\n{update}"
                )

    def _record(self, trial: "Trial") -> None:
        """Put what was found into the reports that take properties, such as JUnit's."""
        self.user_properties += [(name, value) for name, value in trial.final.items() if value is not None]

    def _place(self) -> str:
        """The file as a command takes it from where pytest was started."""
        start = self.config.invocation_params.dir
        return str(self.path.relative_to(start) if self.path.is_relative_to(start) else self.path)


class Nothing(_Item):
    """Skipped: a scenario without an `expect:` block, found in a directory."""

    def runtest(self) -> None:
        """Skip."""
        pytest.skip(nothing(self.path))


def nothing(path: Path) -> str:
    """The message for a scenario that expects nothing."""
    return f"no `expect:` block; mjsheaf expect {path.name} --update writes one into a scenario"


class Broken(_Item):
    """Fails: a file that cannot be read and says what it expects, or was named; a named one that expects nothing."""

    def __init__(self, *, reason: str, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.reason = reason

    def runtest(self) -> None:
        """Fail with the reason."""
        raise _MissedError(self.reason)


class _MissedError(Exception):
    """A failure whose message is all of the test's report."""
