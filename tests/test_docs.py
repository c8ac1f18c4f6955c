"""Examples in README and in the pages of docs/ work: commands end as shown, code runs, files are valid.

Oracle: the pages themselves. Commands are shortened by options at their end: a fraction of a second, small videos.
Blocks of one page share their names, in order. `yaml` is a whole file, `yml` a part of a scenario, `text` is not run.
"""

import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from pkgutil import resolve_name
from threading import Thread
from typing import Any
from xml.etree import ElementTree

import matplotlib.pyplot as plt
import numpy as np
import pytest
import yaml
from pydantic import BaseModel, TypeAdapter

from mjsheaf import load_scenario, simulate
from mjsheaf.scenario import Scenario, list_scenarios
from mjsheaf.studies.plan import StudyFile, load_plan
from mjsheaf.vehicles.actuators import AnyActuator
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import VehicleDescription
from tests.builders import REPOSITORY, team_of
from tests.commands import answer_of, call
from tests.live.client import get, joined, next_state
from tests.pictures import is_legible, written
from tests.strategies import long

DOCS = REPOSITORY / "docs"
sys.path.append(str(DOCS / "_ext"))
import fields as reference  # noqa: E402 - of the site, which is no package

GENERATED = {"generated", "examples"}
PAGES = [
    REPOSITORY / "README.md",
    *(p for p in sorted(DOCS.rglob("*.md")) if not GENERATED & {*p.relative_to(DOCS).parts}),
]
NAMES = [page.relative_to(REPOSITORY).as_posix() for page in PAGES]
SHORT = ["--set", "time.end=0.2"]
SMALL = ["--set", "video.width=160", "--set", "video.height=120", "--set", "video.fps=2"]
SHORTENED = {"run": SHORT + SMALL, "compare": SHORT + SMALL, "sweep": SHORT, "video": ["--width", "160", "--fps", "1"]}
SLOW = {"compare", "sweep", "video", "report", "pytest", "--expect", "--update", "--format", "--out", "--no-video"}
SLOW |= {"controller.gain=30", "export", "--live"}
TEAM = team_of({"B1": [0, 0], "B2": [4, 0], "B3": [8, 0]}, {"D": [2, 6, 8]}, "B1 B2, B2 B3, B1 D, B3 D")
"""What a part of a scenario is a part of."""
INTRODUCED = {
    "sheaf_comparison": ["(5, 1, 8)", "(5, 1)", "(1, 3)", "(−4, 2) m"],
    "sheaf_sections": ["3 numbers", "(0, 1)", "2 numbers"],
    "sheaf_diffusion": ["e^{-2 t}"],
    "sheaf_extension": ["(0, 0)", "(6, 3, 9)", "(2, 1)", "(4, 2, 9)"],
}
"""Numbers that figures of the introduction show."""
VALUE = r"\([^)]*\)|True|False|array\([^)]*\)|-?\d+(?:\.\d+)?(?=$|,|;)"
"""A value that a comment shows."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


def files_of(page: Path) -> dict[str, str]:
    """The files that a page asks its reader to save, by name."""
    return dict(re.findall(r"Save this as `([\w.]+)`.*?^```\w+\n(.*?)^```$", page.read_text(), re.M | re.S))


def save_files(page: Path, to: Path) -> None:
    for name, text in files_of(page).items():
        (to / name).write_text(text)


def commands() -> list[Any]:
    """Every line of a page that begins with mjsheaf or pytest, but for those on machines that are not here.

    One that names no file to be saved is tried once, on whatever pages it stands.
    """
    found: dict[tuple[Path | None, tuple[str, ...]], Path] = {}
    for page in PAGES:
        for line in "".join(blocks(page, "sh")).splitlines():
            if re.match("(mjsheaf|pytest) ", line) and "HOST" not in line:
                own = page if any(name in line for name in files_of(page)) else None
                found[own, tuple(shlex.split(line, comments=True))] = page
    return [
        pytest.param(page, words, id=" ".join(words[1:]), marks=[pytest.mark.slow] if SLOW & {*words} else [])
        for (_, words), page in found.items()
    ]


def visit(url: str) -> None:
    """Open a live page, and close it when it has a connection to the run."""

    def stay() -> None:
        assert get(url)[0] == 200
        with joined(url, max_size=None) as socket:
            next_state(socket)

    Thread(target=stay).start()


@pytest.mark.parametrize(("page", "line"), commands())
def test_command_ends_as_it_should(
    page: Path, line: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.chdir(tmp_path)
    save_files(page, tmp_path)
    program, *words = line
    if program == "pytest":
        plugin = ["-p", "mjsheaf.pytest_plugin", "-p", "no:cacheprovider"]
        subprocess.run([sys.executable, "-m", "pytest", *plugin, *words], check=True, timeout=300)
        return
    if ">" in words:
        words, (_, file) = words[:-2], words[-2:]
        (tmp_path / file).write_text(answer_of(*words).out)
        json.loads((tmp_path / file).read_text())
        return
    if words[0] == "compare-runs":
        for directory in words[1 : words.index("--out")]:
            assert call("run", "paper", *SHORTENED["run"], "--out", directory) == 0
    if words[0] in ("video", "plot", "report", "export"):  # which `make demo` leaves
        assert call("run", "paper", *SHORTENED["run"], "--out", words[1]) == 0
    if words[0] == "view":
        monkeypatch.setattr("webbrowser.open", visit)
    elif words[0] == "run" and words[-1] != "--live":
        request.getfixturevalue("without_plots")
    shortened = [] if "--expect" in words else SHORTENED.get(words[0], [])
    answer = answer_of(*words, *(shortened or SMALL if words[0] == "run" else shortened))
    assert answer.code == (1 if words[:2] == ["check", "air_tracks_surface"] else 0), answer.err
    if "--out" in words:
        assert (tmp_path / words[words.index("--out") + 1]).is_dir()


@pytest.mark.parametrize(("page", "block"), [(p, b) for p in PAGES for b in blocks(p, "console")])
def test_terminal_shows_what_is_printed(
    page: Path, block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save_files(page, tmp_path)
    prompt, *shown = block.splitlines()
    printed = answer_of(*shlex.split(prompt.removeprefix("$ mjsheaf "))).out.splitlines()
    begin = printed.index(shown[0])
    assert printed[begin : begin + len(shown)] == shown


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(p, id=p.name, marks=[pytest.mark.long] if p.name == "extending.md" else [])
        for p in PAGES
        if blocks(p, "python")
    ],
)
def test_code_gives_what_its_comments_say(page: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A comment that begins with a value is what the expression before it gives; "up to sign", its absolute value."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.syspath_prepend(tmp_path)
    save_files(page, tmp_path)
    names: dict[str, Any] = {"array": np.array}
    for code in blocks(page, "python"):
        if "dask_jobqueue" in code:
            compile(code, page.name, "exec")  # needs a cluster
            continue
        exec(compile(code, page.name, "exec"), names)
        for expression, value, rest in re.findall(rf"^(\S.*?)  # ({VALUE})(.*)$", code, re.MULTILINE):
            given = eval(expression, names)
            shown = eval(value, names)
            if "up to sign" in rest:
                given = np.abs(given)
                shown = np.abs(shown)
            np.testing.assert_allclose(given, shown, atol=1e-12, err_msg=expression)
    plt.close("all")


FILES = [(p, text) for p in PAGES for text in blocks(p, "yaml")]
EXPLAINED = [long(p, p.read_text()) for p in sorted(reference.EXPLAINING.glob("*.yaml"))]
"""Files out of which the reference has its examples."""


@pytest.mark.parametrize(("source", "text"), [*FILES, *EXPLAINED])
def test_files_are_valid(source: Path, text: str, tmp_path: Path) -> None:
    path = source
    if source in PAGES:
        save_files(source, tmp_path)
        path = tmp_path / "mine.yaml"
        path.write_text(text)
    given = yaml.safe_load(text)
    if "mjcf" in given:
        VehicleDescription.model_validate(given)
        assert source not in PAGES or load_vehicle(str(path)).actuators
    elif set(given) == {"actuators"}:
        TypeAdapter(dict[str, AnyActuator]).validate_python(given["actuators"])
    elif "scenario" in given:
        points = load_plan(str(path)).points
        assert str(len(points)) in re.findall(r"# (\d+) runs", text) or source not in PAGES
    else:
        shorter = {} if "events" in given else {"time.end": 0.2}
        assert simulate(load_scenario(path, shorter), backend="ideal").attrs["status"] == "finished"


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "yml")], ids=lambda p: p.name)
def test_parts_of_scenarios_are_valid(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for file in reference.EXPLAINING.glob("*.py"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    for text in blocks(page, "yml"):
        part = yaml.safe_load(text)
        assert load_scenario(TEAM | part).phases, text
        assert part.keys() <= Scenario.model_fields.keys()


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "toml") or blocks(p, "xml")], ids=lambda p: p.name)
def test_other_blocks_are_well_formed(page: Path) -> None:
    for text in blocks(page, "toml"):
        assert tomllib.loads(text)
    for text in blocks(page, "xml"):
        assert ElementTree.fromstring(text).tag == "mujoco"


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_to_files(name: str) -> None:
    page = REPOSITORY / name
    for to in re.findall(r"\]\((?!https?:|#)([^)#]+)", page.read_text()):
        place = (page.parent / to).resolve()
        if not GENERATED & {*place.relative_to(REPOSITORY).parts} or place.is_relative_to(REPOSITORY / "examples"):
            assert place.exists(), to
    for module, attribute in re.findall(r"`(mjsheaf(?:\.[a-z_]+)+)\.([A-Za-z_]\w*)`", page.read_text()):
        resolve_name(f"{module}.{attribute}")


@pytest.mark.parametrize("page", ["built", "extending"])
def test_files_that_are_named_are_there(page: str) -> None:
    packages = "|".join(path.parent.name for path in (REPOSITORY / "mjsheaf").glob("*/__init__.py"))
    names = re.findall(rf"`((?:{packages})/\w+\.py)`", (DOCS / f"{page}.md").read_text())
    assert [name for name in names if not (REPOSITORY / "mjsheaf" / name).is_file()] == []
    assert len(names) > 10


def test_functions_in_the_walk_of_a_run_are_there() -> None:
    text = (DOCS / "built.md").read_text()
    found = re.findall(r"((?:`[\w.]+`(?:, | and )?)+) in `(\w+/\w+\.py)`", text)
    for names, file in found:
        source = (REPOSITORY / "mjsheaf" / file).read_text()
        for name in re.findall(r"`(?:\w+\.)?(\w+)`", names):
            assert re.search(rf"\b(def|class) {name}\b|^{name}\b", source, re.M), (name, file)
    assert len(found) > 10


def properties() -> list[Any]:
    """Every field of every section of the files that users write."""
    files: list[type[BaseModel]] = [Scenario, VehicleDescription, StudyFile]
    return [
        pytest.param(name, node, id=f"{section.name}.{name}")
        for model in files
        for section in reference.sections_of(model)
        for name, node in section.schema.get("properties", {}).items()
    ]


@pytest.mark.parametrize(("name", "node"), properties())
def test_every_field_has_a_meaning_and_every_number_a_unit(name: str, node: dict[str, Any]) -> None:
    unit = reference.unit_of(node)
    if reference.is_number(node):
        assert unit is not None, "its description must end with a unit, such as [m/s], or [-]"
    else:
        assert unit is None
    sections = [*node.get("anyOf", []), *node.get("oneOf", []), *([node] if "$ref" in node else [])]
    assert node.get("description") or any("$ref" in below for below in sections)


@pytest.mark.slow(first=True)
def test_every_field_has_an_example_out_of_a_file() -> None:
    """But for fields that are sections themselves, whose fields have."""
    examples = reference.known_examples()
    for model in (Scenario, VehicleDescription, StudyFile):
        for section in reference.sections_of(model):
            for name, node in section.schema.get("properties", {}).items():
                assert (section.name, name) in examples or list(reference.references(node)), f"{section.name}.{name}"


@pytest.mark.slow
def test_the_gallery_shows_every_scenario_once_and_the_refused_last() -> None:
    import gallery

    sections = gallery.ordered(list_scenarios())
    names = [name for section in sections.values() for name in section]
    assert sorted(names) == sorted(list_scenarios())
    assert names[:3] == ["paper", "certified", "harbour"]
    assert list(sections)[-1] == gallery.REFUSED
    refused = {name for name in names if load_scenario(name).expect.refused}
    assert refused <= set(sections[gallery.REFUSED])
    assert {name for name in names if gallery.label_of(name)} == refused


def test_formulas_become_mathml_whose_bars_do_not_grow() -> None:
    pytest.importorskip("latex2mathml")
    pytest.importorskip("ziamath")
    import mathml

    formulas = []
    for page in PAGES:
        text = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(), flags=re.DOTALL)
        formulas += [block or inline for block, inline in re.findall(r"\$\$(.+?)\$\$|\$([^$\n]+?)\$", text, re.DOTALL)]
    assert len(formulas) > 50
    for formula in formulas:
        root = ElementTree.fromstring(mathml.translate(formula, block=False))
        words = "".join(root.itertext())
        assert "\\" not in words, formula  # a command that is not known stays as it is
        bars = [node for node in root.iter(f"{{{mathml.MATHML}}}mo") if node.text == "‖"]
        assert all(node.get("stretchy") == "false" for node in bars), formula


def test_the_figure_of_stalks_shows_the_sheaf_of_its_text(tmp_path: Path) -> None:
    import stalks

    texts = [text.get_text() for axis in stalks.draw().axes for text in axis.texts]
    assert any(text.endswith("= (−4, 2) m") for text in texts)
    assert any("has dimension 3" in text and "has dimension 0" in text for text in texts)
    assert [text for text in texts if text in ("0", "1", "−1")] == list("1001") + list("100010") + [
        *("1", "0", "−1", "0", "0"),
        *("0", "1", "0", "−1", "0"),
    ]
    for name in ("a.svg", "b.svg"):
        stalks.write(tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


@pytest.mark.slow
def test_figures_of_the_introduction_are_legible_and_show_its_numbers(tmp_path: Path) -> None:
    """Numbers: those of the two pages, whose code gives them."""
    import sheaves

    for name, draw in sheaves.FIGURES.items():
        figure = draw()
        assert is_legible(figure), name
        shown = " ".join(text.text for text in written(figure))
        for number in INTRODUCED[name]:
            assert number in shown, (name, number)
        plt.close(figure)
    for directory in ("a", "b"):
        sheaves.write(tmp_path / directory)
    for name in sheaves.FIGURES:
        assert (tmp_path / "a" / f"{name}.svg").read_bytes() == (tmp_path / "b" / f"{name}.svg").read_bytes()
    pages = (DOCS / "sheaves.md").read_text() + (DOCS / "harmonic.md").read_text()
    assert set(re.findall(r"generated/(sheaf_\w+)\.svg", pages)) == set(sheaves.FIGURES)


def test_paths_of_the_introduction_are_those_of_the_simulation() -> None:
    """Oracle: the ideal backend runs the page's scenario under its law."""
    import sheaves

    text = files_of(DOCS / "harmonic.md")["pair.yaml"]
    result = simulate(load_scenario(yaml.safe_load(text)), backend="ideal")
    problem = sheaves.team().dirichlet_problem(list(sheaves.TARGETS))
    pull = problem.B @ np.concatenate(list(sheaves.TARGETS.values()))
    start = np.concatenate(list(sheaves.STARTS.values()))
    times = result.time.values
    path = sheaves.follow(problem.H.toarray(), pull, start, 2.0 * times)  # the scenario's gain is 2 1/s
    position = result.agent_position.values
    given = np.concatenate([position[:, 0, :2], position[:, 1]], axis=1)
    assert np.abs(path - given).max() < 0.1  # m; the simulation holds its command for 0.01 s
    np.testing.assert_allclose(path[-1], given[-1], atol=1e-6)
