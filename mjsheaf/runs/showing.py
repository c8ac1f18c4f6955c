"""Show a run in Python: its figures, and its page in a notebook. Nothing is written unless you save it."""

import base64
import html
import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from mjsheaf.errors import InputError
from mjsheaf.files import naming, write_whole
from mjsheaf.results import store, thinned
from mjsheaf.runs.publish import account_of, scenario_of, shown_bound
from mjsheaf.scenario import Scenario
from mjsheaf.show.style import MATPLOTLIB, FigureOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT = 640  # px of a replay in a notebook
_INSTEAD = "a Dataset as `simulate` returns it, or the directory of a run"


class Figures(dict[str, "Figure"]):
    """Matplotlib figures of a run by name. A notebook shows them below one another."""

    def _repr_html_(self) -> str:
        from mjsheaf.show.panels import write_figure

        pictures = []
        for name, figure in self.items():
            file = io.BytesIO()
            write_figure(figure, file, "png")
            data = base64.b64encode(file.getvalue()).decode("ascii")
            pictures.append(f'<img alt="{html.escape(name)}" src="data:image/png;base64,{data}">')
        return "<br>".join(pictures)


@dataclass(frozen=True)
class ReplayPage:
    """The page of a run, which a notebook shows in a frame. It needs no network.

    Attributes:
        html: The page, as in report.html.
        height: Height of the frame in a notebook, px.
    """

    html: str = field(repr=False)
    height: int = _HEIGHT

    def save(self, path: str | Path) -> Path:
        """Write the page to a file, whole or not at all, and return its path.

        Raises:
            InputError: The file cannot be written.
        """
        place = Path(path)
        with naming(place):
            write_whole(place, self.html.encode("utf-8"))
        return place

    def _repr_html_(self) -> str:
        page = html.escape(self.html, quote=True)
        style = f"width: 100%; height: {self.height}px; border: 1px solid #d0d7de"
        return f'<iframe title="replay" sandbox="allow-scripts" style="{style}" srcdoc="{page}"></iframe>'


def plot(result: xr.Dataset | str | Path, *, title: bool = True) -> Figures:
    """Draw the figures that `mjsheaf run` writes: errors over time, trajectories, first and last configuration.

    The figures belong to the caller. They are not registered with pyplot, whose settings do not change.

    Args:
        result: A Dataset from `simulate`, or the directory of a finished run.
        title: True gives each figure a title; figures in a paper have captions instead.

    Returns:
        Matplotlib figures by name: `errors`, `trajectories` and `configurations`.

    Raises:
        InputError: The result is not from `simulate`, other functions have removed its scenario, or the directory holds
            no run.
    """
    from mjsheaf.checking.theorem.of_run import bounds_of_phases
    from mjsheaf.show.plots import figures_of

    with _opened(result, "plot") as (scenario, dataset, _):
        phases = scenario.phases
        drawn = thinned(dataset)
        bound = shown_bound(phases, drawn["time"].values, *bounds_of_phases(phases, dataset)[0])
    first, last = phases[0].system, phases[-1].system
    with MATPLOTLIB:
        draw = figures_of(
            first.team, last.team, drawn, bound, FigureOptions(title=title), scenario.video.eye, first.obstacles
        )
        return Figures((name, make()) for name, make in draw.items())


def replay(result: xr.Dataset | str | Path, *, height: int = _HEIGHT) -> ReplayPage:
    """Make the page that replays a run in three dimensions next to its curves, for a notebook or a file.

    Args:
        result: A Dataset from `simulate`, or the directory of a finished run.
        height: Height of the frame in a notebook, px.

    Returns:
        The page, with `save(path)` for a file that any browser opens.

    Raises:
        InputError: See `plot`; or the directory holds a run of an earlier version that recorded fewer variables.
    """
    from mjsheaf.checking.theorem.of_run import bounds_of_phases
    from mjsheaf.page import page_of, require_shown

    again = None
    with _opened(result, "replay") as (scenario, dataset, summary):
        require_shown(dataset, "replay: the result")
        phases = scenario.phases
        if summary is None:
            account = account_of(scenario, phases, dataset)
            summary = account.summary
            bounds = account.bounds
            again = f"mjsheaf.simulate(scenario, backend={dataset.attrs['backend']!r})", " in Python"
        else:
            bounds = bounds_of_phases(phases, dataset)
        page = page_of(scenario, phases, dataset, summary, bounds, notes=summary.get("notes", ()), again=again)
    return ReplayPage(page.decode("utf-8"), height)


@contextmanager
def _opened(
    result: xr.Dataset | str | Path, doing: str
) -> Iterator[tuple[Scenario, xr.Dataset, dict[str, Any] | None]]:
    """Yield the scenario and data of a run and, for a directory, its summary.json.

    Raises:
        InputError: There is no run.
    """
    if isinstance(result, xr.Dataset):
        yield scenario_of(result, doing), result, None
    elif isinstance(result, str | Path):
        with store.reopen_run(Path(result)) as (scenario, dataset, summary):
            yield scenario, dataset, summary
    else:
        raise InputError(f"{doing}: result is a {type(result).__name__}; expected {_INSTEAD}")
