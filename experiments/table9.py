"""Cost of four contact laws inside the same coach simulation, beside the seed paper's Table 9.

    python experiments/table9.py [--json]

One stop of the UIC-Z1 coach (four wheelsets, eight contacts, the paper's first test: 42.3 m/s, mu_cd 0.06) with the law called
twice a wheelset and step, at the paper's step of 1e-4 s. The stop is the same for all: its motion follows the
degraded-adhesion law, every other law is evaluated at the same slips and loads and its result only summed. The cost of a law is
what the stop takes with it less what it takes with none, the least of several interleaved rounds, since whatever else runs only
adds time; the range over the rounds stands beside it. The paper's numbers hold the contact detection and Hertz's theory too,
which here are not computed anew: a straight track and a constant load leave them as they are.
"""

import argparse
import json
import math
import time
from collections.abc import Callable
from typing import TypeVar

import numba
import numpy as np
from rich.console import Console

from wsp_env.contact.degraded import adhesion
from wsp_env.contact.fastsim import ELEMENTS, STRIPS, fastsim
from wsp_env.contact.kalker import Patch, kalker_coefficients, saturated_force
from wsp_env.contact.polach import falling_friction, saturation
from wsp_env.contact.traction import Surface
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.velim import CONTACT, TAU_M_PER_J, TEST_SPEEDS_MPS
from wsp_env.report import Table, terminal_table

#: Table 9: seconds in the contact model for test A1.
PAPER_S = {"Kalker, saturated": 118.0, "Polach": 128.0, "degraded adhesion": 130.0, "FASTSIM": 213.0}

STEP_S = 1e-4  # Table 8
STOP_S = 2.0  # simulated [s]; the cost of a step does not change along a stop
TORQUE_NM = 6800.0  # per wheelset: some 1.4 m/s2, so that the wheels slide from the start

#: A law: adhesion force of a wheel [N] of slip and running speed [m/s] and load [N].
Law = Callable[[float, float, float], float]

#: A stop: end speed [m/s] and the sum of all forces that the law gave [N].
Stop = Callable[[int, float, float, float, float, float, float], tuple[float, float]]

Function = TypeVar("Function", bound=Callable[..., object])

_COEFFICIENTS = kalker_coefficients(CONTACT.semi_axis_a_m / CONTACT.semi_axis_b_m, 0.25)
_PATCH = Patch(CONTACT.semi_axis_a_m, CONTACT.semi_axis_b_m, CONTACT.shear_modulus_pa, *map(float, _COEFFICIENTS))
_LAW = CONTACT.law
_MU = CONTACT.kinetic_friction_d


def compiled(function: Function) -> Function:
    """Compile with numba's own defaults, uncached: a stop is compiled anew for every law."""
    made: Function = numba.njit(function)
    return made


@compiled
def nothing(slip: float, speed: float, load: float) -> float:
    """No contact law at all: what the stop itself costs."""
    return 0.0


@compiled
def kalker(slip: float, speed: float, load: float) -> float:
    """Global Kalker saturated by Johnson and Vermeulen."""
    return saturated_force(slip / speed, 0.0, 0.0, load, _MU, _PATCH)[0]


@compiled
def polach(slip: float, speed: float, load: float) -> float:
    """Polach with falling friction."""
    friction = falling_friction(abs(slip), _MU, _LAW.ratio_d, _LAW.gamma_d)
    gradient = _LAW.stiffness * abs(slip) / (speed * friction * load)
    return math.copysign(friction * load * saturation(gradient, _LAW.k_ad, _LAW.k_sd), slip)


@compiled
def degraded(slip: float, speed: float, load: float) -> float:
    """Evaluate this project's law, closed form."""
    return load * adhesion(slip, speed, load, Surface(_MU, _LAW.mu_cr, 1.0, 0.0), TAU_M_PER_J, _LAW).f


@compiled
def by_fastsim(slip: float, speed: float, load: float) -> float:
    """Evaluate FASTSIM on its default grid."""
    return fastsim(slip / speed, 0.0, 0.0, load, _MU, _PATCH, STRIPS, ELEMENTS)[0]


