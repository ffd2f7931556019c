"""Pictures and videos of the hand, drawn off screen."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from ctypes.util import find_library
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import RenderingUnavailableError
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.scene.bottle import BOTTLE

Picture = NDArray[np.uint8]

FRAMES_PER_SECOND = 25
"""Every second control step is shown."""

_LIBRARIES = {"osmesa": "OSMesa", "egl": "EGL"}
_HIDDEN_GROUPS = (3, 4)  # wrapping surfaces, collision shapes
_INSTALL = (
    "pictures need an off-screen OpenGL renderer, and none works on this machine; install one "
    "(Debian or Ubuntu: apt-get install libosmesa6)"
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
        self._model = model
        self._context = _opengl_context(width, height)
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.empty((height, width, 3), np.uint8)
        self._scene = mujoco.MjvScene(model, maxgeom=2000)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0  # three times slower without a GPU
        try:
            self._drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        except mujoco.FatalError as error:
            self._context.free()
            raise RenderingUnavailableError(f"{_INSTALL} ({error})") from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
        self._options = mujoco.MjvOption()
        for group in _HIDDEN_GROUPS:
            self._options.geomgroup[group] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.distance, self._camera.azimuth, self._camera.elevation = 0.7, 135.0, -15.0
        self._placed = False

    def picture(self, data: mujoco.MjData) -> Picture:
        """(height, width, 3) the scene; the camera looks at where the bottle was in the first picture."""
        if not self._placed:
            self._camera.lookat[:] = data.body(BOTTLE).xpos
            self._placed = True
        self._context.make_current()
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, everything, self._scene)
        mujoco.mjr_render(self._rectangle, self._scene, self._drawing)
        mujoco.mjr_readPixels(self._pixels, None, self._rectangle, self._drawing)
        return self._pixels[::-1].copy()

    def close(self) -> None:
        """Free the OpenGL context."""
        self._context.make_current()
        self._drawing.free()
        self._context.free()

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


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
    steps = range(0, len(excitations) + 1, 2)
    write_video(pictures(scene, excitations, steps), path)


def save_png(picture: Picture, path: Path) -> None:
    """Write a picture as PNG."""
    import imageio.v3 as imageio

    imageio.imwrite(path, picture, extension=".png")


def write_video(frames: Iterable[Picture], path: Path) -> None:
    """Write pictures of one size as MP4; equal pictures give equal files."""
    import imageio.v2 as imageio

    repeatable = ["-threads", "1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1"]
    imageio.mimwrite(
        path, list(frames), format="FFMPEG", fps=FRAMES_PER_SECOND, codec="libx264", output_params=repeatable
    )


def _opengl_context(width: int, height: int) -> Any:
    """A current off-screen context of the first OpenGL library that works; `MUJOCO_GL` names another first.

    The libraries are opened here rather than by `mujoco.Renderer`, whose choice is fixed when `mujoco` is
    imported and falls on a window system that servers lack.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    reasons = []
    for backend in sorted(_LIBRARIES, key=lambda name: name != chosen):
        if find_library(_LIBRARIES[backend]) is None:
            continue
        try:
            context = import_module(f"mujoco.{backend}").GLContext(width, height)
            context.make_current()
        except Exception as error:  # each library fails in its own way
            reasons.append(f"{backend}: {type(error).__name__} {' '.join(str(error).split())[:100]}")
        else:
            return context
    found = "; ".join(reasons) or "none found"
    raise RenderingUnavailableError(f"{_INSTALL} ({found})")
