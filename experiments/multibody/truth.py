"""The multibody coach as truth: its stops, recorded, diagnosed with the one-dimensional model.

    python -m experiments.multibody.truth [--out out/multibody_truth]

Three campaigns on straight track, where the wheel loads that move forward are what the model lacks: the coach as it is, hard
stops with deep slides, and an axle that is released. Two in a curve of 300 m, where it also lacks what the curve does: sliding
on slippery rails, and braked so gently on dry ones that no axle slides. Two more with a curve of 150 m in some of the stops,
whose force is several times what sound vehicles vary by: with all wheel speeds, and with the last axle's alone, which hardly
shows the curve. Each is written as a campaign folder and diagnosed as `wsp diagnose` does; the loads that it says are set
beside the true ones, and what the curve takes is printed.
"""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tyro

from experiments.multibody.curving import full, slips, taken
from experiments.multibody.stops import Driven, Planned, along_the_line, drive, write_campaign
from wsp_env.diagnosis import Diagnosis, diagnose
from wsp_env.parameters.track_geometry import Curve, TrackGeometry
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.mechanisms import load_transfer
from wsp_env.recordings import read_campaign

#: Stops from 42 to 30 m/s, about the friction of the paper's Table 2 within 10 %.
STRAIGHT = (
    Planned("A1", 42.3, 0.060), Planned("A2", 36.0, 0.055), Planned("A3", 30.0, 0.065),
    Planned("B1", 40.0, 0.062), Planned("B2", 33.0, 0.057),
)  # fmt: skip
#: Slower, and braked only in the full curve: 300 m radius, 150 mm cant balance 17 m/s; 22 m/s leave 0.6 m/s2.
CURVED = (
    Planned("A1", 22.0, 0.060, 7.0), Planned("A2", 20.0, 0.055, 7.5), Planned("A3", 18.0, 0.065, 8.0),
    Planned("B1", 21.0, 0.062, 7.0), Planned("B2", 19.0, 0.057, 8.0),
)  # fmt: skip
CURVE = TrackGeometry(curves=(Curve(begin_m=40.0, transition_m=60.0, length_m=2000.0, radius_m=300.0, cant_m=0.15),))
#: Dry rail and gentle brakes: no axle slides, and what the curve takes is some per cent of what the brakes do.
GENTLE = (
    Planned("A1", 22.0, 0.28, 3.0, 0.20), Planned("A2", 20.0, 0.27, 3.0, 0.18), Planned("A3", 18.0, 0.26, 2.0, 0.15),
    Planned("B1", 21.0, 0.275, 3.0, 0.19), Planned("B2", 19.0, 0.265, 2.0, 0.16),
)  # fmt: skip
AHEAD = TrackGeometry(curves=(Curve(begin_m=150.0, transition_m=60.0, length_m=2000.0, radius_m=300.0, cant_m=0.15),))
#: Hard stops on a drier rail, all axles sliding deeply: load transfer grows with the deceleration, and on the flat part of a
#: creep curve it moves the slip far. The brake is as strong as experiments/table7.py finds the paper's; the slide protection
#: lets wheels slide by 3 m/s and more (assumption: as in the paper, whose means are 5 m/s) and has its reference speed from the
#: test train's own sensor, so that no axle is released for it.
DEEP = (
    Planned("A1", 44.0, 0.08, 1.0), Planned("A2", 42.0, 0.10, 1.0), Planned("A3", 40.0, 0.07, 1.0),
    Planned("B1", 43.0, 0.09, 1.0), Planned("B2", 41.0, 0.075, 1.0),
)  # fmt: skip
STRONGEST = dataclasses.replace(COACH, brake=dataclasses.replace(COACH.brake, torque_per_bar_nm=3300.0))
SLIDES_DEEPLY = {
    "slip_base_mps": 3.0, "slip_per_speed": 0.05, "slip_release_factor": 0.6, "slip_large_factor": 1.5,
    "deceleration_mps2": 8.0, "deceleration_large_mps2": 15.0, "recovered_mps2": 0.0, "pulse_off_s": 0.1,
}  # fmt: skip
NO_AXLE_RELEASED = {"reference_bound_mps2": 3.0, "resynchronise_s": 60.0}
#: The same with the protection's own reference speed: it releases one axle, mostly the last, every few seconds, so that the two
#: bogies brake with different forces and shift their loads differently. A weaker brake, slippery rail.
RELEASED = (
    Planned("A1", 36.0, 0.06, 1.0), Planned("A2", 32.0, 0.09, 1.0), Planned("A3", 30.0, 0.04, 1.0),
    Planned("B1", 34.0, 0.08, 1.0), Planned("B2", 31.0, 0.05, 1.0),
)  # fmt: skip
STRONG = dataclasses.replace(COACH, brake=dataclasses.replace(COACH.brake, torque_per_bar_nm=2500.0))
#: Stops that begin at their places of one line. Three end before a curve of 150 m, on slippery rails, and slide; the others
#: come to it on dry rails, up to 0.8 m/s2 faster than its cant balances, are braked so gently that no axle slides, three from
#: 90 to 130 m ahead of it and one in its first transition (a brake that acts at high speed could stand in for it), and stop
#: behind it. The curve takes some 2.4 per mille of the weight, five times what a vehicle may vary by; straight track nothing.
SHARP = (
    Planned("A1", 28.0, 0.060, 2.0, 1.0, 20.0, 0.06), Planned("A2", 26.0, 0.055, 2.0, 1.0, 60.0, 0.06),
    Planned("A3", 16.2, 0.28, 5.6, 0.22, 780.0, 0.27), Planned("A4", 15.8, 0.27, 9.5, 0.20, 880.0, 0.27),
    Planned("A5", 16.4, 0.26, 5.5, 0.23, 820.0, 0.27), Planned("B1", 27.0, 0.065, 2.0, 1.0, 110.0, 0.06),
    Planned("B2", 16.0, 0.275, 5.6, 0.21, 800.0, 0.27),
)  # fmt: skip
BEND = Curve(begin_m=1000.0, transition_m=40.0, length_m=150.0, radius_m=150.0, cant_m=0.15)
LINE = TrackGeometry(gauge_m=1.45, curves=(BEND,))
VALIDATE = ("B1", "B2")


