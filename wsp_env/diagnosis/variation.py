"""The normal variation of sound vehicles and tracks, and the law's free parameters: the nuisances of every test.

Sizes as the tolerances of vehicle and test track have them: brake gain 1 % and wheel radius 0.05 % between axles, creep
stiffness 3 %, mu_cd along the track 2 % over 5 to 20 m, each uniform; mu_cd of a run some 15 % about the
believed one (assumption).
"""

import dataclasses

import numpy as np

from wsp_env.diagnosis.balances import ACTUATOR, Balances
from wsp_env.diagnosis.evaluate import Model

_UNIFORM = 1.0 / np.sqrt(3.0)
GAIN = 0.01 * _UNIFORM  # [-] of an axle's torque, where it comes from the cylinder pressure
RADIUS = 0.0005 * _UNIFORM  # [-] of an axle's wheels
STIFFNESS = 0.03 * _UNIFORM  # [-] of the creep curve
TRACK = 0.02 * _UNIFORM  # [-] of mu_cd along the track
TRACK_NODE_M = 5.0  # the shortest distance over which it varies
_UNRESOLVED = 0.3  # share of it between the nodes: assumption; the null recordings have the true share
MU_CD = 0.15  # [-] of a run's, about the believed one: assumption
LOG_TAU = 1.0  # [-] about where the search starts: says next to nothing
MEASURED_GAIN = 0.001  # [-] of a torque that is itself measured: assumption


@dataclasses.dataclass(frozen=True)
class Nuisances:
    """Columns (n, p) that move the residuals by one prior deviation (or by 1), raw, and which have a prior."""

    columns: np.ndarray
    prior: np.ndarray
    names: tuple[str, ...]
    friction: np.ndarray  # (n,) derivative of the residuals by log mu_cd of their own run


def gain_deviation(balances: Balances) -> float:
    """Prior deviation of an axle's brake gain [-]."""
    return MEASURED_GAIN if balances.campaign.vehicle.torque_is_measured else GAIN


def law_columns(balances: Balances, model: Model, base: np.ndarray) -> np.ndarray:
    """Columns (n, 1 + runs): derivative of the residuals by log tau, and by log mu_cd of each run."""
    step = 1e-3
    tau = (balances.raw(dataclasses.replace(model, tau=model.tau * np.exp(step))) - base) / step
    moved = dataclasses.replace(model, mu_cd=tuple(mu * float(np.exp(step)) for mu in model.mu_cd))
    friction = (balances.raw(moved) - base) / step
    runs = balances.rows.run[:, None] == np.arange(len(balances.stops))
    return np.column_stack([tau, friction[:, None] * runs])


def unresolved(friction: np.ndarray) -> np.ndarray:
    """Deviation (n,) that mu_cd leaves by varying between the nodes along the track."""
    return _UNRESOLVED * TRACK * np.abs(friction)


def nuisances(balances: Balances, model: Model, base: np.ndarray) -> Nuisances:
    """Return all nuisances of a model whose residuals are `base` (n,)."""
    rows, axles = balances.rows, balances.axles
    law = law_columns(balances, model, base)
    segments = (rows.segment[:, None] == np.arange(rows.segment.max(initial=-1) + 1)).astype(float)
    own = (rows.axle[:, None] == np.arange(axles)).astype(float)
    evaluations = balances.evaluate(model)
    gains, slopes, speeds, brakes = [], [], [], []
    for part, one in zip(balances.parts, evaluations, strict=True):
        share = one.torque / (2.0 * balances.radius * one.load)
        lost = np.stack([part.summed(one.torque[:, k] / balances.radius) / one.mass for k in range(axles)], axis=1)
        mask = np.nonzero(part.used)[1][:, None] == np.arange(axles)
        gains.append(
            part.joined(
                part.wheel_rows(share)[:, None] * mask,
                np.column_stack([part.vehicle_rows(x) for x in lost.T]),
                part.wheel_rows(one.torque)[:, None] * mask,
            )
        )
        slopes.append(part.joined(part.wheel_rows(one.slope * one.slip)))
        # A larger radius: less slip, so less adhesion expected of the law.
        speeds.append(part.joined(part.wheel_rows(one.slope * balances.radius * part.stop.wheel)))
        brakes.append(part.joined(brakes=part.wheel_rows(one.braking)))
    gain = np.vstack(gains)
    # A stiffer contact acts as more slip: df/dlog k is about s df/ds (exact at small creepage, where alone it counts).
    stiffness = -np.concatenate(slopes)
    radius = np.concatenate(speeds)
    friction: np.ndarray = law[:, 1:].sum(axis=1)
    track = friction[:, None] * _hats(rows.place, rows.wheels)
    by_run = rows.run[:, None] == np.arange(len(balances.stops))

    def each(columns: np.ndarray) -> np.ndarray:
        return np.column_stack([columns[:, [k]] * by_run for k in range(columns.shape[1])])

    groups = [
        ("offset", segments, 0.0),
        ("tau", law[:, :1], LOG_TAU),
        ("mu_cd", law[:, 1:], MU_CD),
        ("gain", gain, gain_deviation(balances)),
        ("radius", radius[:, None] * own, RADIUS),
        ("stiffness", stiffness[:, None] * own, STIFFNESS),
        ("common stiffness", stiffness[:, None], STIFFNESS),
        ("gain of a run", each(gain), gain_deviation(balances)),
        ("radius of a run", each(radius[:, None] * own), RADIUS),
        ("stiffness of a run", each(stiffness[:, None] * own), STIFFNESS),
        ("track", track, TRACK),
    ]
    if (rows.balance == ACTUATOR).any():
        brake = np.concatenate(brakes)[:, None]
        groups += [
            ("nominal gain of the brakes", brake, 0.0),
            ("gain of a brake", brake * own, GAIN),
            ("gain of a brake in a run", each(brake * own), GAIN),
        ]
    names = tuple(name for name, columns, _ in groups for _ in range(columns.shape[1]))
    columns = np.column_stack([columns * (deviation or 1.0) for _, columns, deviation in groups])
    prior = np.concatenate([np.full(columns.shape[1], deviation > 0.0) for _, columns, deviation in groups])
    return Nuisances(columns, prior, names, friction)


def _hats(place: np.ndarray, wheels: np.ndarray) -> np.ndarray:
    """Linear interpolation between nodes along the track (n, nodes); 0 for the vehicle's rows."""
    first = place[wheels].min(initial=0.0) if wheels.any() else 0.0
    x = (place - first) / TRACK_NODE_M
    nodes = int(x[wheels].max(initial=0.0)) + 2 if wheels.any() else 1
    weights: np.ndarray = np.clip(1.0 - np.abs(x[:, None] - np.arange(nodes)), 0.0, None)
    return weights * wheels[:, None]
