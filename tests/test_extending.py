"""What docs/extending.md shows works: its Python blocks run in order, with the assertions that they make."""

import re

from tests.builders import REPOSITORY


def test_every_block_runs() -> None:
    text = (REPOSITORY / "docs" / "extending.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 8
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/extending.md", "exec"), names)


def test_files_that_it_names_are_there() -> None:
    text = (REPOSITORY / "docs" / "extending.md").read_text()
    for name in re.findall(r"`((?:control|team|vehicles|scenario|simulation)/\w+\.py|system\.py)`", text):
        assert (REPOSITORY / "mjsheaf" / name).is_file(), name
