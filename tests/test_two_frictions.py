"""Friction that falls with the running or the slip speed: measured and other curves, and which of the two frictions falls."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from wsp_env.contact.traction import Surface
from wsp_env.diagnosis.answer import Estimate
from wsp_env.diagnosis.words import capital, mechanism_words
from wsp_env.parameters.uic_z1 import BOGIE, COACH
from wsp_env.plant.mechanisms import Active, derive, falling_friction, make, remember, speed_dependent_friction
from wsp_env.plant.mechanisms.speed_dependent_friction import (
    BEND,
    FALL,
    REFERENCE_MPS,
    Parameters,
    friction_factor,
    recovered_friction_factor,
)
from wsp_env.plant.slots import at_speed

BELIEVED = COACH.contact.law
SPEEDS = np.array([0.0, 2.0, 10.0, 20.0, 40.0, 60.0])


def test_the_typical_values_are_the_curve_of_curtius_and_kniffler():
    """Curtius and Kniffler, Glasers Annalen 1944: 7.5 / (V + 44) + 0.161, V in km/h."""
    typical = Parameters(**{one.name: one.typical for one in speed_dependent_friction.CARD.parameters})
    theirs = 7.5 / (3.6 * SPEEDS + 44.0) + 0.161
    at_reference = 7.5 / (3.6 * REFERENCE_MPS + 44.0) + 0.161
    for factor in (friction_factor, recovered_friction_factor):
        assert_allclose([factor(typical, v) for v in SPEEDS], theirs / at_reference, rtol=1e-12)


@given(st.floats(0.0, 3.0), st.floats(0.0, 0.2))
def test_the_bend_changes_neither_the_friction_nor_its_slope_at_the_reference_speed(share, bend):
    p, h = Parameters(share, bend, 1.0), 1e-4
    assert friction_factor(p, REFERENCE_MPS) == 1.0
    slope = (friction_factor(p, REFERENCE_MPS + h) - friction_factor(p, REFERENCE_MPS - h)) / (2.0 * h)
    assert slope == pytest.approx(-share * FALL, rel=1e-6, abs=1e-9)


def test_no_factor_is_absurd():
    every = [friction_factor(Parameters(share, bend, 1.0), v) for share in (0.0, 3.0) for bend in (0.0, 0.2) for v in SPEEDS]
    assert 0.0 < min(every) <= max(every) <= 3.0


@pytest.mark.parametrize(("recovered", "which"), [(1.0, "Friction falls"), (0.1, "The contaminant layer's friction falls")])
@pytest.mark.parametrize(("name", "size"), [("speed_dependent_friction", "share"), ("falling_friction", "decrease")])
def test_the_sentence_says_which_friction_falls(name, size, recovered, which):
    estimates = {size: Estimate(1.8, "-", (1.5, 2.1)), "recovered": Estimate(recovered, "-", (0.0, 1.2))}
    assert capital(mechanism_words(name, estimates)).startswith(which)


def test_without_a_bend_the_fall_is_a_straight_line_that_stays_positive():
    line = [friction_factor(Parameters(1.0, 0.0, 1.0), v) for v in SPEEDS]
    assert_allclose(np.diff(line) / np.diff(SPEEDS), -FALL, rtol=1e-9)
    assert friction_factor(Parameters(3.0, 0.0, 1.0), 90.0) > 0.0


@pytest.mark.parametrize("recovered", [0.0, 0.5, 1.0, 2.0])
def test_the_recovered_friction_has_its_own_share(recovered):
    p = Parameters(0.6, BEND, recovered)
    expected = [friction_factor(Parameters(0.6 * recovered, BEND, 1.0), v) for v in SPEEDS]
    assert_allclose([recovered_friction_factor(p, v) for v in SPEEDS], expected, rtol=1e-12)


def test_a_wheel_meets_both_and_never_more_on_the_contaminated_rail():
    choice = make({"speed_dependent_friction": {"share": 2.0, "recovered": 0.0}})
    active = Active(choice, derive(BOGIE), remember(1, BOGIE.axle_positions_m))
    on = Surface(0.06, 0.28, 1.0, 0.0)
    slow, fast = (at_speed(v, on, active) for v in (1.0, 40.0))
    assert slow.mu_cr == fast.mu_cr == 0.28
    assert slow.mu_cd > 0.06 > fast.mu_cd
    clean = at_speed(0.0, Surface(0.28, 0.28, 1.0, 0.0), active)
    assert clean.mu_cd == clean.mu_cr


@pytest.mark.parametrize(("recovered", "gamma_r", "ratio_r"), [(1.0, 1.8, 1.0 / 4.0), (0.0, 0.6, 0.4), (0.5, 1.2, 1.0 / 3.25)])
def test_the_recovered_friction_falls_with_the_slip_by_its_own_share(recovered, gamma_r, ratio_r):
    """gamma 0.2 and 0.6 s/m, A = 0.4 of both: Table 2 of the seed paper. The excess 1 / A - 1 is 1.5, doubled 3."""
    law = falling_friction.law(falling_friction.Parameters(3.0, 2.0, recovered), BELIEVED)
    assert (law.gamma_d, law.ratio_d) == (pytest.approx(0.6), pytest.approx(1.0 / 4.0))
    assert (law.gamma_r, law.ratio_r) == (pytest.approx(gamma_r), pytest.approx(ratio_r))


@given(st.floats(0.0, 20.0), st.floats(0.0, 5.0), st.floats(0.0, 2.0))
def test_a_fall_with_the_slip_never_turns_into_a_rise(decrease, excess, recovered):
    law = falling_friction.law(falling_friction.Parameters(decrease, excess, recovered), BELIEVED)
    assert min(law.gamma_d, law.gamma_r) >= 0.0
    assert max(law.ratio_d, law.ratio_r) <= 1.0


def test_at_the_null_the_law_is_the_believed_one():
    assert falling_friction.law(falling_friction.Parameters(1.0, 1.0, 0.3), BELIEVED) == BELIEVED
