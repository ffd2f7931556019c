"""An episode as a row of pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdsafebo.hand.observation import CONTROL_INTERVAL
from hdsafebo.hand.render import pictures
from hdsafebo.hand.rollout import Scene
from hdsafebo.pictures.offscreen import Picture

_GAP = 4
"""Pixels between two pictures."""


def frame_steps(horizon: int) -> tuple[int, ...]:
    """Control steps that are shown: most of them early, where the bottle turns."""
    return tuple(round(share * horizon) for share in (0.0, 0.125, 0.25, 0.5, 1.0))


def seconds_of(steps: Sequence[int]) -> tuple[float, ...]:
    """Simulated time of control steps, s."""
    return tuple(round(step * CONTROL_INTERVAL, 3) for step in steps)


def filmstrip(
    scene: Scene,
    excitations: NDArray[np.float64],
    steps: Sequence[int],
    *,
    width: int = 320,
    height: int = 240,
) -> Picture:
    """(height, len(steps) * (width + gap) - gap, 3) pictures of an episode, side by side on white.

    Args:
        scene: hand and horizon.
        excitations: (steps, muscles) of the episode, as `rollout.policy_excitations` gives them.
        steps: increasing numbers of control steps; 0 is the start pose.
        width: of one picture, pixels.
        height: of one picture, pixels.

    Raises:
        RenderingUnavailableError: no OpenGL renderer works.
    """
    frames = pictures(scene, excitations, steps, width=width, height=height)
    gap = np.full((height, _GAP, 3), 255, np.uint8)
    parts = [part for frame in frames for part in (frame, gap)]
    return np.concatenate(parts[:-1], axis=1)
