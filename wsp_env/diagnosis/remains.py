"""Whether structure remains beside the mechanisms, and the closure that describes it."""

import numpy as np

from wsp_env.diagnosis.answer import Closure
from wsp_env.diagnosis.balances import ACTUATOR, ADHESION, VEHICLE, Balances
from wsp_env.diagnosis.candidates import Candidate
from wsp_env.diagnosis.closures import closures
from wsp_env.diagnosis.decide import Outcome
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.rules import HELD_OUT_SHARE, expected
from wsp_env.diagnosis.search import Found
from wsp_env.diagnosis.stops import VEHICLE_BLOCK_S
from wsp_env.diagnosis.variation import nuisances
from wsp_env.diagnosis.words import described

#: Closures: minus log10 of the probability in a null recording, and share of the deceleration or of the adhesion, from which on
#: structure remains that matters.
_CLOSURE_NEG_LOG10_P = 8.0
_LEAST_CLOSURE = 0.01
_NEAR_NODE = 1e-3  # of the largest square of a closure's columns, from which on a node is reported


def closure_left(balances: Balances, outcome: Outcome) -> Closure | None:
    """Return the closure that best explains what the library leaves, if that is structured and matters."""
    search = outcome.last
    left = [one for one in outcome.rest if search.data.candidates[one.which].closure]
    structured = [one for one in left if one.neg_log10_p >= _CLOSURE_NEG_LOG10_P]
    structured.sort(key=lambda one: -one.net)
    model = outcome.fitted.model
    listed = {}
    if structured:
        friction = nuisances(balances, model, balances.raw(model)).friction
        listed = {one.name: (one, one.closure) for one in closures(balances, model, friction) if one.closure}
    for one in structured:
        its, kind = listed[one.name]
        index = search.data.columns_of(one.which)
        # Columns of single runs cannot be held out: these must explain something in the runs to validate too.
        elsewhere = search.solve(index, "validate").reduction if kind.by_run else one.held_out
        if (
            elsewhere > HELD_OUT_SHARE * expected(search, one)
            and _share(balances, model, its.columns @ one.fit.amplitude) > _LEAST_CLOSURE
        ):
            words = described(kind)
            return Closure(kind, one.name, one.net, elsewhere, words.over, words.unit, _shape(its, one))
    return None


def _shape(closure: Candidate, found: Found) -> tuple[tuple[float, float, float], ...]:
    """Return place, value and deviation at the nodes that rows were near; it is minus what it changes in the residuals."""
    squares = np.einsum("nk,nk->k", closure.columns, closure.columns)
    points = np.column_stack([closure.nodes, -found.fit.amplitude, np.sqrt(np.diag(found.fit.covariance))])
    return tuple((float(x), float(y), float(d)) for x, y, d in points[squares > _NEAR_NODE * squares.max()])


def _share(balances: Balances, model: Model, explained: np.ndarray) -> float:
    """Size of a closure's change of the residuals (n,) [-]: of its deceleration, adhesion or torque, over the stops' own."""
    rows = balances.rows
    wheels = (rows.balance == ADHESION) & (rows.slip > 0.01 * rows.speed)
    braked = (rows.balance == VEHICLE) & (rows.deceleration > 0.2)
    shares = [0.0]
    if wheels.any():
        own = [part.wheel_rows(one.adhesion) for part, one in zip(balances.parts, balances.evaluate(model), strict=True)]
        adhesion = np.zeros(len(rows))
        adhesion[rows.wheels] = np.concatenate(own)
        shares.append(float(np.sqrt(np.mean(explained[wheels] ** 2) / np.mean(adhesion[wheels] ** 2))))
    brakes = rows.balance == ACTUATOR
    if brakes.any():
        torque = np.concatenate(
            [part.wheel_rows(one.torque) for part, one in zip(balances.parts, balances.evaluate(model), strict=True)]
        )
        shares.append(float(np.sqrt(np.mean(explained[brakes] ** 2) / max(np.mean(torque**2), 1.0))))
    if braked.sum() > 2:
        rate = np.gradient(explained[braked], VEHICLE_BLOCK_S)
        inside = np.gradient(rows.time[braked]) < 1.5 * VEHICLE_BLOCK_S  # not across two stops
        shares.append(float(np.sqrt(np.mean(rate[inside] ** 2)) / np.mean(rows.deceleration[braked])))
    return max(shares)
