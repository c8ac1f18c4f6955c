"""Malformed scenario files: each is valid, or refused in one line; never a traceback, a hang or a partial directory.

Oracle: the contract on errors, exit codes and directories. Files are those that ship, mutated as trees: fields gone,
doubled, renamed, replaced by other types, endless or huge numbers, deep nesting, odd text; and mutated as bytes.
"""

import shutil
import warnings
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjsheaf import load_vehicle
from mjsheaf.cli.main import main
from mjsheaf.errors import InputError
from mjsheaf.files import dump_yaml, read_yaml
from mjsheaf.runs.simulate import simulate
from mjsheaf.scenario import list_scenarios, load_scenario
from mjsheaf.vehicles.arena import attachable
from tests.builders import RAFT
from tests.commands import DATA_FILES, only_errors
from tests.strategies import scaled

from .mutations import FUZZ, RUNS, TEXTS, TREES, base, in_time, load_or_refuse, mutated_text, mutated_tree, try_files

NAMES = list(list_scenarios())
SHORT = ["time.start=0", "time.end=0.05", "controller.control_period=0.01"]
VEHICLES = 250


def texts(name: str) -> st.SearchStrategy[bytes]:
    return mutated_text(list_scenarios()[name].read_bytes())


@pytest.mark.parametrize("name", NAMES)
def test_what_is_mutated_is_valid(name: str, tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(dump_yaml(base(name)))
    load_scenario(path)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", NAMES)
def test_a_mutated_tree_is_valid_or_refused_in_words(name: str, tmp_path: Path) -> None:
    try_files(mutated_tree(base(name)), TREES, lambda data: load_or_refuse(data, tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_mutated_bytes_are_valid_or_refused_in_words(name: str, tmp_path: Path) -> None:
    try_files(texts(name), TEXTS, lambda data: load_or_refuse(data, tmp_path))


@pytest.fixture(scope="module")
def _compiled() -> None:
    """Compile all loops before any run is timed."""
    for name in ("altitude_anchor", "certified"):  # held and continuous
        simulate(load_scenario(name, {"time.end": 0.05}), "ideal")


@pytest.mark.slow
@pytest.mark.usefixtures("_compiled", "without_plots")
@pytest.mark.parametrize("name", NAMES)
def test_a_mutated_file_runs_whole_or_leaves_nothing(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [part for change in SHORT for part in ("--set", change)]
    runs = iter(range(10 * RUNS))

    def each(data: bytes) -> None:
        folder = tmp_path / str(next(runs))
        folder.mkdir()
        path, out = folder / "scenario.yaml", folder / "out"
        path.write_bytes(data)
        capsys.readouterr()
        with in_time(), pytest.raises(SystemExit) as stopped:
            main(["run", str(path), "--backend", "ideal", "--no-video", "--out", str(out), *arguments])
        code, told = stopped.value.code or 0, capsys.readouterr().err
        assert code in (0, 1, 2, 3)
        assert "Traceback" not in told
        assert only_errors(told) if code else told.count("\n") == told.count("note: ")
        assert {p.name for p in folder.iterdir()} == ({"scenario.yaml", "out"} if code in (0, 3) else {"scenario.yaml"})
        if out.exists():
            assert {p.name for p in out.iterdir()} == DATA_FILES

    try_files(st.one_of(mutated_tree(base(name)), texts(name)), scaled(RUNS), each)


@pytest.mark.parametrize("suffix", [".yaml", ".xml"])
def test_a_mutated_vehicle_is_valid_or_refused(suffix: str, tmp_path: Path) -> None:
    """Its description, as a tree and as bytes, and the bytes of its MJCF file."""
    for own in (".yaml", ".xml"):
        shutil.copy(RAFT.with_suffix(own), tmp_path)
    path = tmp_path / f"raft{suffix}"
    strategy = mutated_text(RAFT.with_suffix(suffix).read_bytes())
    strategy = st.one_of(strategy, mutated_tree(read_yaml(RAFT))) if suffix == ".yaml" else strategy

    @settings(FUZZ, max_examples=scaled(VEHICLES))
    @given(strategy)
    def each(data: bytes) -> None:
        path.write_bytes(data)
        with in_time(), warnings.catch_warnings(), suppress(InputError):
            warnings.simplefilter("ignore")
            attachable(load_vehicle(str(tmp_path / "raft.yaml")))

    each()
