"""Location of a mismatch: balance, axles, runs, and a range of place, time, speed, slip or friction work."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsp_env.diagnosis.answer import Location
from wsp_env.diagnosis.balances import BALANCES, VEHICLE
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.readings import on_sensors
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.weights import Weights

_LEAST_SHARE = 0.1  # share of a mechanism's removed squares from which on a balance is reported
_LEAST_SHOWN = 0.01  # share of all removed squares from which on a balance is reported; less is printed as zero
_LEAST_CONTRAST = 0.2  # least excess of a range's share of the removed squares over its share of the rows
_STRETCHES = 30  # parts of the track in the map
_UNITS = {"place": "m", "time": "s", "speed": "m/s", "slip": "m/s", "work": "J/m"}
_DECIMALS = {"place": 0, "time": 1, "speed": 1, "slip": 2, "work": 0}  # of a range's ends; a smaller range is not reported
_CALLED = {"slip": "slip speed", "work": "friction work W_sp"}
_AXLE_SHARE = 0.5  # removed squares of an axle or a run over an equal share, from which on it is reported


def _rest(balances: Replica, model: Model, weights: Weights) -> np.ndarray:
    """Whitened residuals (n,) of a model after subtraction of the best-fitting nuisances."""
    return weights.projector.rest(weights(balances.raw(model)))


def locate(balances: Replica, model: Model, extended: Model, weights: Weights) -> tuple[Location, ...]:
    """Return where each mechanism removes squares; without a mechanism, where the largest residuals are."""
    if not extended.choice:
        removed = _rest(balances, model, weights) ** 2 - 1.0
        return _places_of(balances, removed, removed, float(removed.sum()))
    raw = balances.raw(extended)
    base = weights(raw)
    normal = base - _rest(balances, extended, weights)
    by_mechanism = []
    for name in extended.choice:
        others = {other: values for other, values in extended.choice.items() if other != name}
        raw_without = balances.raw(dataclasses.replace(extended, choice=others))
        # Nuisances stay as fitted beside the mechanism: fitted again, they would absorb a part of its effect.
        removed = (weights(raw_without) - normal) ** 2 - (base - normal) ** 2
        acting = removed if name in on_sensors(extended) else _of_forces(balances, removed, raw_without - raw)
        by_mechanism.append((removed, acting))
    total = float(sum(removed.sum() for removed, _ in by_mechanism))
    found = [one for removed, acting in by_mechanism for one in _places_of(balances, removed, acting, total)]
    return tuple(sorted(found, key=lambda one: -one.share))


def _of_forces(balances: Replica, removed: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Return where a mechanism acts (n,): the squares `removed` (n,); of the vehicle, the rate of its effect (n,) on the speed.

    The vehicle balance is an integral. A constant force has its largest effect on the speed at the end of a stop.
    """
    segment, acting = balances.rows.segment, removed.copy()
    for one in np.unique(segment[segment >= 0]):
        mine = segment == one
        if mine.sum() > 1:  # of a single row there is no rate
            acting[mine] = np.abs(np.gradient(effect[mine]))
    return acting


def _places_of(balances: Replica, removed: np.ndarray, acting: np.ndarray, total: float) -> tuple[Location, ...]:
    """Return the balances that contain the squares `removed` (n,), and the ranges in them; shares relate to `total`.

    `acting` (n,) says where in a balance they come from, for the ranges.
    """
    rows, own, found = balances.rows, max(float(removed.sum()), 1e-12), []
    for balance, name in enumerate(BALANCES):
        mine = rows.balance == balance
        share = float(removed[mine].sum())
        if not mine.any() or share < max(_LEAST_SHARE * own, _LEAST_SHOWN * total):
            continue
        axles = [k for k in range(balances.axles) if _stands_out(removed, mine & (rows.axle == k), mine, balances.axles)]
        runs = [
            i for i in range(len(balances.stops)) if _stands_out(removed, mine & (rows.run == i), mine, len(balances.stops))
        ]
        over = ("place", "time", "speed") if balance == VEHICLE else tuple(_UNITS)
        if not _placed(balances)[mine].all():
            over = over[1:]
        found.append(
            Location(
                name,
                () if balance == VEHICLE else tuple(k + 1 for k in axles),
                tuple(balances.stops[i].name for i in runs),
                _range(balances, acting, mine, over),
                round(min(share / max(total, 1e-12), 1.0), 3),
            )
        )
    return tuple(sorted(found, key=lambda one: -one.share))


