"""Estimation of speed, pressures and adhesion; the teacher, its wishes and how valves follow them."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from stable_baselines3 import PPO

import agents.imitation
from agents.drawn import Believing, world
from agents.imitation import THIN, imitate
from agents.measure import low_adhesion
from agents.steering import (
    BRAKE_TO_COME,
    CREEPAGE,
    DISTRIBUTOR,
    DOUBTFUL,
    RECENT_SLIP,
    ROLLS_CREEPAGE,
    ROLLS_MPS,
    SLOW_SLIP,
    SPEED,
    Steering,
)
from agents.teacher import Teacher
from agents.train import Arguments, learns, make_model, make_world, train
from baselines.adaptive import AdaptiveController, AdaptiveParameters
from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.evaluation.bound import ceiling
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.figures import figures
from wsp_env.evaluation.runner import Conduct, measure, run, start_plant
from wsp_env.observer import bounds, estimator, running_speed
from wsp_env.observer.estimate import allocate, full_brake
from wsp_env.observer.estimator import SLIDE_REMEMBERED_S
from wsp_env.observer.observation import Observer
from wsp_env.observer.rail import START_S
from wsp_env.parameters.uic_z1 import BOGIE, VEHICLES
from wsp_env.plant.port import Measurement

INTERVAL = 0.02


def braked(vehicle, stops, controller, seconds, sensors=False):
    """Yield plant and estimate after every interval of stops under a controller."""
    plant = start_plant(vehicle, stops, Conduct())
    controller.reset(plant.n, vehicle)
    observer = Observer(vehicle, INTERVAL, sensors)
    observer.reset(measure(plant))
    for _ in range(round(seconds / INTERVAL)):
        command = controller.act(measure(plant))
        plant.step(command)
        observer.observe(measure(plant, sensors), command)
        yield plant, observer.estimate


@pytest.mark.parametrize("law", ["recovering", "classic"])
@pytest.mark.parametrize("name", ["wheelset", "bogie"])
def test_pressures_speed_and_adhesion_are_estimated_within_what_is_claimed(name, law):
    """While wheels slide: pressures to the rise that is learned, adhesion to the mass, the speed to its deviation."""
    vehicle = VEHICLES[name]
    stops = low_adhesion(vehicle, law, 12, 77)
    wrong, adhesions = [], []
    for plant, estimate in braked(vehicle, stops, load("rule-based"), 15.0):
        by_rise = np.abs(estimate.pressure_by_rise) * np.sqrt(estimate.rise_variance)[:, None]
        true = plant.state.brake.pressure / vehicle.brake.full_pressure_bar
        assert (np.abs(estimate.pressure - true) < 0.01 + 3.0 * by_rise).all()
        wrong.append((estimate.speed - plant.state.speed) / estimate.uncertainty)
        adhesions.append(estimate.adhesion - plant.state.adhesion)
    assert 0.3 < np.sqrt(np.mean(np.square(wrong))) < 1.5
    assert np.abs(np.mean(adhesions)) < 0.005


def test_without_braking_a_wheel_tells_the_speed_and_doubt_stays_small():
    for plant, estimate in braked(BOGIE, low_adhesion(BOGIE, "classic", 4, 5), Vents(), 10.0):
        assert_allclose(estimate.speed, plant.state.speed, atol=0.15)
        assert (estimate.uncertainty < 0.1).all()
        assert not estimate.doubtful.any()


class Vents:
    def reset(self, n, vehicle):
        self.shape = (n, vehicle.axles)

    def act(self, measurement):
        return -np.ones(self.shape)


def test_doubt_grows_while_all_slide_and_the_forces_are_learnt_once_a_wheel_rolls():
    drawn = low_adhesion(BOGIE, "recovering", 2, 9)
    stops = [dataclasses.replace(s, noise=0.0, mass=BOGIE.mass_kg, mu_cd=0.7 * s.mu_cd) for s in drawn]
    controller = Released(6.0)
    doubts, last = [], None
    for plant, estimate in braked(BOGIE, stops, controller, 8.0):
        doubts.append(estimate.uncertainty[0])
        last = (estimate.speed - plant.state.speed, estimate.rise_variance.copy())
    doubts = np.array(doubts)
    assert (np.diff(doubts[150:290]) > 0.0).all()
    assert doubts[-1] < 0.5 * doubts[290]
    assert_allclose(last[0], 0.0, atol=0.2)
    assert (np.sqrt(last[1]) < 0.7 * running_speed.RISE_DEVIATION).all()  # the pressure was held while the distributor rose


@pytest.mark.parametrize("demand", [0.5, 1.0])
def test_where_nothing_slides_the_speed_is_never_in_doubt(demand):
    """Loaded and empty, with noisy sensors, on rail that carries the full brake: no wheelset needs to be released."""
    stops = [
        dataclasses.replace(stop, mu_cd=0.2, tau=0.0, noise=0.1, demand=demand, mass=BOGIE.mass_kg + load * BOGIE.payload_kg)
        for stop, load in zip(low_adhesion(BOGIE, "classic", 5, 5), np.linspace(0.0, 1.0, 5), strict=True)
    ]
    for plant, estimate in braked(BOGIE, stops, Applies(), 25.0):
        assert not estimate.doubtful.any()
        fast = plant.state.speed > 5.0
        assert_allclose(estimate.speed[fast], plant.state.speed[fast], atol=0.3)


def test_a_wheelset_rolls_when_asked_for_half_of_what_it_used():
    """The speed is certain again while the brake is not yet vented, and sooner than by a wheel without any brake."""
    stops = [dataclasses.replace(stop, noise=0.0) for stop in low_adhesion(BOGIE, "recovering", 3, 5)]
    seen = None
    for plant, estimate in braked(BOGIE, stops, Released(after=6.0), 8.0):
        certain = (plant.state.time > 6.0) & (estimate.uncertainty < 0.1)
        if certain.all():
            seen = full_brake(BOGIE) * estimate.pressure[:, -1], estimate.speed - plant.state.speed
            break
    assert seen is not None
    assert (seen[0] > 0.01).all()
    assert_allclose(seen[1], 0.0, atol=2.0 * 0.1)  # twice the deviation that is claimed


@pytest.mark.parametrize("seed", range(4))
def test_no_brake_within_its_tolerances_holds_more_than_is_reckoned_with(seed):
    """Brakes that fill, vent and rise differently, under commands at random; but for what the supply rises meanwhile."""
    rng, brake, n = np.random.default_rng(seed), BOGIE.brake, 64
    commands = np.repeat(rng.integers(-1, 2, (40, n)), rng.integers(1, 30, 40), axis=0).astype(float)
    fill = brake.fill_time_constant_s * rng.uniform(1.0 / bounds.FILLS_FASTER, 1.4, n)
    vent = brake.vent_time_constant_s * rng.uniform(0.6, bounds.EMPTIES_SLOWER, n)
    rise = brake.demand_rise_s * rng.uniform(1.0 / bounds.RISES_FASTER, 1.4, n)
    dead = rng.uniform(0.0, brake.dead_time_s + bounds.LATE_S, n)
    held, step, risen = np.zeros(n), 0.005, bounds.LATE_S * bounds.RISES_FASTER / brake.demand_rise_s
    observer, speeds = Observer(BOGIE, INTERVAL), np.full((n, 2), 60.0)
    observer.reset(Measurement(np.zeros(n), speeds, np.zeros(n)))
    for tick in range(len(commands)):
        for part in range(4):
            time = tick * INTERVAL + part * step
            then = np.floor((time - dead) / INTERVAL + 1e-9).astype(int)
            acts = np.where(then < 0, 1.0, commands[np.maximum(then, 0), np.arange(n)])
            given = np.minimum((time + step) / rise, 1.0)
            target = np.where(acts > 0.5, given, np.where(acts < -0.5, 0.0, held))
            held += (target - held) * (1.0 - np.exp(-step / np.where(target > held, fill, vent)))
        command = np.repeat(commands[tick][:, None], 2, axis=1)
        observer.observe(Measurement(np.full(n, (tick + 1) * INTERVAL), speeds, np.ones(n)), command)
        assert (held <= observer.estimate.most_pressure[:, 0] + risen).all(), tick


def test_brakes_that_hold_more_than_is_believed_do_not_lose_the_running_speed():
    """They fill in 0.74 of the nominal time and vent in 1.4: a wheel 6 m/s slower passed for one that rolls, and all locked."""
    vehicle, mechanisms, stops = world("drawn brakes", BOGIE, "classic", 48, 7300037)[7]
    controller = AdaptiveController(AdaptiveParameters(slide_price=1.5))
    result = run(Believing(controller, BOGIE), vehicle, stops[3:4], Conduct(mechanisms=mechanisms))
    assert figures(result, ceiling(vehicle, stops[3:4]))["locked_s"].max() == 0.0


def test_doubt_does_not_outlast_the_slide():
    """Once nothing slides any more, nothing is released for the running speed."""
    stops = [dataclasses.replace(stop, noise=0.0) for stop in low_adhesion(BOGIE, "recovering", 2, 9)]
    plant = start_plant(BOGIE, stops, Conduct())
    observer = Observer(BOGIE, INTERVAL, pressure_sensors=True)
    observer.reset(measure(plant))
    half, shape = np.full((2, 2), 0.5 * BOGIE.brake.full_pressure_bar), np.ones((2, 2))
    doubts = []
    for step in range(1200):  # all wheels slide by 2 m/s for fifteen seconds, then run as fast as is estimated
        wheel = observer.estimate.speed[:, None] - (2.0 if step < 750 else 0.0) * shape
        now = Measurement(np.full(2, step * INTERVAL), wheel / BOGIE.wheel_radius_m, np.ones(2), half)
        observer.observe(now, np.zeros((2, 2)))
        doubts.append(observer.estimate.doubtful.all())
    assert doubts[749]
    assert not any(doubts[750 + int((SLIDE_REMEMBERED_S + 0.5) / INTERVAL) :])


class Applies:
    def reset(self, n, vehicle):
        self.shape = (n, vehicle.axles)

    def act(self, measurement):
        return np.ones(self.shape)


class Released:
    """Applies more than the rail carries, and releases the last axle after a while."""

    def __init__(self, after):
        self.after = after

    def reset(self, n, vehicle):
        self.shape = (n, vehicle.axles)

    def act(self, measurement):
        command = np.where(measurement.time[:, None] < 2.6, 1.0, 0.0) * np.ones(self.shape)
        if measurement.time[0] > self.after:
            command[:, -1] = -1.0
        return command


def test_sensors_replace_what_is_estimated():
    for plant, estimate in braked(BOGIE, low_adhesion(BOGIE, "classic", 2, 3), load("rule-based"), 2.0, sensors=True):
        assert_array_equal(estimate.pressure, plant.state.brake.pressure / BOGIE.brake.full_pressure_bar)


def test_a_vehicle_of_a_batch_is_estimated_as_alone():
    """Begun again in the middle of a batch, a vehicle's observation is that of a batch of one."""
    rng = np.random.default_rng(0)
    stops = low_adhesion(BOGIE, "recovering", 3, 4)
    plant = start_plant(BOGIE, stops, Conduct())
    both = Observer(BOGIE, INTERVAL)
    both.reset(measure(plant))
    for _ in range(30):
        command = rng.integers(-1, 2, (3, 2)).astype(float)
        plant.step(command)
        both.observe(measure(plant), command)
    plant.start(1, stops[2])
    mask = np.array([False, True, False])
    lone_plant, alone = start_plant(BOGIE, stops[2:], Conduct()), Observer(BOGIE, INTERVAL)
    assert_array_equal(both.reset(measure(plant), mask)[1], alone.reset(measure(lone_plant))[0])
    for _ in range(30):
        command = rng.integers(-1, 2, (3, 2)).astype(float)
        plant.step(command)
        lone_plant.step(command[1:2])
        seen, lone = both.observe(measure(plant), command)[1], alone.observe(measure(lone_plant), command[1:2])[0]
        assert_array_equal(seen, lone)


