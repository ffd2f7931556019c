"""Pictures and videos of the hand, drawn off screen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import mujoco
import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import RenderingUnavailableError
from hdsafebo.hand.bottle import BOTTLE
from hdsafebo.hand.policy import PolicySpace
from hdsafebo.hand.rollout import Scene

Picture = NDArray[np.uint8]

FRAMES_PER_SECOND = 25
_BACKENDS = ("egl", "osmesa")
_HIDDEN_GROUPS = (3, 4)  # wrapping surfaces, collision shapes
_INSTALL = (
    "no off-screen OpenGL renderer works on this machine; install one (Debian or Ubuntu: apt-get install libosmesa6, "
    "or libegl1 with a GPU driver) and set MUJOCO_GL=osmesa or MUJOCO_GL=egl"
)


class SceneRenderer:
    """Draws a simulation; use it as a context manager, or call `close`.

    Args:
        model: the MuJoCo model.
        width: of pictures, pixels.
        height: of pictures, pixels.

    Raises:
        RenderingUnavailableError: no OpenGL renderer works; the message says what to install.
    """

    def __init__(self, model: mujoco.MjModel, width: int = 640, height: int = 480) -> None:
        os.environ.setdefault("MUJOCO_GL", "osmesa")
        try:
            from mujoco.rendering.classic.renderer import Renderer

            self._renderer = Renderer(model, height, width)
        except Exception as error:
            raise RenderingUnavailableError(f"{_INSTALL} ({type(error).__name__}: {' '.join(str(error).split())[:200]})") from error
        self._options = mujoco.MjvOption()
        for group in _HIDDEN_GROUPS:
            self._options.geomgroup[group] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.distance, self._camera.azimuth, self._camera.elevation = 0.62, 130.0, -18.0

    def picture(self, data: mujoco.MjData) -> Picture:
        """(height, width, 3) the scene, the camera on the place where the bottle started or on the falling bottle."""
        self._camera.lookat[:] = data.body(BOTTLE).xpos
        self._renderer.update_scene(data, self._camera, self._options)
        return np.asarray(self._renderer.render(), np.uint8).copy()

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.close()

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