def _placed(balances: Replica) -> np.ndarray:
    """Return the mask (n,) of rows with a known place: those of runs with a start position, or of a single run."""
    known = np.array([stop.start_is_known or len(balances.stops) == 1 for stop in balances.stops])
    result: np.ndarray = known[balances.rows.run]
    return result


def _stands_out(removed: np.ndarray, part: np.ndarray, whole: np.ndarray, parts: int) -> bool:
    return bool(removed[part].sum() > _AXLE_SHARE / parts * removed[whole].sum())


def _range(balances: Replica, acting: np.ndarray, mine: np.ndarray, over: tuple[str, ...]) -> str:
    """Return the range, between two change points of the most contrasting quantity, that has most of `acting` (n,)."""
    best, where = 0.0, "everywhere"
    for name in over:
        low, high, contrast, inside = change_points(getattr(balances.rows, name)[mine], acting[mine])
        stands_out = contrast / np.sqrt(max(inside * (1.0 - inside), 1e-6))  # signal-to-noise ratio of a step
        ends = [_number(value, _DECIMALS[name]) for value in (low, high)]
        if contrast > _LEAST_CONTRAST and stands_out > best and ends[0] != ends[1]:
            best, where = stands_out, f"{_CALLED.get(name, name)} from {ends[0]} to {ends[1]} {_UNITS[name]}"
    return where


def _number(value: float, decimals: int) -> str:
    """Return the number with three digits, no more decimals than these, and without exponent."""
    return f"{round(float(f'{value:.3g}'), decimals) + 0.0:.6g}"  # 0.0: no minus before a zero


def change_points(values: np.ndarray, removed: np.ndarray) -> tuple[float, float, float, float]:
    """Return the range of values (n,) in which `removed` (n,) exceeds its mean, and the excess.

    The two change points maximise the sum of `removed` less its mean between them. The third number is this sum over the total
    of `removed`: its share inside minus the share of rows inside. The fourth number is the share of rows inside.
    """
    order = np.argsort(values, kind="stable")
    excess = removed[order] - removed.mean()
    sums = np.concatenate([[0.0], np.cumsum(excess)])
    lowest = np.minimum.accumulate(sums)
    end = int(np.argmax(sums - lowest))
    start = int(np.argmin(sums[: end + 1]))
    contrast = float(sums[end] - sums[start]) / max(float(removed.sum()), 1e-12)
    low, high = values[order[min(start, len(order) - 1)]], values[order[max(end - 1, 0)]]
    return float(low), float(high), contrast, (end - start) / len(order)


def residual_map(balances: Replica, squares: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return the means of `squares` (n,), "before" and "after", by balance, run, axle and place, for the report."""
    rows = balances.rows
    cells = []
    for balance, name in enumerate(BALANCES):
        for run, stop in enumerate(balances.stops):
            for axle in range(-1, balances.axles):
                mine = (rows.balance == balance) & (rows.run == run) & (rows.axle == axle)
                if mine.any():
                    means = {key: float(values[mine].mean()) for key, values in squares.items()}
                    cells.append({"balance": name, "run": stop.name, "axle": axle + 1, **means})
    return {"cells": cells, "places": _places(balances, squares)}


def _places(balances: Replica, squares: Mapping[str, np.ndarray]) -> list[dict[str, Any]]:
    """Mean squares by balance, axle and part of the track, for runs with known start position, or for a single run."""
    rows, cells = balances.rows, []
    placed = _placed(balances)
    if not placed.any():
        return []
    edges = np.linspace(rows.place[placed].min(), rows.place[placed].max() + 1e-6, _STRETCHES + 1)
    which = np.digitize(rows.place, edges) - 1
    for balance, name in enumerate(BALANCES):
        for axle in range(-1, balances.axles):
            for i in range(_STRETCHES):
                mine = placed & (rows.balance == balance) & (rows.axle == axle) & (which == i)
                if mine.any():
                    means = {key: float(values[mine].mean()) for key, values in squares.items()}
                    middle = round(float(0.5 * (edges[i] + edges[i + 1])), 1)
                    cells.append({"balance": name, "axle": axle + 1, "place_m": middle, **means})
    return cells
