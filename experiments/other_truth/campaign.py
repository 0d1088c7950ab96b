"""A campaign: vehicle, brake, protection, track and stops, drawn from a seed, and the simulation of its stops."""

import dataclasses
from typing import NamedTuple, TypeVar

import numpy as np

from experiments.other_truth.plant import LONGEST_S, ROW_S, STEP_S, fresh, simulate
from experiments.other_truth.records import Array, Brake, Places, Protection, Run, Sizes, Vehicle
from experiments.other_truth.sound import MOST_LENGTH, MOST_SLIP_MPS, SOUND, draw_sound

T = TypeVar("T")


class Rows(NamedTuple):
    """One simulated stop, a row every `plant.ROW_S`; views of one array."""

    speed: Array  # (N,) [m/s]
    position: Array  # (N,) of the leading axle [m]
    wheel: Array  # (N, A) [rad/s], as a sensor sees it
    pressure: Array  # (N, A) [bar]
    torque: Array  # (N, A) [N m], true
    slip: Array  # (N, A) [m/s]

    @property
    def length(self) -> float:
        """Length of the stop [m]."""
        return float(self.position[-1] - self.position[0])


@dataclasses.dataclass(frozen=True)
class Campaign:
    """Everything that is drawn once per campaign, and its stops."""

    seed: int
    rng: np.random.Generator  # goes on where the draw ended
    vehicle: Vehicle
    brake: Brake
    protection: Protection
    places: Places
    mu_cd: float  # mean of the runs', before some are made drier
    sound: list[str]  # kinds of sound variation
    runs: list[Run]

    @property
    def axles(self) -> int:
        """Number of wheelsets."""
        return len(self.vehicle.positions_m)

    def stop(self, index: int, sizes: Sizes, sound: bool = True, step_s: float = STEP_S) -> Rows:
        """Return a stop with effects of some sizes, with or without sound variation."""
        varied = draw_sound(self.seed, index, self.axles, self.sound if sound else [])
        out = np.zeros((round(LONGEST_S / ROW_S), 2 + 4 * self.axles))
        run, vehicle = self.runs[index], self.vehicle
        state = fresh(run, vehicle, varied, sizes, self.places)
        rows = simulate(run, vehicle, self.brake, self.protection, varied, sizes, self.places, state, out, step_s)
        return Rows(out[:rows, 0], out[:rows, 1], *(out[:rows, column::4] for column in range(2, 6)))

    def spread(self, index: int) -> tuple[float, float]:
        """Return by how much sound variation moves a stop's length (relative) and mean slip [m/s]."""
        varied, bare = self.stop(index, Sizes()), self.stop(index, Sizes(), sound=False)
        return abs(varied.length / bare.length - 1.0), float(abs(varied.slip.mean() - bare.slip.mean()))


def draw(seed: int) -> Campaign:
    """Draw a campaign; stops that sound variation moves by more than is promised are drawn anew, up to six times."""
    rng = np.random.default_rng(seed)
    vehicle, full_bar = _vehicle(rng)
    axles = len(vehicle.positions_m)
    brake_character = int(rng.integers(3))
    fill = _one_of(brake_character, [rng.uniform(3, 6), rng.uniform(3, 5), rng.uniform(5, 9)])
    protection = _protection(rng)
    places = _places(rng, axles, vehicle.mass_kg)
    mu_cd = rng.uniform(0.026, 0.05)
    runs = _runs(rng, mu_cd, full_bar)
    count = int(rng.integers(6, 11))
    kinds = sorted(rng.choice(list(SOUND), count, replace=False).tolist(), key=list(SOUND).index)
    brake = Brake(brake_character, fill, fill * rng.uniform(1.1, 1.9))
    campaign = Campaign(seed, rng, vehicle, brake, protection, places, mu_cd, kinds, runs)
    for i in range(len(runs)):
        for _ in range(6):
            length, slip = campaign.spread(i)
            if length < MOST_LENGTH and slip < MOST_SLIP_MPS:
                break
            runs[i] = runs[i]._replace(speed_mps=rng.uniform(16.0, 44.0), mu_cd=mu_cd * rng.uniform(0.88, 1.4))
    return campaign


