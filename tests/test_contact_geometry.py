"""Profiles, contact locus and contact points: identities, independent searches, bad input."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wsp_env.contact.geometry.centre import centre_of_load
from wsp_env.contact.geometry.detect import follow, scan
from wsp_env.contact.geometry.equilibrium import contacts, loaded, settled
from wsp_env.contact.geometry.measured import ProfileError, Reading, read_rail, read_wheel
from wsp_env.contact.geometry.patch import make_patch_table, stiffness_at
from wsp_env.contact.geometry.port import (
    AT_WHEEL,
    CURVATURE_A,
    CURVATURE_B,
    PENETRATION,
    PRESSED,
    Contact,
    ContactLostError,
    Pair,
    Pose,
    empty_contacts,
)
from wsp_env.contact.geometry.profile import evaluate
from wsp_env.contact.geometry.standard import s1002, uic60
from wsp_env.contact.geometry.track import Track, Wheelset, make_pair

PAIR = make_pair(s1002(), uic60(), Wheelset(), Track())
POSES = [(0.0, 0.0), (2e-3, 0.0), (-4e-3, 8e-3), (4e-3, -5e-3), (-6e-3, 20e-3)]


@pytest.mark.plain
def test_s1002_has_the_dimensions_of_the_standard():
    wheel = s1002()
    assert float(evaluate(wheel, -55e-3)[0]) == pytest.approx(28e-3, abs=1e-6)  # flange height
    assert float(evaluate(wheel, -37.5e-3)[0]) == pytest.approx(10e-3, abs=2e-4)  # flange 32.5 mm thick, 10 mm above the tread
    assert float(evaluate(wheel, 50e-3)[1]) == pytest.approx(-1.0 / 15.0, abs=1e-6)
    assert float(evaluate(wheel, 0.0)[0]) == 0.0


@pytest.mark.plain
def test_uic60_head_is_72_mm_wide_and_symmetric():
    rail = uic60()
    y = np.linspace(-36.5e-3, 36.5e-3, 201)
    assert_allclose(evaluate(rail, y)[0], evaluate(rail, -y)[0], atol=1e-12)
    assert rail.breaks[-2] == pytest.approx(36e-3, abs=2e-5)
    assert_allclose(evaluate(rail, [0.0, 0.0355])[0], [0.0, -11.28e-3], atol=2e-5)


@pytest.mark.plain
@pytest.mark.parametrize("profile", [s1002(), uic60()])
def test_pieces_join_and_derivatives_are_those_of_the_heights(profile):
    inner = profile.breaks[1:-1]
    below, above = evaluate(profile, inner - 1e-12), evaluate(profile, inner + 1e-12)
    assert_allclose(below[0], above[0], atol=2e-7)
    assert_allclose(np.arctan(below[1]), np.arctan(above[1]), atol=1e-5)
    y = np.linspace(profile.breaks[0] + 1e-3, profile.breaks[-1] - 1e-3, 400)
    y = y[np.min(abs(y[:, None] - profile.breaks), axis=1) > 1e-5]
    step = 1e-7
    up, down = evaluate(profile, y + step), evaluate(profile, y - step)
    assert_allclose((up[0] - down[0]) / (2 * step), evaluate(profile, y)[1], rtol=1e-5, atol=1e-7)
    assert_allclose((up[1] - down[1]) / (2 * step), evaluate(profile, y)[2], rtol=1e-4, atol=1e-3)


def surface(pose: Pose, pair: Pair, s: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Points (3, ...) of the left wheel's surface in the track frame, from the rotations themselves."""
    radius = pair.radius + evaluate(pair.wheel, s)[0]
    point = np.array([radius * np.sin(angle), pair.taping + s + 0 * angle, -radius * np.cos(angle)])
    c, d = math.cos(pose.roll), math.sin(pose.roll)
    roll = np.array([[1, 0, 0], [0, c, -d], [0, d, c]])
    c, d = math.cos(pose.yaw), math.sin(pose.yaw)
    yaw = np.array([[c, -d, 0], [d, c, 0], [0, 0, 1]])
    return np.tensordot(yaw @ roll, point, 1) + np.array([0.0, pose.y, pair.radius + pose.z])[:, None, None]


