"""The conditions by which learned controllers are measured, and the figures of any controller under them."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from wsp_env.evaluation.bound import Ceiling, ceiling
from wsp_env.evaluation.controller import Controller
from wsp_env.evaluation.figures import figures
from wsp_env.evaluation.programme import friction_for
from wsp_env.evaluation.runner import Conduct, StopRecords, run
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import TRACK_STEP_M, Stop
from wsp_env.scenario import Scenario, draw

#: Low adhesion in the sense of the test programme: peak of the contaminated rail's adhesion at the initial speed [-].
INITIAL_ADHESION = (0.05, 0.08)

#: Initial speed [m/s]: 80 to 160 km/h.
INITIAL_SPEED_MPS = (22.0, 44.5)

#: Recovery rate [m/J] as in the test programme (assumption: around the seed paper's 1.9e-4).
RECOVERY_M_PER_J = (1.2e-4, 3.0e-4)

#: Seeds of the conditions: watched while training; looked at while prices and ranges of the trainings were chosen; held out of
#: all of that. Training itself draws from other streams.
WATCHED, CHOSEN_BY, HELD_OUT = 1_000_001, 4_000_037, 7_000_031

#: Described track [m].
_TRACK_M = 8000.0

_CONDUCT = Conduct()

#: Figures that a policy must not have larger than the rules'.
COMPARED = (
    "distance_m", "mean_slip_mps", "slip_deviation_mps", "contact_energy_mj", "largest_creepage", "beyond_limit_s",
    "locked_s", "air_nl", "utilisation",
)  # fmt: skip


def low_adhesion(vehicle: Vehicle, law: str, count: int, seed: int) -> list[Stop]:
    """Draw full-brake stops on contaminated rail under "recovering" or "classic" law; the same stops for both."""
    stops = []
    scenario = Scenario(tau=RECOVERY_M_PER_J)
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        speed, load = rng.uniform(*INITIAL_SPEED_MPS), rng.uniform()
        friction = friction_for(rng.uniform(*INITIAL_ADHESION), speed, vehicle.mass_kg + load * vehicle.payload_kg, vehicle)
        pins = {"mu_cd": friction, "initial_speed": speed, "load": load, "demand": 1.0, "track": "constant"}
        stops.append(draw(scenario, vehicle, rng, int(_TRACK_M / TRACK_STEP_M) + 1, pins, classic=law == "classic"))
    return stops


def mixed(vehicle: str, count: int, classic_share: float, seed: int) -> list[Stop]:
    """Draw stops of which a share is under the classic law, the others under the recovering one."""
    classic = round(classic_share * count)
    kind = VEHICLES[vehicle]
    return [*low_adhesion(kind, "recovering", count - classic, seed), *low_adhesion(kind, "classic", classic, seed)]


class Yardstick:
    """The same stops for every controller that is measured.

    Parameters
    ----------
    vehicle : wheelset, bogie or coach, or any other
    stops : N conditions
    conduct : sensors and mechanisms

    """

    def __init__(self, vehicle: str | Vehicle, stops: Sequence[Stop], conduct: Conduct = _CONDUCT) -> None:
        self.vehicle: Vehicle = VEHICLES[vehicle] if isinstance(vehicle, str) else vehicle
        self.stops = stops
        self.top: Ceiling = ceiling(self.vehicle, stops)
        self.conduct = dataclasses.replace(conduct, pressure_sensors=True)  # who has not learned with them does not look

    @classmethod
    def drawn(cls, vehicle: str, law: str, count: int, seed: int, conduct: Conduct = _CONDUCT) -> "Yardstick":
        """Return one with low-adhesion stops of that law and seed."""
        return cls(vehicle, low_adhesion(VEHICLES[vehicle], law, count, seed), conduct)

    def figures(self, controller: Controller) -> dict[str, np.ndarray]:
        """Return the figures of all stops, their durations [s] and whether they came to an end, (N,) each."""
        return self.judged(run(controller, self.vehicle, self.stops, self.conduct))

    def judged(self, result: StopRecords) -> dict[str, np.ndarray]:
        """Return the same of stops that have been braked already."""
        return figures(result, self.top) | {"duration_s": result.duration, "stopped": result.stopped}

    def means(self, controller: Controller) -> dict[str, float]:
        """Return the means of the compared figures and of the metres slid (mean of the axles), and the share that ran on."""
        return means(self.figures(controller))


def means(found: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the means of the compared figures of some stops, see `Yardstick.means`."""
    slid = float(np.mean(found["mean_slip_mps"] * found["duration_s"]))
    own = {"slide_distance_m": slid, "ran_on": float(np.mean(~found["stopped"]))}
    return {name: float(np.mean(found[name])) for name in COMPARED} | own
