"""Prediction of slip and torque that removes the correlation of friction and slip in the closed loop.

Friction turns the sliding wheel, and its equilibrium is weak. If a load bounces or the rail is better for a moment, the wheel
speeds up and the WSP reacts. High friction and small slip thus occur together although no law causes it (bias of simultaneous
equations, Haavelmo, Econometrica 11, 1943). The slip at which a law is evaluated must therefore not depend on the friction that
the law is to explain. Known before a block of time are the earlier slip and torque. The wheel's own equation predicts the slip
within the block from them (prediction error method, L. Ljung, System identification, 1999, chapters 7 and 13: without bias in
closed loop if the noise's autocorrelation is known, see `wsp_env.diagnosis.colour`). The prediction starts one block earlier,
because a smoothed slip contains some later samples. The difference between friction and law in the block before that start is
assumed to continue, so that a large missing effect does not bias the prediction. The wheel's acceleration is predicted too: a
late reading or another inertia acts through it, and the measured one also depends on the friction.

The recorded torque within a block also depends on the friction, because the WSP reacts within the block. The slip is therefore
predicted with an expected torque, from a regression over all blocks of a stop (two-stage least squares, Theil 1953, in Economic
forecasts and policy, 1961, chapter 6). Delays (late sensors or brakes) show only in the torque's own course. For them, the
recorded torque is used.

For the same reason a fit about one replica is not compared with a fit about another by their residuals alone. What is recorded
is the motion; the residual is what friction did by itself. A wheel that follows its friction within a block takes most of it
up: the less a model lets friction depend on the slip at once, the smaller are its residuals, whatever is true. The likelihood
of the recording is that of the residuals times the derivative of a residual by the recorded force (`prompt_gain`; change of
variables, the determinant of full-information likelihood, Koopmans, Rubin, Leipnik, Cowles Commission Monograph 10, 1950).
The noise of the sensors turns no wheel. It is neglected beside the friction, which varies along a track by several times as
much (docs/lab/diagnosis_truth_u.md).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from wsp_env.diagnosis.balances import Rows
from wsp_env.diagnosis.stops import PreparedStop, least_slip

#: Lower bound of the derivative of a residual by the recorded force. Where friction falls steeply with slip, a wheel locks
#: within a block, which does not show how steeply (assumption).
_LEAST_GAIN = 0.1
_PAST_S = (0.04, 0.08, 0.16)  # times [s] before a block whose torque changes enter the regression: some steps of a valve


def stretches(rows: Rows) -> list[np.ndarray]:
    """Return the rows (m,) of every uninterrupted slide of a wheel, in the order of time."""
    found = []
    for run in np.unique(rows.run):
        for axle in range(int(rows.axle.max(initial=-1)) + 1):
            mine = np.flatnonzero((rows.run == run) & (rows.axle == axle) & rows.wheels)
            slides, apart = rows.slides[mine], np.diff(rows.time[mine])
            ends = (apart > 1.5 * apart.min(initial=np.inf)) | (slides[1:] != slides[:-1])
            parts = np.split(mine, np.flatnonzero(ends) + 1) if len(mine) else []
            found += [part for part in parts if rows.slides[part[0]]]
    return found


def prompt_gain(damping: np.ndarray, block_s: float, radius: float, inertia: np.ndarray) -> np.ndarray:
    """Return the derivative (T, A) [-] of a block's residual force by the recorded one.

    A force that is larger by 1 N during a block turns the wheel, so that its mean slip is smaller by r^2 / J times half of the
    block, and the law's force with it.

    Parameters
    ----------
    damping : (T, A) derivative of the law's torque on a wheel by its slip [N m s/m]
    block_s : length of a block [s]
    radius, inertia : of the wheelsets [m], (A,) [kg m2]

    """
    result: np.ndarray = np.maximum(1.0 + damping * radius * 0.5 * block_s / inertia, _LEAST_GAIN)
    return result


def predicted(
    stop: PreparedStop, slides: np.ndarray, torque: np.ndarray, damping: np.ndarray, block: int, radius: float,
    inertia: np.ndarray,
) -> tuple[PreparedStop, PreparedStop]:  # fmt: skip
    """Return a stop twice, with the motion of sliding wheels predicted from the beginning of the previous block.

    First under the expected torques; the torques of this copy give the predicted rates with the law's friction. Then under the
    recorded torques; this copy keeps the stop's own torques. A wheel that does not slide in both whole blocks stays unchanged.

    Parameters
    ----------
    stop : with torques that give its wheels' rates with the law's friction
    slides : (T, A) bool, where a wheel slides; predicted slips are not smaller than the smallest one there, or `least_slip`
    torque : (T, A) recorded [N m]. Where it is smaller than the stop's torque, friction was below the law's and the wheel
        slower
    damping : (T, A) derivative of the law's torque on a wheel by its slip [N m s/m]; it stabilises the wheel where the curve
        rises
    block : number of samples of a block
    radius, inertia : of the wheelsets [m], (A,) [kg m2]

    """
    slip = stop.speed[:, None] - radius * stop.wheel
    least = np.minimum(least_slip(stop.speed)[:, None], np.where(slides, slip, np.inf).min(axis=0, initial=np.inf))
    throughout: np.ndarray = np.asarray(_blocks(slides, block).all(axis=1))
    both = throughout & _before(throughout)
    disturbance = _blocks(torque - stop.torque, block)
    by_moment = radius * stop.step_s / inertia  # slip [m/s] in a sample by 1 N m
    bias = _before(_before(disturbance.mean(axis=1) * throughout))  # difference between friction and law, assumed to continue
    decay = _with_before(np.exp(-_blocks(damping, block) * by_moment))
    moments = _with_before(disturbance) - bias[:, None]
    most = np.maximum(_with_before(_blocks(stop.speed[:, None], block)), 0.0)
    innovation = _with_before(_blocks(torque, block)) - _expected(torque, (slip, stop.wheel_rate), both, block, stop.step_s)

    def within(values: np.ndarray) -> np.ndarray:
        """Return the second blocks, as (T, A), of values (B, 2 block, A)."""
        result: np.ndarray = (values[:, block:] * both[:, None]).reshape(-1, slip.shape[1])[: len(slip)]
        return result

    def turned(moments: np.ndarray) -> PreparedStop:
        """Return the stop without the wheel motion due to moments (B, 2 block, A) [N m].

        No moment moves a wheel further than from rolling to standing: where friction falls steeply, the motion would grow
        beyond all limits.
        """
        less = np.zeros((len(moments), 2 * block + 1, slip.shape[1]))  # slip caused by the moments [m/s]
        for i in range(2 * block):
            less[:, i + 1] = np.clip(decay[:, i] * less[:, i] + by_moment * moments[:, i], -most[:, i], most[:, i])
        rate = np.diff(less, axis=1) / stop.step_s
        slid_on = np.clip(stop.wheel - within(less[:, :-1]) / radius, 0.0, (stop.speed[:, None] - least) / radius)
        return dataclasses.replace(
            stop,
            wheel=np.where(slides, slid_on, stop.wheel),
            wheel_rate=stop.wheel_rate - within(rate) / radius,
            wheel_jerk=stop.wheel_jerk - within(np.gradient(rate, stop.step_s, axis=1)) / radius,
        )

    expected = moments - innovation
    return dataclasses.replace(turned(expected), torque=stop.torque + within(expected)), turned(moments)


def _expected(
    torque: np.ndarray, states: Sequence[np.ndarray], both: np.ndarray, block: int, step_s: float
) -> np.ndarray:  # fmt: skip
    """Return the expected torques (B, 2 block, A) [N m] over every block and the one before.

    A regression over the blocks `both` (B, A) predicts them from the values known at the beginning of the previous block:
    earlier torques, and `states` (T, A) of the wheel. Its prior is that the torque stays constant, with the weight of one block
    (Kass and Wasserman, J. Am. Stat. Assoc. 90, 1995). Other blocks keep the recorded torques.
    """
    result = _with_before(_blocks(torque, block))
    blocks, axle = np.nonzero(both)
    if not len(blocks):
        return result
    begins = (blocks - 1) * block

    def before(values: np.ndarray, seconds: float = 0.0) -> np.ndarray:
        return values[np.clip(begins - 1 - round(seconds / step_s), 0, None), axle]

    stays = before(torque)
    known = [stays, *(stays - before(torque, seconds) for seconds in _PAST_S), *map(before, states)]
    x = np.column_stack([np.ones(len(stays)), *known])
    x /= np.maximum(np.linalg.norm(x, axis=0), 1e-12)
    moves = result[blocks, :, axle] - stays[:, None]
    prior = np.eye(x.shape[1]) / np.sqrt(len(x))
    weights = np.linalg.lstsq(np.vstack([x, prior]), np.vstack([moves, np.zeros((len(prior), moves.shape[1]))]), rcond=None)[0]
    result[blocks, :, axle] = stays[:, None] + x @ weights
    return result


def _with_before(values: np.ndarray) -> np.ndarray:
    """Return for every block (B, block, A) the previous block and itself (B, 2 block, A)."""
    return np.concatenate([_before(values), values], axis=1)


def _before(values: np.ndarray) -> np.ndarray:
    """Return for every block (B, ...) the previous one; zeros for the first."""
    return np.concatenate([np.zeros_like(values[:1]), values[:-1]])


def _blocks(values: np.ndarray, block: int) -> np.ndarray:
    """Return values (T, A) by blocks (B, block, A); the last block is padded with its last sample."""
    blocks = -(-len(values) // block)
    filled = np.pad(values, ((0, blocks * block - len(values)), (0, 0)), "edge")
    return filled.reshape(blocks, block, values.shape[1])