def _one_of(index: int, values: list[T]) -> T:
    """Return one of several values, all of which were drawn."""
    return values[index]


def _vehicle(rng: np.random.Generator) -> tuple[Vehicle, float]:
    """Draw a vehicle and the pressure [bar] of its full brake."""
    axles = 2 if rng.random() < 0.2 else 4
    radius, wheelbase, pivots = (
        round(rng.uniform(0.42, 0.46), 3),
        round(rng.uniform(2.4, 2.7), 2),
        round(rng.uniform(14.0, 19.0), 1),
    )
    if axles == 2:
        pivots = round(rng.uniform(8.0, 10.0), 1)
    positions = [0.0, wheelbase, pivots, pivots + wheelbase] if axles == 4 else [0.0, pivots]
    mass = round(rng.uniform(36e3, 50e3) * axles / 4, -2)
    full_bar, full_mps2 = rng.uniform(2.4, 3.8), rng.uniform(1.15, 1.6)
    per_bar = round(full_mps2 * mass * radius / (axles * full_bar), 0)
    inertia = round(rng.uniform(120, 180), 0)
    return Vehicle(mass, radius, inertia, per_bar, wheelbase, pivots, np.array(positions)), full_bar


def _protection(rng: np.random.Generator) -> Protection:
    kind = int(rng.integers(3))
    return Protection(
        kind=kind,
        period_s=_one_of(kind, [rng.uniform(0.05, 0.1), rng.uniform(0.02, 0.04), rng.uniform(0.08, 0.14)]),
        slowing_mps2=rng.uniform(1.2, 1.6),
        slip_mps=rng.uniform(0.5, 1.0),
        slip_per_speed=rng.uniform(0.05, 0.13),
        vent=_one_of(kind, [rng.uniform(0.04, 0.08), rng.uniform(1.5, 3.0), rng.uniform(0.5, 1.0)]),
        apply=_one_of(kind, [rng.uniform(0.015, 0.03), rng.uniform(1.0, 2.5), rng.uniform(1.0, 2.5)]),
    )


def _places(rng: np.random.Generator, axles: int, mass: float) -> Places:
    return Places(
        gain_axle=int(rng.integers(axles)),
        dragging_axle=int(rng.integers(axles)),
        radius_axle=int(rng.integers(axles)),
        leaking_axle=int(rng.integers(axles)),
        parking_axle=int(rng.integers(axles)),
        patch_m=rng.uniform(250, 450),
        patch_length_m=rng.uniform(80, 220),
        electric_from_mps=rng.uniform(4, 12),
        planing_mps=rng.uniform(16, 24),
        wave_m=rng.uniform(8, 13),
        resonance_radps=2 * np.pi * rng.uniform(1.8, 3.0),
        release_s=rng.uniform(6, 14),
        drying_j=0.5 * mass / axles * 25.0**2 * rng.uniform(0.1, 0.3),
        curve_m=rng.uniform(300, 550),
        curve_length_m=rng.uniform(200, 400),
    )


def _runs(rng: np.random.Generator, mu_cd: float, full_bar: float) -> list[Run]:
    """Draw five to ten stops: of every four one on a drier rail and one that is braked gently."""
    count, runs = int(rng.integers(5, 11)), []
    levels = rng.permutation(np.linspace(16.0, 44.0, count) + rng.uniform(-1, 1, count))
    for r in range(count):
        gentle, drier = r % 4 == 3, r % 4 == 1
        mu = mu_cd * rng.uniform(0.88, 1.12) * (rng.uniform(1.2, 1.5) if drier else 1.0)
        bar = full_bar * (rng.uniform(0.3, 0.5) if gentle else rng.uniform(0.9, 1.05))
        position, coast, rise = round(rng.uniform(0, 200), 2), rng.uniform(1.5, 4.0), rng.uniform(0.6, 2.0)
        runs.append(Run(float(levels[r]), position, coast, mu, 0.0, bar, rise))
    tau = rng.uniform(1.2e-4, 2.6e-4)
    return [run._replace(tau_m_per_j=tau) for run in runs]
