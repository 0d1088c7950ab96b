"""What a refit moves, and what its weights let vary in place of it."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize_scalar
from synthetic_stops import stop, write_campaign

from wsp_env.diagnosis import fitting
from wsp_env.diagnosis.balances import Balances, Rows, Whitening
from wsp_env.diagnosis.candidates import Variant, columns, parameter_of, switched, without
from wsp_env.diagnosis.covariance import Evidence
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import refit
from wsp_env.diagnosis.form_errors import forms
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import prepare
from wsp_env.diagnosis.variation import (
    MU_CD,
    ONSET,
    Group,
    Net,
    law_columns,
    nuisances,
    segment_columns,
    shapes,
)
from wsp_env.diagnosis.weights import Weights, free_parameters, weigh
from wsp_env.plant.mechanisms import ALL
from wsp_env.recordings import read_campaign

LAW = Model(2e-4, (0.06, 0.07))


@pytest.fixture(scope="module")
def replica(tmp_path_factory):
    """A stop that slides, and one whose wheels stay on the steep part of their curve, but near the friction that there is."""
    slides = stop(LAW.tau, LAW.mu_cd[0], noise=1.0, seed=1)
    rolls = stop(LAW.tau, LAW.mu_cd[1], peak=0.002, noise=1.0, seed=2)
    folder = tmp_path_factory.mktemp("fitting") / "c"
    write_campaign(folder, {"A1": slides, "B1": rolls}, ["A1"], ["B1"])
    campaign = read_campaign(folder)
    return Replica(Balances(campaign, prepare(campaign)[0]), LAW)


@pytest.fixture(scope="module")
def weights(replica):
    base = replica.raw(LAW)
    law = law_columns(replica, LAW, base)
    groups = [Group("tau", law[:, :1], 1.0, True), Group("mu_cd", law[:, 1:], MU_CD, True)]
    return weigh(replica, replica.whitening(LAW), groups)


def test_the_friction_of_a_stop_that_does_not_slide_is_not_moved(replica, weights):
    assert_array_equal(free_parameters(replica), [True, True, False])
    fitted = refit(replica, LAW, (), weights)
    assert fitted.model.mu_cd[1] == LAW.mu_cd[1]
    assert fitted.model.mu_cd[0] != LAW.mu_cd[0]
    assert fitted.model.tau != LAW.tau


def test_friction_that_differs_between_axles_acts_on_wheels_that_roll_near_it_too(replica):
    """All axles' frictions up by a share is mu_cd of every run up by that share, also where no wheel slides."""
    base = replica.raw(LAW)
    groups = {group.name: group.columns for group in nuisances(replica, LAW, base, replica.whitening(LAW))}
    every = law_columns(replica, LAW, base)[:, 1:].sum(axis=1)
    assert_allclose(groups["friction of an axle"].sum(axis=1), every, rtol=1e-12)
    assert np.abs(every[(replica.rows.run == 1) & replica.rows.wheels]).max() > 0.2 * np.abs(every).max()


def test_a_drag_is_told_whenever_it_sets_in(replica):
    """A brake that drags with 500 N m, from its application on or 0.8 s later: nothing else is said to vary more for that."""
    drag = Variant("dragging_brake", ("torque_nm",), {"axle": 1.0, "from_start": 0.0})
    base, whitening = replica.raw(LAW), replica.whitening(LAW)
    groups = nuisances(replica, LAW, base, whitening)
    (onset,) = (group for group in groups if group.name == ONSET)
    effect = replica.raw(switched(LAW, drag, np.array([500.0]))) - base
    largest = max(float(run.brake_torque_nm.max()) for run in replica.campaign.runs.values())
    until = onset.columns.reshape(len(base), 2, -1, replica.axles)[:, :, :3, 0].sum(axis=(1, 2))  # of axle 1, 0.8 s
    told = []
    for rows in (base - effect, base - effect + 500.0 / largest * until):
        evidence = Evidence(replica, whitening, [*groups, Group("drag", effect[:, None], np.inf, True)], rows, until[:, None])
        sizes = evidence.solve()
        told.append((evidence.amplitudes(sizes)[-1], dict(zip(evidence.names, sizes.groups, strict=True))))
    (exact, before), (found, after) = told
    assert found == pytest.approx(exact, rel=0.02)
    assert after[ONSET] > 2.0 * before[ONSET]
    assert all(after[name] < 1.2 * before[name] for name in before if name != ONSET)