def overlap(points: np.ndarray, pair: Pair) -> np.ndarray:
    """Height of the rail over points, measured upwards in the rail's frame."""
    dy, dz = points[1] - pair.rail_y, points[2] - pair.rail_z
    across, up = dy * pair.cosine + dz * pair.sine, dz * pair.cosine - dy * pair.sine
    over = evaluate(pair.rail, across)[0] - up
    return np.where((across > pair.rail.breaks[0]) & (across < pair.rail.breaks[-1]), over, -np.inf)


@pytest.mark.parametrize(("y", "yaw"), POSES)
def test_deepest_point_of_the_whole_surface_is_found(y, yaw):
    pose = settled(y, yaw, PAIR)._replace(roll=0.002)
    rows = empty_contacts()
    pose = pose._replace(z=pose.z - 2e-3)
    assert scan(pose, 1.0, PAIR, rows) > 0
    found = Contact(*rows[0])
    s = found.at_wheel + np.linspace(-1e-3, 1e-3, 201)[:, None]
    angle = np.linspace(-0.05, 0.05, 401)[None, :]
    wide = np.linspace(PAIR.first, PAIR.last, 600)[:, None]
    points = surface(pose, PAIR, s, angle)
    over = overlap(points, PAIR)
    _, slope, _ = evaluate(PAIR.rail, found.at_rail)
    best = np.unravel_index(np.argmax(over), over.shape)
    assert over[best] / math.hypot(1.0, float(slope)) == pytest.approx(found.penetration, abs=1e-7)
    assert np.max(overlap(surface(pose, PAIR, wide, angle), PAIR)) <= found.penetration * math.hypot(1.0, float(slope)) + 1e-9
    assert points[0][best] == pytest.approx(found.x, abs=2e-4)


@pytest.mark.plain
@pytest.mark.parametrize(("y", "yaw"), POSES)
def test_curvatures_are_those_of_the_gap(y, yaw):
    pose = settled(y, yaw, PAIR)
    found = contacts(pose, "left", PAIR)[0]
    near = 2e-5
    s = found.at_wheel + near * np.linspace(-1, 1, 21)[:, None]
    bottom = math.asin((found.x + math.sin(yaw) * (found.y - y)) / found.rolling_radius)
    angle = bottom + 2e-3 * np.linspace(-1, 1, 21)[None, :]
    points = surface(pose, PAIR, s, angle)
    c, d = math.cos(found.angle), math.sin(found.angle)
    _, slope, _ = evaluate(PAIR.rail, found.at_rail)
    gap = -overlap(points, PAIR) / math.hypot(1.0, float(slope))
    t1, t2 = points[0] - found.x, (points[1] - found.y) * c + (points[2] - found.z) * d
    terms = np.stack([np.ones_like(t1), t1, t2, t1**2, t1 * t2, t2**2], axis=-1).reshape(-1, 6)
    scale = abs(terms).max(axis=0)
    fit = np.linalg.lstsq(terms / scale, gap.ravel(), rcond=None)[0] / scale
    mean, half = 0.5 * (fit[3] + fit[5]), math.hypot(0.5 * (fit[3] - fit[5]), 0.5 * fit[4])
    assert_allclose(sorted((found.curvature_a, found.curvature_b)), [mean - half, mean + half], rtol=0.01)


def test_following_equals_scanning():
    scanned, followed = empty_contacts(), empty_contacts()
    for yaw in (0.0, 5e-3):
        pose = settled(-7e-3, yaw, PAIR)
        scan(pose, -1.0, PAIR, followed)
        for y in np.arange(-7e-3, 4e-3, 2e-5):
            pose = settled(float(y), yaw, PAIR) if abs(y / 1e-3 - round(y / 1e-3)) < 1e-6 else pose._replace(y=float(y))
            scan(pose, -1.0, PAIR, scanned)
            follow(pose, -1.0, PAIR, followed)
            live = followed[followed[:, PENETRATION] > -np.inf]
            for row in live:  # a gap's minimum that is narrower than a scan's step is of no weight until it is near the rail
                match = scanned[np.argmin(abs(scanned[:, AT_WHEEL] - row[AT_WHEEL]))]
                if row[PENETRATION] > -5e-5:
                    assert_allclose(row, match, rtol=0, atol=1e-6)
            if len(live) == 0 or not live[:, PENETRATION].max() >= scanned[0, PENETRATION] - 1e-12:
                scan(pose, -1.0, PAIR, followed)  # a contact that appeared


