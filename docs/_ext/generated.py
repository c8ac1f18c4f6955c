"""Pages made from the program and its files when the site is built: references, vehicles, the gallery of scenarios."""

import inspect
import re
from pathlib import Path
from typing import Any

import fields
import gallery
import packages
import replays
import sheaves
import stalks
import typer
import vehicles
from sphinx.application import Sphinx

from mjsheaf.cli.main import app as command_line
from mjsheaf.scenario import Scenario, list_scenarios
from mjsheaf.studies.plan import StudyFile
from mjsheaf.vehicles.vehicle import VehicleDescription

DOCS = Path(__file__).resolve().parents[1]
REPOSITORY = DOCS.parent


def _shown(argument: Any) -> str:
    return str(argument.metavar or argument.name.upper())


def commands_page() -> str:
    """Every command with its arguments and options."""
    lines = []
    for name, command in sorted(typer.main.get_command(command_line).commands.items()):  # type: ignore[attr-defined]
        if command.hidden:
            continue
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join([f"mjsheaf {name}", *(_shown(p) for p in arguments)])
        lines += [f"## mjsheaf {name}\n", f"`{usage}`\n", fields.prose(inspect.cleandoc(command.help or "")) + "\n"]
        for p in command.params:
            names = (
                ", ".join(f"`{o}`" for o in (*p.opts, *p.secondary_opts))
                if p.param_type_name == "option"
                else f"`{_shown(p)}`"
            )
            text = fields.prose(" ".join((getattr(p, "help", None) or "").split()))
            lines += [names, f": {text or 'see above'}\n"]
    return "\n".join(lines)


def write(path: Path, text: str) -> None:
    """Write a file where it is new, so that what is unchanged is not read again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text() != text:
        path.write_text(text)


def generate(_: Sphinx) -> None:
    """Write all pages below generated/."""
    to, examples = DOCS / "generated", fields.known_examples()
    for name, model in (("scenario", Scenario), ("vehicle", VehicleDescription), ("study", StudyFile)):
        write(to / f"{name}_fields.md", fields.reference(model, name, examples))
    shipped = set(list_scenarios())
    gallery.publish(to / "extra")
    for stale in (to / "gallery").glob("*.md"):
        if stale.stem not in shipped:
            stale.unlink()
    for name in shipped:
        write(to / "gallery" / f"{name}.md", gallery.page(name))
    write(to / "gallery_fields.md", gallery.cards())
    write(to / "commands_fields.md", commands_page())
    write(to / "variables_fields.md", fields.variables())
    stalks.write(to / "stalks.svg")
    packages.write(to / "packages.svg")
    sheaves.write(to)
    write(to / "vehicles_fields.md", vehicles.page(to / "vehicles"))
    changes = re.sub(r"\A# .*\n", "", (REPOSITORY / "CHANGELOG.md").read_text())
    write(to / "changes_fields.md", changes)


def setup(app: Sphinx) -> dict[str, bool]:
    """Generate pages before Sphinx looks for them; runs of scenarios begin before those of examples."""
    app.connect("config-inited", lambda *_: replays.begin() and None)
    app.connect("builder-inited", generate)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
