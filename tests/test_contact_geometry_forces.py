"""Hertz and Kalker for the ellipse at hand, slip, and the laws on the resultant with spin."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.contact.geometry.detect import scan
from wsp_env.contact.geometry.equilibrium import settled
from wsp_env.contact.geometry.forces import Motion, Slip, slip_at, tangential
from wsp_env.contact.geometry.patch import damping_of, make_patch_table, normal_force, patch_at, stiffness_at
from wsp_env.contact.geometry.port import ANGLE, ROLLING_RADIUS, Pose, Y, empty_contacts
from wsp_env.contact.geometry.standard import s1002, uic60
from wsp_env.contact.geometry.track import Track, Wheelset, make_pair
from wsp_env.contact.hertz import hertz
from wsp_env.contact.kalker import kalker_coefficients, linear_force
from wsp_env.contact.polach import polach_force
from wsp_env.contact.port import LAWS
from wsp_env.contact.traction import Surface
from wsp_env.parameters.contact import ELLIPSE_LOAD_N, ContactParameters

pytestmark = pytest.mark.plain

YOUNG, POISSON = 2.0 * 82e9 * 1.28, 0.28
TABLE = make_patch_table(YOUNG, POISSON)
PAIR = make_pair(s1002(), uic60(), Wheelset(), Track())
CONTACT = ContactParameters()
ON = Surface(0.06, CONTACT.kinetic_friction_r, 1.0, 0.0)
TREAD = patch_at(1.1, 0.6, 52e3, TABLE)
LOAD, SPEED, TAU = 52e3, 20.0, 1.9e-4


@pytest.mark.parametrize("sums", [(1.1, 0.4), (0.8, 0.2814), (1.0, 1.0), (1.1, 25.0), (0.45, 63.0)])
def test_table_gives_hertz_and_kalker(sums):
    ellipse = hertz(*sums, LOAD, YOUNG, POISSON)
    patch = patch_at(*sums, LOAD, TABLE)
    assert_allclose([patch.semi_axis_a, patch.semi_axis_b], [ellipse.semi_axis_a_m, ellipse.semi_axis_b_m], rtol=5e-5)
    assert_allclose(stiffness_at(*sums, TABLE) * ellipse.approach_m**1.5, LOAD, rtol=5e-5)
    ratio = min(patch.semi_axis_a / patch.semi_axis_b, 10.0)
    assert_allclose([patch.c11, patch.c22, patch.c23], kalker_coefficients(ratio, POISSON), rtol=2e-4)
    assert patch.shear_modulus == pytest.approx(82e9)


def test_no_curvature_gives_no_nan():
    for sums in ((1.1, 1e-9), (1.1, 0.0), (1e-9, 1.1)):
        assert np.all(np.isfinite(patch_at(*sums, LOAD, TABLE)))
        assert math.isfinite(stiffness_at(*sums, TABLE))
    assert patch_at(1.1, 0.6, 0.0, TABLE).semi_axis_a == 0.0


def test_normal_force_pushes_only_and_damps():
    stiffness = stiffness_at(1.1, 0.6, TABLE)
    assert normal_force(-1e-6, 1.0, stiffness, 0.3) == 0.0
    assert normal_force(math.nan, 1.0, stiffness, 0.3) == 0.0
    assert normal_force(1e-4, -100.0, stiffness, 0.3) == 0.0
    assert normal_force(1e-4, 0.0, stiffness, 0.3) == pytest.approx(stiffness * 1e-6)
    # Half a wheelset let go beside its equilibrium: the decrement of one contact is that of its damping ratio.
    mass, ratio = 650.0, 0.05
    damping = damping_of(ratio, LOAD, mass, stiffness)
    rest = (LOAD / stiffness) ** (2.0 / 3.0)
    p, speed, step, peaks = 1.001 * rest, 0.0, 1e-6, []
    for _ in range(30000):
        before = speed
        speed += step * (LOAD - normal_force(p, speed, stiffness, damping)) / mass
        p += step * speed
        if before > 0.0 >= speed:
            peaks.append(p / rest - 1.0)
    decrement = math.log(peaks[0] / peaks[2]) / 2.0
    assert decrement == pytest.approx(2.0 * math.pi * ratio / math.sqrt(1.0 - ratio**2), rel=0.01)


def rolling(pose: Pose, side: float, motion: Motion) -> tuple[Slip, np.ndarray]:
    rows = empty_contacts()
    assert scan(pose, side, PAIR, rows) > 0
    return slip_at(motion, pose, PAIR.radius, rows, 0), rows[0]


def test_a_wheel_that_rolls_has_spin_only():
    pose = settled(2e-3, 0.0, PAIR)
    for side in (1.0, -1.0):
        radius = rolling(pose, side, Motion(0, 0, 0, 0, 0, 0))[1][ROLLING_RADIUS]
        turn = SPEED / radius  # about the axle, which is rolled
        slip, row = rolling(pose, side, Motion(SPEED, 0.0, 0.0, 0.0, turn * math.cos(pose.roll), turn * math.sin(pose.roll)))
        assert_allclose([slip.x, slip.y, slip.approach], 0.0, atol=1e-9)
        assert slip.spin == pytest.approx(-turn * math.sin(row[ANGLE] - pose.roll), rel=1e-9)


def test_slip_of_braking_yaw_and_fall():
    pose = settled(0.0, 0.0, PAIR)
    slip, row = rolling(pose, 1.0, Motion(SPEED, 0.3, -0.1, 0.0, 0.0, 0.0))
    assert slip.x == SPEED
    c, s = math.cos(row[ANGLE]), math.sin(row[ANGLE])
    assert_allclose([slip.y, slip.approach], [0.3 * c - 0.1 * s, 0.1 * c + 0.3 * s], rtol=1e-12)
    turned, row = rolling(pose, 1.0, Motion(0, 0, 0, 0, 0, 0.02))  # left wheel goes back as the wheelset yaws to the left
    assert turned.x == pytest.approx(-0.02 * row[Y], rel=1e-9)


@pytest.mark.parametrize("law", ["degraded", "classic"])
def test_without_lateral_slip_it_is_the_law_of_one_dimension(law):
    record = LAWS[law].make(CONTACT)
    stiffness = 0.25 * math.pi * TREAD.shear_modulus * TREAD.semi_axis_a * TREAD.semi_axis_b * TREAD.c11
    for creepage in (1e-4, -0.01, 0.2):
        slip = creepage * SPEED
        found = tangential(Slip(slip, 0.0, 0.0, 0.0), SPEED, LOAD, TREAD, ON, TAU, record)
        tau = TAU if law == "degraded" else 0.0
        one = LAWS["degraded"].make(CONTACT)._replace(stiffness=stiffness)
        expected = float(degraded_adhesion(slip, SPEED, LOAD, ON.mu_cd, tau, one))
        assert found.x == pytest.approx(expected * LOAD, rel=1e-9)
        assert found.y == 0.0
        assert found.work == pytest.approx(abs(found.x * creepage), rel=1e-12)


def test_with_polachs_law_it_is_polachs_force():
    record = LAWS["polach"].make(CONTACT)
    for creep_x, creep_y, spin in ((0.002, 0.001, 0.1), (0.02, -0.01, -0.5), (0.0, 0.004, 0.2), (1e-5, 0.0, 0.3)):
        slip = Slip(creep_x * SPEED, creep_y * SPEED, spin * SPEED, 0.0)
        found = tangential(slip, SPEED, LOAD, TREAD, ON, 0.0, record)
        expected = polach_force(
            creep_x, creep_y, spin, math.hypot(slip.x, slip.y), LOAD, TREAD, ON.mu_cd, record.ratio_d, record.gamma_d,
            record.k_a, record.k_s,
        )  # fmt: skip
        assert_allclose([found.x, found.y], expected, rtol=1e-9, atol=1e-9)


def test_small_creepages_give_kalkers_linear_force():
    law = LAWS["polach"].make(CONTACT)._replace(k_a=1.0, k_s=1.0)
    dry = Surface(0.5, 0.5, 1.0, 0.0)
    for creep_x, creep_y in ((1e-7, 0.0), (0.0, 1e-7)):
        found = tangential(Slip(creep_x * SPEED, creep_y * SPEED, 0.0, 0.0), SPEED, LOAD, TREAD, dry, 0.0, law)
        assert_allclose([found.x, found.y], linear_force(creep_x, creep_y, 0.0, TREAD), rtol=1e-3)


def test_spin_pushes_sideways_as_in_kalkers_theory():
    law = LAWS["polach"].make(CONTACT)._replace(k_a=1.0, k_s=1.0, ratio_d=1.0, gamma_d=0.0)
    dry = Surface(0.5, 0.5, 1.0, 0.0)
    for spin in (0.02, -0.02):
        found = tangential(Slip(0.0, 0.0, spin * SPEED, 0.0), SPEED, LOAD, TREAD, dry, 0.0, law)
        linear = linear_force(0.0, 0.0, spin, TREAD)[1]
        assert found.x == 0.0
        assert 0.3 < found.y / linear < 1.2  # Polach approximates it


def test_work_recovers_by_the_whole_slip():
    record = LAWS["degraded"].make(CONTACT)
    resultants = []
    for angle in (0.0, 0.7, math.pi / 2):
        slip = Slip(4.0 * math.cos(angle), 4.0 * math.sin(angle), 0.0, 0.0)
        with_work = tangential(slip, SPEED, LOAD, TREAD, ON, TAU, record)
        without = tangential(slip, SPEED, LOAD, TREAD, ON, 0.0, record)
        assert with_work.work == pytest.approx(with_work.adhesion.f * LOAD * 0.2)
        assert with_work.adhesion.kept == pytest.approx(math.exp(-TAU * with_work.work), rel=1e-9)
        assert math.hypot(with_work.x, with_work.y) > 1.2 * math.hypot(without.x, without.y)
        assert math.atan2(with_work.y, with_work.x) == pytest.approx(angle, abs=1e-12)
        resultants.append(math.hypot(with_work.x, with_work.y))
    assert_allclose(resultants, resultants[0], rtol=0.02)  # only c11 and c22 differ


def test_the_force_of_spin_knows_no_recovery():
    record = LAWS["degraded"].make(CONTACT)
    slip = Slip(0.1, 0.02, 6.0, 0.0)
    shares = []
    for tau in (0.0, TAU):
        with_spin = tangential(slip, SPEED, LOAD, TREAD, ON, tau, record)
        shares.append(with_spin.y - with_spin.x * slip.y / slip.x)
    assert shares[0] == pytest.approx(shares[1], rel=1e-9)
    assert shares[0] != 0.0


@pytest.mark.parametrize("law", sorted(LAWS))
def test_every_law_serves(law):
    record = LAWS[law].make(CONTACT)
    for slip in (Slip(0.0, 0.0, 0.0, 0.0), Slip(0.0, 0.0, 0.1, 0.0), Slip(1.0, -1.0, 0.5, 0.0)):
        for speed, load in ((SPEED, LOAD), (0.0, LOAD), (SPEED, 0.0)):
            found = tangential(slip, speed, load, patch_at(1.1, 0.6, load, TABLE), ON, TAU, record)
            assert np.all(np.isfinite([found.x, found.y, found.work, *found.adhesion]))
            assert math.hypot(found.x, found.y) <= (0.7 + 0.06 / 0.4) * load + 1e-9


@pytest.mark.parametrize("load", [31e3, 53e3, 84e3])
def test_a_default_ellipse_is_as_uncertain_as_the_area_that_another_load_gives(load):
    default, loaded = (hertz(1.1, 0.6, one, YOUNG, POISSON) for one in (ELLIPSE_LOAD_N, load))
    grown = np.log(loaded.semi_axis_a_m * loaded.semi_axis_b_m / (default.semi_axis_a_m * default.semi_axis_b_m))
    assert CONTACT.ellipse_uncertainty(load) == pytest.approx(abs(grown), abs=1e-9)
    own = dataclasses.replace(CONTACT, semi_axis_a_m=0.0055)
    assert own.ellipse_uncertainty(load) == 0.0