@pytest.mark.parametrize(("n", "yaw"), [(20, 0.0), (20, 8e-3), (40, 0.0), (40, 8e-3)])
def test_the_force_goes_on_where_contacts_appear_and_cross_a_joint(n, yaw):
    """70 um deep, up to the flange: within 5 um of shift forces of some 60 kN change by 1 kN at most, however contacts do.

    At the joint of the rail's arcs and where the overlap gets a second hump Hertz's force by itself jumps by 10 to 60 %.
    """
    pair, table = make_pair(s1002(), uic60(), Wheelset(), Track(inclination=1.0 / n)), make_patch_table(210e9, 0.28)
    forces, touching = [], set()
    for y in np.arange(-5.5e-3, 0.0, 5e-6):
        pose = settled(float(y), yaw, pair)
        forces.append([])
        for side in (1.0, -1.0):
            rows = empty_contacts()
            scan(pose._replace(z=pose.z - 7e-5), side, pair, rows)
            pressed = rows[rows[:, PRESSED] > 0.0]
            touching.add(len(pressed))
            forces[-1].append(
                sum(stiffness_at(*row[[CURVATURE_A, CURVATURE_B]], table) * row[PRESSED] ** 1.5 for row in pressed)
            )
    force = np.array(forces)
    assert 1 in touching
    assert 2 in touching
    assert 50e3 < force.max() < 100e3
    assert np.abs(np.diff(force, axis=0)).max() < 1e3


@pytest.mark.plain
def test_wider_gauge_moves_the_rails_apart():
    wide = make_pair(s1002(), uic60(), Wheelset(), Track(gauge_m=1.445))
    assert wide.rail_y - PAIR.rail_y == pytest.approx(5e-3, abs=1e-12)


def test_gauge_is_measured_14_mm_below_the_tops():
    y = np.linspace(*PAIR.rail.breaks[[0, -1]], 200001)
    z = evaluate(PAIR.rail, y)[0]
    across = PAIR.rail_y + y * PAIR.cosine - z * PAIR.sine
    up = PAIR.rail_z + y * PAIR.sine + z * PAIR.cosine
    assert up.max() == pytest.approx(0.0, abs=1e-9)
    assert across[up >= -14e-3].min() == pytest.approx(1.435 / 2.0, abs=2e-6)


@pytest.mark.plain
def test_a_curve_bends_the_rails():
    curved = make_pair(s1002(), uic60(), Wheelset(), Track(curvature_1pm=1.0 / 150.0))
    pose = settled(-7e-3, 10e-3, PAIR)  # right flange on the outer rail of a left curve, whose gauge face is hollow
    straight, bent = contacts(pose, "right", PAIR)[0], contacts(pose, "right", curved)[0]
    assert straight.penetration == bent.penetration
    assert bent.curvature_a - straight.curvature_a == pytest.approx(-0.5 / 150.0 * math.sin(abs(straight.angle)), rel=1e-2)
    assert Track(curvature_1pm=0.002, superelevation_m=0.15).tilt_rad == pytest.approx(-0.1, abs=1e-3)


@pytest.mark.plain
def test_centre_of_load_is_the_deepest_point_between_circles():
    pose = settled(-8e-3, 0.0, PAIR)
    rows = empty_contacts()
    scan(pose._replace(z=pose.z - 2e-5), -1.0, PAIR, rows)
    assert centre_of_load(pose._replace(z=pose.z - 2e-5), -1.0, PAIR, rows, 0) == pytest.approx(rows[0, AT_WHEEL], abs=1e-5)


@pytest.mark.plain
@pytest.mark.parametrize(
    "pose", [Pose(0.09, 0.0, 0.0, 0.0), Pose(0.0, 0.01, 0.0, 0.0), Pose(math.nan, 0.0, 0.0, 0.0), Pose(0.0, 0.0, 0.0, math.nan)]
)
def test_a_lost_contact_is_one_clear_error(pose):
    with pytest.raises(ContactLostError, match=r"wheel is not on its rail|finite"):
        contacts(pose, "left", PAIR)
    rows = empty_contacts()
    scan(settled(0.0, 0.0, PAIR), 1.0, PAIR, rows)
    follow(pose, 1.0, PAIR, rows)
    assert not np.any(rows[:, PENETRATION] > 0.0)
    assert scan(pose, 1.0, PAIR, rows) == 0
    assert np.all(rows[:, PENETRATION] == -np.inf)


