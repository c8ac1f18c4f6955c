"""The directory of a run: all or nothing, and never over what is not ours.

Oracle: the contract on DIR; what lies on the disk afterwards.
"""

import json
from pathlib import Path

import pytest

from mjsheaf import files as whole
from mjsheaf.errors import PlaceError
from mjsheaf.results.store import enclosing_run, record_in, save_summary, staging
from tests.builders import refused


def publish(directory: Path, word: str = "new") -> None:
    with staging(directory) as fresh:
        save_summary({"word": word}, fresh / "summary.json")


def fail(directory: Path, error: type[BaseException]) -> None:
    with staging(directory) as fresh:
        (fresh / "half").write_text("")
        raise error


def tree(directory: Path) -> list[str]:
    return sorted(str(p.relative_to(directory)) for p in directory.rglob("*"))


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_failure_leaves_what_was_there(error: type[BaseException], tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    with pytest.raises(error):
        fail(tmp_path / "old" / "a" / "b" / "run", error)
    assert tree(tmp_path) == ["old"]  # parents that were there before stay, though they are empty
    publish(tmp_path / "old" / "run", "kept")
    with pytest.raises(error):
        fail(tmp_path / "old" / "run", error)
    assert json.loads((tmp_path / "old" / "run" / "summary.json").read_text())["word"] == "kept"


def test_interrupt_between_the_renames_puts_the_old_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    publish(tmp_path / "run", "old")
    rename = Path.rename

    def interrupted(self: Path, target: Path) -> Path:
        if target == tmp_path / "run" and not self.name.endswith(".old"):
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(whole, "_exchange", lambda one, other: False)  # as on a system that cannot
    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        publish(tmp_path / "run")
    assert tree(tmp_path) == ["run", "run/summary.json"]
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["word"] == "old"


def test_relative_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    publish(tmp_path / "run")
    monkeypatch.chdir(tmp_path / "run")
    for here in (".", "", "../run", str(tmp_path / "run")):
        with refused(PlaceError, "--out", "current directory"):
            publish(Path(here))
    with refused(PlaceError, "inside", "--out"):
        publish(Path("inside"))
    publish(Path("../other"))
    publish(Path("inside/../../third"))
    assert tree(tmp_path) == [f"{name}{rest}" for name in ("other", "run", "third") for rest in ("", "/summary.json")]


def test_enclosing_run_is_found_through_links(tmp_path: Path) -> None:
    publish(tmp_path / "run")
    (tmp_path / "link").symlink_to(tmp_path / "run")
    assert record_in(tmp_path / "run") is not None
    assert enclosing_run(tmp_path / "run") is None
    assert enclosing_run(tmp_path / "link" / "x" / "y.mp4") == tmp_path / "run"
    for text in ("{}", "[]", "3", "{", '"mjsheaf_version"'):
        (tmp_path / "summary.json").write_text(text)
        assert record_in(tmp_path) is None


def test_numbers_that_are_not_finite_become_null(tmp_path: Path) -> None:
    save_summary({"a": float("inf"), "b": [float("nan"), 1.0], "c": {"d": float("-inf")}}, tmp_path / "summary.json")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["a"], summary["b"], summary["c"]) == (None, [None, 1.0], {"d": None})
    assert tree(tmp_path) == ["summary.json"]
