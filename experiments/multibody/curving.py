"""What a curve takes from a coach that rolls through it, in newtons, beside the rules that railways go by.

    python -m experiments.multibody.curving

The force is what the balance of the whole vehicle in one dimension lacks: the loss of momentum of all masses, wheels' turning
included, less what brakes and running resistance take. On straight track it is nothing.

Rules, in per mille of the weight: Roeckl's formula, 650 / (R - 55) from 300 m on and 500 / (R - 30) below, of the railways of
Germany, Austria and Switzerland, and 700 / R of the former Soviet Union's, both after Astakhov (1966), Resistance to the
motion of railway rolling stock, as cited by Wikipedia, Curve resistance (railroad); Astakhov measured a few times less at the
speed that the cant balances, and gives 200 / R plus 1.5 per m/s2 of unbalanced lateral acceleration.
"""

import math

import numpy as np
import tyro
from rich.console import Console

from experiments.multibody.stops import Driven, Planned, drive
from wsp_env.parameters.track_geometry import Curve, TrackGeometry
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.velim import SAMPLE_TIME_S
from wsp_env.report import Table, terminal_table

#: Radius [m], gauge [m]; below some 200 m tracks are laid wider, here by 15 mm (assumption: of the usual 10 to 20 mm).
CURVES = ((300.0, 1.435), (190.0, 1.435), (150.0, 1.435), (150.0, 1.45))
CANT_M, TRANSITION_M, LENGTH_M, BEGIN_M = 0.15, 40.0, 150.0, 30.0
#: Unbalanced lateral acceleration in the plane of the track [m/s2]: none, and as much as lines usually allow.
UNBALANCED_MPS2 = (0.0, 0.65)
#: A dry rail, and the contaminated one of the paper.
FRICTION = (0.28, 0.06)
#: Distance of the contact points across the track [m].
ACROSS_M = 1.5


def places(driven: Driven) -> np.ndarray:
    """Return the way (T,) of the leading axle since the start [m]."""
    step: np.ndarray = 0.5 * (driven.speed[1:] + driven.speed[:-1]) * SAMPLE_TIME_S
    return np.concatenate([[0.0], np.cumsum(step)])


def taken(driven: Driven, vehicle: Vehicle, begin_m: float, end_m: float) -> float:
    """Return the mean force [N] beside brakes and running resistance while the leading axle runs from `begin_m` to `end_m`."""
    force = driven.torque.sum(axis=1) / vehicle.wheel_radius_m
    force = force + np.polynomial.Polynomial([float(value) for value in vehicle.resistance])(driven.speed)
    turning = vehicle.wheelset_inertia_kgm2 * driven.wheel_speed.sum(axis=1) / vehicle.wheel_radius_m
    taken_by_them = SAMPLE_TIME_S * np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]))])
    momentum = vehicle.mass_kg * driven.speed + turning + taken_by_them
    first, last = np.searchsorted(places(driven), [begin_m, end_m])
    return float((momentum[first] - momentum[last]) / (driven.time[last] - driven.time[first]))


def slips(driven: Driven, vehicle: Vehicle, begin_m: float, end_m: float) -> np.ndarray:
    """Return the mean of v - r w (A,) on that stretch [m/s], as one dimension has it, with the nominal radius."""
    first, last = np.searchsorted(places(driven), [begin_m, end_m])
    turning = vehicle.wheel_radius_m * driven.wheel_speed[first:last]
    result: np.ndarray = (driven.speed[first:last, None] - turning).mean(axis=0)
    return result


def full(curve: Curve, vehicle: Vehicle) -> tuple[float, float]:
    """Return where the leading axle is [m] when the last one enters the full curve, and when it leaves it itself."""
    length = vehicle.axle_positions_m[-1] - vehicle.axle_positions_m[0]
    return curve.begin_m + curve.transition_m + length, curve.end_m - curve.transition_m


def rules(radius_m: float, unbalanced_mps2: float) -> tuple[float, float, float]:
    """Return the resistance in per mille by Roeckl, by 700 / R and by Astakhov."""
    roeckl = 650.0 / (radius_m - 55.0) if radius_m >= 300.0 else 500.0 / (radius_m - 30.0)
    return roeckl, 700.0 / radius_m, 200.0 / radius_m + 1.5 * unbalanced_mps2


def main() -> None:
    """Print the table."""
    weight, rows = COACH.mass_kg * COACH.gravity_mps2, []
    tilt = math.asin(CANT_M / ACROSS_M)
    for radius, gauge in CURVES:
        curve = Curve(BEGIN_M, TRANSITION_M, LENGTH_M, radius, CANT_M)
        speeds = [math.sqrt(radius * (one / math.cos(tilt) + COACH.gravity_mps2 * math.tan(tilt))) for one in UNBALANCED_MPS2]
        stops = [Planned("", v, mu, (curve.end_m + 25.0) / v, 0.5) for v in speeds for mu in FRICTION]
        driven = drive(stops, track=TrackGeometry(gauge_m=gauge, curves=(curve,)), keep=("derailment_quotient",))
        lie = full(curve, COACH)
        for stop, one, unbalanced in zip(stops, driven, np.repeat(UNBALANCED_MPS2, len(FRICTION)), strict=True):
            force = taken(one, COACH, *lie)
            said = (f"{value:.1f}" for value in rules(radius, float(unbalanced)))
            slip = ", ".join(f"{value:.3f}" for value in slips(one, COACH, *lie))
            rows.append(
                (f"{radius:g}", f"{1e3 * gauge:g}", f"{stop.speed_mps:.1f}", f"{stop.mu_cd:g}", f"{force:.0f}",
                 f"{1e3 * force / weight:.2f}", *said, slip)
            )  # fmt: skip
    header = (
        "R [m]", "gauge [mm]", "speed [m/s]", "mu_cd", "takes [N]", "per mille", "Roeckl", "700 / R", "Astakhov",
        "slips [m/s]",
    )  # fmt: skip
    Console(width=150, highlight=False).print(terminal_table(Table(header, rows, "in the full curve, rolling freely")))


if __name__ == "__main__":
    tyro.cli(main)
