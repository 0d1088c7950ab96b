"""Figures of merit of a stop, computed from what the runner recorded."""

import numpy as np

from wsp_env.envs.step import LOCKED_RUNNING_MPS, LOCKED_WHEEL_MPS
from wsp_env.evaluation.bound import Ceiling
from wsp_env.evaluation.runner import StopRecords
from wsp_env.parameters.resistance import running_resistance
from wsp_env.parameters.vehicle import ATMOSPHERE_BAR, Vehicle

#: Figure of a stop -> its unit and meaning. "Worst axle" because one flat wheel is enough. The ratios compare with other stops
#: under the same conditions; a ratio's stop that was given up at the time limit is infinitely long.
FIGURES = {
    "distance_m": ("m", "stopping distance"),
    "ratio_dry": ("-", "stopping distance over that on clean rail without a WSP"),
    "ratio_bound": ("-", "stopping distance over the shortest possible within the slide limit"),
    "ratio_reference": ("-", "stopping distance over that with perfect knowledge and the real valves"),
    "mean_slip_mps": ("m/s", "mean slip speed, eq. (21) of the seed paper, mean of the axles"),
    "slip_deviation_mps": ("m/s", "standard deviation of the slip speed, eq. (21), mean of the axles"),
    "largest_slip_mps": ("m/s", "largest slip speed of any axle"),
    "largest_creepage": ("-", "largest creepage of any axle at speeds where the slide limit holds"),
    "beyond_limit_s": ("s", "time beyond the slide limit, worst axle"),
    "locked_s": ("s", "time locked above 5 km/h, worst axle"),
    "utilisation": ("-", "contact work over what best adhesion and full brake could have done on the same way"),
    "air_nl": ("Nl", "air let into the cylinders of all axles"),
    "valve_switchings": ("-", "changes of the valves' commands, all axles"),
    "longest_vent_s": ("s", "longest uninterrupted venting, any axle"),
    "contact_energy_mj": ("MJ", "heat in one contact, worst wheel"),
    "reservoir_fall_bar": ("bar", "what the air used takes from reservoirs that nothing refills; 0 where they never end"),
    "unreported_s": ("s", "longest time for which a wheel stood above 10 km/h without being reported, any axle"),
}

#: Why a stop is longer than the bound; the metres of the causes add up to the whole on uniform rail.
CAUSES = {
    "build_up": "brake still filling",
    "too_little": "too little brake",
    "too_much": "slip beyond the best",
    "beyond_limit": "beyond the slide limit (gain if negative)",
}

#: Slip speed [m/s] above the best one from which an axle counts as sliding too much (assumption).
_SLIP_MARGIN_MPS = 0.2


#: A wheel that stands while the vehicle runs faster [m/s] is to be reported (assumption: 10 km/h).
MONITORED_MPS = 10.0 / 3.6


