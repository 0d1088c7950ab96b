"""What the test team believed of a campaign, what was true of it, and the normal variation between the two."""

import dataclasses
import math

import numpy as np

from experiments.concealed.records import Brake, Effects, Law, PlannedStop, Vehicle

#: Coach UIC-Z1 (seed paper, Tables 1, 2 and 5; its bogie and wheelset are a half and a quarter of it).
AXLE_POSITIONS_M = {1: (0.0,), 2: (0.0, 2.56), 4: (0.0, 2.56, 19.0, 21.56)}
MASS_PER_AXLE_KG = 10_750.0
INERTIA_KGM2 = 160.0
RADIUS_M = 0.445
GRAVITY_MPS2 = 9.81
#: Contact (Table 2; semi-axes and c11: assumption, typical of this wheel load).
SEMI_AXIS_A_M, SEMI_AXIS_B_M, C11, SHEAR_MODULUS_PA = 0.00488, 0.00691, 4.12, 8.0e10
K_AD, K_SD, K_AR, K_SR = 0.3, 0.1, 1.0, 0.4
RATIO, GAMMA_D_SPM, GAMMA_R_SPM, MU_CR = 0.4, 0.2, 0.6, 0.28

TRACK_M = 4000
RUNS = ("A1", "A2", "A3", "A4", "A5", "B1", "B2", "B3")
TUNE, VALIDATE = RUNS[:5], RUNS[5:]

#: Normal variation, which is no effect.
GAIN_SPREAD, RADIUS_SPREAD, VALVE_SPREAD, STIFFNESS_SPREAD = 0.01, 0.0005, 0.15, 0.03
TRACK_SPREAD, FRICTION_SPREAD = 0.02, 0.15


@dataclasses.dataclass(frozen=True)
class Sensors:
    """What the recorders do to the truth; the defaults are faultless recorders."""

    noise: float = 1.0  # times the deviations of `sensors.DEVIATION`
    lag_s: float = 0.0  # mean delay of the wheel-speed sensors
    clock_s: float = 0.0  # the vehicle's speed was sampled that much later than its time stamp says
    pitch_s2pm: float = 0.0  # error of the radar's speed per deceleration
    drift_nmps: float = 0.0  # drift of one axle's torque
    drift_axle: int = 0


@dataclasses.dataclass(frozen=True)
class Setup:
    """A campaign before it is driven: the truth and what was believed."""

    vehicle: Vehicle
    law: Law
    brake: Brake
    runs: dict[str, PlannedStop]
    profile: np.ndarray  # factor on mu_cd at every metre of track
    effects: Effects
    sensors: Sensors
    believed_mu_cd: float
    measured_torque: bool  # else cylinder pressure times the nominal gain

    @property
    def axles(self) -> int:
        """Number of wheelsets."""
        return len(self.vehicle.radius)


def make_vehicle(axles: int) -> Vehicle:
    """Return the vehicle as believed."""
    offset = np.array(AXLE_POSITIONS_M[axles])
    body, pivot = np.zeros(axles), np.zeros(axles)
    if axles == 2:  # moments about the rail: m a h = dN (wheelbase), shared by two wheels
        body[:] = np.array([0.5, -0.5]) / offset[1]
    elif axles == 4:  # four wheels of a bogie carry the body's moment; half the mass hangs on each bogie's pivot
        base = offset[1] - offset[0]
        body[:] = np.array([0.25, 0.25, -0.25, -0.25]) / (offset[2:].mean() - offset[:2].mean())
        pivot[:] = np.array([0.25, -0.25, 0.25, -0.25]) / base
    radius = np.full(axles, RADIUS_M)
    stiffness = np.full(axles, math.pi * SHEAR_MODULUS_PA * SEMI_AXIS_A_M * SEMI_AXIS_B_M * C11 / 4)
    return Vehicle(MASS_PER_AXLE_KG * axles, INERTIA_KGM2, GRAVITY_MPS2, radius, stiffness, offset, body, pivot)


def make_law(tau: float) -> Law:
    """Return the seed paper's law."""
    peak = 1.5 / (math.pi * SEMI_AXIS_A_M * SEMI_AXIS_B_M)
    return Law(K_AD, K_SD, K_AR, K_SR, RATIO, RATIO, GAMMA_D_SPM, GAMMA_R_SPM, MU_CR, tau, SEMI_AXIS_A_M, peak)


def make_brake(axles: int, wsp: bool = True) -> Brake:
    """Return the brake without variation; its times are assumptions."""
    dead = np.full(axles, 40, dtype=np.int64)
    return Brake(np.ones(axles), np.full(axles, 0.3), np.full(axles, 0.22), dead, 0.4, float(wsp))


