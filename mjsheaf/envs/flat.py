"""Episodes with actions and observations as arrays, which Gymnasium and PettingZoo share.

An action is an array in [-1, 1]: 1 is the largest of the agent's actions, and -1 the smallest; see `Episode.bounds`.
Zero is zero. What cannot be negative, such as the thrust of a rotor, is in [0, 1], and cut to its smallest. An
observation is an array of the parts that `Episode.observe` names, one after another.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces

from mjsheaf.arrays import Array
from mjsheaf.envs.episode import Episode
from mjsheaf.errors import InputError, expected

PARTS = ("measurements", "received", "attitude", "velocity", "angular_velocity", "present")
"""Parts of an observation, in order."""
LARGEST = 1e9
"""Bound of every number of an observation: a larger position is a blow-up."""
RENDER_MODES = ["rgb_array"]
_PICTURE = (480, 640)  # px
_ROOM = 1.6  # of the team's size, at which the camera stands


class FlatEpisode(Episode):
    """An episode with actions and observations as arrays.

    Attributes:
        parts: Parts of an observation.
        render_mode: 'rgb_array', or None.
    """

    def __init__(
        self,
        scenario: Any,
        *,
        parts: Sequence[str] = PARTS,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Prepare the first episode; `options` are those of `Episode`.

        Raises:
            InputError: As for `Episode`; or a part or the render mode is unknown.
        """
        for part in parts:
            if part not in PARTS:
                raise InputError(f"parts: unknown part {part!r}; {expected(str(part), PARTS)}")
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise InputError(f"render_mode is {render_mode!r}; expected None or 'rgb_array'")
        self.parts = tuple(parts)
        self.render_mode = render_mode
        super().__init__(scenario, visible=render_mode is not None, **options)

    @property
    def options(self) -> dict[str, Any]:
        """Arguments that make an equal episode."""
        options = super().options | {"parts": self.parts, "render_mode": self.render_mode}
        del options["visible"]  # follows from the render mode
        return options

    @cached_property
    def action_spaces(self) -> dict[str, spaces.Box]:
        """Space of each agent's action, by id."""
        lows = {name: -(limits[0] < 0.0).astype(np.float64) for name, limits in self.bounds.items()}
        return {name: spaces.Box(low, 1.0, dtype=np.float64) for name, low in lows.items()}

    @cached_property
    def observation_spaces(self) -> dict[str, spaces.Box]:
        """Space of each agent's observation, by id."""
        return {name: box(len(own), LARGEST) for name, own in self.flat().items()}

    def flat(self) -> dict[str, Array]:
        """Return the observation of each agent at the last sample, by id."""
        return {
            name: np.concatenate([np.zeros(0), *(np.ravel(own[part]).astype(np.float64) for part in self.parts)])
            for name, own in self.observe().items()
        }

    def act_flat(self, actions: Mapping[str, Any]) -> None:
        """Choose the actions of agents by arrays in [-1, 1], by id; see `Episode.act`."""
        self.act(actions, normalized=True)

    def step_period(self) -> None:
        """Take one control period."""
        self.advance(self.world.steps_per_sample)

    def picture(self) -> Any:
        """Draw the vehicles as they are, shape (480, 640, 3), 8 bits a colour; headless where there is no display."""
        from mjsheaf.envs.control_suite import BodyPhysics
        from mjsheaf.envs.suite import MovableCamera

        if not hasattr(self, "_camera"):
            self._camera = MovableCamera(BodyPhysics(self), *_PICTURE)
        places = self.world.positions()
        low, high = places.min(axis=0), places.max(axis=0)
        self._camera.set_pose(0.5 * (low + high), _ROOM * float(np.linalg.norm(high - low)) + 3.0, 120.0, -35.0)
        return self._camera.render().copy()


def box(size: int, bound: float) -> Any:
    """Return the space of arrays (size,) within a bound."""
    return spaces.Box(-bound, bound, (size,), np.float64)
