"""mjsheaf: cellular sheaves for heterogeneous multi-agent target tracking, on MuJoCo bodies.

Names are imported when first used, so that the sheaf algebra can be used without loading MuJoCo.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mjsheaf._version import __version__

if TYPE_CHECKING:
    from mjsheaf import envs
    from mjsheaf.checking.check import check
    from mjsheaf.law.custom import register
    from mjsheaf.law.in_python import Controller, PerAgent
    from mjsheaf.loop.mujoco_engine import World
    from mjsheaf.loop.session import Session
    from mjsheaf.runs.publish import plot, replay, save
    from mjsheaf.runs.simulate import simulate, simulate_many
    from mjsheaf.scenario import Scenario, load_scenario
    from mjsheaf.sheaf import NonlinearSheaf, Sheaf
    from mjsheaf.vehicles.loading import load_vehicle

_HOME = {
    "Sheaf": "mjsheaf.sheaf",
    "NonlinearSheaf": "mjsheaf.sheaf",
    "Scenario": "mjsheaf.scenario",
    "load_scenario": "mjsheaf.scenario",
    "simulate": "mjsheaf.runs.simulate",
    "simulate_many": "mjsheaf.runs.simulate",
    "check": "mjsheaf.checking",
    "medium": "mjsheaf.media.medium",
    "Session": "mjsheaf.loop.session",
    "World": "mjsheaf.loop.mujoco_engine",
    "load_vehicle": "mjsheaf.vehicles.loading",
    "save": "mjsheaf.runs.publish",
    "plot": "mjsheaf.runs.publish",
    "replay": "mjsheaf.runs.publish",
    "register": "mjsheaf.law.custom",
    "Controller": "mjsheaf.law.in_python",
    "PerAgent": "mjsheaf.law.in_python",
}

__all__ = [
    "Controller",
    "NonlinearSheaf",
    "PerAgent",
    "Scenario",
    "Session",
    "Sheaf",
    "World",
    "__version__",
    "check",
    "envs",
    "load_scenario",
    "load_vehicle",
    "medium",
    "plot",
    "register",
    "replay",
    "save",
    "simulate",
    "simulate_many",
]


def __getattr__(name: str) -> Any:
    if name == "envs":  # a package, whose functions load libraries of their own
        return import_module("mjsheaf.envs")
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'mjsheaf' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
