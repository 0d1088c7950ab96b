"""What a model's forces do to the estimated speed, and replicas about models with mechanisms on."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import minimum_filter1d
from synthetic_stops import AXLES, MASS_KG, SAMPLE_S, stops, write_campaign

from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.diagnosis import structure
from wsp_env.diagnosis.balances import ADHESION, BALANCES, VEHICLE, Balances, Whitening
from wsp_env.diagnosis.candidates import variants
from wsp_env.diagnosis.covariance import Sizes
from wsp_env.diagnosis.evaluate import Evaluator, Model
from wsp_env.diagnosis.forces import Forces
from wsp_env.diagnosis.net import Law, candidate
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.replica_slips import _FLAT_S, required_slips
from wsp_env.diagnosis.stops import BLOCK_S, SLIP_MPS, VEHICLE_BLOCK_S, PreparedStop, least_slip, prepare, smooth_wheels
from wsp_env.diagnosis.swings import swings
from wsp_env.diagnosis.trials import weights_of
from wsp_env.diagnosis.variation import Group, law_columns
from wsp_env.recordings import Campaign, read_campaign

DRAG = {"dragging_brake": {"torque_nm": 600.0, "axle": 2.0}}
LAW = Model(2e-4, (0.06, 0.07))


def campaign_of(folder) -> Campaign:
    """Two stops, as good sensors record them."""
    a, b = stops(LAW.tau, LAW.mu_cd, seeds=(1, 2), noise=1.0)
    write_campaign(folder, {"A1": a, "B1": b}, ["A1"], ["B1"])
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('source = "measured"', 'source = "pressure times the nominal gain"'), encoding="utf-8")
    return read_campaign(folder)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    campaign = campaign_of(tmp_path_factory.mktemp("sound") / "c")
    return Balances(campaign, prepare(campaign)[0])


def test_a_force_that_the_wheels_do_not_feel_is_in_the_estimated_speed(sound):
    """A recording that lost d by a force is estimated as E d; with the force in the model all of d is there again."""
    drag = {"aerodynamic_drag": {"c_ns2_per_m2": 0.5}}
    for stop in sound.stops:
        force = 0.5 * stop.speed**2
        lost = -(np.cumsum(force) - 0.5 * force) * stop.step_s / MASS_KG
        slow = dataclasses.replace(stop, speed=stop.speed + stop.estimator(stop.time, lost))
        (found,) = Evaluator(sound.campaign, [slow])(Model(LAW.tau, LAW.mu_cd, drag))
        (bare,) = Evaluator(sound.campaign, [slow])(LAW)
        assert np.abs(found.speed - stop.speed - lost).max() < 0.02 * np.abs(bare.speed - stop.speed - lost).max()


def test_a_lifted_wheel_leaves_its_adhesion_finite(sound):
    """At such a deceleration a high body lifts the trailing wheels."""
    lifted = Model(LAW.tau, LAW.mu_cd, {"load_transfer": {"body_height_m": 4.0, "pivot_height_m": 2.0}})
    stop = dataclasses.replace(sound.sources[0], acceleration=np.full_like(sound.sources[0].acceleration, -60.0))
    (found,) = Evaluator(sound.campaign, [stop])(lifted)
    (bare,) = Evaluator(sound.campaign, [stop])(LAW)
    assert found.load.min() == pytest.approx(0.1 * bare.load.min())
    assert np.isfinite(found.force / found.load).all()


def test_a_force_that_is_always_there_is_left_to_the_recorded_speed(sound):
    """A gradient over the whole stop bends no speed: its offset and slope are read from the recording."""
    bare, uphill = (Evaluator(sound.campaign, sound.stops)(Model(2e-4, LAW.mu_cd, choice))
                    for choice in ({}, {"track_gradient": {"rise": 0.002}}))  # fmt: skip
    for one, other in zip(bare, uphill, strict=True):
        assert np.abs(other.speed - one.speed).max() < 1e-4


def test_a_replica_about_a_brake_s_mechanism_has_its_torque_once(sound):
    """Its residuals are those of the recordings, and the mechanism's change is what it was about the bare law."""
    model = Model(LAW.tau, LAW.mu_cd, DRAG)
    bare, about = Replica(sound, LAW), Replica(sound, model)
    rows = sound.rows
    slides = (rows.balance == ADHESION) & (rows.slip > 0.02 * rows.speed)
    for used in (slides, rows.balance == VEHICLE):
        recorded, copied = sound.raw(model)[used], about.raw(model)[used]
        noise = float(np.std(sound.raw(LAW)[used]))
        assert np.sqrt(np.mean((recorded - copied) ** 2)) < noise
        before, after = (one.raw(model)[used] - one.raw(LAW)[used] for one in (bare, about))
        assert before @ after == pytest.approx(before @ before, rel=0.05)


