"""Pictures and videos of the hand, drawn off screen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.scene.bottle import BOTTLE
from hdsafebo.pictures.offscreen import OffscreenRenderer, Picture, View
from hdsafebo.pictures.video import write_video

_VIEW = View(distance=0.7, azimuth=135.0, elevation=-15.0)


class SceneRenderer(OffscreenRenderer):
    """Draws a hand and its bottle; use it as a context manager, or call `close`.

    Args:
        model: the MuJoCo model.
        width: of pictures, pixels.
        height: of pictures, pixels.

    Raises:
        RenderingUnavailableError: no OpenGL renderer works; the message says what to install.
    """

    def __init__(self, model: mujoco.MjModel, width: int = 640, height: int = 480) -> None:
        super().__init__(model, _VIEW, width, height)

    def picture(self, data: mujoco.MjData) -> Picture:
        """(height, width, 3) the scene; the camera looks at where the bottle was in the first picture."""
        return self.picture_at(data, data.body(BOTTLE).xpos)


def pictures(
    scene: Scene,
    excitations: NDArray[np.float64],
    steps: Sequence[int],
    *,
    width: int = 640,
    height: int = 480,
) -> list[Picture]:
    """Pictures of an episode at the given control steps; 0 is the start pose.

    An episode that ended before a step is shown as it ended.

    Args:
        scene: hand and horizon.
        excitations: (steps, muscles) of the episode, as `rollout.policy_excitations` gives them.
        steps: increasing numbers of control steps.
        width: of the pictures, pixels.
        height: of the pictures, pixels.

    Raises:
        RenderingUnavailableError: no OpenGL renderer works.
    """
    simulation = scene.simulation()
    taken: list[Picture] = []
    with SceneRenderer(simulation.model, width, height) as renderer:
        simulation.reset()
        done = 0
        for wanted in steps:
            for excitation in excitations[done:wanted]:
                simulation.step(excitation)
            done = max(done, wanted)
            taken.append(renderer.picture(simulation.data))
    return taken


def record_video(scene: Scene, excitations: NDArray[np.float64], path: Path) -> None:
    """Write an episode as MP4 (H.264, 25 frames per second, real time).

    Raises:
        RenderingUnavailableError: no OpenGL renderer works.
    """
    steps = range(0, len(excitations) + 1, 2)  # every second control step of 20 ms
    write_video(pictures(scene, excitations, steps), path)