def torque_for(adhesion: float, vehicle: Vehicle) -> float:
    """Return the torque of a wheelset [N m] that asks for an adhesion coefficient."""
    return adhesion * RADIUS_M * vehicle.mass * vehicle.gravity / len(vehicle.radius)


def reference() -> Setup:
    """Return the stops in which effects are measured: a coach without variation or noise, once gently, the others sliding."""
    vehicle = make_vehicle(4)
    gust = _gust(np.random.default_rng(1))

    def run(speed: float, adhesion: float, position: float) -> PlannedStop:
        return PlannedStop(speed, 1.5, 3.0, torque_for(adhesion, vehicle), position, 0.055, 0.0, 0.3, gust)

    sliding = {f"sliding {v:.0f}": run(v, 0.19, 50.0) for v in (34.0, 37.0, 40.0, 43.0)}
    runs = {"gentle": run(38.0, 0.07, 50.0), **sliding}
    return Setup(vehicle, make_law(1.6e-4), make_brake(4), runs, np.ones(TRACK_M), Effects(), Sensors(0.0), 0.055, False)


def draw(rng: np.random.Generator, axles: int, noise: float, measured_torque: bool) -> Setup:
    """Draw a campaign with nothing but normal variation."""

    def within(spread: float, size: int) -> np.ndarray:
        return 1.0 + rng.uniform(-spread, spread, size)

    vehicle = make_vehicle(axles)
    vehicle = vehicle._replace(
        radius=RADIUS_M * within(RADIUS_SPREAD, axles), stiffness=vehicle.stiffness * within(STIFFNESS_SPREAD, axles)
    )
    law = make_law(rng.uniform(1.4e-4, 2.9e-4))
    plain = make_brake(axles)
    brake = plain._replace(
        gain=within(GAIN_SPREAD, axles),
        fill=plain.fill * within(VALVE_SPREAD, axles),
        vent=plain.vent * within(VALVE_SPREAD, axles),
        dead_steps=np.round(plain.dead_steps * within(VALVE_SPREAD, axles)).astype(np.int64),
        rise=plain.rise * float(within(VALVE_SPREAD, 1)[0]),
    )
    believed = round(float(rng.uniform(0.048, 0.068)), 4)
    runs = {}
    for name in RUNS:
        mu_cd = believed * float(within(FRICTION_SPREAD, 1)[0])
        # One stop of each group brakes too gently to slide; the others ask for more than the contaminated rail gives.
        demand = rng.uniform(1.1, 1.4) if name in ("A4", "B3") else rng.uniform(2.4, 3.6)
        runs[name] = PlannedStop(
            speed=float(rng.uniform(24.0, 44.0)),
            end_speed=1.5,
            coast=float(rng.uniform(2.0, 4.0)),
            demand=torque_for(demand * mu_cd, vehicle),
            position=float(rng.uniform(0.0, 200.0)),
            mu_cd=mu_cd,
            slope=0.0,
            phase=float(rng.uniform(0.0, 2.0 * math.pi)),
            gust=_gust(rng),
        )
    return Setup(vehicle, law, brake, runs, _track(rng), Effects(), Sensors(noise), believed, measured_torque)


def _track(rng: np.random.Generator) -> np.ndarray:
    """Factor on mu_cd: values within the spread every 5 to 20 m, half cosines between them."""
    knots = np.cumsum(rng.uniform(5.0, 20.0, TRACK_M // 5))
    values = 1.0 + rng.uniform(-TRACK_SPREAD, TRACK_SPREAD, len(knots))
    place = np.arange(TRACK_M, dtype=float)
    right = np.clip(np.searchsorted(knots, place), 1, len(knots) - 1)
    share = np.clip((place - knots[right - 1]) / (knots[right] - knots[right - 1]), 0.0, 1.0)
    smooth = 0.5 - 0.5 * np.cos(np.pi * share)
    track: np.ndarray = values[right - 1] + smooth * (values[right] - values[right - 1])
    return track


def _gust(rng: np.random.Generator) -> np.ndarray:
    """Ornstein-Uhlenbeck process of deviation 1 and a correlation time of 1.5 s, every 0.1 s."""
    keep = math.exp(-0.1 / 1.5)
    gust = np.empty(2500)
    gust[0] = rng.standard_normal()
    shocks = math.sqrt(1.0 - keep * keep) * rng.standard_normal(len(gust))
    for i in range(1, len(gust)):
        gust[i] = keep * gust[i - 1] + shocks[i]
    return gust