class Campaign(NamedTuple):
    """What is recorded, and on which track."""

    stops: tuple[Planned, ...]
    track: TrackGeometry | None = None
    vehicle: Vehicle = COACH
    thresholds: Mapping[str, float] | None = None  # of the slide protection, in place of its own
    blind: tuple[int, ...] = ()  # axles whose wheel speeds are not recorded


CAMPAIGNS = {
    "straight": Campaign(STRAIGHT),
    "deep": Campaign(DEEP, vehicle=STRONGEST, thresholds=SLIDES_DEEPLY | NO_AXLE_RELEASED),
    "released": Campaign(RELEASED, vehicle=STRONG, thresholds=SLIDES_DEEPLY),
    "curve": Campaign(CURVED, CURVE),
    "gentle": Campaign(GENTLE, AHEAD),
    "sharp": Campaign(SHARP, LINE),
    "sharp_last": Campaign(SHARP, LINE, blind=(1, 2, 3)),
}


def sliding(driven: Driven) -> np.ndarray:
    """Return the samples (T,) bool in which the brake acts and the coach runs faster than 5 m/s."""
    return (driven.torque.min(axis=1) > 0.0) & (driven.speed > 5.0)


def true_levers(driven: list[Driven], vehicle: Vehicle) -> np.ndarray:
    """Return the change of wheel load per deceleration (A,) [N / (m/s2)], least squares over all stops."""
    own = [sliding(one) for one in driven]
    slowing = np.concatenate([one.deceleration[at] for one, at in zip(driven, own, strict=True)])
    change = np.concatenate([one.wheel_load[at] - vehicle.static_wheel_load_n for one, at in zip(driven, own, strict=True)])
    return slowing @ change / (slowing @ slowing)