@pytest.mark.plain
@pytest.mark.parametrize("by_pressure", [False, True])
@pytest.mark.parametrize("sensors", [False, True])
def test_each_vehicle_is_for_itself_whatever_it_measures_and_commands(sensors, by_pressure):
    rng = np.random.default_rng(3)
    together, alone = (Observer(BOGIE, INTERVAL, sensors, by_pressure) for _ in range(2))
    seen = []
    for step in range(40):
        speeds = np.linspace(70.0, 40.0, 40)[step] - rng.uniform(0.0, 8.0, (3, 2))
        pressure = rng.uniform(0.0, 3.0, (3, 2)) if sensors else None
        now = Measurement(np.full(3, step * INTERVAL), speeds, np.full(3, 0.8), pressure)
        own = Measurement(*(None if array is None else array[1:2] for array in now))
        command = rng.uniform(-1.0, 1.0, (3, 2)) if by_pressure else rng.integers(-1, 2, (3, 2))
        if step == 0:
            seen = [together.reset(now), alone.reset(own)]
        elif step == 20:
            seen = [together.reset(now, np.array([False, True, False])), alone.reset(own)]
        else:
            seen = [together.observe(now, command), alone.observe(own, command[1:2])]
        assert_array_equal(seen[0][1], seen[1][0])
    assert (together.rail.seen > START_S).any()  # some slid


