"""The runner: what it records agrees with the plant, and a bad controller is reported and not obeyed."""

import numpy as np
import pytest

from wsp_env.evaluation.runner import Conduct, ControllerFailure, run
from wsp_env.parameters.uic_z1 import BOGIE, COACH
from wsp_env.plant.port import Stop
from wsp_env.scenario import Scenario, draw


def stops(n: int = 2, vehicle=BOGIE, **pins) -> list[Stop]:
    conditions = {"mu_cd": 0.05, "initial_speed": 15.0, "demand": 0.6, "track": "constant", "load": 0.0} | pins
    return [draw(Scenario(), vehicle, np.random.default_rng(i), 200, conditions) for i in range(n)]


class Applies:
    def reset(self, n, vehicle):
        self.shape = (n, vehicle.axles)

    def act(self, measurement):
        return np.ones(self.shape)


class ByPressure(Applies):
    action = "pressure"


class Blind(Applies):
    """Remembers what it was shown."""

    def reset(self, n, vehicle):
        super().reset(n, vehicle)
        self.seen = []

    def act(self, measurement):
        self.seen.append(measurement)
        measurement.wheel_speed[:] = -1.0  # a controller cannot reach into the plant
        return super().act(measurement)


def test_every_stop_ends_at_rest_and_keeps_its_distance():
    result = run(Applies(), BOGIE, stops(3, mu_cd=0.2))
    assert result.stopped.all()
    np.testing.assert_allclose(result.speed[-1], 0.0)
    np.testing.assert_allclose(result.position[-1], result.distance)
    assert (np.diff(result.position, axis=0) >= 0.0).all()
    assert result.command.shape == (len(result.time) - 1, 3, 2)
    np.testing.assert_array_equal(result.steps, np.ceil(result.duration / 0.02 - 1e-9))


def test_a_stop_does_not_depend_on_the_others_of_its_batch():
    many, one = run(Applies(), BOGIE, stops(3)), run(Applies(), BOGIE, stops(1))
    assert many.distance[0] == one.distance[0]
    np.testing.assert_array_equal(many.slip[: len(one.time), 0], one.slip[:, 0])


def test_full_pressure_is_what_the_open_valve_gives():
    """Commanding the demanded pressure and leaving the valve open are one thing where nothing is vented."""
    valve, pressure = run(Applies(), BOGIE, stops(1, mu_cd=0.2)), run(ByPressure(), BOGIE, stops(1, mu_cd=0.2))
    assert pressure.distance[0] == pytest.approx(valve.distance[0], rel=1e-3)


def test_a_failed_sensor_reads_zero_from_then_on_and_the_plant_is_out_of_reach():
    controller = Blind()
    fails = np.full((1, 2), np.inf)
    fails[0, 1] = 1.0
    result = run(controller, BOGIE, stops(1, mu_cd=0.2), sensor_fails_s=fails)
    assert result.stopped.all()
    times = [seen.time[0] for seen in controller.seen]
    assert times == sorted(times)
    honest = Blind()
    honest.act = lambda measurement: (honest.seen.append(measurement), np.ones((1, 2)))[1]
    run(honest, BOGIE, stops(1, mu_cd=0.2), sensor_fails_s=fails)
    late = [seen for seen in honest.seen if seen.time[0] >= 1.0]
    assert all(seen.wheel_speed[0, 1] == 0.0 for seen in late)
    assert late[0].wheel_speed[0, 0] > 10.0
    assert all(seen.pressure is None for seen in late)


def test_pressures_are_measured_where_the_vehicle_has_the_sensors():
    controller = Blind()
    run(controller, BOGIE, stops(1), Conduct(time_limit_s=1.0, pressure_sensors=True))
    assert controller.seen[-1].pressure.shape == (1, 2)


def test_a_stop_that_does_not_end_is_given_up():
    result = run(Applies(), COACH, stops(1, COACH), Conduct(time_limit_s=1.0))
    assert not result.stopped.any()
    assert result.duration[0] == pytest.approx(1.0)


def _returning(value):
    controller = Applies()
    controller.act = lambda measurement: value
    return controller


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (np.full((2, 2), np.nan), "returned nan for axle 1 of stop 1 at 0.00 s"),
        (np.ones((2, 3)), r"returned shape \(2, 3\) at 0.00 s, expected \(2, 2\)"),
        (None, "returned NoneType instead of numbers"),
        ("vent", "returned str instead of numbers"),
        (np.array([[1.0, 1.0], [0.0, 2.0]]), "returned 2 for axle 2 of stop 2 at 0.00 s: -1 vents, 0 holds, \\+1 applies"),
    ],
)
def test_what_is_no_command_is_reported(value, complaint):
    with pytest.raises(ControllerFailure, match=complaint):
        run(_returning(value), BOGIE, stops(2))


def test_a_controller_that_raises_is_reported_with_its_moment():
    class Raises(Applies):
        def act(self, measurement):
            if measurement.time[0] > 0.5:
                raise ZeroDivisionError("slip of nothing")
            return super().act(measurement)

    with pytest.raises(ControllerFailure, match=r"Raises.act raised ZeroDivisionError at 0\.5\d s: slip of nothing"):
        run(Raises(), BOGIE, stops(2))
