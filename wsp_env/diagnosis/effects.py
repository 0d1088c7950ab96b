"""Effects of the mechanisms found: each one's curve through the residuals, and held-out runs before and after."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from wsp_env.diagnosis.answer import Curve, Estimate, Location, RunFigures, RunTrace
from wsp_env.diagnosis.balances import ACTUATOR, ADHESION, BALANCES, KINEMATICS, VEHICLE, Balances
from wsp_env.diagnosis.candidates import parameter_of
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.weights import Weights
from wsp_env.plant.mechanisms import ALL, at_stop
from wsp_env.recordings import Smoothing, derive, rolling_radii
from wsp_env.recordings import simulate as simulation
from wsp_env.recordings.derive import braking

_BINS = 16
_LEAST_ROWS = 5  # per bin
_ACTS = 0.02  # share of a mechanism's largest change of a residual, from which on a row counts as affected
_COURSE_POINTS = 200
_UNITS = {"slip": "slip speed [m/s]", "work": "W_sp [J/m]", "place": "place [m]", "time": "time [s]", "speed": "speed [m/s]",
          "axle": "axle [-]", "deceleration": "deceleration [m/s2]"}  # fmt: skip


def curve(balances: Replica, extended: Model, weights: Weights, name: str, parameters: Mapping[str, Estimate]) -> Curve:
    """Return a mechanism's change of the residuals in the balance that shows it best, fitted and observed.

    The observed change is the fitted change plus the residual of the extended model (partial residuals).
    """
    without = dataclasses.replace(extended, choice={k: v for k, v in extended.choice.items() if k != name})
    base = balances.raw(extended)
    white = weights.projector.rest(weights(base))
    rest = weights.whitening.back(white * weights.noise)
    explained = balances.raw(without) - base
    rows, shown = balances.rows, weights(explained) ** 2
    balance = int(np.argmax([shown[rows.balance == i].sum() for i in range(len(BALANCES))]))
    mine = (rows.balance == balance) & (np.abs(explained) > _ACTS * np.abs(explained[rows.balance == balance]).max(initial=0.0))
    over = ALL[name].signature.over
    values = rows.axle + 1.0 if over == "axle" else getattr(rows, over)
    edges = np.unique(np.quantile(values[mine], np.linspace(0.0, 1.0, _BINS + 1))) if mine.any() else np.zeros(0)
    if over == "axle":
        edges = np.arange(balances.axles + 1) + 0.5
    which = np.digitize(values, edges[1:-1])
    points = []
    for i in range(max(len(edges) - 1, 0)):
        part = mine & (which == i)
        if part.sum() >= _LEAST_ROWS:
            observed = explained[part] + rest[part]
            points.append(
                (values[part].mean(), observed.mean(), rest[part].std() / np.sqrt(part.sum()), explained[part].mean())
            )
    x, observed, deviation, fitted = np.array(points).reshape(-1, 4).T
    low, high = _interval(name, parameters)
    bounds = np.sort([low * fitted, high * fitted], axis=0)
    quantity = {VEHICLE: "speed [m/s]", ACTUATOR: "brake torque [N m]"}.get(balance, "adhesion coefficient [-]")
    return Curve(
        BALANCES[balance], _UNITS[over], f"change of the {quantity}", *(tuple(map(float, a)) for a in (
            x, observed, deviation, fitted, bounds[0], bounds[1]))
    )  # fmt: skip


def _interval(name: str, parameters: Mapping[str, Estimate]) -> tuple[float, float]:
    """Bounds of the first size over its value: the factors by which the whole curve may be smaller or larger."""
    size, first = next(iter(parameters.items()))
    null = parameter_of(name, size).null
    change = first.value - null
    if change == 0.0:
        return 1.0, 1.0
    low, high = sorted((bound - null) / change for bound in first.interval90)
    return float(low), float(high)


def held_out(balances: Balances, before: Model, after: Model) -> tuple[RunFigures, ...]:
    """Return the paper's figures of every run, simulated before and after: Table 4 and eqs. (19) to (21).

    Speeds are those of the whole stop, simulated with the recorded torque. Compare their statistics only: sample by sample, the
    simulation diverges from the recording.
    """
    smoothing, campaign = Smoothing(), balances.campaign
    radii = rolling_radii(campaign, smoothing)
    pieces, lengths = zip(
        *(_piece(balances, radii, smoothing, model, i) for i in range(len(balances.stops)) for model in (before, after)),
        strict=True,
    )
    whole = simulation.simulate_pieces(campaign, pieces, radii, max(lengths))
    sides = [(balances.evaluate(model), balances.raw(model)) for model in (before, after)]
    figures = []
    for i, stop in enumerate(balances.stops):
        errors, speeds, slides = [], [], []
        mine = (balances.rows.run == i) & (balances.rows.balance == VEHICLE)
        for side, (evaluations, raw) in enumerate(sides):
            measured = evaluations[i].force / (2.0 * evaluations[i].believed_load)  # as the residuals are
            errors.append(_adhesion_errors(balances, i, measured, raw))
            speeds.append(float(np.abs(raw[mine]).max(initial=0.0)))
            at = len(sides) * i + side
            slides.append(simulation.slide(pieces[at].derived, whole.piece(at, lengths[at]), pieces[at].start))
        figures.append(
            RunFigures(
                stop.name, stop.group, errors[0], errors[1], speeds[0], speeds[1],
                *(value for key in ("mean", "deviation") for value in (
                    getattr(slides[0], f"recorded_{key}_mps"), getattr(slides[0], f"simulated_{key}_mps"),
                    getattr(slides[1], f"simulated_{key}_mps"))),
            )
        )  # fmt: skip
    return tuple(figures)


def course(balances: Balances, before: Model, after: Model, where: Sequence[Location] = ()) -> RunTrace | None:
    """Return the time series of the axle and the run that show the finding best; None if there is no wheel row.

    The run is a held-out one. If the first location in `where` contains no held-out run, it is one of that location's runs. The
    axle is the one that a mechanism names, else one of that location, else any. Among these, the series with the largest change
    by the mechanisms is chosen, whether the fit improves or not: noise is common to both sides and cancels. If nothing was
    found, it is the series that the baseline fits worst beyond noise while sliding: on the steep part of the creep curve, an
    error of slip within the noise changes the prediction much.
    """
    rows = balances.rows
    scored = rows.validate if rows.validate.any() else np.ones(len(rows), dtype=bool)
    seen_in = [i for i, stop in enumerate(balances.stops) if any(stop.name in one.runs for one in where[:1])]
    if after.choice and seen_in and not np.isin(rows.run[scored], seen_in).any():
        scored = np.isin(rows.run, seen_in)
    # Freely rolling wheels fit still worse; show them only if they are the finding.
    rolls = bool(where) and where[0].equation == BALANCES[KINEMATICS]
    wheels = (rows.wheels if rolls else rows.balance == ADHESION) & scored
    if not wheels.any():
        return None
    base, extended = balances.raw(before), balances.raw(after)
    named = _named_axles(after)
    axles = named or [axle - 1 for one in where[:1] for axle in one.axles] or range(balances.axles)

    def size(mine: np.ndarray) -> float:
        if after.choice:
            return _mean_square(base - extended, mine)
        return _systematic(base[mine & (~rows.wheels | rows.slides)])

    def worst(k: int) -> float:
        return max(size(wheels & (rows.axle == k) & (rows.run == i)) for i in range(len(balances.stops)))

    axle = max(axles, key=worst)
    chosen = "the one that is named" if named else "the one that it moves most" if after.choice else "the one fitted worst"
    speed = _about_vehicle(balances, base, extended, where) and not named
    shown = (rows.balance == VEHICLE) & scored if speed else wheels & (rows.axle == axle)
    run = max(range(len(balances.stops)), key=lambda i: size(shown & (rows.run == i)))
    mine = _thinned(wheels & (rows.run == run) & (rows.axle == axle))
    vehicle = _thinned((rows.run == run) & (rows.balance == VEHICLE))
    one = balances.evaluate(before)[run]
    measured = np.zeros(len(rows))
    measured[(rows.run == run) & rows.wheels] = balances.parts[run].wheel_rows(one.force / (2.0 * one.load))

    def floats(values: np.ndarray) -> tuple[float, ...]:
        return tuple(map(float, values))

    return RunTrace(
        run=balances.stops[run].name,
        group=balances.stops[run].group,
        axle=axle + 1,
        time_s=floats(rows.time[mine]),
        adhesion_measured=floats(measured[mine]),
        adhesion_before=floats((measured - base)[mine]),
        adhesion_after=floats((measured - extended)[mine]),
        speed_time_s=floats(rows.time[vehicle]),
        speed_residual_before_mps=floats(base[vehicle]),
        speed_residual_after_mps=floats(extended[vehicle]),
        shows="speed" if speed else "adhesion",
        chosen=chosen,
    )


def _named_axles(model: Model) -> list[int]:
    """Return the axle, from 0, that a model's first mechanism names; empty if there is none, or if it means all axles."""
    for name, values in list(model.choice.items())[:1]:
        whole = [one.name for one in ALL[name].parameters if one.kind == "axle"]
        return [round(values[one]) - 1 for one in whole if values.get(one, 0.0) >= 1.0]
    return []


