"""The pytest plugin, run as a user runs it: in a process of its own, in a directory of scenarios that are not ours.

Oracle: a tiny team whose final error is known exactly, and the output of pytest.
"""

import tomllib
from collections.abc import Callable

import pytest

from tests.builders import REPOSITORY
from tests.commands import python

TINY = """\
time: {end: 1}
controller: {gain: 2, control_period: 0.05}
agents: [{id: A, position: [0, 0]}]
targets: [{id: T, position: [3, 4]}]
sensing: [[A, T]]
physics: {timestep: 0.005}
"""
FILES = {
    "met.yaml": TINY + "expect: {ideal: {tracking_error: 0.65}, physics: {tracking_error: 2}}\n",
    "missed.yaml": TINY + "expect: {ideal: {tracking_error: 0.5, mean_disagreement: 1}}\n",
    "unstable.yml": TINY.replace("gain: 2", "gain: 900").replace("end: 1", "end: 20")
    + "expect: {ideal: {tracking_error: 1}}\n",
    "refused.yaml": TINY.replace("[0, 0]", "[0, 0, 5]") + "expect: {refused: A is free along z}\n",
    "ran.yaml": TINY + "expect: {refused: A is free along z}\n",
    "drifts.yaml": TINY.replace("[0, 0]", "[0, 0, 5]") + "expect: {ideal: {tracking_error: 1}}\n",
    "broken.yaml": TINY.replace("gain", "gian") + "expect: {ideal: {tracking_error: 1}}\n",
    "garbage.yaml": TINY + "expect: [\n",
    "lost.yaml": TINY.replace("[0, 0]", "[0, 0], vehicle: none.yaml") + "expect: {physics: {tracking_error: 1}}\n",
    "silent.yaml": TINY,
    "empty.yaml": TINY + "expect: {}\n",
    "others.yaml": "expect: 100-continue\nservices: [1, 2]\n",
    "odd.yaml": "? [\n",
    "vehicle.yaml": (REPOSITORY / "models" / "hull.yaml").read_text(),
    "run/scenario.yaml": TINY + "expect: {ideal: {tracking_error: 0.1}}\n",
    "run/summary.json": "{}",
    "test_other.py": "def test_something():\n    assert True\n",
    "still.py": "def still(t, sample):\n    return 0.0 * sample.disagreement\n",
    "own.yaml": TINY + "expect: {controller: still.py:still, ideal: {tracking_error: 5.01}}\n",
    "none.yaml": TINY + "expect: {controller: still.py:none, ideal: {tracking_error: 9}}\n",
}