@pytest.mark.parametrize("share", [-0.3, 0.5, 1.0])
def test_rows_with_another_inertia_have_as_much_noise_as_the_whitening_says(sound, share):
    """The same recordings, whatever was believed: with the true inertia in the model, only the channels' noise is left."""

    def left(balances, model):
        replica = Replica(balances, model)
        return float(np.sqrt(np.mean(replica.whitening(model)(replica.raw(model))[replica.rows.slides] ** 2)))

    vehicle = sound.campaign.vehicle
    lighter = dataclasses.replace(vehicle, wheelset_inertia_kgm2=vehicle.wheelset_inertia_kgm2 / (1.0 + share))
    campaign = dataclasses.replace(sound.campaign, vehicle=lighter)
    model = Model(LAW.tau, LAW.mu_cd, {"wheelset_inertia": {"share": share}})
    assert left(Balances(campaign, prepare(campaign)[0]), model) == pytest.approx(left(sound, LAW), rel=0.01)


def test_the_slip_that_a_force_needs_is_where_the_law_gives_it(sound):
    """A slide's measured slip is kept whole, that of a wheel on the steep part of the curve not at all."""
    law, load = sound.vehicle.contact.law, MASS_KG * 9.81 / (2 * AXLES)
    evaluator = Evaluator(sound.campaign, sound.sources)
    found = evaluator(LAW)
    needed = required_slips(sound, evaluator, LAW, found, [one.slip for one in found])
    for i, (stop, one, slip, share) in enumerate(zip(sound.sources, found, *needed, strict=True)):
        limit = least_slip(stop.speed)[:, None]
        inside = np.abs(slip) < 0.99 * limit
        given = degraded_adhesion(slip, stop.speed[:, None], load, LAW.mu_cd[i], LAW.tau, law)
        needed = one.force / (2.0 * load)
        assert inside.sum() > 100
        assert np.abs(given - needed)[inside & (needed > -0.05)].max() < 1e-6
        around = round(_FLAT_S / stop.step_s)  # samples: the share is averaged
        slides = minimum_filter1d(one.slip > 1.3 * limit, around, axis=0)
        assert slides.sum() > 100
        assert share[slides].min() > 1.0 - 1e-9
        moved = degraded_adhesion(slip + SLIP_MPS, stop.speed[:, None], load, LAW.mu_cd[i], LAW.tau, law) - given
        steep = (one.slip < 0.7 * limit) & (moved > np.maximum(needed, 0.01))  # a secant: the tangent is steeper
        assert steep.sum() > 100
        assert np.abs(share[minimum_filter1d(steep, around, axis=0)]).max() < 1e-9


