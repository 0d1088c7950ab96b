"""The same stop under the classic and under the recovering law: what the recovery of adhesion is worth (seed paper, Fig. 16).

One stop without recovery for every mu_cd and one with recovery for every mu_cd and tau, all else equal. Drawn several times
with the noise of the sensors each has a scatter: a closed loop of valves takes another course with every noise.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.evaluation.braking import Braked, Braking, read, work
from wsp_env.evaluation.carried import carry
from wsp_env.evaluation.programme import TRACK_LENGTH_M
from wsp_env.evaluation.runner import Conduct, ControllerFailure
from wsp_env.evaluation.summary import interval
from wsp_env.executor import Executor, ThisProcess
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.velim import TEST_SPEEDS_MPS
from wsp_env.plant.port import TRACK_STEP_M, Stop
from wsp_env.scenario import Scenario, draw

#: The two stops have parted once their speeds differ by this much [m/s] (assumption: visible in a diagram such as Fig. 16).
PARTED_MPS = 0.5

#: Noise of the wheel-speed sensors of drawn stops [rad/s], from none to this (assumption: as in the test programme).
DRAWN_NOISE = 0.1

_CONDUCT, _HERE, _AS_MADE = Conduct(), ThisProcess(), dict[str, Any]()


@dataclasses.dataclass(frozen=True)
class ComparedStops:
    """The stop under both laws at one point of the grid, as a mean over its draws; one given up at the time limit has inf [m].

    `_ci` are half the widths of the means' 95 % intervals over the draws, nan for one draw.
    """

    mu_cd: float  # [-]
    tau: float  # [m/J]
    classic_m: float  # stopping distance [m]
    recovering_m: float  # [m]
    gained_m: float  # how much shorter with recovery [m]
    gained_share: float  # of the classic distance [-]
    parted_mps: float  # speed with recovery at which the two have parted [m/s]; nan if they never do
    parted_s: float  # when [s]; nan likewise
    largest_gap_mps: float  # largest difference of the speeds at the same time [m/s], as the paper's eq. (19)
    classic_slip_mps: float  # mean slip speed, eq. (21), mean of the axles [m/s]
    recovering_slip_mps: float  # [m/s]
    classic_ci_m: float = math.nan  # [m]
    recovering_ci_m: float = math.nan  # [m]
    gained_ci_m: float = math.nan  # of the differences draw by draw [m]


@dataclasses.dataclass(frozen=True)
class Comparison:
    """All pairs, mu_cd by mu_cd, and the speeds (T,) [m/s] of the first draw over time (T,) [s] to draw."""

    pairs: tuple[ComparedStops, ...]
    time: np.ndarray
    classic: dict[float, np.ndarray]  # mu_cd -> speed
    recovering: dict[tuple[float, float], np.ndarray]  # mu_cd, tau -> speed


@dataclasses.dataclass(frozen=True)
class StopOptions:
    """The stop.

    Parameters
    ----------
    speed
        Initial speed [m/s].
    demand
        Share of full brake pressure.
    load
        Share of the payload.
    draws
        Times that each is braked, with drawn noise of the sensors; 1: once without.

    """

    speed: float = TEST_SPEEDS_MPS["A1"]
    demand: float = 1.0
    load: float = 0.0
    draws: int = 5

    def __post_init__(self) -> None:
        """Refuse less than one draw."""
        if self.draws < 1:
            raise ParameterError(f"draws = {self.draws}: at least 1")


def compare(
    controller: str,
    vehicle: Vehicle,
    mu_cd: Sequence[float],
    tau: Sequence[float],
    stop: StopOptions,
    conduct: Conduct = _CONDUCT,
    parameters: Mapping[str, Any] = _AS_MADE,
    executor: Executor = _HERE,
) -> Comparison:
    """Brake the same stop under both laws over the grid of mu_cd [-] and tau [m/J]; several draws have noise.

    `controller` and `parameters` are as for `wsp_env.evaluation.controller.load`. A controller that ends its process ends this
    one, unless the executor has others. Raises `ParameterError` for conditions that cannot be and `ControllerFailure` for a
    controller that fails.
    """
    grid = [(friction, rate) for friction in mu_cd for rate in (0.0, *tau)]
    draws = stop.draws
    noises = [0.0] if draws == 1 else np.random.default_rng([0, 1]).uniform(0.0, DRAWN_NOISE, draws).tolist()
    stops = [
        _stop(vehicle, friction, rate, stop, number, noise) for friction, rate in grid for number, noise in enumerate(noises)
    ]
    task = Braking(controller, carry(controller, executor.far), parameters, vehicle, tuple(stops), conduct)
    (done,) = executor.run(work, [task])
    if done.failure:
        raise ControllerFailure(f"{controller}: {done.failure}")
    result = read(done.result)
    row = {point: i * draws for i, point in enumerate(grid)}
    pairs = [
        _mean([_pair(result, friction, rate, row[friction, 0.0] + i, row[friction, rate] + i) for i in range(draws)])
        for friction in mu_cd
        for rate in tau
    ]
    speed = result.speed.astype(np.float64)
    return Comparison(
        tuple(pairs),
        result.time,
        {friction: speed[:, row[friction, 0.0]] for friction in mu_cd},
        {(friction, rate): speed[:, row[friction, rate]] for friction in mu_cd for rate in tau},
    )


def _mean(pairs: Sequence[ComparedStops]) -> ComparedStops:
    """Return the mean of a point's draws with its intervals; of those that parted, where they did."""
    if len(pairs) == 1:
        return pairs[0]
    columns = {
        field.name: np.array([getattr(pair, field.name) for pair in pairs]) for field in dataclasses.fields(ComparedStops)
    }
    means = {name: float(np.mean(values)) for name, values in columns.items()}
    for name in ("parted_mps", "parted_s"):
        parted = columns[name][np.isfinite(columns[name])]
        means[name] = float(parted.mean()) if parted.size else math.nan
    for name in ("classic", "recovering", "gained"):
        means[f"{name}_ci_m"] = interval(columns[f"{name}_m"])[1]
    return ComparedStops(**means)


