"""Stand-ins for hardware, so that the examples run anywhere: settings by name in, measurements out.

Replace a call by your own system; nothing else in an example changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

_GOOD_GAINS = np.array([2.0, 4.0, 3.0, 8.0, 5.0, 12.0, 3.0, 6.0, 9.0, 4.0, 7.0, 5.0])


def arm_truth(gains: Mapping[str, float]) -> dict[str, float]:
    """Tracking error in mm, peak torque in Nm and clearance in mm of an arm with twelve gains in Nm/rad."""
    gain = np.array([gains[f"gain_{j}"] for j in range(1, 13)])
    ratio = np.log(gain / _GOOD_GAINS)
    stiff = float(np.log(gain).mean())
    return {
        "tracking_error": 2.0 + 3.0 * float((ratio**2).mean()) + 1.5 * float((np.diff(ratio) ** 2).mean()),
        "torque": 12.0 + 11.0 * stiff + 0.15 * float(gain.max()),
        "clearance": 14.0 - 8.0 * float(np.abs(ratio[:4]).mean()) - 3.0 * float(ratio.std()),
    }


def arm(gains: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
    """One movement of the arm, with sensor noise."""
    noise = {"tracking_error": 0.05, "torque": 0.2, "clearance": 0.1}
    return {name: v + noise[name] * rng.standard_normal() for name, v in arm_truth(gains).items()}


def arm_starts(n: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """Careful gains that were tried by hand, with their measurements: all of them safe."""
    starts: list[dict[str, float]] = []
    while len(starts) < n:
        gain = _GOOD_GAINS * np.exp(rng.uniform(-1.2, 0.1, 12))
        gains = {f"gain_{j}": float(v) for j, v in enumerate(gain, 1)}
        row = gains | arm(gains, rng)
        if row["torque"] <= 36.0 and row["clearance"] >= 6.0:
            starts.append(row)
    return starts


def gripper_truth(s: Mapping[str, Any]) -> dict[str, float]:
    """Placement error in mm, coil temperature in degrees and grip force in N of a pulsed gripper."""
    f, current, angle = s["frequency"], s["current"], s["angle"]
    pulses, rest, pad = s["pulses"], s["rest"], s["pad"]
    error = 1.0 + (np.log(f) - 3.6) ** 2 / 3 + (current - 18) ** 2 / 30 + (angle - 8) ** 2 / 300
    error += 0.35 * abs(pulses - 5) + 0.15 * abs(rest - 3) + {"soft": 1.0, "ribbed": 0.0, "hard": 0.6}[pad]
    heat = (
        24 + 1.5 * current + 0.09 * f + 1.6 * pulses - 1.2 * rest + {"soft": 0, "ribbed": 3, "hard": 7}[pad]
    )
    grip = 1 + 0.22 * current + 0.25 * pulses - 0.0025 * angle**2 - 0.15 * rest
    grip += {"soft": -0.3, "ribbed": 0.2, "hard": 0.5}[pad]
    return {"error": float(error), "temperature": float(heat), "grip": float(grip)}


def gripper(s: Mapping[str, Any], rng: np.random.Generator) -> dict[str, float]:
    """One cycle of the gripper, with measurement noise of the sizes that its data sheet gives."""
    noise = {"error": 0.1, "temperature": 0.5, "grip": 0.1}
    return {name: v + noise[name] * rng.standard_normal() for name, v in gripper_truth(s).items()}


def crane_truth(s: Mapping[str, float], payload: float) -> dict[str, float]:
    """Cycles per hour, sway in mm and holding margin in N of a gantry with a payload in kg."""
    speed, acceleration, lift, grip = s["speed"], s["acceleration"], s["lift"], s["grip"]
    cycles = 60 * speed / (speed + 0.4) * acceleration / (acceleration + 0.8) - 8 * lift
    sway = 4 + 2 * payload * acceleration * (0.4 + lift) + 3 * speed**2 * (1 + 0.4 * payload)
    return {
        "cycles": cycles - 0.1 * max(grip - 30, 0.0),
        "sway": sway,
        "slack": 0.9 * grip - payload * (6 + 1.5 * acceleration),
    }


def crane(s: Mapping[str, float], payload: float, rng: np.random.Generator) -> dict[str, float]:
    """One cycle of the gantry, with sensor noise."""
    return {name: v + 0.3 * rng.standard_normal() for name, v in crane_truth(s, payload).items()}


def crane_settings(rng: np.random.Generator) -> dict[str, list[float]]:
    """The 500 settings that the gantry's controller has stored."""
    ranges = {"speed": (0.1, 1.5), "acceleration": (0.2, 4.0), "lift": (0.05, 0.5), "grip": (10.0, 60.0)}
    return {name: rng.uniform(*ends, 500).round(3).tolist() for name, ends in ranges.items()}


def crane_starts(
    settings: Mapping[str, list[float]], n: int, payload: float, rng: np.random.Generator
) -> list[dict[str, float]]:
    """Stored settings that were tried by hand with a light payload, with room to both limits."""
    rows = [{name: values[i] for name, values in settings.items()} for i in range(500)]
    true = [crane_truth(row, payload) for row in rows]
    careful = [i for i, t in enumerate(true) if t["sway"] <= 18 and t["slack"] >= 5]
    chosen = rng.choice(careful, n, replace=False)
    return [rows[i] | {"payload": payload} | crane(rows[i], payload, rng) for i in chosen]


def grasp_truth(s: Mapping[str, float]) -> dict[str, float]:
    """Speed in 1/s, economy in 1/J, contact force in N and clearance in mm of a compliant gripper."""
    stiffness, damping = s["stiffness"], s["damping"]
    return {
        "speed": 2.0 + 1.2 * stiffness - 0.3 * stiffness**2 - 2.0 * (damping - 0.35) ** 2,
        "economy": 1.0 / (1.0 + stiffness + damping),
        "force": 4.0 + 5.5 * stiffness - 1.5 * damping,
        "clearance": 5.0 - 1.2 * stiffness - 4.0 * (damping - 0.4) ** 2,
    }


def grasp(s: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
    """One grasp, with sensor noise."""
    noise = {"speed": 0.02, "economy": 0.005, "force": 0.05, "clearance": 0.03}
    return {name: v + noise[name] * rng.standard_normal() for name, v in grasp_truth(s).items()}