@pytest.mark.parametrize(
    "choice",
    [
        {"load_transfer": {"body_height_m": 1.2, "pivot_height_m": 0.4}},
        {"initial_slope": {"factor": 0.6}},
        {"vehicle_mass": {"extra": 0.1}},
    ],
)
def test_the_slip_that_a_force_needs_is_where_the_extended_model_gives_it(sound, choice):
    """Other loads, another slope: a wheel that rolls is where the model that the replica is about puts it."""
    model, evaluator = Model(LAW.tau, LAW.mu_cd, choice), Evaluator(sound.campaign, sound.sources)
    found = evaluator(model)
    slips, _ = required_slips(sound, evaluator, model, found, [one.slip for one in found])
    there = evaluator(model, [(one.slip - slip) / sound.radius for one, slip in zip(found, slips, strict=True)])
    for stop, one, slip in zip(sound.sources, there, slips, strict=True):
        needed = one.force / (2.0 * one.load)
        inside = (np.abs(slip) < 0.99 * least_slip(stop.speed)[:, None]) & (needed > -0.05)
        assert inside.sum() > 100
        assert np.abs(one.slip - slip).max() < 1e-9  # the vehicle's speed stays as it was found
        assert np.abs(one.adhesion - needed)[inside].max() < 1e-6


def test_a_clock_s_error_is_no_slide(sound):
    """A speed that is read 0.1 m/s too high while all wheels roll gives the replica no slip."""
    stop = sound.sources[0]
    rolls = stop.time < 0.7  # of a stop that coasts for a second
    fast = Balances(sound.campaign, [dataclasses.replace(stop, speed=stop.speed + 0.1)])
    evaluator, model = Evaluator(sound.campaign, fast.sources), Model(LAW.tau, LAW.mu_cd[:1])
    (one,) = found = evaluator(model)
    (slip,), (share,) = required_slips(fast, evaluator, model, found, [one.slip])
    assert (one.slip[rolls] > 0.05).all()
    assert np.abs((share * one.slip + (1.0 - share) * slip)[rolls]).max() < 0.01


@pytest.mark.parametrize("offset", [-0.15, 0.15])
def test_with_a_clock_s_error_in_the_model_the_replica_has_the_residuals_of_a_clock_without(sound, offset):
    """Also where a part of the measured slip is kept, and as large an error makes rolling wheels look like sliding ones."""

    def late(stop: PreparedStop) -> PreparedStop:
        return dataclasses.replace(stop, speed=stop.speed + stop.estimator(stop.time, -offset * stop.acceleration))

    read = sound.like([late(stop) for stop in sound.sources])
    clock = dataclasses.replace(LAW, choice={"clock_offset": {"offset_s": offset}})
    replica, wheels = Replica(sound, LAW), sound.rows.wheels
    white, clean = replica.whitening(LAW), replica.raw(LAW)

    def beyond(replica: Replica, model: Model) -> float:
        return float(np.sqrt(np.mean(white(replica.raw(model) - clean)[wheels] ** 2)))

    for found in (Replica(read, LAW), Replica(read, clock)):
        assert beyond(found, clock) < 0.02 * beyond(found, LAW)


@pytest.mark.parametrize("change", [-0.014, 0.014])
def test_a_wheel_of_another_radius_rolls_and_is_no_slide(sound, change):
    """With its radius in the model, residuals and what the law does to them are those of the wheel as it was believed."""
    larger = 1.0 + change * (np.arange(AXLES) == 1)

    def turns(stop: PreparedStop) -> PreparedStop:
        """Return the same stop, forces and slips, with the wheels that turn less and the torques that belong to them."""
        rate, force = stop.wheel_rate / larger, stop.torque + sound.inertia * stop.wheel_rate
        torque = force * larger - sound.inertia * rate
        wheel, jerk = stop.wheel / larger, stop.wheel_jerk / larger
        return dataclasses.replace(stop, wheel=wheel, wheel_rate=rate, wheel_jerk=jerk, torque=torque)

    turned = sound.like([turns(stop) for stop in sound.sources])
    known = Model(LAW.tau, LAW.mu_cd, {"wheel_radius": {"change": change, "axle": 2.0}})
    replica, other = Replica(sound, LAW), Replica(turned, LAW)
    mine = (sound.rows.axle == 1) & sound.rows.wheels
    assert (other.rows.slides == replica.rows.slides)[mine].mean() > 0.98
    white = replica.whitening(LAW)

    def beyond(raw: np.ndarray) -> float:
        return float(np.sqrt(np.mean(white(raw - replica.raw(LAW))[mine] ** 2)))

    assert beyond(other.raw(known)) < 0.02 * beyond(other.raw(LAW))
    half = Model(LAW.tau, LAW.mu_cd, {"wheel_radius": {"change": 0.5 * change, "axle": 2.0}})
    assert beyond(other.raw(half)) == pytest.approx(0.5 * beyond(other.raw(LAW)), rel=0.05)
    column, expected = (white(law_columns(one, model, one.raw(model)))[mine] for one, model in ((other, known), (replica, LAW)))
    assert np.abs(column - expected).max() < 0.1 * np.abs(expected).max()
    assert np.linalg.norm(column - expected) < 0.02 * np.linalg.norm(expected)


