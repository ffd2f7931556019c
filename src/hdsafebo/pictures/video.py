"""Pictures and videos as files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from hdsafebo.pictures.offscreen import Picture

FRAMES_PER_SECOND = 25


def save_png(picture: Picture, path: Path) -> None:
    """Write a picture as PNG."""
    import imageio.v3 as imageio

    imageio.imwrite(path, picture, extension=".png")


def write_video(frames: Iterable[Picture], path: Path, fps: float = FRAMES_PER_SECOND) -> None:
    """Write pictures of one size as MP4 (H.264); equal pictures give equal files."""
    import imageio.v2 as imageio

    repeatable = ["-threads", "1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1"]
    imageio.mimwrite(path, list(frames), format="FFMPEG", fps=fps, codec="libx264", output_params=repeatable)