def test_arrays_of_another_shape_are_refused():
    """A compiled pass would look beyond their ends."""
    plant = start_plant(BOGIE, low_adhesion(BOGIE, "classic", 2, 3), Conduct())
    observer, now = Observer(BOGIE, INTERVAL), measure(plant)
    observer.reset(now)
    for wrong in ({"wheel_speed": np.ones((2, 4))}, {"wheel_speed": np.ones((3, 2))}, {"demand": np.ones(1)}):
        with pytest.raises(ValueError, match="reset for 2 vehicles of 2 axles"):
            observer.observe(now._replace(**wrong), np.ones((2, 2)))
    with pytest.raises(ValueError, match=r"not for arrays of \(1, 2\) and \(2,\)"):
        observer.observe(now, np.ones((1, 2)))


def told(doubtful):
    """What a teacher is told by an estimate."""
    return SimpleNamespace(doubtful=np.array(doubtful), rolling_adhesion=np.full((len(doubtful), 2), 0.015))


def test_the_teachers_slip_costs_least_of_all():
    stops = low_adhesion(BOGIE, "recovering", 4, 6)
    plant = start_plant(BOGIE, stops, Conduct())
    for price in (1.0, 4.0):
        targets = Teacher(plant, price).targets()
        speed = plant.state.speed[:, None, None]
        slips = np.linspace(0.05, 0.25 * speed[..., 0], 200, axis=-1)
        load_n = (plant.conditions.mass * 9.81 / 4.0)[:, None, None]
        friction, tau = plant.conditions.mu_cd[:, None, None], plant.conditions.tau[:, None, None]
        law = BOGIE.contact.law
        cost = (speed + price * slips) / degraded_adhesion(slips, speed, load_n, friction, tau, law)
        own = (speed[..., 0] + price * targets) / degraded_adhesion(
            targets, speed[..., 0], load_n[..., 0], friction[..., 0], tau[..., 0], law
        )
        assert (own <= 1.01 * cost.min(axis=-1)).all()
    assert (Teacher(plant, 1.0).targets() >= Teacher(plant, 4.0).targets()).all()


