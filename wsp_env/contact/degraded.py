"""The degraded-adhesion law in closed form.

Source: eqs. (1) to (10) of the seed paper (Meli, Ridolfi et al.). The work of friction per metre of travel,
W_sp = f N |e|, cleans the contact: f = (1 - lambda) f_d + lambda f_r with lambda = 1 - exp(-tau W_sp). The paper solves
this implicit equation for f by iteration (eq. 10); it has the closed form

    f = f_r + W0(z) / a,   a = tau N |e|,   z = -a (f_r - f_d) exp(-a f_r),

with Lambert's W on its principal branch, written here as f_r - (f_r - f_d) exp(-a f_r) exp(-W0(z)), which needs no
division and holds at a = 0. The classic law (no recovery, lambda = 0) is tau = 0.

Two generalisations stand ready for physics beyond the paper, both absent by default: lambda = 1 - exp(-u^n) with
u = tau max(W_sp - W_0, 0), solved by a safeguarded Newton method (the closed form is n = 1, W_0 = 0), and a share of the layer
that is held by what came before, whatever this wheel's work.

Conventions: one contact is one wheel; slip speed s = v - r w [m/s] and creepage e = s / v [-] are positive in braking.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.compiled import inlined, kernel, with_math
from wsp_env.contact import elementary
from wsp_env.contact.polach import falling_friction, saturation, saturation_slope
from wsp_env.contact.recovery import kept_by_shape
from wsp_env.contact.traction import LOAD_FLOOR, SPEED_FLOOR, Adhesion, Surface, TractionLaw


class DegradedLaw(NamedTuple):
    """Parameters of the law that do not change along the track (mu_cd and tau do, and are arguments)."""

    stiffness: float  # pi G a b c11 / 4 [N], eq. (6)
    k_ad: float  # Polach's reduction factor of the adhesion area, degraded [-]
    k_sd: float  # the same of the slip area [-]
    k_ar: float  # adhesion area, recovered [-]
    k_sr: float  # slip area, recovered [-]
    mu_cr: float  # kinetic friction coefficient after full recovery [-]
    ratio_d: float  # A_d, kinetic over static friction, degraded [-]
    ratio_r: float  # A_r, the same, recovered [-]
    gamma_d: float  # friction decrease rate, degraded [s/m]
    gamma_r: float  # friction decrease rate, recovered [s/m]
    recovery_exponent: float = 1.0  # n [-]; 1 is the paper's eq. (4)
    recovery_threshold: float = 0.0  # W_0 [J/m], work that recovers nothing; 0 is the paper's


@kernel
def paper_recovery(law: DegradedLaw) -> DegradedLaw:
    """Return the law with the paper's eq. (4) of recovery."""
    return DegradedLaw(
        law.stiffness, law.k_ad, law.k_sd, law.k_ar, law.k_sr, law.mu_cr, law.ratio_d, law.ratio_r, law.gamma_d, law.gamma_r,
        1.0, 0.0,
    )  # fmt: skip


# exp(-W0(z)) is analytic in p = sqrt(2 (1 + e z)): the square root takes away the branch point at z = -1/e. These are the
# numerator and denominator, rising powers of p, of its rational best approximation of degrees 8 and 9 on z in [-1/e, 50], found
# by reweighted least squares in 60 digits: relative error 8e-15. All terms are positive, so that nothing cancels.
_TREE_P = (
    2.7182818284590673, 4.283291813258296, 2.4988315261422556, 0.6777707692851259, 0.0887428013070055, 0.005340391890063214,
    0.00012848080796621823, 8.850430951505105e-07, 3.411076550737356e-10,
)  # fmt: skip
_TREE_Q = (
    1.0, 2.5757349986370297, 2.661670410685651, 1.4173402885077828, 0.4170145350775404, 0.06790501614595601,
    0.005855815874223711, 0.00024352301778039076, 4.090668711596914e-06, 1.854242752179631e-08,
)  # fmt: skip


@inlined
def exp_minus_lambert_w0(z: float) -> float:
    """Return exp(-W0(z)) [-] for z in [-1/e, 50], so that W0(z) = z exp(-W0(z)); without iteration or branch.

    A positive z means more friction with the contaminant than without, which happens when mu_cd comes near mu_cr; it is then
    below (f_d / f_r - 1) / e.
    """
    p2 = max(2.0 * (math.e * z + 1.0), 0.0)
    p = math.sqrt(p2)
    c, d = _TREE_P, _TREE_Q
    p4 = p2 * p2
    above = (c[0] + p * c[1]) + p2 * (c[2] + p * c[3]) + p4 * ((c[4] + p * c[5]) + p2 * (c[6] + p * c[7]) + p4 * c[8])
    below = (
        (d[0] + p * d[1]) + p2 * (d[2] + p * d[3]) + p4 * ((d[4] + p * d[5]) + p2 * (d[6] + p * d[7]) + p4 * (d[8] + p * d[9]))
    )
    return above / below


