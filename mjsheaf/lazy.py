"""Modules that take long to load, each loaded when it is first used: `lazy.publish.execute(...)`.

Commands that import this module alone appear at once. For type checkers its names are the modules themselves, also in
annotations, which are quoted: "lazy.publish.Outcome".
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mjsheaf.checking.check as examining
    import mjsheaf.cli.figures as check_figure
    import mjsheaf.comparing.compare as comparing
    import mjsheaf.comparing.page as comparing_page
    from mjsheaf import checking, export, files, progress, scenario, threads
    from mjsheaf.checking import record, report
    from mjsheaf.checking.theorem import theorem
    from mjsheaf.live import live
    from mjsheaf.media import flow_files
    from mjsheaf.results import store
    from mjsheaf.runs import expecting, overlay, publish
    from mjsheaf.scenario import load, slips
    from mjsheaf.show import plots, style
    from mjsheaf.studies import plan, study, workers
    from mjsheaf.vehicles import effects, loading
    from mjsheaf.video import draw, film, gl
else:
    _PLACES = {
        "check_figure": "cli.figures",
        "checking": "checking",
        "comparing": "comparing.compare",
        "comparing_page": "comparing.page",
        "draw": "video.draw",
        "effects": "vehicles.effects",
        "examining": "checking.check",
        "expecting": "runs.expecting",
        "export": "export",
        "files": "files",
        "film": "video.film",
        "flow_files": "media.flow_files",
        "gl": "video.gl",
        "live": "live.live",
        "load": "scenario.load",
        "loading": "vehicles.loading",
        "overlay": "runs.overlay",
        "plan": "studies.plan",
        "plots": "show.plots",
        "progress": "progress",
        "publish": "runs.publish",
        "record": "checking.record",
        "report": "checking.report",
        "scenario": "scenario",
        "slips": "scenario.slips",
        "store": "results.store",
        "study": "studies.study",
        "style": "show.style",
        "theorem": "checking.theorem.theorem",
        "threads": "threads",
        "workers": "studies.workers",
    }

    def __getattr__(name):
        if name not in _PLACES:
            raise AttributeError(f"module 'mjsheaf.lazy' has no attribute {name!r}")
        return import_module(f"mjsheaf.{_PLACES[name]}")
