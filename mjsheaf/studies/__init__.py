"""Studies: many runs of one scenario, on every core or a cluster, that resume after an interruption."""

from mjsheaf.studies.plan import Plan, Point, load_plan
from mjsheaf.studies.study import Study, run_study

__all__ = ["Plan", "Point", "Study", "load_plan", "run_study"]
