"""What a training is made of: its arguments, checked before anything is written, and the options of its environments."""

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

from agents import checkpoint
from agents.worlds import REWARD
from wsp_env.envs.task import make_task
from wsp_env.parameters.quantity import ParameterError


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What a training is made of."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    seed: int = 1
    steps: int = 3_276_800  # decisions of PPO, rounded to whole segments
    out: Path = Path()  # folder of the run; none: out/agents/VEHICLE-SEED
    envs: int = 512  # stops at once
    classic_share: float = 0.25  # of them under the classic law
    rollout: int = 64  # decisions of each stop between two updates
    batch: int = 8192
    epochs: int = 2  # passes over each rollout
    segment: int = 25  # updates between two checkpoints; each begins new stops: PPO sees their first 32 s, most of a stop
    learning_rate: float = 1e-4  # falls linearly to zero
    gamma: float = 0.99  # a time constant of 2 s at 50 decisions a second: what comes later is in the potential, see `Shaped`
    gae_lambda: float = 0.95
    clip: float = 0.1
    entropy: float = 0.0
    log_deviation: float = -3.0  # of the brake wanted, at the start
    imitation: int = 40  # rounds in which the policy first learns from a teacher, see `agents.imitation`; 0: none
    imitation_decisions: int = 200  # of each stop in a round
    imitation_thin: int = 4  # decisions between two that the teacher answers: neighbours are alike
    critic_segments: int = 1  # first segments in which only the value function learns
    hidden: tuple[int, ...] = (128, 128)  # layers of the policy
    critic: tuple[int, ...] = (64, 64)  # layers of the value function
    slide_price: float = 4.3  # metres travelled that a metre of sliding is worth, see `Shaped`
    action: Literal["steered", "valve", "pressure"] = "steered"  # steered: brake wanted, reached by the valves
    pressure_sensors: bool = False
    reward: str = '{"air": 0.00005}'  # JSON, changes of `agents.worlds.REWARD`, see `wsp_env.envs.task.RewardWeights`
    scenario: str = (  # JSON, see `wsp_env.scenario.Scenario`
        '{"mu_cd": [0.02, 0.065], "tau": [1e-4, 3.5e-4], "demand": [0.35, 1.0], "initial_speed": [12.0, 44.5]}'
    )
    torque_per_bar_nm: float = 2400.0  # of a wheelset; stronger brakes than the vehicles' own 1500, so that it learns for all
    mechanisms: str = "{}"  # JSON, {name: {parameter: value, or [lowest, highest] to draw from}}
    #: varied: brakes, gains, radii and noise drawn; line: also gradients, drag and fading pads; cleaning: the wheels also clean
    #: the rail for those behind, see `agents.varied`
    world: Literal["nominal", "varied", "line", "cleaning"] = "nominal"
    recurrent: int = 0  # units of an LSTM before the networks (sb3-contrib), 0: none
    start: str = ""  # folder of a run whose last checkpoint this one begins from; none: from nothing
    watched: int = 24  # stops under each law by which learning is watched


def task_options(arguments: Arguments) -> dict[str, Any]:
    """Return the options of the environments."""
    texts = {name: _read(name, getattr(arguments, name)) for name in ("reward", "scenario", "mechanisms")}
    texts["reward"] = REWARD | texts["reward"]
    action = "pressure" if arguments.action == "pressure" else "valve"
    vehicle = {"brake": {"torque_per_bar_nm": arguments.torque_per_bar_nm}}
    return texts | {"action": action, "pressure_sensors": arguments.pressure_sensors, "vehicle": vehicle}


def _read(name: str, text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError as error:
        raise SystemExit(f"--{name} {text!r} is not JSON ({error}); like --{name} '{getattr(Arguments, name)}'") from None


def check(arguments: Arguments) -> None:
    """Refuse arguments that cannot be before anything is written."""
    for name in ("steps", "envs", "rollout", "batch", "epochs", "segment", "watched"):
        if getattr(arguments, name) < 1:
            raise SystemExit(f"--{name} {getattr(arguments, name)} is impossible: it must be at least 1")
    if not 0.0 <= arguments.classic_share <= 1.0:
        raise SystemExit(f"--classic-share {arguments.classic_share:g} is impossible: it must lie in [0, 1]")
    if arguments.imitation_thin < 1 or arguments.imitation_decisions % arguments.imitation_thin:
        raise SystemExit(
            f"--imitation-thin {arguments.imitation_thin} is impossible: --imitation-decisions is no multiple of it"
        )
    try:
        make_task(task_options(arguments)).make_vehicle(arguments.vehicle)
    except ParameterError as error:
        raise SystemExit(str(error)) from None
    if arguments.start and not (Path(arguments.start) / checkpoint.CHECKPOINT).exists():
        raise SystemExit(f"{arguments.start} holds no {checkpoint.CHECKPOINT} to begin from")


def same_arguments(arguments: Any) -> None:
    """Refuse to go on with a run that was begun with other arguments."""
    path = arguments.out / "arguments.json"
    given = record(arguments)
    if path.exists() and (begun := json.loads(path.read_text(encoding="utf-8"))) != given:
        other = ", ".join(name for name in given if begun.get(name) != given[name])
        raise SystemExit(f"{arguments.out} holds a run with another {other}: choose another --out, or remove the folder")
    path.write_text(json.dumps(given, indent=2) + "\n", encoding="utf-8")


def record(arguments: Any) -> dict[str, Any]:
    """Return the arguments of a training without its folder `out`, as JSON has them."""
    values = dataclasses.asdict(arguments)
    del values["out"]
    return dict(json.loads(json.dumps(values, default=str)))
