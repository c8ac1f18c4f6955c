"""Malformed scenario files: each is valid, or refused in one line; never a traceback or a hang.

Oracle: the contract on errors. Files are those that ship, mutated as trees: fields gone, doubled, renamed, replaced by
other types, endless or huge numbers, deep nesting, odd text. test_fuzz_text.py mutates their bytes, and runs some.
"""

from pathlib import Path

import pytest

from mjsheaf.files import dump_yaml
from mjsheaf.scenario import list_scenarios, load_scenario
from tests.strategies import tried

from .mutations import RUNS, TEXTS, TREES, base, load_or_refuse, trees, try_files

NAMES = list(list_scenarios())


def test_ten_thousand_files_are_tried() -> None:
    """Different ones, by this module and test_fuzz_text.py: each test there asserts the number of its trials."""
    assert len(NAMES) * (TREES + TEXTS + RUNS) >= tried(10_000, 1_000)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_mutated_is_valid(name: str, tmp_path: Path) -> None:
    """Else every mutation would be refused for the same reason."""
    path = tmp_path / "scenario.yaml"
    path.write_text(dump_yaml(base(name)))
    load_scenario(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_mutated_tree_is_valid_or_refused_in_words(name: str, tmp_path: Path) -> None:
    try_files(trees(name), TREES, lambda data: load_or_refuse(data, tmp_path))