Run = Callable[..., tuple[int, str]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Run pytest in a directory of FILES, with the plugin found by its entry point as in an installed wheel."""
    folder = tmp_path_factory.mktemp("user") / "project"
    for name, text in FILES.items():
        path = folder / "scenarios" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    # What a wheel's metadata would say, made from the project's own; the environment's copy may be older.
    installed = folder.parent / "installed" / "mjsheaf_plugin-1.dist-info"
    installed.mkdir(parents=True)
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    entries = [f"{name} = {value}" for name, value in project["entry-points"]["pytest11"].items()]
    (installed / "entry_points.txt").write_text("\n".join(["[pytest11]", *entries, ""]))
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: mjsheaf-plugin\nVersion: 1\n")

    def pytest_of_user(*arguments: str) -> tuple[int, str]:
        start = f"import sys; sys.path[:0] = [{str(installed.parent)!r}, {str(REPOSITORY)!r}]; import pytest"
        done = python(f"{start}\nsys.exit(pytest.main({[*arguments]!r}))", cwd=folder)
        return done.returncode, done.stdout + done.stderr

    return pytest_of_user


VERDICTS = """\
PASSED met.yaml::ideal met.yaml::physics own.yaml::ideal refused.yaml::refused test_other.py::test_something
FAILED missed.yaml::ideal unstable.yml::ideal ran.yaml::refused drifts.yaml::ideal none.yaml::ideal
FAILED broken.yaml::load garbage.yaml::load lost.yaml::physics
SKIPPED silent.yaml::expect empty.yaml::expect
"""
REASONS = """\
tracking_error          <= 0.5      0.6079  21.6 % above
watch it: mjsheaf run scenarios/missed.yaml --backend ideal
it ran, expected a refusal that says 'A is free along z'
broken.yaml: controller.gian: unknown field; expected
garbage.yaml: line 8
scenarios/lost.yaml on physics: cannot be simulated: agents.A.vehicle:
there is no 'none' in it
no `expect:` block; mjsheaf expect silent.yaml --update writes one
"""


def test_each_scenario_and_backend_is_a_test_that_says_what_is_wrong(run: Run) -> None:
    """In full in test_expecting.py; nothing else is collected."""
    code, told = run("--mjsheaf", "scenarios", "-v", "-rs", "-p", "no:cacheprovider", "--junitxml=report.xml")
    assert code == 1
    for verdict, *tests in map(str.split, VERDICTS.splitlines()):
        for test in tests:
            assert f"scenarios/{test} {verdict}" in told
    assert "8 failed, 5 passed, 2 skipped" in told
    for other in ("others.yaml", "odd.yaml", "vehicle.yaml", "run/scenario.yaml", "Traceback"):
        assert other not in told
    for words in REASONS.splitlines():
        assert words in told


@pytest.mark.long
def test_tests_are_chosen_by_name_and_spread_over_processes(run: Run) -> None:
    code, told = run("--mjsheaf", "scenarios", "-k", "met and ideal or refused.yaml", "-n", "2", "-v")
    assert code == 0, told
    assert "2 passed" in told
    code, told = run("--mjsheaf", "scenarios/met.yaml::ideal", "-q")
    assert code == 0, told
    assert "1 passed" in told


@pytest.mark.long
def test_a_file_that_is_named_is_never_passed_over_in_silence(run: Run) -> None:
    """Broken, no scenario, or without expectations: it fails, where a directory's walk would leave it alone."""
    named = ("vehicle.yaml", "odd.yaml", "others.yaml", "silent.yaml", "empty.yaml", "run/scenario.yaml", "met.yaml")
    code, told = run("--mjsheaf", *(f"scenarios/{name}" for name in named), "-v", "-p", "no:cacheprovider")
    assert code == 1
    for test, verdict, why in (
        ("vehicle.yaml::load", "FAILED", "vehicle.yaml: "),
        ("odd.yaml::load", "FAILED", "odd.yaml: line 2"),
        ("others.yaml::load", "FAILED", "others.yaml: services: unknown field"),
        ("silent.yaml::expect", "FAILED", "silent.yaml: no `expect:` block; mjsheaf expect silent.yaml --update"),
        ("empty.yaml::expect", "FAILED", "empty.yaml: no `expect:` block"),
        ("run/scenario.yaml::ideal", "FAILED", "tracking_error is 0.6079"),
        ("met.yaml::ideal", "PASSED", ""),
    ):
        assert f"{test} {verdict}" in told
        assert why in told
    assert "Traceback" not in told
    assert "6 failed, 2 passed" in told


@pytest.mark.long
def test_bounds_may_have_to_be_tight(run: Run) -> None:
    code, told = run("--mjsheaf", "scenarios/met.yaml", "-v", "-o", "mjsheaf_tight=1.1")
    assert code == 1
    assert "met.yaml::ideal PASSED" in told
    assert "loose bounds, of more than 1.1 times what is found: tracking_error" in told
    assert "tighten them: mjsheaf expect scenarios/met.yaml --update" in told
    for wrong in ("x", "0.5"):
        code, told = run("--mjsheaf", "scenarios/met.yaml", "-o", f"mjsheaf_tight={wrong}")
        assert code == 4
        assert f"mjsheaf_tight is '{wrong}'; expected a number of at least 1" in told


@pytest.mark.long
@pytest.mark.parametrize("option", ["--controller", "--mjsheaf-controller"])
def test_the_law_of_the_command_line_replaces_it(run: Run, option: str) -> None:
    code, told = run("--mjsheaf", "scenarios/met.yaml::ideal", option, "scenarios/still.py:still", "-v")
    assert code == 1
    assert "met.yaml::ideal FAILED" in told
    assert "tracking_error is 5," in told
    assert "still.py:still" in told