def test_a_doubtful_vehicle_lets_its_last_wheelset_roll():
    plant = start_plant(BOGIE, low_adhesion(BOGIE, "recovering", 2, 6), Conduct())
    for _ in range(100):  # the wheels still roll
        plant.step(np.ones((2, 2)))
    calm, doubtful = (Teacher(plant, 2.0).wanted(told(doubt)) for doubt in ([False, False], [False, True]))
    assert_array_equal(calm[0], doubtful[0])
    assert calm[1, 0] == doubtful[1, 0]
    assert -1.0 < doubtful[1, 1] <= -0.9 < calm[1, 1]


def test_the_command_brings_the_brake_nearest_to_the_one_wanted():
    steering = Steering(BOGIE, INTERVAL)
    rng = np.random.default_rng(1)
    observation = np.zeros((500, Observer(BOGIE, INTERVAL).size), np.float32)
    distributor, wanted = rng.uniform(0.4, 1.9, (500, 1)), rng.uniform(-1, 0.99, (500, 2))
    held = distributor * rng.uniform(0, 1, (500, 2))
    observation[:, 2 * BRAKE_TO_COME : 2 * BRAKE_TO_COME + 2], observation[:, DISTRIBUTOR] = held, distributor[:, 0]
    observation[:, 2 * RECENT_SLIP : 2 * RECENT_SLIP + 2] = 1.0  # they slide
    command = steering.commands(torch.as_tensor(observation), torch.as_tensor(wanted.astype(np.float32))).numpy()
    fill, vent = (np.exp(-INTERVAL / t) for t in (BOGIE.brake.fill_time_constant_s, BOGIE.brake.vent_time_constant_s))
    after = {-1: vent * held, 0: held, 1: distributor + (held - distributor) * fill}
    missed = {k: np.abs(v - (wanted + 1.0)) for k, v in after.items()}
    own = np.select([command == k for k in missed], list(missed.values()))
    assert (own <= np.min(list(missed.values()), axis=0) + 1e-6).all()
    everything = steering.commands(torch.as_tensor(observation), torch.ones(500, 2))
    assert (everything == 1.0).all()


