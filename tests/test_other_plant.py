"""Checks of the other plant against conservation laws, half its step and independent solutions."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar
from scipy.special import lambertw

from experiments.other_plant.contact import adhesion
from experiments.other_plant.draw import Law, body, draw
from experiments.other_plant.records import Curve, Stops
from experiments.other_plant.run import brake, simulate
from wsp_env.parameters.uic_z1 import BOGIE, COACH, WHEELSET
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement

_FILM = Curve(0.03, 0.4, 0.2, 0.3, 0.1)
_CLEAN = body(COACH).clean
_STIFFNESS = body(COACH).stiffness_n


class Applies:
    """Never intervenes."""

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Take the shape of the commands."""
        self.shape = (n, vehicle.axles)
        self.times: list[float] = []

    def act(self, measurement: Measurement) -> np.ndarray:
        """Apply."""
        self.times.append(float(measurement.time[0]))
        return np.ones(self.shape)


class Cycles(Applies):
    """Vents, holds and applies in turns, without looking."""

    def act(self, measurement: Measurement) -> np.ndarray:
        """Vent for 0.3 s and hold for 0.2 s in each 1.5 s."""
        phase = float(measurement.time[0]) % 1.5
        return np.full(self.shape, -1.0 if phase < 0.3 else 0.0 if phase < 0.5 else 1.0)


class Slides(Applies):
    """Vents above 15 % of slip over the fastest wheel, applies below 5 %; as crude as can be."""

    def act(self, measurement: Measurement) -> np.ndarray:
        """Compare with the fastest wheel of now and of before."""
        speed = measurement.wheel_speed
        fastest = speed.max(axis=1, keepdims=True)
        self.reference = np.maximum(fastest, getattr(self, "reference", fastest) - 0.1)
        slip = 1.0 - speed / np.maximum(self.reference, 1.0)
        return np.select([slip > 0.15, slip < 0.05], [-1.0, 1.0], 0.0)


def _slower(stops: Stops) -> Stops:
    return stops._replace(speed_mps=0.4 * stops.speed_mps)  # shorter tests


def _polach(creepage: np.ndarray | float, slip: np.ndarray | float, load: float, curve: Curve) -> np.ndarray:
    mu = curve.friction * (1.0 + (1.0 / curve.ratio - 1.0) * np.exp(-curve.decrease * np.asarray(slip)))
    eps = _STIFFNESS * np.asarray(creepage) / (mu * load)
    return np.asarray(
        2.0 * mu / np.pi * (curve.k_a * eps / (1.0 + (curve.k_a * eps) ** 2) + np.arctan(curve.k_s * eps)), dtype=float
    )


@pytest.mark.parametrize("speed", [3.0, 15.0, 44.0])
def test_classic_peak(speed: float) -> None:
    """The peak of the classic law is that of its formula, maximised independently, and the project's number."""
    load = 53e3
    expected = -minimize_scalar(
        lambda e: -float(_polach(e, e * speed, load, _FILM)), bounds=(1e-4, 0.5), method="bounded", options={"xatol": 1e-9}
    ).fun
    slips = np.linspace(0.0, 0.5, 20_001) * speed
    found = max(adhesion(slip, speed, load, _STIFFNESS, _FILM, _CLEAN, 0.0)[0] for slip in slips)
    assert found == pytest.approx(expected, rel=1e-6)
    if speed == 44.0:
        assert found == pytest.approx(0.062, abs=5e-4)  # shared/physics.md


