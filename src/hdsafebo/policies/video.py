"""A video of one episode of a policy."""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True)
class Film:
    """An episode and what it looked like.

    Attributes:
        episode: the episode.
        frames: pictures, the first of the start.
        fps: of the pictures, in real time.
    """

    episode: Episode
    frames: list[Picture]
    fps: float


def film_episode(
    maker: EnvironmentMaker, policy: AffinePolicy, seed: int, horizon: int, fps: float = FRAMES_PER_SECOND
) -> Film:
    """Play a policy once and keep what the environment draws.

    Frames are left out so that a second has at most `fps` of them or so.

    Raises:
        RenderingUnavailableError: the environment or this machine cannot draw.
    """
    try:
        environment = maker.make(render_mode="rgb_array")
    except ProblemError as error:
        raise RenderingUnavailableError(f"environment {maker.name!r} makes no pictures: {error}") from error
    frames: list[Picture] = []
    seen = 0
    steps_per_second = float(environment.metadata.get("render_fps") or _DEFAULT_FPS)
    stride = max(1, ceil(steps_per_second / fps - 0.5))

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
    return Film(episode, frames, steps_per_second / stride)


def record_episode(
    maker: EnvironmentMaker, policy: AffinePolicy, seed: int, horizon: int, path: Path
) -> Episode:
    """Play a policy once and write what the environment draws as MP4, in real time.

    Raises:
        RenderingUnavailableError: the environment or this machine cannot draw.
        WriteError: the file cannot be written.
    """
    film = film_episode(maker, policy, seed, horizon)
    with replacing(path) as temporary:
        write_video(film.frames, temporary, film.fps)
    return film.episode


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
