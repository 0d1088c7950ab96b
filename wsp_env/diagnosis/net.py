"""Columns and effects of mechanisms that remain after tau and mu_cd are fitted again (net).

Part of what a mechanism changes is taken up by the law's free parameters. Only the rest shows in recordings, and only the rest
changes a stop of a simulation whose law was tuned without the mechanism.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.candidates import Candidate, Variant, located, parameter_of, switched, without
from wsp_env.diagnosis.evaluate import Evaluation, Model
from wsp_env.diagnosis.interest import Compared, StopChange, only_sensors
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import Net, law_columns, segment_columns
from wsp_env.plant.mechanisms import ALL

#: Lower bound of the smallest effect of interest of a time, in samples; of a rolled distance, at the stops' median speed.
#: Channels of one logger are read within a sample of each other; the small size is then 0.6 of a sample.
_SAMPLES = 4.0


class Law:
    """Derivatives of residuals and adhesion by the law's parameters, for net effects."""

    def __init__(self, replica: Replica, model: Model, base: np.ndarray, whitening: Whitening) -> None:
        segments = segment_columns(replica)
        self._segments = segments.shape[1]
        self.compared = Compared(replica, replica.evaluate(model))
        self._net, self._whitening = Net(whitening, np.column_stack([segments, law_columns(replica, model, base)])), whitening
        self._rest = whitening(self.net(base[:, None])[0])[:, 0]
        little = 1e-3
        tau = replica.evaluate(dataclasses.replace(model, tau=model.tau * float(np.exp(little))), model)
        mu = replica.evaluate(dataclasses.replace(model, mu_cd=tuple(m * float(np.exp(little)) for m in model.mu_cd)), model)
        self._by = [
            ((a.adhesion - one.adhesion) / little, (b.adhesion - one.adhesion) / little)
            for one, a, b in zip(self.compared.before, tau, mu, strict=True)
        ]

    def grows(self, column: np.ndarray) -> bool:
        """Whether the weighted residual grows along a column (n,) after refitting the law."""
        return bool(self._whitening(self.net(column[:, None])[0])[:, 0] @ self._rest > 0.0)

    def net(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return columns (n, k) after refitting the law, and the changes (1 + runs, k) of log tau and log mu_cd by it."""
        left, amplitudes = self._net(columns)
        return left, amplitudes[self._segments :]

    def without(self, after: Sequence[Evaluation], logs: np.ndarray) -> list[Evaluation]:
        """Return evaluations with changes (1 + runs,) of log tau and log mu_cd subtracted."""
        return [
            dataclasses.replace(one, adhesion=one.adhesion - logs[0] * by_tau - logs[1 + i] * by_mu)
            for i, (one, (by_tau, by_mu)) in enumerate(zip(after, self._by, strict=True))
        ]


def candidate(replica: Replica, model: Model, base: np.ndarray, law: Law, variant: Variant) -> Candidate:
    """Return a mechanism that is off, with its columns about a model and their net size in smallest effects of interest."""
    found, scale, moves = [], [], variant.moves()
    sensor, swings = only_sensors({variant.name: {}}), ALL[variant.name].signature.swings

    def step_by(i: int, move: float) -> tuple[np.ndarray, np.ndarray, Sequence[Evaluation]]:
        values = variant.null()
        values[i] += move
        moved = switched(model, variant, values)
        column = replica.raw(moved, model) - base
        return column, law.net(column[:, None])[1][:, 0], replica.evaluate(moved, model)

    for i, move in enumerate(moves):
        column, logs, after = step_by(i, move)
        size = parameter_of(variant.name, variant.sizes[i])
        # A nonlinear effect is stepped to the side that the residual asks for. A term is linear, and so is what acts at a
        # place: a patch of more or less friction has the same column within 4 % of its length.
        if size.null > size.low and not variant.family and not located(variant) and law.grows(column):
            moves[i] = -move
            column, logs, after = step_by(i, -move)
        found.append(column)
        multiple = law.compared.change(after if sensor else law.without(after, logs), sensor, swings).multiple
        scale.append(min(multiple, _samples(replica, variant.name, variant.sizes[i], move) / _SAMPLES))
    return Candidate(dataclasses.replace(variant, steps=tuple(moves)), np.column_stack(found), np.array(scale))


def _samples(replica: Replica, name: str, size: str, move: float) -> float:
    """Return a change of a time in samples, or of a rolled distance at the stops' median speed; infinity for other sizes."""
    parameter = parameter_of(name, size)
    if parameter.unit != "s" and not parameter.rolled:
        return np.inf
    seconds = abs(move) / (float(np.median(replica.rows.speed)) if parameter.rolled else 1.0)
    return seconds / replica.sample_s


def net_by_run(law: Law, columns: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Return columns (n, k) after refitting the law; what acts in one run only stays in it, although tau is common."""
    runs, place = np.unique(run, return_inverse=True)
    touched = np.array([columns[run == one].any(axis=0) for one in runs])
    return np.where(touched[place] | (touched.sum(axis=0) != 1), law.net(columns)[0], 0.0)


def net_effect(replica: Replica, model: Model, variant: Variant, whitening: Whitening) -> StopChange:
    """Return the change of the stops by a mechanism that is on, against the law refitted without it."""
    sensor, swings = only_sensors({variant.name: {}}), ALL[variant.name].signature.swings
    return net_change(replica, model, without(model, variant), whitening, sensor, swings)


def net_change(
    replica: Replica, model: Model, off: Model, whitening: Whitening, sensor: bool = False, swings: bool = False
) -> StopChange:  # fmt: skip
    """Return the change of the stops by a model, against another model `off` with refitted law."""
    after, base = replica.evaluate(model), replica.raw(off)
    law = Law(replica, off, base, whitening)
    if sensor:
        return law.compared.change(after, True)
    logs = law.net((replica.raw(model) - base)[:, None])[1][:, 0]
    return law.compared.change(law.without(after, logs), swings=swings)