def _stop(
    vehicle: Vehicle, mu_cd: float, tau: float, stop: StopOptions, seed: int, noise: float
) -> Stop:  # fmt: skip
    pins: dict[str, Any] = {
        "mu_cd": mu_cd, "tau": tau, "initial_speed": stop.speed, "demand": stop.demand, "load": stop.load, "gradient": 0.0,
        "sensor_noise": noise, "track": "constant",
    }  # fmt: skip
    return draw(Scenario(), vehicle, np.random.default_rng(seed), int(TRACK_LENGTH_M / TRACK_STEP_M) + 1, pins)


def _pair(result: Braked, mu_cd: float, tau: float, classic: int, recovering: int) -> ComparedStops:
    gap = np.abs(result.speed[:, classic].astype(np.float64) - result.speed[:, recovering])
    apart = np.flatnonzero(gap > PARTED_MPS)
    reached = np.where(result.stopped, result.distance, np.inf)
    long, short = float(reached[classic]), float(reached[recovering])
    gained = long - short if np.isfinite(short) else np.nan
    return ComparedStops(
        mu_cd=mu_cd,
        tau=tau,
        classic_m=long,
        recovering_m=short,
        gained_m=gained,
        gained_share=gained / long if np.isfinite(long) else np.nan,
        parted_mps=float(result.speed[apart[0], recovering]) if apart.size else np.nan,
        parted_s=float(result.time[apart[0]]) if apart.size else np.nan,
        largest_gap_mps=float(gap.max()),
        classic_slip_mps=_mean_slip(result, classic),
        recovering_slip_mps=_mean_slip(result, recovering),
    )


def _mean_slip(result: Braked, row: int) -> float:
    return float(result.slip[1 : result.steps[row] + 1, row].mean())
