"""A video of one episode of a policy."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from hdsafebo.errors import ProblemError, RenderingUnavailableError
from hdsafebo.files.atomic import replacing
from hdsafebo.pictures.offscreen import Picture
from hdsafebo.pictures.video import FRAMES_PER_SECOND, write_video
from hdsafebo.policies.affine import AffinePolicy
from hdsafebo.policies.environments import EnvironmentMaker
from hdsafebo.policies.episode import Episode, play_episode

_DEFAULT_FPS = 30


def record_episode(
    maker: EnvironmentMaker, policy: AffinePolicy, seed: int, horizon: int, path: Path
) -> Episode:
    """Play a policy once and write what the environment draws as MP4, in real time.

    Frames are left out so that a second has at most 25 or so.

    Raises:
        RenderingUnavailableError: the environment or this machine cannot draw.
        WriteError: the file cannot be written.
    """
    try:
        environment = maker.make(render_mode="rgb_array")
    except ProblemError as error:
        raise RenderingUnavailableError(f"environment {maker.name!r} makes no pictures: {error}") from error
    frames: list[Picture] = []
    seen = 0
    fps = float(environment.metadata.get("render_fps") or _DEFAULT_FPS)
    stride = max(1, ceil(fps / FRAMES_PER_SECOND - 0.5))

    def watch(environment: Any) -> None:
        nonlocal seen
        if seen % stride == 0:
            frames.append(_frame(environment, maker.name))
        seen += 1

    try:
        episode = play_episode(environment, policy, seed, horizon, watch)
    finally:
        environment.close()
    if not frames:
        raise RenderingUnavailableError(f"environment {maker.name!r} drew nothing: {episode.failure}")
    with replacing(path) as temporary:
        write_video(frames, temporary, fps / stride)
    return episode


def _frame(environment: Any, name: str) -> Picture:
    """One picture."""
    try:
        picture = environment.render()
    except RenderingUnavailableError:
        raise
    except Exception as error:  # each environment and OpenGL library fails in its own way
        raise RenderingUnavailableError(
            f"environment {name!r} cannot draw here: {type(error).__name__}: {error}; a machine without a "
            "display needs an off-screen OpenGL library (Debian or Ubuntu: apt-get install libosmesa6, then "
            "set MUJOCO_GL=osmesa)"
        ) from error
    if not isinstance(picture, np.ndarray) or picture.ndim != 3:
        raise RenderingUnavailableError(f"environment {name!r} drew {type(picture).__name__}, no picture")
    return np.asarray(picture, np.uint8)