LAWS: dict[str, Law] = {"Kalker, saturated": kalker, "Polach": polach, "degraded adhesion": degraded, "FASTSIM": by_fastsim}


def make_stop(law: Law) -> Stop:
    """Return a compiled coach stop that also evaluates `law` at every contact and step."""

    @compiled
    def stop(
        steps: int, speed: float, mass: float, inertia: float, radius: float, load: float, torque: float
    ) -> tuple[float, float]:
        wheels = np.full(4, speed / radius)
        felt = 0.0
        for _ in range(steps):
            total = 0.0
            for k in range(4):
                slip = speed - radius * wheels[k]
                moving = adhesion(slip, speed, load, Surface(_MU, _LAW.mu_cr, 1.0, 0.0), TAU_M_PER_J, _LAW)
                force = 2.0 * load * moving.f * (1.0 if slip >= 0.0 else -1.0)
                for side in (0.99, 1.01):  # two slips and loads, or the compiler would compute one wheel for both
                    felt += law(side * slip, speed, side * load)
                total += force
                # linearly implicit in the slip: the paper's explicit step is stable only far from standstill
                rate = radius * (radius * force - torque) / inertia
                wheels[k] += STEP_S * rate / (radius * (1.0 + STEP_S * radius**2 * 2.0 * load * moving.df_ds / inertia))
            speed -= STEP_S * total / mass
        return speed, felt

    return stop


def measure(rounds: int = 11) -> dict[str, np.ndarray]:
    """Return seconds in each law per simulated second, (rounds,)."""
    vehicle = COACH
    arguments = (
        round(STOP_S / STEP_S),
        TEST_SPEEDS_MPS["A1"],
        vehicle.mass_kg,
        vehicle.wheelset_inertia_kgm2,
        vehicle.wheel_radius_m,
        vehicle.static_wheel_load_n,
        TORQUE_NM,
    )
    stops = {"": make_stop(nothing)} | {name: make_stop(law) for name, law in LAWS.items()}
    for stop in stops.values():
        stop(10, *arguments[1:])
    times: dict[str, list[float]] = {name: [] for name in stops}
    for _ in range(rounds):
        for name, stop in stops.items():
            start = time.process_time()
            stop(*arguments)
            times[name].append(time.process_time() - start)
    return {name: (np.array(times[name]) - min(times[""])) / STOP_S for name in LAWS}


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON")
    chosen = parser.parse_args()
    console = Console(highlight=False, stderr=chosen.json)
    if not console.is_terminal:
        console = Console(highlight=False, stderr=chosen.json, width=120)
    with console.status("compiling and measuring ..."):
        cost = measure()
    least = {name: float(own.min()) for name, own in cost.items()}
    ratios = {name: own / cost["Polach"] for name, own in cost.items()}
    if chosen.json:
        document = {
            name: {
                "s_per_s": least[name],
                "largest_s_per_s": float(cost[name].max()),
                "ratio": least[name] / least["Polach"],
                "ratios": [float(ratios[name].min()), float(ratios[name].max())],
                "paper_s": PAPER_S[name],
            }
            for name in LAWS
        }
        print(json.dumps(document))
        return
    rows = [
        (
            name,
            f"{1e3 * least[name]:.2f}",
            f"{1e3 * cost[name].max():.2f}",
            f"{least[name] / least['Polach']:.2f}",
            f"{ratios[name].min():.2f} to {ratios[name].max():.2f}",
            f"{PAPER_S[name] / PAPER_S['Polach']:.2f}",
        )
        for name in LAWS
    ]
    header = ("contact law", "ms per simulated s, least", "largest", "to Polach", "in the rounds", "the paper's")
    console.print(terminal_table(Table(header, rows)))
    console.print(
        f"Steps of {STEP_S:g} s, eight contacts. FASTSIM on {STRIPS} x {ELEMENTS} cells. The paper's times hold the contact "
        "detection and Hertz's theory, the same for all laws, which brings its ratios closer to one."
    )


if __name__ == "__main__":
    main()
