"""Pictures of a body, drawn off screen."""

from __future__ import annotations

import mujoco

from hdsafebo.bodies.model import Body
from hdsafebo.pictures.offscreen import OffscreenRenderer, Picture, View

_VIEW = View(distance=2.6, azimuth=160.0, elevation=-8.0)
_BELOW_PELVIS = 0.1
"""m; the middle of the body."""


class BodyRenderer(OffscreenRenderer):
    """Draws a body and its muscles; use it as a context manager, or call `close`.

    Args:
        body: the body.
        width: of pictures, pixels.
        height: of pictures, pixels.

    Raises:
        RenderingUnavailableError: no OpenGL renderer works; the message says what to install.
    """

    def __init__(self, body: Body, width: int = 640, height: int = 480) -> None:
        super().__init__(body.mj, _VIEW, width, height)
        self._pelvis = body.pelvis

    def picture(self, data: mujoco.MjData) -> Picture:
        """(height, width, 3) the scene; the camera looks at where the pelvis was in the first picture."""
        point = data.xpos[self._pelvis].copy()
        point[2] -= _BELOW_PELVIS
        return self.picture_at(data, point)
