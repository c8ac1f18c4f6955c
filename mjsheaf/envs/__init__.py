"""Environments for reinforcement learning: a scenario on bodies, with actions added to its law.

Each environment is a thin face of one core, `Episode`. A zero action leaves the run of `mjsheaf run` as it is, to the
bit. Names are imported when first used: each face needs a library of its own.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjsheaf.envs.control_suite import dm_env
    from mjsheaf.envs.episode import Episode

_HOME = {"Episode": "mjsheaf.envs.episode", "dm_env": "mjsheaf.envs.control_suite"}

__all__ = ["Episode", "dm_env"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'mjsheaf.envs' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