def test_steering_sees_brake_and_distributor_where_the_observer_puts_them():
    observer = Observer(BOGIE, INTERVAL)
    plant = start_plant(BOGIE, low_adhesion(BOGIE, "classic", 2, 3), Conduct())
    observer.reset(measure(plant))
    for command in (np.ones((2, 2)), np.ones((2, 2)), -np.ones((2, 2)), np.zeros((2, 2))) * 10:
        plant.step(command)
        seen = observer.observe(measure(plant), command)
    weight = (BOGIE.mass_kg + 0.5 * BOGIE.payload_kg) * BOGIE.gravity_mps2 / 2
    per_share = BOGIE.full_brake_torque_nm / BOGIE.wheel_radius_m / weight / Observer.ADHESION_SCALE
    own = seen[:, 2 * BRAKE_TO_COME : 2 * BRAKE_TO_COME + 2]
    assert_allclose(own, per_share * observer.estimate.pressure_to_come, rtol=1e-6)
    assert_allclose(seen[:, DISTRIBUTOR], per_share * observer.estimate.distributor, rtol=1e-6)
    slip = observer.estimate.speed[:, None] - BOGIE.wheel_radius_m * measure(plant).wheel_speed
    assert_allclose(seen[:, 2 * CREEPAGE : 2 * CREEPAGE + 2], slip / observer.estimate.speed[:, None], rtol=1e-5, atol=1e-7)
    for place, kept in ((RECENT_SLIP, observer.filtered.recent_slip), (SLOW_SLIP, observer.filtered.slow_slip)):
        assert_allclose(Observer.SLIP_SCALE * seen[:, 2 * place : 2 * place + 2], kept, rtol=1e-5)
    assert_allclose(Observer.SPEED_SCALE * seen[:, SPEED], observer.estimate.speed, rtol=1e-6)
    assert_array_equal(seen[:, DOUBTFUL], observer.estimate.doubtful)