def _about_vehicle(balances: Balances, base: np.ndarray, extended: np.ndarray, where: Sequence[Location]) -> bool:
    """Whether the vehicle balance shows the finding best; without `where`, by the relative decrease of the residuals."""
    if where:
        return where[0].equation == BALANCES[VEHICLE]
    rows = balances.rows
    fall = []
    for mine in (rows.balance == VEHICLE, rows.wheels):
        left = max(_mean_square(extended, mine), 1e-30)
        fall.append(mine.sum() * (_mean_square(base, mine) / left - 1.0))
    return bool(fall[0] > fall[1])


def _systematic(values: np.ndarray) -> float:
    """Mean square of a series (n,) less its noise, half the mean square of successive differences (von Neumann 1941)."""
    if len(values) < _LEAST_ROWS:
        return 0.0
    return float(np.mean(values**2) - 0.5 * np.mean(np.diff(values) ** 2))


def _mean_square(values: np.ndarray, mine: np.ndarray) -> float:
    return float(np.mean(values[mine] ** 2)) if mine.any() else 0.0


def _thinned(mask: np.ndarray) -> np.ndarray:
    """Return the indices of at most `_COURSE_POINTS` rows of a mask, evenly thinned."""
    index = np.flatnonzero(mask)
    return index[:: -(-len(index) // _COURSE_POINTS) or 1]


def _adhesion_errors(balances: Balances, i: int, measured: np.ndarray, raw: np.ndarray) -> tuple[float | None, ...]:
    """Mean absolute adhesion error over mean adhesion, for each axle of a stop while it slides; None without enough rows."""
    rows, part = balances.rows, balances.parts[i]
    recorded = np.zeros(len(rows))
    recorded[(rows.run == i) & rows.wheels] = part.wheel_rows(measured)
    errors: list[float | None] = []
    for axle in range(balances.axles):
        mine = (rows.run == i) & (rows.axle == axle) & rows.slides
        enough = mine.sum() >= _LEAST_ROWS
        errors.append(float(np.abs(raw[mine]).mean() / np.abs(recorded[mine]).mean()) if enough else None)
    return tuple(errors)


def _piece(
    balances: Balances, radii: np.ndarray, smoothing: Smoothing, model: Model, i: int
) -> tuple[simulation.Piece, int]:  # fmt: skip
    """Return the braking of a stop under a model, without errors of its sensors, and its length in samples."""
    campaign, stop = balances.campaign, balances.stops[i]
    run = campaign.runs[stop.name]
    derived = derive(campaign, run, radii, smoothing)
    start, end = braking(run, campaign.sample_time_s, smoothing)
    fast = np.flatnonzero(derived.speed_mps > smoothing.least_speed_mps)
    end = max(min(end, int(fast[-1]) + 1 if fast.size else start), start + 2)
    choice = {name: values for name, values in model.choice.items() if ALL[name].signature.acts_on != "sensor"}
    return simulation.Piece(run, derived, start, model.mu_cd[i], model.tau, at_stop(choice, stop.earlier)), end - start
