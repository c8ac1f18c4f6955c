"""`mjsheaf new` writes a scenario that runs as it is, and whose options are valid; it replaces nothing."""

import re
import shlex
from pathlib import Path

import pytest
import yaml

from mjsheaf import check, load_scenario
from tests.commands import answer_of, call


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def test_file_is_valid_and_teaches() -> None:
    answer = answer_of("new", "search-2")
    assert answer.code == 0
    text = Path("search-2.yaml").read_text()
    assert "search-2.yaml" in answer.out
    assert not re.search(r"\{(file|name)\}", text)
    assert "mjsheaf run search-2.yaml" in text
    assert load_scenario("search-2.yaml").name == "search-2"
    options = text.replace("#: ", "")
    assert len(yaml.safe_load(options)) >= len(yaml.safe_load(text)) + 3
    assert len(load_scenario(yaml.safe_load(options)).phases) == 2
    for line in text.splitlines():
        assert len(line) <= 120


def test_a_file_named_without_its_suffix_is_proposed() -> None:
    assert call("new", "mine") == 0
    answer = answer_of("check", "mine")
    assert answer.code == 2
    assert "did you mean mine.yaml?" in answer.err


@pytest.mark.slow
def test_it_holds_and_runs() -> None:
    assert call("new", "mine") == 0
    record = check(load_scenario("mine.yaml"))
    assert record["ok"]
    assert record["theorem"]["applies"]
    assert record["notes"] == []
    assert call("run", "mine.yaml", "--no-video") == 0
    assert (Path("runs") / "mine-physics" / "report.html").is_file()


def test_the_commands_it_prints_can_be_pasted() -> None:
    out = answer_of("new", "a b").out
    assert "mjsheaf check 'a b.yaml', then mjsheaf run 'a b.yaml'" in out
    assert shlex.split(out)[-1] == "a b.yaml"


@pytest.mark.parametrize("name", ["mine", "mine.yaml", "mine.yml"])
def test_nothing_is_replaced(name: str) -> None:
    path = Path(name if "." in name else f"{name}.yaml")
    path.write_text("# of somebody's own")
    answer = answer_of("new", name)
    assert answer.code == 2
    assert "exists" in answer.err
    assert path.read_text() == "# of somebody's own"
    path.unlink()
    path.symlink_to("nowhere.yaml")
    assert answer_of("new", name).code == 2
    assert sorted(Path().iterdir()) == [path]


@pytest.mark.parametrize("name", ["", ".", "..", ".yaml", "a\nb", "no/such/place", "paper", "/"])
def test_what_is_no_name_is_refused(name: str) -> None:
    answer = answer_of("new", name)
    assert answer.code == 2
    assert len(answer.err.splitlines()) == 1
    assert list(Path().iterdir()) == []
