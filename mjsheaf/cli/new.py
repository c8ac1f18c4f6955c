"""`mjsheaf new`."""

import re
import shlex
from pathlib import Path
from typing import Annotated

import typer

from mjsheaf.cli.options import require_file_name
from mjsheaf.cli.terminal import print_lines
from mjsheaf.errors import InputError, shortened


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of the scenario, or the path of the file to write.")],
) -> None:
    """Write a scenario to begin with: NAME.yaml, which runs as it is and says in comments what to change.

    A file that is there is not replaced.
    """
    from mjsheaf.io.files import naming, write_whole
    from mjsheaf.scenario.load import list_scenarios, name_from

    path = Path(name if name.endswith((".yaml", ".yml")) else f"{name}.yaml")
    if not re.fullmatch(r"\w[\w .+-]*", path.stem):  # it stands in a comment
        raise InputError(f"{shortened(name)!r}: expected a name, such as mine")
    if path.exists() or path.is_symlink():
        raise InputError(f"{path}: exists already; expected another name")
    if name in list_scenarios():
        raise InputError(f"{name}: comes with mjsheaf, which would take that one; expected another name")
    require_file_name("NAME", path, ".yaml", ".yml")
    template = Path(__file__).parents[1] / "scenario" / "template.yaml"
    text = template.read_text(encoding="utf-8").replace("{file}", path.name).replace("{name}", name_from(path))
    with naming(path):
        write_whole(path, text.encode("utf-8"))
    quoted = shlex.quote(str(path))
    print_lines(f"wrote {path}; next: mjsheaf check {quoted}, then mjsheaf run {quoted}")
