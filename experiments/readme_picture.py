"""The README's picture: a bogie stops under the recovering and under the classic law, with the same controller.

`make picture`, or `python experiments/readme_picture.py [FILE]`.
"""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure

from wsp_env.envs.single import BrakingEnv
from wsp_env.evaluation.controller import load
from wsp_env.plant.command import to_action

#: The conditions of both stops: the recovery rate and the first initial speed of the seed paper (section 4.1, Table 3), on a
#: rail more slippery than the paper's.
CONDITIONS = {
    "mu_cd": 0.04,
    "tau": 1.9e-4,
    "initial_speed": 42.3,
    "demand": 1.0,
    "load": 0.0,
    "sensor_noise": 0.0,
    "track": "constant",
}
#: Set-point of the slip controller [-]: large enough that sliding cleans the rail.
CREEPAGE = 0.2


def brake(law: str) -> dict[str, np.ndarray]:
    """Return what happened along a stop of `wsp_env/Bogie-v1` under one law, arrays (T,) or (T, 2) by their names in `info`."""
    env = gym.make("wsp_env/Bogie-v1", adhesion=law)
    env.reset(seed=0, options=CONDITIONS)
    assert isinstance(env.unwrapped, BrakingEnv)
    batch = env.unwrapped.batch
    controller = load("slip", {"creepage": CREEPAGE})
    controller.reset(1, batch.vehicle)
    moments = []
    ended = False
    while not ended:
        action = to_action(controller.act(batch.measurement())[0])
        _, _, terminated, truncated, info = env.step(action)
        moments.append(info)
        ended = terminated or truncated
    return {name: np.array([moment[name] for moment in moments]) for name in moments[0] if name != "reward_terms"}


def draw(stops: dict[str, dict[str, np.ndarray]]) -> Figure:
    """Draw speeds over adhesion, one column a law."""
    figure = Figure(figsize=(10, 6), dpi=110, layout="constrained")
    axes = figure.subplots(2, len(stops), sharex=True, sharey="row", squeeze=False)
    for column, (law, stop) in enumerate(stops.items()):
        top, bottom = axes[:, column]
        time, speed = stop["time_s"], stop["speed_mps"]
        wheels = speed[:, None] - stop["slip_speed_mps"]
        top.plot(time, wheels[:, 0], color="#0072B2", linewidth=0.9, label="leading wheelset")
        top.plot(time, wheels[:, 1], color="#56B4E9", linewidth=0.9, label="trailing wheelset")
        top.plot(time, speed, color="black", linewidth=1.5, label="vehicle")
        top.set_title(f"{law} law: {stop['position_m'][-1]:.0f} m in {time[-1]:.0f} s")
        bottom.plot(time, stop["adhesion_r"][:, 0], color="#009E73", linewidth=1.2, label="limit after full recovery $f_r$")
        bottom.plot(time, stop["adhesion_d"][:, 0], color="#D55E00", linewidth=1.2, label="limit without recovery $f_d$")
        bottom.plot(time, stop["adhesion"][:, 0], color="#0072B2", linewidth=1.2, label="adhesion $f$, leading wheelset")
        bottom.set_xlabel("time [s]")
        for axis in (top, bottom):
            axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("speed [m/s]")
    axes[1, 0].set_ylabel("adhesion coefficient [-]")
    axes[1, 0].set_ylim(0.0, 0.5)  # f_r alone goes higher, at low speed
    axes[0, 0].legend(fontsize=8)
    axes[1, 0].legend(fontsize=8, loc="center right")
    return figure


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/picture.png")
    draw({law: brake(law) for law in ("recovering", "classic")}).savefig(target)
    print(target)