@pytest.mark.parametrize("speed", [5.0, 40.0])
def test_where_nothing_slides_the_brake_is_applied_whatever_is_wanted(speed):
    steering, limit = Steering(BOGIE, INTERVAL), max(ROLLS_MPS, ROLLS_CREEPAGE * speed)
    observation = np.zeros((4, Observer(BOGIE, INTERVAL).size), np.float32)
    observation[:, SPEED], observation[:, DISTRIBUTOR] = speed / Observer.SPEED_SCALE, 1.0
    observation[:, 2 * BRAKE_TO_COME : 2 * BRAKE_TO_COME + 2] = 0.5
    observation[1, 2 * RECENT_SLIP] = observation[2, 2 * SLOW_SLIP] = 1.1 * limit / Observer.SLIP_SCALE  # of the first axle
    observation[3, DOUBTFUL] = 1.0
    command = steering.commands(torch.as_tensor(observation), -torch.ones(4, 2)).numpy()  # nothing is wanted
    assert_array_equal(command, [[1, 1], [-1, 1], [-1, 1], [-1, -1]])


def test_what_slides_beyond_the_slide_limit_is_vented_whatever_is_wanted():
    observation = np.zeros((2, Observer(BOGIE, INTERVAL).size), np.float32)
    observation[:, DISTRIBUTOR] = 1.0
    observation[:, 2 * CREEPAGE : 2 * CREEPAGE + 2] = [[0.31, 0.29], [1.0, 0.0]]
    observation[1, 2 * RECENT_SLIP : 2 * RECENT_SLIP + 2] = 0.0  # it locked too fast for the slow slips to see it
    assert_array_equal(Steering(BOGIE, INTERVAL).commands(torch.as_tensor(observation), torch.ones(2, 2)), [[-1, 1], [-1, 1]])


def test_a_policy_brakes_a_stronger_brake_with_the_same_force():
    """What is wanted is a force: half the pressure of a brake of twice the strength, and the same commands."""
    strong = dataclasses.replace(BOGIE, brake=dataclasses.replace(BOGIE.brake, torque_per_bar_nm=3000.0))
    stops = low_adhesion(BOGIE, "recovering", 3, 8)
    wishes = [Teacher(start_plant(vehicle, stops, Conduct()), 3.0) for vehicle in (BOGIE, strong)]
    for teacher in wishes:
        for _ in range(100):
            teacher.plant.step(np.zeros((3, 2)))
            teacher.plant.state.brake.pressure[:] = 1.0 * 1500.0 / teacher.plant.vehicle.brake.torque_per_bar_nm
    own, other = (teacher.wanted(told([False] * 3)) for teacher in wishes)
    assert_allclose(own, other, atol=1e-6)  # the first interval began without pressure
    assert (np.abs(own) < 1.0).any()


@pytest.mark.slow
@pytest.mark.long
def test_imitation_brings_the_policy_near_the_teacher(tmp_path, monkeypatch):
    """On stops that it has not seen, in states that it gets into itself, it wants what the teacher does."""
    monkeypatch.setattr(agents.imitation, "BATCH", 1024)
    world = make_world(Arguments(envs=64))
    world.seed(3)
    torch.manual_seed(3)
    model = make_model(Arguments(envs=64, hidden=(64, 64), out=tmp_path), world)
    assert len(list(imitate(model, world, 2.0, rounds=12, decisions=400))) == 12
    batches = [part.batch for part in world.venv.venv.parts]
    world.seed(99)
    observation = world.reset()
    own, wanted = [], []
    for _ in range(400):
        wanted.append(np.concatenate([Teacher(batch.plant, 2.0).wanted(batch.observer.estimate) for batch in batches]))
        own.append(np.clip(model.predict(observation, deterministic=True)[0], -1.0, 1.0))
        observation = world.step(own[-1])[0]
    missed = np.mean(np.square(np.array(own) - np.array(wanted)))
    assert missed < 0.5 * np.var(np.array(wanted), axis=(0, 1)).mean()  # no constant comes near