def said_levers(parameters: dict[str, float], vehicle: Vehicle) -> np.ndarray:
    """Return the same (A,) of a load transfer as the diagnosis says it."""
    heights = load_transfer.Parameters(parameters.get("body_height_m", 0.0), parameters.get("pivot_height_m", 0.0))
    return load_transfer.steadily(heights, vehicle)


def said_of_curves(campaign: Campaign, driven: list[Driven]) -> None:
    """Print what the full curves take of the stops that run through them."""
    weight = campaign.vehicle.mass_kg * campaign.vehicle.gravity_mps2
    for curve in campaign.track.curves if campaign.track else ():
        begin, end = full(curve, campaign.vehicle)
        for stop, one in zip(campaign.stops, driven, strict=True):
            stretch = begin - stop.start_m, min(end - stop.start_m, one.distance - 30.0)
            if stretch[0] < stretch[1]:
                force = taken(one, campaign.vehicle, *stretch)
                slip = np.round(slips(one, campaign.vehicle, *stretch), 3).tolist()
                print(f"{stop.name}: the curve takes {force:.0f} N, {1e3 * force / weight:.2f} per mille; slips {slip} m/s")


def answer(found: Diagnosis, true: np.ndarray, vehicle: Vehicle) -> dict[str, object]:
    """Return what is kept of a diagnosis, with the wheel loads it says beside the true ones."""
    said: dict[str, dict[str, float]] = found.model.get("mechanisms", {})
    kept: dict[str, object] = {"verdict": found.verdict, "sentence": found.sentence, "mechanisms": said}
    kept["discovered"] = [str(one) for one in found.discovered]
    kept["notes"] = list(found.notes)
    kept["true_n_per_mps2"] = np.round(true, 1).tolist()
    if "load_transfer" in said:
        own = said_levers(said["load_transfer"], vehicle)
        kept["said_n_per_mps2"] = np.round(own, 1).tolist()
        kept["said_over_true"] = round(float(own @ true / (true @ true)), 3)
    return kept


def main(out: Path = Path("out/multibody_truth"), only: tuple[str, ...] = tuple(CAMPAIGNS), again: bool = True) -> None:
    """Record, diagnose, print.

    Parameters
    ----------
    out
        Folder of the campaigns, with answers.json.
    only
        Names of the campaigns.
    again
        Diagnose too; without, the campaigns are only recorded.

    """
    answers: dict[str, object] = {}
    for name in only:
        campaign = CAMPAIGNS[name]
        vehicle = campaign.vehicle
        stops, line = campaign.stops, campaign.track
        if line is not None and any(stop.start_m for stop in stops):
            driven = along_the_line(stops, line, vehicle, thresholds=campaign.thresholds)
        else:
            driven = drive(stops, track=line, vehicle=vehicle, thresholds=campaign.thresholds)
        write_campaign(out / name, f"multibody coach, {name}", stops, driven, VALIDATE, vehicle, campaign.blind)
        said_of_curves(campaign, driven)
        true = true_levers(driven, vehicle)
        for stop, one in zip(stops, driven, strict=True):
            mean = np.round(one.wheel_load[sliding(one)].mean(axis=0) / 1e3, 2).tolist()
            print(f"{name} {stop.name}: {one.distance:.0f} m, mean wheel loads {mean} kN", flush=True)
        print(f"{name}: true change of wheel load {np.round(true).tolist()} N per m/s2", flush=True)
        if again:
            answers[name] = answer(diagnose(read_campaign(out / name)), true, vehicle)
            print(json.dumps({name: answers[name]}, indent=2), flush=True)
    (out / "answers.json").write_text(json.dumps(answers, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main)