@inlined
def limit(
    slip: float, per_speed: float, load: float, law_stiffness: float, mu_c: float, ratio: float, gamma: float,
    k_a: float, k_s: float,
) -> tuple[float, float, float]:  # fmt: skip
    """One limit curve (eqs. 5 to 7): its value and its derivatives by s and by 1 / v; slip = |s|, per_speed = 1 / v."""
    mu = falling_friction(slip, mu_c, ratio, gamma)
    dmu_ds = -gamma * (mu - mu_c)
    scale = law_stiffness / (mu * load)
    gradient = scale * slip * per_speed
    share = saturation(gradient, k_a, k_s)
    slope = saturation_slope(gradient, k_a, k_s)
    df_ds = dmu_ds * (share - slope * gradient) + mu * slope * scale * per_speed
    return mu * share, df_ds, mu * slope * scale * slip


@inlined
def adhesion(slip_speed: float, speed: float, normal_load: float, on: Surface, tau: float, law: DegradedLaw) -> Adhesion:
    """Evaluate the law at |slip_speed| [m/s], running speed [m/s] and normal load of one wheel [N].

    Parameters
    ----------
    on : friction coefficients and contaminant layer; a layer of 1 and nothing held is the paper's law. Below 1 the wheel's
        limit without recovery is f_r - layer (f_r - f_d), as earlier wheels have removed the rest. `on.mu_cr` stands for that
        of the law, which a mechanism may have changed with the running speed
    tau : recovery rate [m/J]; 0 is the classic law
    law : the constant parameters

    """
    slip = abs(slip_speed)
    load = max(normal_load, LOAD_FLOOR)
    rolling = abs(speed)
    per_speed = 1.0 / max(rolling, SPEED_FLOOR)
    dper_dv = -per_speed * per_speed if rolling > SPEED_FLOOR else 0.0
    f_d, df_d_ds, df_d_dp = limit(slip, per_speed, load, law.stiffness, on.mu_cd, law.ratio_d, law.gamma_d, law.k_ad, law.k_sd)
    f_r, df_r_ds, df_r_dp = limit(slip, per_speed, load, law.stiffness, on.mu_cr, law.ratio_r, law.gamma_r, law.k_ar, law.k_sr)
    gap = on.layer * (f_r - f_d)
    rest = f_r - on.held * (f_r - f_d)
    a = tau * load * slip * per_speed
    rate = 1.0
    if law.recovery_exponent == 1.0 and law.recovery_threshold == 0.0:
        dry = math.exp(-a * rest)
        kept = dry * exp_minus_lambert_w0(-a * gap * dry)  # exp(-a f) = 1 - lambda(W_sp)
    else:
        kept, rate = kept_by_shape(rest, gap, a, tau * law.recovery_threshold, law.recovery_exponent)
    f = rest - gap * kept
    # Implicit differentiation of f = rest - gap exp(-u^n), u = a f - offset; rate is d(u^n)/du.
    share = on.held + on.layer * kept
    growth = gap * kept * rate * f * tau * load
    inverse = 1.0 / max(1.0 - a * gap * kept * rate, 1e-12)
    df_ds = (df_r_ds * (1.0 - share) + df_d_ds * share + growth * per_speed) * inverse
    df_dp = (df_r_dp * (1.0 - share) + df_d_dp * share + growth * slip) * inverse
    return Adhesion(f, f_d, f_r, df_ds, df_dp * dper_dv, kept)


_adhesion_in_batches = with_math(adhesion, elementary)


#: Contacts by the paper's recovery that the compiler works on at once. What is left of a number beyond its multiples goes one
#: by one, at eight times the cost. Other recoveries are solved one by one anyway.
_LANES = 8


def _adhesions(paper: bool) -> Callable[..., None]:
    """Return the compiled loop over contacts for all fields of `Adhesion`; `paper` as of `_loop`."""

    @kernel
    def loop(met: np.ndarray, count: int, given: DegradedLaw, found: np.ndarray) -> None:
        law = paper_recovery(given) if paper else given
        for i in range(count):
            on = Surface(met[3, i], met[4, i], met[5, i], met[6, i])
            state = _adhesion_in_batches(met[0, i], met[1, i], met[2, i], on, met[7, i], law)
            for field, value in enumerate(state):
                found[field, i] = value

    return loop


