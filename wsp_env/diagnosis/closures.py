"""Closures: flexible functions of what was measured, which show what is structured but in no library, and where."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from wsp_env.diagnosis.answer import ClosureKind, ClosureOver, Quantity
from wsp_env.diagnosis.balances import ACTUATOR, KINEMATICS, VEHICLE, Balances
from wsp_env.diagnosis.candidates import Candidate
from wsp_env.diagnosis.evaluate import Evaluation, Model
from wsp_env.diagnosis.words import described

_NODES = 6  # of a function of slip speed, speed or work, at quantiles
_TIME_NODE_S = 3.0
_FREQUENCIES_HZ = tuple(np.geomspace(0.15, 1.2, 13))


def closures(balances: Balances, model: Model, friction: np.ndarray) -> list[Candidate]:
    """Return the closures that these recordings allow.

    Parameters
    ----------
    friction : (n,) derivative of the residuals by log mu_cd: closures of the adhesion are relative changes of friction

    """
    rows, found = balances.rows, []
    vehicle = rows.balance == VEHICLE
    slides = rows.wheels & (rows.slip > 0.01 * rows.speed)
    own = (rows.axle[:, None] == np.arange(balances.axles)).astype(float)
    by_run = (rows.run[:, None] == np.arange(len(balances.stops))).astype(float)

    def add(
        quantity: Quantity, over: ClosureOver, columns: np.ndarray, nodes: Iterable[float], frequency_hz: float = 0.0
    ) -> None:
        kind = ClosureKind(quantity, over, frequency_hz)
        found.append(Candidate(described(kind).name, columns, closure=kind, nodes=tuple(map(float, nodes))))

    axles, runs = range(1, balances.axles + 1), range(1, len(balances.stops) + 1)
    if slides.any():
        measured: tuple[tuple[ClosureOver, np.ndarray], ...] = (("slip", rows.slip), ("speed", rows.speed), ("work", rows.work))
        for over, values in measured:
            nodes = _quantiles(values[slides])
            add("adhesion", over, (friction * slides)[:, None] * _interpolation(values, nodes), nodes)
        add("adhesion", "axle", (friction * slides)[:, None] * own, axles)
        nodes = _clock(rows.time)
        clock = _interpolation(rows.time, nodes)
        columns = np.column_stack([(friction * slides * run)[:, None] * clock for run in by_run.T])
        add("adhesion", "time", columns, np.tile(nodes, len(runs)))
    steepness, offset, drift, resisted = _parts(balances, model)
    free = (rows.balance == KINEMATICS).astype(float)
    columns = (steepness * free)[:, None] * np.column_stack([own, own * rows.speed[:, None]])
    add("rolling slip", "axle", columns, (*axles, *axles))
    columns = (rows.deceleration * (1.0 * vehicle - steepness) * rows.speed)[:, None]
    add("recorded speed", "deceleration", columns, (1.0,))
    add("torque", "axle", np.column_stack([offset, drift]), (*axles, *axles))
    if (rows.balance == ACTUATOR).any():
        pressed = np.concatenate(
            [part.joined(brakes=part.wheel_rows(one.braking)) for part, one in _evaluated(balances, model)]
        )
        nodes = _quantiles(pressed[rows.balance == ACTUATOR])
        add("torque", "pressure", -1.0 * (rows.balance == ACTUATOR)[:, None] * _interpolation(pressed, nodes), nodes)
    add("force", "speed", resisted, _quantiles(rows.speed))
    for frequency in _FREQUENCIES_HZ:
        phase = 2.0 * np.pi * frequency * rows.time
        waves = np.column_stack([np.sin(phase), np.cos(phase)]) * vehicle[:, None]
        columns = np.column_stack([waves * run[:, None] for run in by_run.T])
        add("force", "frequency", columns, np.repeat(runs, 2), float(frequency))
    nodes = _clock(rows.time)
    columns = np.column_stack([_interpolation(rows.time, nodes) * (vehicle * run)[:, None] for run in by_run.T])
    add("force", "time", columns, np.tile(nodes, len(runs)))
    return found


def _parts(balances: Balances, model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return df/ds of every row, and what moves by a torque, a growing torque of each axle, a force over speed."""
    rows = balances.rows
    nodes = _quantiles(rows.speed)
    steepness: list[np.ndarray] = []
    offsets: list[np.ndarray] = []
    drifts: list[np.ndarray] = []
    resisted: list[np.ndarray] = []
    for part, one in _evaluated(balances, model):
        stop = part.stop
        steepness.append(part.joined(part.wheel_rows(one.slope)))
        axle = np.nonzero(part.used)[1][:, None] == np.arange(balances.axles)
        per_torque = part.wheel_rows(1.0 / (2.0 * balances.radius * one.load))[:, None] * axle
        ones = np.ones(len(stop.time))
        for collected, course in ((offsets, ones), (drifts, stop.time - stop.time[0])):
            over_time = part.wheel_rows(np.repeat(course[:, None], balances.axles, axis=1))[:, None]
            vehicle = part.vehicle_rows(part.summed(course)) / (balances.radius * one.mass)
            every = np.repeat(vehicle[:, None], balances.axles, axis=1)
            collected.append(part.joined(per_torque * over_time, every, axle * over_time))
        forces = _interpolation(stop.speed, nodes)
        summed = np.column_stack([part.vehicle_rows(part.summed(force)) for force in forces.T])
        resisted.append(part.joined(vehicle=summed / one.mass))
    return np.concatenate(steepness), np.vstack(offsets), np.vstack(drifts), np.vstack(resisted)


def _evaluated(balances: Balances, model: Model) -> Iterator[tuple[Any, Evaluation]]:
    return zip(balances.parts, balances.evaluate(model), strict=True)


def _quantiles(values: np.ndarray) -> np.ndarray:
    return np.unique(np.quantile(values, np.linspace(0.0, 1.0, _NODES))) if len(values) else np.zeros(1)


def _interpolation(values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Weights (n, nodes) of linear interpolation."""
    return np.column_stack([np.interp(values, nodes, unit) for unit in np.eye(len(nodes))])


def _clock(time: np.ndarray) -> np.ndarray:
    return np.arange(0.0, time.max(initial=0.0) + _TIME_NODE_S, _TIME_NODE_S)
