"""What fails while a stop lasts, how the programme asks for it, and how it is judged."""

import dataclasses
import math

import numpy as np
import polars
import pytest

from wsp_env.cli.plant_options import PhysicsOptions
from wsp_env.evaluation.bound import ceiling
from wsp_env.evaluation.faults import Faults, standing_reported
from wsp_env.evaluation.figures import FIGURES, figures
from wsp_env.evaluation.programme import Case, Draws, Requirement, draw_stops, read_programme
from wsp_env.evaluation.runner import Conduct, StopRecords, run
from wsp_env.evaluation.summary import decided, judge
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE, COACH

HOLD = np.zeros((3, 2))


def faults(**times):
    none = Faults.none(3, 2)
    return dataclasses.replace(none, **{name: np.broadcast_to(time, getattr(none, name).shape) for name, time in times.items()})


def test_a_valve_obeys_until_it_fails():
    stuck = faults(vents_s=[5.0, np.inf], applies_s=[np.inf, 5.0])
    assert (stuck.acting(HOLD, np.full(3, 4.9), False) == 0.0).all()
    assert stuck.acting(HOLD - 1.0, np.full(3, 5.0), False).tolist() == [[-1.0, 0.0]] * 3  # one vents, one vents no more
    assert stuck.acting(HOLD + 1.0, np.full(3, 5.0), False).tolist() == [[-1.0, 1.0]] * 3
    assert not stuck.protected.any()


def test_without_current_every_valve_applies_but_the_one_that_is_stuck_open():
    lost = faults(power_s=[2.0, np.inf, np.inf], vents_s=[np.inf, 1.0])
    assert lost.acting(HOLD - 1.0, np.full(3, 3.0), False).tolist() == [[1.0, -1.0], [-1.0, -1.0], [-1.0, -1.0]]
    assert lost.protected.tolist() == [[False, False], [True, False], [True, False]]


def test_a_case_names_what_fails_on_the_drawn_axle():
    case = Case("stuck", "", 80.0, (0.05, 0.08), valve_vents_s=5.0)
    drawn = draw_stops(case, read_programme(), COACH, Draws(4))
    assert (np.isfinite(drawn.faults.vents_s).sum(axis=1) == 1).all()
    assert np.isinf(drawn.faults.sensor_s).all()
    assert (drawn.faults.protected.sum(axis=1) == COACH.axles - 1).all()


def test_a_case_may_shut_off_the_air_and_change_the_physics():
    equipped = Case("air", "", 80.0, reservoir_l=100.0).equipped(BOGIE)
    assert equipped.brake.reservoir_volume_l == 100.0
    assert Case("dry", "", 80.0).equipped(BOGIE) is BOGIE
    with pytest.raises(ParameterError, match="mechanisms"):
        Case("bad", "", 80.0, mechanisms=3)
    with pytest.raises(ParameterError, match="reservoir_l"):
        Case("bad", "", 80.0, reservoir_l=-1.0)


def rows(name, values, stopped=True):
    """Return stops of a controller with these figures of ratio_dry and nothing else."""
    table = {"controller": name, "case": "spray", "law": "classic", "stopped": stopped, "within_limit": True}
    figures = {figure: [0.0] * len(values) for figure in FIGURES}
    columns = {**{key: [value] * len(values) for key, value in table.items()}, "draw": list(range(len(values)))}
    return polars.DataFrame({**columns, **figures, "ratio_dry": values})


REQUIRED = (
    Requirement("extension", "ratio_dry", 1.4, "assumption", ("spray",), mean_at_most=1.25),
    Requirement("no lock", "locked_s", 0.0, "assumption"),
)


def test_a_requirement_may_ask_for_worst_and_mean():
    stops = polars.concat(
        [rows("good", [1.2, 1.29]), rows("late", [1.3, 1.3]), rows("once", [1.0, 1.41]), rows("on", [1.0], False)]
    )
    passed = {v.controller: v.passed for v in judge(stops, REQUIRED) if v.requirement == "extension"}
    assert passed == {"good": True, "late": False, "once": False, "on": False}