def figures(result: StopRecords, ceiling: Ceiling, protected: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return the figures of N stops by name, (N,) each, but the ratios, which need other stops.

    `protected` (N, A): axles whose valves obey; slides, locks and venting of the others are not the controller's. None: all.
    """
    obeys = np.ones(result.air.shape, dtype=bool) if protected is None else protected
    interval = result.time[1]
    braking = np.arange(len(result.time) - 1)[:, None] < result.steps  # (T, N)
    speed, slip = result.speed[1:].astype(np.float64), result.slip[1:].astype(np.float64)
    counts = np.maximum(result.steps, 1)[:, None]
    mean = np.where(braking[..., None], slip, 0.0).sum(axis=0) / counts
    variance = np.where(braking[..., None], (slip - mean) ** 2, 0.0).sum(axis=0) / counts
    creepage = slip / np.maximum(speed, 1e-3)[..., None]
    counted = (braking & (speed > ceiling.limit.above_mps))[..., None]
    beyond = counted & (creepage > ceiling.limit.creepage) & obeys
    standing = speed[..., None] - slip < LOCKED_WHEEL_MPS
    locked = (braking & (speed > LOCKED_RUNNING_MPS))[..., None] & standing & obeys
    monitored = (braking & (speed > MONITORED_MPS))[..., None] & standing
    unreported = monitored if result.reported is None else monitored & ~result.reported
    changed = (np.diff(result.command, axis=0) != 0.0) & braking[1:, :, None]
    vented = (result.command < -0.5) & braking[..., None] & obeys
    return {
        "distance_m": result.distance,
        "mean_slip_mps": mean.mean(axis=1),
        "slip_deviation_mps": np.sqrt(variance).mean(axis=1),
        "largest_slip_mps": np.where(braking[..., None], slip, 0.0).max(axis=(0, 2)),
        "largest_creepage": np.where(counted, creepage, 0.0).max(axis=(0, 2)),
        "beyond_limit_s": interval * beyond.sum(axis=0).max(axis=1),
        "locked_s": interval * locked.sum(axis=0).max(axis=1),
        "utilisation": _utilisation(result, ceiling),
        "air_nl": result.air.sum(axis=1),
        "valve_switchings": changed.sum(axis=(0, 2)).astype(np.float64),
        "longest_vent_s": interval * longest_run(vented).max(axis=1),
        "contact_energy_mj": 0.5e-6 * result.contact_work.max(axis=1),
        "reservoir_fall_bar": reservoir_fall(result, ceiling.vehicle),
        "unreported_s": interval * longest_run(unreported).max(axis=1),
    }


def reservoir_fall(result: StopRecords, vehicle: Vehicle) -> np.ndarray:
    """Return by how much the pressure of reservoirs that nothing refills falls in N stops (N,) [bar]."""
    volume = vehicle.brake.reservoir_volume_l * vehicle.axles
    fall: np.ndarray = result.air.sum(axis=1) * (ATMOSPHERE_BAR / volume if volume > 0.0 else 0.0)
    return fall


def losses(result: StopRecords, ceiling: Ceiling) -> dict[str, np.ndarray]:
    """Return the metres lost against the bound by cause (see `CAUSES`), (N,) each.

    On the way dx a stop with the forces T takes the speed that the bound takes on dx sum(T) / sum(T_best): the rest is lost,
    by each axle as much as its force falls short. The bound's own resistances are those of the stop.
    """
    possible, used, way = _forces(result, ceiling)
    vehicle, speed = ceiling.vehicle, 0.5 * (result.speed[1:] + result.speed[:-1]).astype(np.float64)
    resisted = running_resistance(speed, vehicle.resistance)
    resisted += ceiling.stops.mass * vehicle.gravity_mps2 * ceiling.stops.gradient
    total = np.maximum(possible.sum(axis=2) + resisted, 1.0)
    lost = way[..., None] * (possible - used) / total[..., None]
    position = 0.5 * (result.position[1:] + result.position[:-1])
    _, best_slip = ceiling.at(speed, position)
    slip = 0.5 * (result.slip[1:] + result.slip[:-1])
    beyond = (slip > ceiling.limit.creepage * speed[..., None]) & (speed > ceiling.limit.above_mps)[..., None]
    too_much = ~beyond & (slip > best_slip + _SLIP_MARGIN_MPS)
    demand = ceiling.stops.torque / vehicle.full_brake_torque_nm
    filled_s = demand * vehicle.brake.demand_rise_s + vehicle.brake.dead_time_s
    filling = ~beyond & ~too_much & (result.time[1:, None] <= filled_s)[..., None]
    rest = ~beyond & ~too_much & ~filling
    masks = {"build_up": filling, "too_little": rest, "too_much": too_much, "beyond_limit": beyond}
    return {cause: np.where(masks[cause], lost, 0.0).sum(axis=(0, 2)) for cause in CAUSES}


def _forces(result: StopRecords, ceiling: Ceiling) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return possible and used wheelset forces (T, N, A) [N] and the way (T, N) [m] of each control interval."""
    speed = 0.5 * (result.speed[1:] + result.speed[:-1])
    position = 0.5 * (result.position[1:] + result.position[:-1])
    axle_load = ceiling.stops.mass * ceiling.vehicle.gravity_mps2 / ceiling.vehicle.axles
    adhesion = 0.5 * (result.adhesion[1:] + result.adhesion[:-1]).astype(np.float64)
    return ceiling.capacity(speed, position), adhesion * axle_load[:, None], np.diff(result.position, axis=0)


def _utilisation(result: StopRecords, ceiling: Ceiling) -> np.ndarray:
    possible, used, way = _forces(result, ceiling)
    total: np.ndarray = (used.sum(axis=2) * way).sum(axis=0) / np.maximum((possible.sum(axis=2) * way).sum(axis=0), 1e-9)
    return total


def longest_run(active: np.ndarray) -> np.ndarray:
    """Longest run of True along the first axis of a boolean array (T, ...): (...) numbers of steps."""
    count = np.zeros(active.shape[1:], dtype=int)
    longest = count.copy()
    for row in active:
        count = np.where(row, count + 1, 0)
        np.maximum(longest, count, out=longest)
    return longest