_adhesions_by_paper, _adhesions_in_general = _adhesions(True), _adhesions(False)


@kernel
def adhesions(met: np.ndarray, count: int, law: DegradedLaw, found: np.ndarray) -> None:
    """Evaluate the law of many contacts at once, see `wsp_env.contact.port.tractions`."""
    if law == paper_recovery(law):
        _adhesions_by_paper(met, min((count + _LANES - 1) // _LANES * _LANES, met.shape[1]), law, found)
    else:
        _adhesions_in_general(met, count, law, found)


def _loop(output: int, paper: bool) -> Callable[..., None]:
    """Return the compiled loop for one field of `Adhesion`; `paper` leaves out what the paper's recovery does not need.

    That makes it free of branches, and `elementary` of calls: the compiler works on several contacts at once. A ufunc would be
    slower: numba's take scalars only, so that the law's parameters would come as so many more operands.
    """

    @kernel
    def loop(states: tuple[np.ndarray, ...], given: DegradedLaw, result: np.ndarray) -> None:
        law = paper_recovery(given) if paper else given
        slip_speed, speed, load, mu_cd, tau, layer = states
        for i in range(result.size):
            on = Surface(mu_cd[i], law.mu_cr, layer[i], 0.0)
            state = _adhesion_in_batches(slip_speed[i], speed[i], load[i], on, tau[i], law)
            result[i] = state[output] if slip_speed[i] >= 0.0 or output == 3 else -state[output]

    return loop


def _flat(value: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of that shape as the loop takes it, flat and writable; copied only where it is not so."""
    return np.require(value if value.shape == shape else np.broadcast_to(value, shape), None, ["C", "W"]).reshape(-1)


def _public(name: str, output: int, what: str) -> Callable[..., np.ndarray]:
    general, by_paper = _loop(output, False), _loop(output, True)

    def evaluate(
        slip_speed: ArrayLike,
        speed: ArrayLike,
        normal_load: ArrayLike,
        mu_cd: ArrayLike,
        tau: ArrayLike,
        law: DegradedLaw,
        layer: ArrayLike = 1.0,
    ) -> np.ndarray:
        inputs = [np.asarray(x, dtype=np.float64) for x in (slip_speed, speed, normal_load, mu_cd, tau, layer)]
        result: np.ndarray = np.empty(np.broadcast_shapes(*(x.shape for x in inputs)))
        law = DegradedLaw(*map(float, law))
        loop = by_paper if law == paper_recovery(law) else general
        loop(tuple(_flat(x, result.shape) for x in inputs), law, result.reshape(-1))
        return result[()]

    evaluate.__name__ = evaluate.__qualname__ = name
    evaluate.__doc__ = f"""{what}

    Parameters
    ----------
    slip_speed : s = v - r w [m/s], positive in braking; the result carries its sign (derivatives by s do not)
    speed : running speed v [m/s]
    normal_load : load of one wheel N [N]
    mu_cd : kinetic friction coefficient of the contaminated rail [-]
    tau : recovery rate [m/J]; 0 is the classic law
    law : the constant parameters
    layer : share of the contaminant layer that earlier wheels left [-]

    Scalars or arrays that broadcast; returns an array of the common shape (a numpy scalar for scalars).

    """
    return evaluate


degraded_adhesion = _public("degraded_adhesion", 0, "Adhesion coefficient f = T / N [-], eqs. (1) to (4) solved for f.")
adhesion_without_recovery = _public("adhesion_without_recovery", 1, "Limit f_d [-] without recovery, eq. (5): the classic law.")
adhesion_recovered = _public("adhesion_recovered", 2, "Limit f_r [-] after full recovery, eq. (5).")
adhesion_slope = _public("adhesion_slope", 3, "Derivative of f by the slip speed [s/m], at constant running speed.")


def _make(contact: Any) -> DegradedLaw:
    return DegradedLaw(
        contact.stiffness_n,
        contact.polach_k_ad,
        contact.polach_k_sd,
        contact.polach_k_ar,
        contact.polach_k_sr,
        contact.kinetic_friction_r,
        contact.friction_ratio_d,
        contact.friction_ratio_r,
        contact.friction_decrease_d_spm,
        contact.friction_decrease_r_spm,
    )


LAW = TractionLaw("degraded", "the seed paper's law: friction work recovers adhesion", DegradedLaw, adhesion, _make, adhesions)
