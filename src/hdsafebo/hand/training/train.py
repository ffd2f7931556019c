"""Trains soft actor-critic agents (Haarnoja et al., ICML 2018), one per observation setting."""

from __future__ import annotations

import io
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from hdsafebo.files.bounded import read_bytes
from hdsafebo.hand.environment import BottleHandEnv
from hdsafebo.hand.rollout import Scene
from hdsafebo.hand.scene.model import Variant
from hdsafebo.hand.training.actor import Actor

CHECKPOINTS = (0.1, 0.25, 0.5, 0.75, 1.0)
"""Shares of the training after which the actor is kept: synergies come from agents of all skills."""

PROGRESS_STEPS = 100

_UNREPEATABLE = [
    "start_time",
    "ep_info_buffer",
    "ep_success_buffer",
    "_logger",
    "replay_buffer",
    "env",
    "_last_obs",
    "_last_original_obs",
]


@dataclass(frozen=True)
class SacSettings:
    """Size of the training.

    Attributes:
        steps: control steps of each agent.
        width: units of each of the two hidden layers.
        train_every: control steps between updates.
        updates: gradient steps per update.
        learning_starts: control steps of random actions before the first update.
        batch_size: transitions per gradient step.
    """

    steps: int
    width: int = 128
    train_every: int = 4
    updates: int = 2
    learning_starts: int = 500
    batch_size: int = 256


@dataclass(frozen=True)
class Trained:
    """A trained agent.

    Attributes:
        setting: its observation setting.
        actors: by number of training steps.
        step: (episodes,) training step at which each episode ended.
        total_reward: (episodes,) of the training episodes.
        dropped: (episodes,) the bottle dropped.
    """

    setting: str
    actors: dict[int, Actor]
    step: NDArray[np.int64]
    total_reward: NDArray[np.float64]
    dropped: NDArray[np.bool_]


@dataclass(frozen=True)
class Training:
    """One agent to train: plain data, so that it can be trained in any process.

    Attributes:
        scene: hand and horizon.
        setting: which parts of the observation the agent sees.
        sac: size of the training.
        seed: of networks, exploration and replay.
        folder: where the stable-baselines3 archive `<setting>.zip` and the progress are written.
    """

    scene: Scene
    setting: str
    sac: SacSettings
    seed: int
    folder: Path

    @property
    def archive(self) -> Path:
        """The stable-baselines3 archive."""
        return self.folder / f"{self.setting}.zip"

    @property
    def progress(self) -> Path:
        """A file that grows by one byte per `PROGRESS_STEPS` control steps."""
        return self.folder / f"{self.setting}.progress"


def train_agent(job: Training) -> Trained:
    """Train one agent and write its archive.

    The archive is for people who continue the training; nothing here reads it, since it holds pickled parts.
    """
    import torch
    from stable_baselines3 import SAC
    from stable_baselines3.common.callbacks import BaseCallback

    torch.set_num_threads(1)
    checkpoints = {max(1, round(share * job.sac.steps)) for share in CHECKPOINTS}
    actors: dict[int, Actor] = {}
    episodes: list[tuple[int, float, bool]] = []

    class Recorder(BaseCallback):
        """Keeps checkpoints of the actor and the outcomes of episodes."""

        total = 0.0

        def _on_step(self) -> bool:
            self.total += float(self.locals["rewards"][0])
            if self.locals["dones"][0]:
                episodes.append((self.num_timesteps, self.total, bool(self.locals["infos"][0]["dropped"])))
                self.total = 0.0
            if self.num_timesteps in checkpoints:
                actors[self.num_timesteps] = actor_of(self.model)
            if self.num_timesteps % PROGRESS_STEPS == 0:
                with job.progress.open("ab") as file:
                    file.write(b".")
            return True

    sac = job.sac
    agent = SAC(
        "MlpPolicy",
        BottleHandEnv(cast(Variant, job.scene.variant), job.scene.roll, job.scene.horizon, job.setting),
        train_freq=sac.train_every,
        gradient_steps=sac.updates,
        learning_starts=sac.learning_starts,
        batch_size=sac.batch_size,
        buffer_size=sac.steps,
        use_sde=True,  # smooth exploration: muscles filter white noise away
        policy_kwargs={"net_arch": [sac.width, sac.width]},
        seed=job.seed,
        device="cpu",
    )
    agent.learn(sac.steps, callback=Recorder())
    agent.save(job.archive, exclude=_UNREPEATABLE)
    job.archive.write_bytes(repeatable_archive(read_bytes(job.archive)))
    columns = zip(*episodes, strict=True) if episodes else ((), (), ())
    step, total, dropped = columns
    return Trained(
        job.setting, actors, np.array(step, np.int64), np.array(total, float), np.array(dropped, bool)
    )


def actor_of(agent: Any) -> Actor:
    """The actor of a stable-baselines3 SAC agent with two hidden ReLU layers and gSDE."""
    network = agent.policy.actor
    linear = [layer for layer in network.latent_pi if hasattr(layer, "weight")]
    mean = network.mu[0]  # followed by the limiter
    arrays = [(_array(layer.weight), _array(layer.bias)) for layer in (*linear, mean)]
    return Actor(tuple(arrays[:-1]), arrays[-1], _array(network.log_std))


def _array(tensor: Any) -> NDArray[np.float32]:
    return np.array(tensor.detach().cpu().numpy(), np.float32)


def repeatable_archive(archive: bytes) -> bytes:
    """The same ZIP archive without times and memory addresses, so that equal trainings give equal files.

    The addresses are in the printed forms of functions, which stable-baselines3 keeps for the reader.
    """
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(archive)) as source,
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as target,
    ):
        for name in sorted(source.namelist()):
            content = source.read(name)
            if name == "data":
                content = re.sub(rb" at 0x[0-9a-f]+", b"", content)
            target.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
