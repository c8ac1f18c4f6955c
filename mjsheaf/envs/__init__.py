"""Environments for reinforcement learning: a scenario on bodies, with actions added to its law.

Each environment is a thin face of one core, `Episode`. A zero action leaves the run of `mjsheaf run` as it is, to the
bit. Names are imported when first used: each face needs a library of its own. Where Gymnasium is installed, shipped
scenarios are registered with it as `mjsheaf/NAME-v0`.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjsheaf.envs.control_suite import dm_env
    from mjsheaf.envs.episode import Episode
    from mjsheaf.envs.gym import env, vector_env
    from mjsheaf.envs.petting_zoo import parallel_env

_HOME = {
    "Episode": "mjsheaf.envs.episode",
    "dm_env": "mjsheaf.envs.control_suite",
    "env": "mjsheaf.envs.gym",
    "parallel_env": "mjsheaf.envs.petting_zoo",
    "vector_env": "mjsheaf.envs.gym",
}

__all__ = ["Episode", "dm_env", "env", "parallel_env", "vector_env"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        try:
            return getattr(import_module(_HOME[name]), name)
        except ModuleNotFoundError as error:
            if error.name not in ("gymnasium", "pettingzoo"):
                raise
            raise ImportError(f"mjsheaf.envs.{name} needs {error.name}; expected pip install 'mjsheaf[rl]'") from error
    raise AttributeError(f"module 'mjsheaf.envs' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


def _register_scenarios() -> None:
    """Register every shipped scenario as `mjsheaf/NAME-v0`; nothing is loaded until one is made."""
    from gymnasium.envs.registration import register, registry

    from mjsheaf.scenario.load import list_scenarios

    for name in list_scenarios():
        if f"mjsheaf/{name}-v0" not in registry:
            register(f"mjsheaf/{name}-v0", entry_point="mjsheaf.envs.gym:make_named", kwargs={"name": name})


if find_spec("gymnasium") is not None:
    _register_scenarios()