def test_law_and_derivatives() -> None:
    """The recovering law is Lambert's closed form; its derivatives are differences."""
    rng = np.random.default_rng(1)
    for _ in range(500):
        speed, load, tau = rng.uniform(0.3, 45.0), rng.uniform(2e4, 1.2e5), rng.uniform(1e-5, 5e-4)
        slip = speed * rng.uniform(-0.1, 1.0)
        sign, e = np.sign(slip), abs(slip) / speed
        f_d, f_r = _polach(e, abs(slip), load, _FILM), _polach(e, abs(slip), load, _CLEAN)
        a = tau * load * e
        expected = sign * (f_r + lambertw(-a * (f_r - f_d) * np.exp(-a * f_r)).real / a)
        f, by_slip, by_speed = adhesion(slip, speed, load, _STIFFNESS, _FILM, _CLEAN, tau)
        assert f == pytest.approx(float(expected), abs=1e-10)
        d = 1e-6 * speed
        above = [adhesion(slip + d, speed, load, _STIFFNESS, _FILM, _CLEAN, tau)[0],
                 adhesion(slip, speed + d, load, _STIFFNESS, _FILM, _CLEAN, tau)[0]]  # fmt: skip
        below = [adhesion(slip - d, speed, load, _STIFFNESS, _FILM, _CLEAN, tau)[0],
                 adhesion(slip, speed - d, load, _STIFFNESS, _FILM, _CLEAN, tau)[0]]  # fmt: skip
        slopes = (np.array(above) - np.array(below)) / (2.0 * d)
        np.testing.assert_allclose([by_slip, by_speed], slopes, rtol=1e-3, atol=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("law", ["recovering", "classic"])
@pytest.mark.parametrize("controller", [Applies(), Cycles(), Slides()], ids=lambda made: type(made).__name__)
def test_energy(law: Law, controller: Applies) -> None:
    """What contacts, brakes and resistance take is the kinetic energy that is lost."""
    stops = _slower(draw("all", law, COACH, 2, 3))
    state = simulate(controller, COACH, stops, 0.02, 5e-4)
    turning = COACH.wheelset_inertia_kgm2 * ((stops.speed_mps[:, None] / stops.radius_m) ** 2 - state.omega_radps**2)
    lost = 0.5 * stops.mass_kg * (stops.speed_mps**2 - state.speed_mps**2) + 0.5 * turning.sum(axis=1)
    np.testing.assert_allclose(state.contact_j + state.brake_j + state.resistance_j, lost, rtol=1e-3)
    assert (state.contact_j > 0.0).all()


@pytest.mark.long
@pytest.mark.parametrize("law", ["recovering", "classic"])
@pytest.mark.parametrize("controller", [Applies(), Cycles()], ids=lambda made: type(made).__name__)
def test_half_step(law: Law, controller: Applies) -> None:
    """Half the step changes nothing, open loop."""
    stops = _slower(draw("drawn", law, BOGIE, 3, 5))
    coarse, fine = (brake(controller, BOGIE, stops, substep_s=step) for step in (5e-4, 2.5e-4))
    np.testing.assert_allclose(coarse["distance_m"], fine["distance_m"], rtol=1e-4)
    np.testing.assert_allclose(coarse["mean_slip_mps"], fine["mean_slip_mps"], rtol=2e-3)


def _flow(above: float, below: float) -> float:
    ratio = min(below / above, 1.0)
    ellipse = [np.sqrt(1.0 - ((min(max(r, 0.3), 1.0) - 0.3) / 0.7) ** 2) for r in (ratio, 0.995)]
    return float(above * (ellipse[0] if ratio < 0.995 else ellipse[1] * (1.0 - ratio) / 0.005))


@pytest.mark.long
def test_dry_rail_is_a_rigid_body() -> None:
    """Wheels that roll give the distance of a rigid body under an independently integrated brake."""
    stops = _slower(draw("dry", "classic", COACH, 2, 11))
    found = brake(Applies(), COACH, stops)
    for n in range(2):
        reduced = stops.mass_kg[n] + (COACH.wheelset_inertia_kgm2 / stops.radius_m[n] ** 2).sum()

        def rates(t: float, y: np.ndarray, n: int = n, reduced: float = reduced) -> list[float]:
            k = stops.curvature[n]
            bent = (1.0 - np.exp(-k * min(t / stops.rise_s[n], 1.0))) / (1.0 - np.exp(-k))
            supply = 3.8 * (stops.inshot[n] * min(t / 0.3, 1.0) + (1.0 - stops.inshot[n]) * bent)
            torque = stops.torque_pbar[n] * y[2] * (1.0 - stops.hysteresis[n])
            force = (torque / stops.radius_m[n]).sum() * (1.0 + stops.pad_slope[n] * (1.0 - y[1] / 20.0))
            return [y[1], -force / reduced, stops.fill_ps[n] * _flow(supply + 1.01325, y[2] + 1.01325)]

        def standing(t: float, y: np.ndarray) -> float:
            return float(y[1]) - 0.3

        standing.terminal = True  # type: ignore[attr-defined]  # as solve_ivp wants it
        rigid = solve_ivp(rates, (0.0, 100.0), [0.0, stops.speed_mps[n], 0.0], events=standing, rtol=1e-7, max_step=0.05)
        assert found["distance_m"][n] == pytest.approx(rigid.y[0, -1], rel=1e-3)
    assert (found["mean_slip_mps"] < 0.05).all()
    assert (found["locked_s"] == 0.0).all()


@pytest.mark.long
def test_equal_axles_are_equal() -> None:
    """Equal axles do the same, and a coach of equal axles does what one of them does alone."""
    same = _slower(draw("nominal", "classic", COACH, 2, 2))
    stops = same._replace(ripple=np.zeros_like(same.ripple), pulse_phase=np.full_like(same.pulse_phase, 0.5))
    state = simulate(Cycles(), COACH, stops, 0.02, 5e-4)
    np.testing.assert_array_equal(state.omega_radps, np.repeat(state.omega_radps[:, :1], 4, axis=1))
    np.testing.assert_array_equal(state.slip_m, np.repeat(state.slip_m[:, :1], 4, axis=1))
    alone = draw("nominal", "classic", WHEELSET, 2, 2)
    single = alone._replace(ripple=np.zeros_like(alone.ripple), speed_mps=stops.speed_mps, film=stops.film)
    np.testing.assert_allclose(simulate(Cycles(), WHEELSET, single, 0.02, 5e-4).position_m, state.position_m, rtol=1e-9)


@pytest.mark.long
def test_deterministic_and_rows_do_not_disturb_each_other() -> None:
    """A stop depends on its seed and number only."""
    both = brake(Slides(), BOGIE, _slower(draw("all", "recovering", BOGIE, 3, 4)))
    again = brake(Slides(), BOGIE, _slower(draw("all", "recovering", BOGIE, 3, 4)))
    fewer = brake(Slides(), BOGIE, _slower(draw("all", "recovering", BOGIE, 2, 4)))
    for name, values in both.items():
        np.testing.assert_array_equal(values, again[name], err_msg=name)
        np.testing.assert_array_equal(values[:2], fewer[name], err_msg=name)


def test_effective_times() -> None:
    """The nominal times are the believed ones."""
    stops = draw("nominal", "classic", WHEELSET, 1, 0)
    for vents, conductance, effective in ((False, stops.fill_ps[0], 0.25), (True, stops.vent_ps[0], 0.15)):
        pressure, elapsed = 3.8 * vents, 0.0
        while pressure > 3.8 * np.exp(-1.0) if vents else pressure < 3.8 * (1.0 - np.exp(-1.0)):
            step = _flow(pressure + 1.01325, 1.01325) if vents else -_flow(4.81325, pressure + 1.01325)
            pressure, elapsed = pressure - conductance * step * 1e-4, elapsed + 1e-4
        assert elapsed == pytest.approx(effective, rel=2e-3)


@pytest.mark.long
def test_clock() -> None:
    """Decisions come on time until the end."""
    controller = Applies()
    duration = brake(controller, WHEELSET, draw("nominal", "classic", WHEELSET, 1, 0))["duration_s"][0]
    np.testing.assert_allclose(controller.times, 0.02 * np.arange(len(controller.times)))
    assert 0.0 <= len(controller.times) * 0.02 - duration < 0.0201
