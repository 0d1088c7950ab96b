"""Where a mismatch is: balance, axles, runs, and the range of slip, speed or place."""

from typing import Any

import numpy as np

from wsp_env.diagnosis.answer import Location
from wsp_env.diagnosis.balances import BALANCES, KINEMATICS, VEHICLE, Balances
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.variation import nuisances

_LEAST_SHARE = 0.1  # of the removed residual, from which on a balance is told of
_STRETCHES = 30  # of the track, in the map
_AXLE_SHARE = 0.5  # of an equal share, from which on an axle or a run is told of


def rests(balances: Balances, model: Model, weights: Weights) -> np.ndarray:
    """Squares (n,) of the whitened residuals of a model, the nuisances' best part taken away."""
    base = balances.raw(model)
    found = nuisances(balances, model, base)
    projector = Projector(found.columns / weights.deviation[:, None], found.prior)
    result: np.ndarray = projector.rest(weights(base)) ** 2
    return result


def locate(balances: Balances, model: Model, extended: Model, weights: Weights, closure: str) -> tuple[Location, ...]:
    """Return where the extension removed what, or, without one, where the largest residuals are."""
    rows = balances.rows
    before = rests(balances, model, weights)
    removed = before - (rests(balances, extended, weights) if extended.choice else 1.0)
    total = max(float(removed.sum()), 1e-12)
    found = []
    for balance, name in enumerate(BALANCES):
        mine = rows.balance == balance
        share = float(removed[mine].sum()) / total
        if not mine.any() or share < _LEAST_SHARE or (closure.startswith("force") and balance != VEHICLE):
            continue
        axles = [k for k in range(balances.axles) if _stands_out(removed, mine & (rows.axle == k), mine, balances.axles)]
        runs = [
            i for i in range(len(balances.stops)) if _stands_out(removed, mine & (rows.run == i), mine, len(balances.stops))
        ]
        found.append(
            Location(
                name,
                () if balance == VEHICLE else tuple(k + 1 for k in axles),
                tuple(balances.stops[i].name for i in runs),
                closure or _range(balances, removed, mine, balance),
                round(min(share, 1.0), 3),
            )
        )
    return tuple(sorted(found, key=lambda one: -one.share))


def _stands_out(removed: np.ndarray, part: np.ndarray, whole: np.ndarray, parts: int) -> bool:
    return bool(removed[part].sum() > _AXLE_SHARE / parts * removed[whole].sum())


def _range(balances: Balances, removed: np.ndarray, mine: np.ndarray, balance: int) -> str:
    """Say between which slip speeds or speeds the middle four fifths of what is removed lie."""
    values, what = (balances.rows.speed, "speed") if balance in (VEHICLE, KINEMATICS) else (balances.rows.slip, "slip speed")
    order = np.argsort(values[mine])
    gained = np.cumsum(np.maximum(removed[mine][order], 0.0))
    low, high = (float(values[mine][order][np.searchsorted(gained, share * gained[-1])]) for share in (0.1, 0.9))
    return f"{what} from {low:.2g} to {high:.2g} m/s"


def residual_map(balances: Balances, model: Model, extended: Model, weights: Weights) -> dict[str, Any]:
    """Mean squares by balance, run and axle, before and after, for the report."""
    rows = balances.rows
    squares = {"before": rests(balances, model, weights), "after": rests(balances, extended, weights)}
    cells = []
    for balance, name in enumerate(BALANCES):
        for run, stop in enumerate(balances.stops):
            for axle in range(-1, balances.axles):
                mine = (rows.balance == balance) & (rows.run == run) & (rows.axle == axle)
                if mine.any():
                    means = {key: float(values[mine].mean()) for key, values in squares.items()}
                    cells.append({"balance": name, "run": stop.name, "axle": axle + 1, **means})
    return {"cells": cells, "places": _places(balances, squares)}


def _places(balances: Balances, squares: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """Mean squares by balance, axle and stretch of track."""
    rows, cells = balances.rows, []
    edges = np.linspace(rows.place.min(), rows.place.max() + 1e-6, _STRETCHES + 1)
    which = np.digitize(rows.place, edges) - 1
    for balance, name in enumerate(BALANCES):
        for axle in range(-1, balances.axles):
            for i in range(_STRETCHES):
                mine = (rows.balance == balance) & (rows.axle == axle) & (which == i)
                if mine.any():
                    means = {key: float(values[mine].mean()) for key, values in squares.items()}
                    middle = round(float(0.5 * (edges[i] + edges[i + 1])), 1)
                    cells.append({"balance": name, "axle": axle + 1, "place_m": middle, **means})
    return cells