def test_columns_of_a_torque_s_zero_are_what_an_offset_does(sound):
    largest = max(float(np.abs(one.torque).max()) for one in sound.evaluate(LAW))
    columns = Forces(sound, LAW).zeros()
    for axle in range(AXLES):
        added = 1e-3 * largest * (np.arange(AXLES) == axle)
        moved = sound.like([dataclasses.replace(stop, torque=stop.torque + added) for stop in sound.sources])
        change = (moved.raw(LAW) - sound.raw(LAW)) / 1e-3
        segment = sound.rows.segment
        expected = columns[:, axle].copy()
        for which in np.unique(segment[segment >= 0]):  # the speed that each stretch starts with is free
            expected[segment == which] -= expected[segment == which].mean()
        slow = sound.rows.balance == VEHICLE
        assert change[slow] == pytest.approx(expected[slow], abs=1e-3 * np.abs(expected[slow]).max())
        wheels = sound.rows.wheels & (sound.rows.axle == axle)
        assert expected[wheels] == pytest.approx(1.0 * largest / (2.0 * sound.radius * MASS_KG * 9.81 / (2 * AXLES)), rel=1e-6)


def test_columns_of_an_unround_sensor_are_what_its_reading_does(sound):
    """A pulse wheel off its centre, at some angle as a recording begins; its reading is smoothed as every wheel speed."""
    share, phase, axle = 1e-4, 0.7, 2
    columns = Forces(sound, LAW).unround_wheels().reshape(len(sound.rows.run), len(sound.stops), 2, AXLES)
    moved = []
    for stop in sound.sources:
        shown = stop.wheel * np.sin(np.cumsum(stop.wheel, axis=0) * stop.step_s + phase) * (np.arange(AXLES) == axle)
        wheel, rate, jerk, _ = smooth_wheels(share * shown, np.zeros_like(shown), stop.step_s)
        moved.append(dataclasses.replace(
            stop, wheel=stop.wheel + wheel, wheel_rate=stop.wheel_rate + rate, wheel_jerk=stop.wheel_jerk + jerk
        ))  # fmt: skip
    change = (sound.like(moved).raw(LAW) - sound.raw(LAW)) / share
    mine = columns[..., axle].sum(axis=1) @ np.array([np.cos(phase), np.sin(phase)])
    wheels = sound.rows.wheels & (sound.rows.axle == axle)
    assert np.corrcoef(change[wheels], mine[wheels])[0, 1] > 0.98
    assert change[wheels] @ mine[wheels] / (mine[wheels] @ mine[wheels]) == pytest.approx(1.0, abs=0.1)
    assert not columns[sound.rows.run == 0, 1].any()  # every recording begins at an angle of its own


def test_times_below_some_samples_are_no_effects(sound):
    """Channels of one logger are read within a sample of each other: the small size is 0.6 of a sample at least."""
    replica = Replica(sound, LAW)
    base, whitening = replica.raw(LAW), replica.whitening(LAW)
    law = Law(replica, LAW, base, whitening)
    for name in ("wheel_speed_lag", "clock_offset", "brake_delay"):
        variant = next(one for one in variants(replica) if one.name == name)
        found = candidate(replica, LAW, base, law, variant)
        assert abs(found.variant.moves()[0]) / found.scale[0] >= 4.0 * SAMPLE_S * (1.0 - 1e-9)