def test_a_wheelset_beside_its_track_cannot_settle():
    for y in (0.06, -0.09):
        with pytest.raises(ContactLostError):
            settled(y, 0.0, PAIR)
        with pytest.raises(ContactLostError):
            loaded(y, 0.0, 1e4, 0.3, PAIR, make_patch_table(2.1e11, 0.28))


def write(file, y, z, unit=1e3):
    file.write_text("# y z\n" + "\n".join(f"{a * unit:.6f} {b * unit:.6f}" for a, b in zip(y, z, strict=True)))
    return file


def test_measured_profiles_give_the_contacts_of_the_closed_form(tmp_path):
    noise = np.random.default_rng(1)
    y = np.arange(-50e-3, 60e-3, 0.2e-3)
    wheel = read_wheel(
        write(tmp_path / "w.txt", y, evaluate(s1002(), y)[0] + noise.normal(0, 1e-6, y.size)), Reading(noise_m=1e-6)
    )
    y = np.arange(-36.7e-3, 36.7e-3, 0.2e-3)
    rail = read_rail(write(tmp_path / "r.txt", -y, evaluate(uic60(), y)[0]), Reading(mirror_y=True, noise_m=1e-6))
    print(wheel, "|", rail)
    assert wheel.rms_m == pytest.approx(1e-6, rel=0.1)
    pair = make_pair(wheel.profile, rail.profile, Wheelset(), Track())
    for shift in (-3e-3, -1e-3, 1e-3, 3e-3):
        pose, expected = settled(shift, 0.0, pair), settled(shift, 0.0, PAIR)
        assert pose.z == pytest.approx(expected.z, abs=5e-6)
        for side in ("left", "right"):
            assert contacts(pose, side, pair)[0].rolling_radius == pytest.approx(
                contacts(expected, side, PAIR)[0].rolling_radius, abs=5e-5
            )


GOOD = np.linspace(-36e-3, 36e-3, 100)


@pytest.mark.parametrize(
    ("y", "z", "match"),
    [
        (np.r_[GOOD[:50], GOOD[48], GOOD[50:]], -(np.r_[GOOD, 0.0] ** 2), "folds back at y = "),
        (GOOD[:10], -(GOOD[:10] ** 2), "10 points"),
        (GOOD, GOOD**2, "highest point of a rail lies at its edge"),
        (GOOD * 1e3, -(GOOD**2), "see the unit"),
        (np.r_[GOOD[:-1], np.nan], -(GOOD**2), "finite"),
    ],
)
def test_a_bad_profile_file_is_one_clear_error(tmp_path, y, z, match):
    file = write(tmp_path / "bad.txt", y, z)
    with pytest.raises(ProfileError, match=match) as error:
        read_rail(file)
    assert "bad.txt" in str(error.value)


def test_other_bad_files(tmp_path):
    with pytest.raises(ProfileError, match=r"none\.txt"):
        read_rail(tmp_path / "none.txt")
    file = tmp_path / "text.txt"
    file.write_text("y,z\n1,2\n1,two\n")
    with pytest.raises(ProfileError, match=r"text\.txt, line 3: two numbers"):
        read_rail(file)
    with pytest.raises(ProfileError, match="flange, must have a negative y"):
        read_wheel(write(tmp_path / "mirrored.txt", np.linspace(-0.05, 0.05, 50), np.linspace(0.0, 0.02, 50)))
    flat = read_rail(write(tmp_path / "flat.txt", GOOD, -(GOOD**2)))
    with pytest.raises(ValueError, match="must reach 14 mm below its top"):
        make_pair(s1002(), flat.profile, Wheelset(), Track())
    for wrong in ({"gauge_m": 14.35}, {"inclination": math.nan}, {"curvature_1pm": 1.0}):
        with pytest.raises(ValueError, match="must"):
            Track(**wrong)
