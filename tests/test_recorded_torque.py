"""What shows in the course of the torque is evaluated under the recorded torques, everything else under the expected ones."""

import pytest
from numpy.testing import assert_allclose
from replica_cases import LAW, sound_balances

from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.plant.mechanisms.terms import Feature, Slot


def term(number, feature, coefficient, scale):
    """Return the parameters of a term in the brake torque of all axles."""
    of = {"coefficient": coefficient, "slot": Slot.BRAKE_TORQUE, "axles": 0.0, "feature": feature, "scale": scale}
    return {f"{name}_{number}": float(value) for name, value in of.items()}


PLAY = term(1, Feature.TORQUE_PLAY, 800.0, 0.09)
FADING = term(2, Feature.TORQUE_SETTLING, -500.0, 8.0)
DELAY = {"lag_s": 0.1, "axle": 0.0}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return sound_balances(tmp_path_factory.mktemp("torque") / "c")


def with_terms(**terms):
    return Model(LAW.tau, LAW.mu_cd, terms)


def change(balances, model, less):
    """Return the change of the forces (T, A) in the first stop."""
    return balances.evaluate(model)[0].force - balances.evaluate(less)[0].force


@pytest.mark.parametrize(
    ("model", "recorded"),
    [
        (with_terms(discovered=PLAY), True),
        (with_terms(brake_delay=DELAY), True),
        (with_terms(discovered=FADING), False),
    ],
)
def test_play_and_delays_follow_the_recorded_torque(sound, model, recorded):
    replica = Replica(sound, LAW)
    expected = change(replica.timed if recorded else replica._copy, model, LAW)
    assert_allclose(change(replica, model, LAW), expected, atol=1e-6 * abs(expected).max())
    other = change(replica._copy if recorded else replica.timed, model, LAW)
    assert abs(other - expected).max() > 1e-3 * abs(expected).max()


def test_only_the_term_that_follows_the_torque_does_so(sound):
    both, replica = with_terms(discovered=PLAY | FADING), Replica(sound, LAW)
    faded = with_terms(discovered=PLAY | FADING | {"coefficient_1": 0.0})
    expected = change(replica.timed, both, faded) + change(replica._copy, faded, LAW)
    assert_allclose(change(replica, both, LAW), expected, atol=1e-6 * abs(expected).max())


def test_a_replica_about_play_changes_by_the_difference_only(sound):
    about = with_terms(discovered=PLAY)
    replica, more = Replica(sound, about), with_terms(discovered=PLAY | {"coefficient_1": 900.0})
    assert_allclose(replica.evaluate(about)[0].force, replica._copy.evaluate(about)[0].force, rtol=1e-12)
    expected = change(replica.timed, more, about)
    assert_allclose(change(replica, more, about), expected, atol=1e-6 * abs(expected).max())


@pytest.mark.parametrize("late", [{"brake_delay": DELAY}, {"discovered": PLAY}])
def test_a_derivative_beside_a_model_keeps_what_its_delays_and_play_do(sound, late):
    replica, model = Replica(sound, LAW), with_terms(**late)
    weaker = {"brake_gain_imbalance": {"gain": -0.01, "axle": 1.0}}
    moved, prompt = with_terms(**late, **weaker), with_terms(**weaker)
    found = replica.evaluate(moved, beside=model)[0].force - replica.evaluate(model)[0].force
    assert_allclose(found, change(replica._copy, prompt, LAW), atol=1e-9 * abs(found).max())
    exact = change(replica, moved, model)
    assert 0.0 < abs(found - exact).max() < 0.2 * abs(found).max()


def test_a_derivative_by_a_delay_is_exact(sound):
    replica, model = Replica(sound, LAW), with_terms(brake_delay=DELAY)
    later = with_terms(brake_delay=DELAY | {"lag_s": 0.11})
    exact = replica.evaluate(later)[0].force
    assert_allclose(Replica(sound, LAW).evaluate(later, beside=model)[0].force, exact, rtol=1e-12)