@pytest.mark.parametrize(("correlation", "expected"), [(0.0, 0.0), (0.9, 3.0 * np.sqrt(0.9))])
def test_only_what_goes_on_from_row_to_row_is_structure(correlation, expected):
    """Noise of three times the channels' own is none of it; the same as an autoregressive course is."""
    runs, each = 8, 200
    rng = np.random.default_rng(4)
    n = runs * AXLES * each
    y = rng.standard_normal((runs * AXLES, each))
    for i in range(1, each):
        y[:, i] = correlation * y[:, i - 1] + np.sqrt(1.0 - correlation**2) * y[:, i]
    which = np.repeat(np.arange(runs * AXLES), each)
    rows = SimpleNamespace(
        balance=np.zeros(n, dtype=int),
        noise=np.full(n, len(BALANCES)),  # of wheels that slide
        run=which // AXLES,
        axle=which % AXLES,
        time=np.tile(BLOCK_S * np.arange(each), runs * AXLES),
        deceleration=np.ones(n),
    )
    base = 3e-3 * y.ravel()
    order = rng.permutation(n)  # rows come in any order
    for name in ("run", "axle", "time"):
        setattr(rows, name, getattr(rows, name)[order])
    group = Group("g", 1e-6 * rng.standard_normal((n, 1)), 1.0)
    sizes = Sizes(np.ones(1), np.array([1.0, 1.0, 1.0, 1.0, 3.0]))
    whitening = Whitening(np.full(n, 1e-3), ())
    last = SimpleNamespace(about=LAW, sizes=sizes, groups=[group], small=group, whitening=whitening, base=base[order])
    replica = SimpleNamespace(
        about=LAW, rows=rows, vehicle=SimpleNamespace(gravity_mps2=9.81), axles=AXLES, radius=0.445, inertia=160.0,
        stops=[SimpleNamespace(mass=43e3)],
    )  # fmt: skip
    found = structure.structured(replica, last, weights_of(replica, last))
    assert found.size == pytest.approx(expected, abs=0.35)
    # A friction of 3e-3 on each axle by itself is 1.5e-3 on all four, of a deceleration of 1 m/s2 the share 9.81 times that.
    swing = np.sqrt(2.0 * correlation) * 9.81 * 3e-3 / np.sqrt(AXLES)
    assert found.multiple == pytest.approx(swing / 0.01, rel=0.15)


def test_axles_that_swing_against_each_other_move_no_stop():
    """Loads that bounce from side to side are seen in every row, and all axles together retard as before."""
    each, time = 400, BLOCK_S * np.arange(400)
    n = AXLES * each
    axle = np.repeat(np.arange(AXLES), each)
    rows = SimpleNamespace(noise=np.full(n, len(BALANCES)), run=np.zeros(n, dtype=int), axle=axle, time=np.tile(time, AXLES))
    for phase, share in ((np.pi, 0.0), (0.0, 1.0)):
        raw = 0.01 * np.sin(2.0 * np.pi * 0.3 * np.tile(time, AXLES) + phase * axle)
        square = structure._of_all_axles(raw, rows, len(BALANCES))
        assert square == pytest.approx(share * 0.5e-4 * np.cos(2.0 * np.pi * 0.3 * 3.0 * BLOCK_S), rel=0.02, abs=1e-9)