def test_one_line_says_what_decides():
    stops = polars.concat([rows("good", [1.2, 1.29]), rows("late", [1.3, 1.3])])
    first, second = decided(judge(stops, REQUIRED))
    assert first == "PASS good: all 2 requirements; nearest: extension 1.245 of 1.25 (mean)"
    assert second == "FAIL late: extension 1.3 of 1.25 (mean), the other 1 met"
    locked = rows("locks", [1.5, 1.5]).with_columns(locked_s=polars.lit(2.0))
    (line,) = decided(judge(locked, REQUIRED))
    assert (
        line == "FAIL locks: no lock 2 of 0 s (spray, classic, draw 1), and 1 more of 2"
    )  # where nothing is granted, that decides


def test_a_controller_without_a_monitor_reports_no_wheel():
    assert not standing_reported(object(), (2, 3)).any()


@pytest.mark.parametrize("text", ["{", "3"])
def test_mechanisms_that_are_none_are_refused(text):
    with pytest.raises(ParameterError, match="mechanisms"):
        PhysicsOptions(mechanisms=text).conduct()


def test_mechanisms_and_the_cap_reach_the_stops():
    options = PhysicsOptions(mechanisms='{"load_transfer": {}}', cap_recovery=True)
    assert options.conduct().mechanisms == {"load_transfer": {}}
    assert options.on(BOGIE).contact.traction_law == "capped"
    assert math.isclose(options.on(BOGIE).contact.law.creepage, 0.3)


class Vents:
    """Vents all axles for good; says of no wheel that it stands."""

    def reset(self, n, vehicle):
        self.shape = (n, vehicle.axles)

    def act(self, measurement):
        return -np.ones(self.shape)


def test_what_fails_acts_in_the_stop_and_is_not_held_against_the_controller():
    """Without current a vehicle brakes whatever its controller wants; an axle whose valve vents no more keeps its pressure."""
    low = Case("low", "", 30.0, (0.03, 0.031), power_lost_s=0.5)
    stuck = dataclasses.replace(low, power_lost_s=np.inf, valve_applies_s=0.0, mechanisms={"leading_axle_cleaning": {}})
    found = {}
    for case in (low, stuck):
        drawn = draw_stops(case, read_programme(), BOGIE, Draws(1))
        conduct = Conduct(time_limit_s=8.0, mechanisms=case.mechanisms)
        result = run(Vents(), BOGIE, drawn.stops[:1], conduct, faults=rows_of(drawn.faults, 1))
        found[case.name if case is low else "stuck"] = (drawn, result)
    drawn, result = found["low"]
    assert (result.command[40:] == 1.0).all()
    drawn, result = found["stuck"]
    axle = int(np.argmin(drawn.faults.applies_s[0]))
    assert (result.command[:, 0, axle] == 0.0).all()  # it cannot vent
    assert (result.command[:, 0, 1 - axle] == -1.0).all()
    assert result.reported is not None
    assert not result.reported.any()


def rows_of(faults, n):
    """Return the first n stops' faults."""
    return Faults(*(getattr(faults, field.name)[:n] for field in dataclasses.fields(Faults)))


def test_a_wheel_that_locks_because_its_valve_failed_is_to_be_reported_all_the_same():
    speed, slip = np.full((51, 1), 20.0), np.zeros((51, 1, 2))
    slip[:, :, 0] = 20.0  # stands
    zeros = np.zeros((51, 1, 2))
    stop = draw_stops(Case("low", "", 72.0, (0.05, 0.06)), read_programme(), BOGIE, Draws(1)).stops[0]
    records = StopRecords(
        time=0.02 * np.arange(51), speed=speed, position=np.linspace(0.0, 20.0, 51)[:, None], slip=slip, pressure=zeros,
        adhesion=zeros, command=zeros[1:], steps=np.array([50]), duration=np.ones(1), distance=np.full(1, 20.0),
        stopped=np.ones(1, dtype=bool), air=np.full((1, 2), 100.0), contact_work=np.zeros((1, 2)),
        reported=np.arange(50)[:, None, None] >= np.full((1, 2), 25),
    )  # fmt: skip
    equipped = dataclasses.replace(BOGIE, brake=dataclasses.replace(BOGIE.brake, reservoir_volume_l=100.0))
    found = figures(records, ceiling(equipped, [stop]), np.array([[False, True]]))
    assert found["locked_s"][0] == 0.0
    assert found["unreported_s"][0] == pytest.approx(0.5)
    assert found["reservoir_fall_bar"][0] == pytest.approx(200.0 * 1.01325 / 200.0)
    assert figures(records, ceiling(BOGIE, [stop]))["locked_s"][0] == pytest.approx(1.0)
