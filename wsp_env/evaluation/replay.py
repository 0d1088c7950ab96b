"""How would a controller have done in that test: controllers brake under the conditions of recorded stops."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from wsp_env.envs.model import TunedModel
from wsp_env.envs.step import LOCKED_RUNNING_MPS, LOCKED_WHEEL_MPS
from wsp_env.envs.task import Task
from wsp_env.evaluation.bound import SlideLimit
from wsp_env.evaluation.braking import Braking, read, work
from wsp_env.evaluation.carried import carry
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.policy import Policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.executor import Executor, ThisProcess
from wsp_env.parameters.campaign_vehicle import plant_vehicle
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.plant.port import Choice, Stop
from wsp_env.recordings import Campaign, Smoothing, Tuning, conditions, derive, rolling_radii, tune
from wsp_env.recordings.derive import braking
from wsp_env.recordings.simulate import simulate
from wsp_env.scenario import Scenario, draw

#: Rows of the table that are no controllers: the stop as recorded, and simulated with the torque as recorded.
RECORDED, SIMULATED = "recorded", "recorded torque, simulated"

#: Figure of a replayed stop -> unit and meaning; all from the start of braking to the last speed that was recorded.
FIGURES = {
    "distance_m": ("m", "distance run"),
    "time_s": ("s", "time taken"),
    "mean_slip_mps": ("m/s", "mean slip speed, eq. (21) of the seed paper, mean of the axles"),
    "slip_deviation_mps": ("m/s", "standard deviation of the slip speed, eq. (21), mean of the axles"),
    "largest_creepage": ("-", "largest creepage of any axle where the slide limit holds"),
    "beyond_limit_s": ("s", "time beyond the slide limit, worst axle"),
    "locked_s": ("s", "time locked above 5 km/h, worst axle"),
}


_HERE = ThisProcess()


@dataclasses.dataclass(frozen=True)
class Course:
    """One stop: T samples from the start of braking on."""

    stop: str
    who: str
    time_s: np.ndarray  # (T,)
    speed_mps: np.ndarray  # (T,)
    slip_mps: np.ndarray  # (T, A)
    figures: Mapping[str, float]


@dataclasses.dataclass(frozen=True)
class Replay:
    """The courses of all stops by all controllers, and the controllers that failed."""

    campaign: str
    tau_m_per_j: float
    courses: tuple[Course, ...]
    failures: Mapping[str, str]  # controller -> message

    def to_json(self) -> dict[str, Any]:
        """Return the figures as plain data."""
        rows = [{"stop": course.stop, "controller": course.who, **course.figures} for course in self.courses]
        figures = {name: {"unit": unit, "meaning": meaning} for name, (unit, meaning) in FIGURES.items()}
        return {
            "campaign": self.campaign,
            "tau_m_per_J": self.tau_m_per_j,
            "figures": figures,
            "stops": rows,
            "failures": dict(self.failures),
        }


def replay(
    campaign: Campaign,
    controllers: Mapping[str, Mapping[str, Any]],
    *,
    along_track: bool = False,
    conduct: Conduct = Conduct(),
    model: TunedModel | None = None,
    smoothing: Smoothing = Smoothing(),
    base: Vehicle | None = None,
    executor: Executor = _HERE,
    done: Callable[[str], None] = lambda what: None,
) -> Replay:
    """Tune the law on the campaign and let every controller brake under the conditions of each of its stops.

    Parameters
    ----------
    controllers : names, see `load`, with the parameters that are set
    along_track : mu_cd varies along the track as estimated from the recordings
    conduct : how the controllers' stops are run: the plant, physics beyond the paper's model
    model : as a diagnosis found it: its tau, its mu_cd of every run and its mechanisms, instead of the law tuned here, in the
        stop with the recorded torque, too; one without mu_cd adds its mechanisms to the law tuned here
    base : gives what the campaign does not tell of its vehicle, see `plant_vehicle`
    executor : does the work, a task for every controller, see `wsp_env.executor`; the results do not depend on it
    done : called with the name of what has been computed

    Raises
    ------
    CampaignError, ParameterError
        for a campaign or a controller's name that cannot be used, or a policy whose contract does not fit

    """
    loaded = {name: load(name, parameters) for name, parameters in controllers.items()}
    tuning = tune(campaign, smoothing)
    if model is not None:
        tuning, conduct = _tuned_as(model, tuning), dataclasses.replace(conduct, mechanisms=model.mechanisms)
    replayed = conditions(campaign, tuning, along_track, smoothing, base)
    courses = [course for name in tuning.runs for course in _recorded(campaign, name, tuning, conduct.mechanisms, smoothing)]
    last = {course.stop: float(course.speed_mps[-1]) for course in courses if course.who == RECORDED}
    done(RECORDED)
    vehicle, stops, names = braked(campaign, replayed)
    for controller in loaded.values():
        if isinstance(controller, Policy):
            controller.check(vehicle, conduct.control_interval_s, conduct.pressure_sensors)
    tasks = [Braking(name, carry(name, executor.far), set_to, vehicle, tuple(stops), conduct)
             for name, set_to in controllers.items()]  # fmt: skip
    failures, braked_by = {}, {}
    for task, content, failure in executor.run(work, tasks):
        if failure:
            failures[task.name] = failure
            continue
        braked_by[task.name] = read(content)
        done(task.name)
    for name in (name for name in controllers if name in braked_by):
        time, whole_speed, whole_position, whole_slip, *_ = braked_by[name]
        for index, stop in enumerate(names):
            part = slice(0, int(np.argmax(whole_speed[:, index] <= last[stop])) + 1 or None)
            position = whole_position[part, index]
            speed, slip = whole_speed[part, index], whole_slip[part, index]
            courses.append(_course(stop, name, time[part], speed, slip, float(position[-1])))
    order = list(tuning.runs)
    return Replay(campaign.name, tuning.tau_m_per_J, tuple(sorted(courses, key=lambda c: order.index(c.stop))), failures)


def braked(campaign: Campaign, replayed: Mapping[str, Any]) -> tuple[Vehicle, list[Stop], list[str]]:
    """Return the vehicle, the stops and their names, from what `wsp_env.recordings.conditions` makes of a campaign."""
    task = Task(conditions=replayed)
    vehicle = find_vehicle(replayed["vehicle"], plant_vehicle(campaign.vehicle, campaign.contact, campaign.name))
    generator = np.random.default_rng(0)
    pins = [{key: value for key, value in stop.items() if key != "name"} for stop in task.stops]
    stops = [draw(Scenario(), vehicle, generator, task.track_nodes, pin) for pin in pins]
    return vehicle, stops, [stop["name"] for stop in task.stops]


def _tuned_as(model: TunedModel, tuning: Tuning) -> Tuning:
    """Return a tuning with the tau and the mu_cd of a model; `ParameterError` for a run that it does not know."""
    if not model.mu_cd:
        return tuning
    if unknown := [name for name in tuning.runs if name not in model.mu_cd]:
        raise ParameterError(
            f"model {model.path} has no mu_cd of {', '.join(unknown)}: it was found on other recordings; it knows "
            f"{', '.join(model.mu_cd) or 'none'}"
        )
    runs = {name: dataclasses.replace(score, mu_cd=model.mu_cd[name]) for name, score in tuning.runs.items()}
    tau = tuning.tau_m_per_J if model.tau_m_per_j is None else model.tau_m_per_j
    return dataclasses.replace(tuning, tau_m_per_J=tau, runs=runs)


def _recorded(
    campaign: Campaign, name: str, tuning: Tuning, mechanisms: Choice, smoothing: Smoothing
) -> tuple[Course, Course]:  # fmt: skip
    """Return a stop as recorded, and simulated with its recorded torque."""
    recording = campaign.runs[name]
    radii = rolling_radii(campaign, smoothing)
    derived = derive(campaign, recording, radii, smoothing)
    start, end = braking(recording, campaign.sample_time_s, smoothing)
    time = derived.time_s[start:end] - derived.time_s[start]
    speed = derived.speed_mps[start:end]
    way = float(np.trapezoid(speed, time))
    as_recorded = _course(name, RECORDED, time, speed, derived.slip_speed_mps[start:end], way)
    law = (tuning.runs[name].mu_cd, tuning.tau_m_per_J)
    whole = simulate(campaign, recording, derived, radii, np.array([start]), end - start, *law, mechanisms)
    own = whole.speed_mps[0]
    slip = own[:, None] - whole.circumferential_mps[0]
    return as_recorded, _course(name, SIMULATED, time, own, slip, float(np.trapezoid(own, time)))


def _course(stop: str, who: str, time: np.ndarray, speed: np.ndarray, slip: np.ndarray, distance: float) -> Course:
    limit = SlideLimit()
    interval = float(time[1] - time[0]) if len(time) > 1 else 0.0
    creepage = slip / np.maximum(speed, 1e-3)[:, None]
    counted = (speed > limit.above_mps)[:, None]
    locked = (speed[:, None] - slip < LOCKED_WHEEL_MPS) & (speed > LOCKED_RUNNING_MPS)[:, None]
    figures = {
        "distance_m": distance,
        "time_s": float(time[-1]),
        "mean_slip_mps": float(slip.mean()),
        "slip_deviation_mps": float(slip.std(axis=0).mean()),
        "largest_creepage": float(np.where(counted, creepage, 0.0).max()),
        "beyond_limit_s": interval * float((counted & (creepage > limit.creepage)).sum(axis=0).max()),
        "locked_s": interval * float(locked.sum(axis=0).max()),
    }
    return Course(stop, who, time, speed, slip, figures)
