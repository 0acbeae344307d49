"""Pictures of a workcell from beside it, for people."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.simulation.manipulation.physics import mujoco

_LOOK_AT, _DISTANCE = (0.4, 0.0, 0.85), 1.55  # m
_AZIMUTH, _ELEVATION = 215.0, -25.0  # degrees: from behind the place, to its left


class Film:
    """Draws states of MuJoCo's model, once they are over. `close` frees its OpenGL context.

    data: the simulation. size: width and height [pixels]. Raises RenderError where there is no
    OpenGL.
    """

    def __init__(self, model: Any, data: Any, size: tuple[int, int]) -> None:
        mj = mujoco()
        try:
            self._renderer = mj.Renderer(model, size[1], size[0])
        except Exception as error:  # of many kinds, by the library that is missing
            raise RenderError(f'no OpenGL context for MuJoCo: {error}') from error
        self._model, self._data = model, data
        self._drawn, self._camera = mj.MjData(model), mj.MjvCamera()
        self._camera.lookat[:], self._camera.distance = _LOOK_AT, _DISTANCE
        self._camera.azimuth, self._camera.elevation = _AZIMUTH, _ELEVATION

    def state(self) -> NDArray[np.float64]:
        """The present one, for `picture`: MuJoCo's generalised coordinates."""
        return np.array(self._data.qpos)

    def picture(self, state: NDArray[np.float64]) -> NDArray[np.uint8]:
        """(height, width, 3) RGB."""
        self._drawn.qpos[:] = state
        mujoco().mj_forward(self._model, self._drawn)
        self._renderer.update_scene(self._drawn, self._camera)
        return np.array(self._renderer.render())

    def strip(self, states: Sequence[NDArray[np.float64]]) -> NDArray[np.uint8]:
        """Pictures of eight of the states, evenly chosen, beside each other in two rows."""
        chosen = np.linspace(0, len(states) - 1, 8).round().astype(int)
        pictures = [self.picture(states[k]) for k in chosen]
        return np.concatenate([np.concatenate(each, axis=1)
                               for each in (pictures[:4], pictures[4:])])

    def close(self) -> None:
        """Free what OpenGL holds."""
        self._renderer.close()
