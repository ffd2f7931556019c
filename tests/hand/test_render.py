"""Pictures where the machine can draw, a typed error where it cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdsafebo.errors import RenderingUnavailableError
from hdsafebo.hand.render import SceneRenderer, pictures, record_video
from hdsafebo.hand.rollout import Scene
from hdsafebo.pictures import offscreen
from hdsafebo.pictures.video import save_png, write_video

SCENE = Scene("forearm", horizon=20)


@pytest.fixture
def drawable() -> None:
    try:
        SceneRenderer(SCENE.simulation().model, 64, 48).close()
    except RenderingUnavailableError as error:
        pytest.skip(str(error))


@pytest.mark.usefixtures("drawable")
def test_start_pose_shows_bottle_and_muscles(tmp_path: Path) -> None:
    excitations = np.tile(SCENE.simulation().pose.activation, (20, 1))
    start, later = pictures(SCENE, excitations, [0, 20], width=160, height=120)
    assert start.shape == (120, 160, 3)
    red, green, blue = (start[..., k].astype(int) for k in range(3))
    assert ((blue > 150) & (red < 100)).mean() > 0.01  # the bottle
    assert ((red > 120) & (green < 90) & (blue < 90)).mean() > 0.005  # muscles and cap
    assert (start != later).any()
    save_png(start, tmp_path / "start.png")
    assert (tmp_path / "start.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.usefixtures("drawable")
def test_environment_renders() -> None:
    from hdsafebo.hand.environment import BottleHandEnv

    environment = BottleHandEnv("forearm", render_mode="rgb_array")
    environment.reset()
    assert environment.render().shape == (480, 640, 3)
    environment.close()
    assert BottleHandEnv("forearm").render() is None


def test_equal_frames_give_equal_videos(tmp_path: Path) -> None:
    frames = [np.full((48, 64, 3), 20 * k, np.uint8) for k in range(6)]
    for name in ("one.mp4", "other.mp4"):
        write_video(frames, tmp_path / name)
    one = (tmp_path / "one.mp4").read_bytes()
    assert one == (tmp_path / "other.mp4").read_bytes()
    assert b"ftyp" in one[:16]


def test_without_a_renderer_the_error_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(offscreen, "find_library", lambda name: None)
    with pytest.raises(RenderingUnavailableError, match=r"apt-get install libosmesa6.*none found"):
        record_video(SCENE, np.zeros((2, 43)), tmp_path / "none.mp4")
    assert not (tmp_path / "none.mp4").exists()