@pytest.mark.parametrize(("blocks", "kept"), [(400, 0.0), (2, 1.0)])
def test_a_push_that_is_gone_within_half_a_second_moves_no_stop(blocks, kept):
    """Pushes that last two blocks; in slides that are no longer, nobody can say that they end."""
    rng, runs = np.random.default_rng(3), 400 * 50 // blocks
    pushes = np.repeat(0.01 * rng.standard_normal(runs * blocks // 2), 2)
    run, time = np.repeat(np.arange(runs), blocks), np.tile(BLOCK_S * np.arange(blocks), runs)
    n = len(pushes)
    rows = SimpleNamespace(noise=np.full(n, len(BALANCES)), run=run, axle=np.zeros(n, dtype=int), time=time)
    assert structure._of_all_axles(pushes, rows, len(BALANCES)) == pytest.approx(kept * 1e-4, abs=4e-6)


def test_the_coloured_noise_of_a_recorded_speed_swings_no_vehicle():
    rng, each, runs = np.random.default_rng(7), 300, 8
    time = VEHICLE_BLOCK_S * np.arange(each)
    covariance = 0.03**2 * np.exp(-np.abs(np.subtract.outer(time, time)) / 0.5)
    root = np.linalg.cholesky(covariance)
    n = runs * each
    rows = SimpleNamespace(
        noise=np.full(n, VEHICLE), run=np.repeat(np.arange(runs), each), axle=np.full(n, -1), time=np.tile(time, runs)
    )
    roots = tuple((np.arange(each) + each * i, np.linalg.inv(root)) for i in range(runs))
    seen = SimpleNamespace(whitening=Whitening(np.ones(n), roots))
    noise = (root @ rng.standard_normal((each, runs))).T.ravel()
    swing = 0.02 * np.sin(2.0 * np.pi * 0.3 * np.tile(time, runs))

    def squared(raw):
        return structure._of_speed(seen, raw, np.ones(n), rows, 1) - structure._of_speed(seen, raw, np.ones(n), rows, 2)

    expected = 0.5 * 0.02**2 * (np.cos(0.6 * np.pi * VEHICLE_BLOCK_S) - np.cos(1.2 * np.pi * VEHICLE_BLOCK_S))
    assert abs(squared(noise)) < 0.3 * expected
    assert squared(noise + swing) == pytest.approx(expected, rel=0.3)


def test_a_speed_that_swings_proposes_its_frequency(sound):
    """Phases differ from stop to stop; 2 cm/s beside a noise of 1 cm/s are seen."""
    swinging = [
        dataclasses.replace(stop, recorded_speed=stop.recorded_speed + 0.02 * np.sin(2.0 * np.pi * 0.41 * stop.time + phase))
        for phase, stop in enumerate(sound.sources)
    ]
    assert swings(swinging, sound.radius, sound.inertia)[0] == pytest.approx(0.41, abs=0.02)
    assert swings([dataclasses.replace(sound.sources[0], time=np.zeros(0))], sound.radius, sound.inertia) == ()


@pytest.mark.parametrize("extra", [-0.3, 0.3])
def test_noise_of_a_wheel_s_force_is_as_large_beside_a_vehicle_of_another_mass(sound, extra):
    """Over the load by the model it would look smaller beside a heavier vehicle, which then seems to fit better."""
    light = Model(LAW.tau, LAW.mu_cd, {"vehicle_mass": {"extra": extra}})
    stop = sound.sources[0]
    noisy = Balances(sound.campaign, [dataclasses.replace(stop, torque=stop.torque + 100.0), *sound.sources[1:]])
    wheels = sound.rows.wheels & (sound.rows.run == 0)
    bare, other = ((noisy.raw(model) - sound.raw(model))[wheels] for model in (LAW, light))
    np.testing.assert_allclose(bare, 100.0 / (2.0 * sound.radius * stop.mass * 9.81 / (2.0 * AXLES)), rtol=0.05)
    np.testing.assert_allclose(other, bare, rtol=0.1)


def test_a_vehicle_that_a_model_stops_too_early_has_finite_adhesion(sound):
    """A replica far from the recordings may turn back where the recorded vehicle still rolls."""
    stop = dataclasses.replace(sound.sources[0], speed=sound.sources[0].speed - 30.0)
    assert stop.speed.min() < 0.0
    memory = Model(LAW.tau, LAW.mu_cd, {"contaminant_memory": {"distance_m": 0.04}})
    (found,) = Evaluator(sound.campaign, [stop])(memory)
    assert np.isfinite(found.adhesion).all()
    assert np.isfinite(found.slope).all()