def test_torques_that_wander_by_what_would_matter_in_a_stop_are_a_finding(replica):
    """Axle 1 has 10 % more and less in turns of 4 s; normal variation is 1 % of all axles together."""
    base, whitening = replica.raw(LAW), replica.whitening(LAW)
    groups = nuisances(replica, LAW, base, whitening)
    (course,) = (group for group in groups if group.name == "torque in time")
    assert course.most * course.expected / np.sqrt(replica.axles) == pytest.approx(0.01)
    assert not course.fixed
    turns = course.columns.reshape(len(base), replica.axles, -1)[:, 0] @ (
        0.1 * (-1.0) ** np.arange(course.columns.shape[1] // replica.axles)
    )
    sizes = {}
    for most in (course.most, np.inf):
        given = [group._replace(most=most) if group is course else group for group in groups]
        evidence = Evidence(replica, whitening, given, base + turns)
        sizes[most] = dict(zip(evidence.names, evidence.solve().groups, strict=True))["torque in time"]
    assert sizes[course.most] == course.most
    assert sizes[np.inf] > 1.5 * course.most


@pytest.mark.parametrize("factor", [0.05, 0.3, 3.0, 8.0])
def test_a_refit_finds_the_same_law_from_wherever_it_begins(replica, weights, factor):
    """In the logarithm of tau the rows bend: a step that is cut parameter by parameter leads uphill, and stops far away."""
    near = refit(replica, LAW, (), weights)
    far = refit(replica, dataclasses.replace(LAW, tau=factor * LAW.tau), (), weights)
    assert far.cost == pytest.approx(near.cost, abs=0.1)
    assert far.model.tau == pytest.approx(near.model.tau, rel=0.01)


@pytest.mark.parametrize("variant", [Variant("vehicle_mass", ("extra",), {}), Variant("falling_friction", ("decrease",), {})])
def test_the_form_of_a_mechanism_holds_nothing_of_its_size(replica, variant):
    """Bent over what was measured, less the effect itself: both at right angles as seen beside the law."""
    size = parameter_of(variant.name, variant.sizes[0])
    model = switched(LAW, variant, np.array([size.null + 0.5 * (size.typical - size.null)]))
    whitening, base = replica.whitening(LAW), replica.raw(model)
    net = Net(whitening, np.column_stack([segment_columns(replica), law_columns(replica, model, base)]))
    effect = replica.raw(without(model, variant)) - base
    (form,) = forms(replica, model, [variant], whitening)
    seen = whitening(net(np.column_stack([effect, form.columns]))[0])
    cosines = seen[:, 0] @ seen[:, 1:] / np.maximum(np.linalg.norm(seen[:, 0]) * np.linalg.norm(seen[:, 1:], axis=0), 1e-12)
    assert np.abs(cosines).max() < 1e-6
    assert np.linalg.norm(seen[:, 1:]) > 0.1 * np.linalg.norm(seen[:, 0])


@pytest.mark.parametrize("over", ["speed", "time"])
def test_a_form_may_be_wrong_over_speed_and_time(replica, over):
    """As a straight line, or bent; what a brake that fades after the stop began left had been a drag of the air."""
    bent, values = shapes(replica), getattr(replica.rows, over)
    left = values - bent @ np.linalg.lstsq(bent, values, rcond=None)[0]
    assert np.abs(left).max() < 1e-9 * np.ptp(values)


def test_what_a_refit_does_not_move_varies_in_its_weights_as_much_as_it_is_believed_to(replica, weights):
    """A nuisance c of deviation 1 leaves c'c / (1 + c'c) of its own column; of what is moved all is left."""
    law = weights(law_columns(replica, LAW, replica.raw(LAW))) * [1.0, MU_CD, MU_CD]
    squares, left = np.sum(law**2, axis=0), np.diag(weights.projector.inner(law, law))
    assert squares[2] > 10.0  # the stop would tell its friction, were it not left to the weights
    assert left[2] == pytest.approx(squares[2] / (1.0 + squares[2]), rel=1e-9)
    assert left[1] == pytest.approx(squares[1], rel=1e-9)


@pytest.mark.parametrize("variant", [Variant("sanding", ("share",), {"axle": 1.0}), Variant("vehicle_mass", ("extra",), {})])
def test_at_a_bound_a_derivative_is_taken_on_the_inner_side(replica, variant):
    """A step beyond the bound is none: its column would be rounding, and a refit would go wherever that points."""
    (size,) = variant.sizes
    parameter = parameter_of(variant.name, size)
    for bound, inside in ((parameter.high, -1.0), (parameter.low, 1.0)):
        model = switched(LAW, variant, np.array([bound]))
        base, step = replica.raw(model), abs(float(variant.moves()[0]))
        moved = replica.raw(switched(LAW, variant, np.array([bound + inside * 0.01 * step])))
        derivative = (moved - base) / 0.01 * inside
        for sign in (1.0, -1.0):
            stepped = dataclasses.replace(variant, steps=(sign * step,))
            found = columns(replica, model, base, stepped)[:, 0]
            assert np.linalg.norm(found - sign * derivative) < 0.02 * np.linalg.norm(derivative)


class _Bent:
    """A replica whose residuals y - f(size) are known; the law is known too."""

    determinant = 0.0

    def __init__(self, y, effect):
        self._y, self._effect = y, effect
        self.rows = Rows(**{one.name: np.zeros(len(y), dtype=int) for one in dataclasses.fields(Rows)})
        self.stops, self.campaign = (None,), SimpleNamespace(contact=SimpleNamespace(kinetic_friction_r=0.28))

    def raw(self, model, beside=None):
        values = {one.name: 0.0 for one in ALL["brake_delay"].parameters} | dict(model.choice.get("brake_delay", {}))
        return self._y - self._effect(values["lag_s"], values["rise_share"])


DELAY = Variant("brake_delay", ("lag_s",), {"axle": 0.0, "rise_share": 0.0})
TIME = np.linspace(0.0, 1.0, 200)


def one_kind(nuisances):
    """Return weights of rows with white noise of deviation 0.01 and these nuisances (n, k)."""
    scaled = np.column_stack([np.zeros((len(TIME), 0)), nuisances]) / 0.01
    projector = Projector.of(scaled, np.ones(scaled.shape[1], dtype=bool))
    return Weights(Whitening(np.full(len(TIME), 0.01), ()), np.ones(len(TIME)), projector)


def test_small_sizes_of_what_is_fitted_change_no_fit_of_a_linear_effect(monkeypatch):
    """But they widen its interval: of the whole, a part may be of the small one."""
    monkeypatch.setattr(fitting, "law_columns", lambda balances, *_: np.zeros((len(TIME), 2)))
    slope, small_s = np.sin(20.0 * TIME), 0.01
    rows = _Bent(0.3 * slope + 0.01 * np.random.default_rng(1).standard_normal(len(TIME)), lambda lag, _: lag * slope)
    weights = one_kind(small_s * slope[:, None])
    found = [refit(rows, Model(2e-4, (0.06,)), (DELAY,), one) for one in (weights, weights.freed(small_s * slope[:, None]))]
    assert found[0].values[0] == pytest.approx(found[1].values[0], rel=1e-6)
    assert found[0].cost == pytest.approx(found[1].cost, rel=1e-6)
    assert found[0].covariance[0] == pytest.approx(found[1].covariance[0], rel=1e-6)
    own = 0.01**2 / float(slope @ slope)
    assert found[1].covariance[0][0, 0] == pytest.approx(own + small_s**2, rel=1e-3)


def test_a_parameter_at_its_bound_does_not_keep_the_others_from_moving(monkeypatch):
    """The rise share would fall below 0, and a lag beside it is then another than alone."""
    monkeypatch.setattr(fitting, "law_columns", lambda balances, *_: np.zeros((len(TIME), 2)))
    first, second = np.sin(20.0 * TIME), np.sin(20.0 * TIME) + 0.5 * np.cos(20.0 * TIME)
    rows = _Bent(0.3 * first - 0.2 * second, lambda lag, share: lag * first + share * second)
    both = Variant("brake_delay", ("lag_s", "rise_share"), {"axle": 0.0})
    start = switched(Model(2e-4, (0.06,)), both, np.array([0.2, 0.0]))
    fitted = refit(rows, start, (both,), one_kind(np.zeros((len(TIME), 0))))
    alone = float(first @ (0.3 * first - 0.2 * second)) / float(first @ first)
    assert fitted.values[0] == pytest.approx([alone, 0.0], rel=1e-4)


@pytest.mark.parametrize("begin", [0.05, 0.5])
def test_a_fit_of_a_bent_effect_ends_where_the_squares_are_least(monkeypatch, begin):
    """Also beside what it cannot explain: slopes over a whole step of the search would lead it elsewhere."""
    monkeypatch.setattr(fitting, "law_columns", lambda balances, *_: np.zeros((len(TIME), 2)))

    def effect(lag, _):
        return np.exp(-TIME / (0.05 + lag))

    observed = effect(0.3, 0.0) + 0.3 * np.exp(-(((TIME - 0.2) / 0.1) ** 2))
    rows = _Bent(observed, effect)
    start = switched(Model(2e-4, (0.06,)), DELAY, np.array([begin]))
    fitted = refit(rows, start, (DELAY,), one_kind(np.zeros((len(TIME), 0))))
    best = minimize_scalar(
        lambda lag: np.sum(((observed - effect(lag, 0.0)) / 0.01) ** 2), bounds=(0.01, 1.0), method="bounded"
    )
    assert fitted.cost == pytest.approx(best.fun, abs=0.1)
    assert fitted.values[0] == pytest.approx(best.x, rel=1e-3)


def test_beside_large_residuals_a_step_goes_where_the_squares_along_it_are_least(monkeypatch):
    """What an effect bends to is missing in the recording: a whole Gauss-Newton step would be too long by half."""
    monkeypatch.setattr(fitting, "law_columns", lambda balances, *_: np.zeros((len(TIME), 2)))
    along, bent = np.linalg.qr(np.column_stack([np.sin(20.0 * TIME), np.cos(20.0 * TIME)]))[0].T
    begin_s = 0.1
    rows = _Bent(0.01 * along - 0.3 * bent, lambda lag, _: (lag - begin_s) * along + (lag - begin_s) ** 2 * bent)
    begin, weights = switched(Model(2e-4, (0.06,)), DELAY, np.array([begin_s])), one_kind(np.zeros((len(TIME), 0)))
    every, law_stays = np.ones(len(TIME), dtype=bool), np.zeros(2, dtype=bool)
    state = fitting._State(rows, begin, (DELAY,), weights, every, law_stays)
    system = state.system()
    whole = float(state._moved(system.steps, state._step(system, 0.0)).choice["brake_delay"]["lag_s"])
    taken = float(state.after(system, 0.0).model.choice["brake_delay"]["lag_s"])

    def squares(lag):
        return float(np.sum(rows.raw(switched(Model(2e-4, (0.06,)), DELAY, np.array([lag]))) ** 2))

    best = minimize_scalar(squares, bounds=(0.05, 0.15), method="bounded", options={"xatol": 1e-8}).x
    assert whole - begin_s > 1.4 * (best - begin_s) > 0.0
    assert taken - begin_s == pytest.approx(best - begin_s, rel=0.02)
