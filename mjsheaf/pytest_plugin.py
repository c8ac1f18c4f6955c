"""A pytest plugin that turns scenarios into tests: `pytest --mjsheaf scenarios/`.

Every YAML file with an `expect:` block gives a test for each backend that has bounds in it, or one test, `refused`. It
passes where the runs are as expected. In a directory, scenarios without the block are skipped and other files ignored;
a file that is named itself fails if it is broken or expects nothing. Without --mjsheaf nothing is collected,
and nothing of mjsheaf but this module is imported. A block with a field `controller` is for that law in Python;
--controller FILE.py:NAME replaces it.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mjsheaf.scenario import Scenario


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --mjsheaf, --mjsheaf-controller, also named --controller, and the setting mjsheaf_tight."""
    group = parser.getgroup("mjsheaf")
    group.addoption("--mjsheaf", action="store_true", help="collect scenarios with an `expect:` block as tests")
    about: dict[str, Any] = {
        "metavar": "FILE.py:NAME",
        "dest": "mjsheaf_controller",
        "help": "run scenarios under this law in Python instead of the one that their `expect:` block names",
    }
    group.addoption("--mjsheaf-controller", **about)
    with suppress(ValueError):  # another plugin has it
        group.addoption("--controller", **about)
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
    if not parent.config.getoption("--mjsheaf") or file_path.suffix not in (".yaml", ".yml"):
        return None
    named = parent.session.isinitpath(file_path)
    records = ("summary.json", "compare.json", "runs.json", "study.json")
    if not named and any((file_path.parent / record).exists() for record in records):
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
        raw = read_yaml(path)
    except ScenarioError:
        with suppress(OSError):
            if re.search(rb"(?m)^expect\s*:", path.read_bytes()):
                return True  # most likely one that is broken
        return None
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

        tests: dict[str, list[str]] = {}
        fault = [
            f"{self.path}: no `expect:` block; mjsheaf expect {self.path.name} --update writes one into a scenario"
        ]
        if self.expects or self.named:
            try:
                scenario = self.load()
                backends = expected_backends(scenario)
                refused = scenario.expect.refused is not None
                tests = {"refused": backends} if refused else {backend: [backend] for backend in backends}
            except MjsheafError as error:
                tests = {"load": []}
                fault = [*error.args]
        for name, backends in (tests or {"expect": []}).items():
            yield Expectation.from_parent(self, name=name, backends=backends, fault=fault)

    def load(self) -> "Scenario":
        """The scenario."""
        from mjsheaf.scenario import load_scenario

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return load_scenario(self.path)


class Expectation(pytest.Item):
    """A test of a scenario file: that it runs on these backends as it expects; without any, what is wrong."""

    parent: ScenarioFile

    def __init__(self, *, backends: list[str], fault: list[str], **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._backends, self._fault = backends, fault

    def runtest(self) -> None:
        """Run the scenario on each backend; properties of the report take what was found.

        It fails where a trial misses a bound or, with `mjsheaf_tight`, meets one that is wider than that many times.
        """
        from mjsheaf.errors import MjsheafError, in_field
        from mjsheaf.runs.expecting import describe, expected_law, loose, missed, try_scenario

        if self.name == "expect" and not self.parent.named:
            pytest.skip(self._fault[0])
        if not self._backends:
            raise MjsheafError(*self._fault)
        start = self.config.invocation_params.dir
        place = str(self.path.relative_to(start) if self.path.is_relative_to(start) else self.path)  # for a command
        with in_field(place):
            scenario = self.parent.load()
            law = expected_law(scenario, self.path.parent, self.config.getoption("mjsheaf_controller"))
        for backend in self._backends:
            with in_field(f"{place} on {backend}: cannot be simulated"), warnings.catch_warnings():
                warnings.simplefilter("ignore")  # a run says what matters of them
                trial = try_scenario(scenario, backend, law=law)
            self.user_properties += [(name, value) for name, value in trial.final.items() if value is not None]
            table = describe(trial, place, place).splitlines()
            if not trial.met:
                raise MjsheafError(", ".join(missed(trial.checks)), *table)
            tight = self.config.getini("mjsheaf_tight")
            slack = loose(trial, float(tight)) if tight else []
            if slack:
                names = ", ".join(check["measure"] for check in slack)
                update = f"  tighten them: mjsheaf expect {place} --update"
                raise MjsheafError(f"loose bounds, of more than {tight} times what is found: {names}", *table, update)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return the location of the item: pytest writes scenarios/paper.yaml::physics."""
        return self.path, None, self.name

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """A missed expectation by its own message, anything else as pytest reports it."""
        from mjsheaf.errors import MjsheafError

        ours = isinstance(excinfo.value, MjsheafError)
        return str(excinfo.value) if ours else super().repr_failure(excinfo, style)