def test_what_is_fitted_in_sequence_is_what_the_network_wanted_while_it_braked(tmp_path, monkeypatch):
    """A network that remembers is fitted from the memory that it had, through stops that end meanwhile."""
    arguments = Arguments(envs=4, recurrent=8, hidden=(8,), scenario='{"initial_speed": [3.0, 4.0]}', out=tmp_path)
    world = make_world(arguments)
    world.seed(1)
    world.training = False  # the normalisation stays as it is
    model = make_model(arguments, world)
    wanted, fitted, predict = [], [], model.predict

    def remembered(*given, **named):
        wanted.append(predict(*given, **named))
        return wanted[-1]

    monkeypatch.setattr(model, "predict", remembered)
    monkeypatch.setattr(torch, "randperm", torch.arange)
    monkeypatch.setattr(agents.imitation, "_improve", lambda optimiser, own, wish: fitted.append(own.detach()) or 0.0)
    assert len(list(imitate(model, world, 4.0, rounds=3, decisions=120))) == 3
    while_braking = np.array([action for action, _ in wanted[::THIN]]).reshape(3, 120 // THIN, 4, 2)
    in_sequence = np.concatenate([part.numpy() for part in fitted[-(len(fitted) // 3) :]])
    assert_allclose(in_sequence[-12:].reshape(3, 4, 120 // THIN, 2), while_braking.swapaxes(1, 2), atol=1e-6)
    assert world.venv.venv.parts[0].batch.plant.state.time.max() < 3 * 120 * INTERVAL  # some began anew


def test_imitation_needs_wishes(tmp_path):
    with pytest.raises(SystemExit, match="--action steered"):
        train(Arguments(action="valve", out=tmp_path))


def test_a_policy_that_does_not_learn_yet_keeps_its_weights(tmp_path):
    arguments = Arguments(envs=4, rollout=16, batch=64, hidden=(8,), out=tmp_path)
    world = make_world(arguments)
    model = PPO("MlpPolicy", world, n_steps=16, batch_size=64, policy_kwargs={"net_arch": [8]}, device="cpu")
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    learns(model, False)
    model.learn(128)
    own = ("policy_net", "action_net", "log_std")
    for name, value in model.policy.state_dict().items():
        assert torch.equal(value, before[name]) == any(part in name for part in own), name
    learns(model, True)
    model.learn(64)
    assert not torch.equal(model.policy.action_net.weight, before["action_net.weight"])


def test_a_speed_that_contradicts_makes_the_forces_less_certain():
    """Within three standard deviations the correction is the usual one; beyond, less certain, within the bounds of q."""
    deviation, found = estimator.ROLLING_DEVIATION_MPS, []
    for missing in (0.1, 0.5, 2.0, 50.0):
        e = allocate(1, BOGIE, 0.02)
        e.speed[:], e.mass_ratio[:], e.speed_variance[:] = 20.0, 1.0, 0.2**2
        e.covariance[:], e.mass_variance[:] = -0.5 * 0.2 * 0.04, 0.04**2
        running_speed.correct(0, 20.0 - missing, deviation, True, e)
        assert 20.0 - missing <= e.speed[0] < 20.0
        found.append((float(e.mass_variance[0]), float(e.mass_ratio[0]), float(e.speed[0])))
    usual = 0.2**2 / (0.2**2 + deviation**2)
    assert_allclose(found[0][2], 20.0 - usual * 0.1)
    variances = [variance for variance, _, _ in found]
    assert variances[0] == variances[1] < variances[2] < variances[3] <= (running_speed.MASS_RANGE[1] - 1.0) ** 2
    assert all(ratio > 1.0 for _, ratio, _ in found)  # it was too fast: the vehicle is slowed by more
