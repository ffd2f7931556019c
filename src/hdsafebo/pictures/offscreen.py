"""Draws a MuJoCo simulation without a window."""

from __future__ import annotations

import os
from ctypes.util import find_library
from dataclasses import dataclass
from importlib import import_module
from types import TracebackType
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from hdsafebo.errors import RenderingUnavailableError

Picture = NDArray[np.uint8]

_LIBRARIES = {"osmesa": "OSMesa", "egl": "EGL"}
_INSTALL = (
    "pictures need an off-screen OpenGL renderer, and none works on this machine; install one "
    "(Debian or Ubuntu: apt-get install libosmesa6)"
)


@dataclass(frozen=True)
class View:
    """Where the camera stands, and what it does not show.

    Attributes:
        distance: from the point that is looked at, m.
        azimuth: degrees.
        elevation: degrees; negative looks down.
        hidden_groups: groups of shapes that are not drawn.
    """

    distance: float
    azimuth: float
    elevation: float
    hidden_groups: tuple[int, ...] = (3, 4)


class OffscreenRenderer:
    """Draws a simulation; use it as a context manager, or call `close`.

    Args:
        model: the MuJoCo model.
        view: where the camera stands.
        width: of pictures, pixels.
        height: of pictures, pixels.

    Raises:
        RenderingUnavailableError: no OpenGL renderer works; the message says what to install.
    """

    def __init__(self, model: mujoco.MjModel, view: View, width: int = 640, height: int = 480) -> None:
        self._model = model
        self._context = _opengl_context(width, height)
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.empty((height, width, 3), np.uint8)
        self._scene = mujoco.MjvScene(model, maxgeom=5000)
        for costly in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[costly] = 0  # three times slower without a GPU
        try:
            self._drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        except mujoco.FatalError as error:
            self._context.free()
            raise RenderingUnavailableError(f"{_INSTALL} ({error})") from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
        self._options = mujoco.MjvOption()
        for group in view.hidden_groups:
            self._options.geomgroup[group] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.distance = view.distance
        self._camera.azimuth, self._camera.elevation = view.azimuth, view.elevation
        self._placed = False

    def picture_at(self, data: mujoco.MjData, point: NDArray[np.float64]) -> Picture:
        """(height, width, 3) the scene; the camera looks at the (3,) point of the first picture."""
        if not self._placed:
            self._camera.lookat[:] = point
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

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


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
