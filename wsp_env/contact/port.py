"""The contact port: every traction law behind one interface, force, derivatives and work.

`traction` evaluates whichever law a record belongs to. Compiled code is specialised for the record's type: the choice costs
nothing in a step. To add a law, write a file with its `LAW` (see `wsp_env.contact.traction.TractionLaw`) and name it below.
"""

import importlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.compiled import by_type, generated, kernel, record_reader
from wsp_env.contact.degraded import DegradedLaw, degraded_adhesion
from wsp_env.contact.traction import Adhesion, Surface, TractionLaw

_FILES = (
    "wsp_env.contact.degraded",
    "wsp_env.contact.laws.capped",
    "wsp_env.contact.laws.classic",
    "wsp_env.contact.laws.polach",
    "wsp_env.contact.laws.kalker",
    "wsp_env.contact.laws.fastsim",
)

#: Every law by name.
LAWS: dict[str, TractionLaw] = {law.name: law for law in (importlib.import_module(file).LAW for file in _FILES)}


def traction(slip_speed: float, speed: float, normal_load: float, on: Surface, tau: float, law: Any) -> Adhesion:
    """Adhesion of one wheel at |slip| [m/s], running speed [m/s] and load [N] under the law that `law` is a record of.

    `tau` is the recovery rate [m/J], of which laws without recovery take no notice. The work of friction per metre of travel
    is W_sp = f N |e| [J/m]; `kept` says what it leaves of the contaminant layer.
    """
    return _EVALUATE[type(law)](slip_speed, speed, normal_load, on, tau, law)


def tractions(met: np.ndarray, count: int, law: Any, found: np.ndarray) -> None:
    """Evaluate many contacts at once.

    Parameters
    ----------
    met : rows (8, n): slip speed, speed, load, the fields of `Surface`, tau; the first `count` columns count, the others are
        finite
    found : rows (6, n), filled: the fields of `Adhesion`

    """
    _SEVERAL[type(law)](met, count, law, found)


def law_at(like: Any, rows: np.ndarray, i: int) -> Any:
    """Return row i of `rows` (N, fields) as a law's record of the type of `like`."""
    return _READ[type(like)](rows, i)


def stiffened(law: Any, stiffness: float) -> Any:
    """Return a law's record with the contact stiffness pi G a b c / 4 [N] of another ellipse or direction."""
    return law._replace(stiffness=stiffness)


def _stiffener(record: Any) -> Any:
    values = ", ".join("stiffness" if field == "stiffness" else f"law.{field}" for field in record._fields)
    return generated("stiffen", f"def stiffen(law, stiffness):\n    return record({values})\n", {"record": record})


_EVALUATE = {law.record: law.evaluate for law in LAWS.values()}
_READ = {law.record: record_reader(law.record) for law in LAWS.values()}
by_type(traction, "law", _EVALUATE)


@kernel
def _one_by_one(met: np.ndarray, count: int, law: Any, found: np.ndarray) -> None:
    for i in range(count):
        on = Surface(met[3, i], met[4, i], met[5, i], met[6, i])
        state = traction(met[0, i], met[1, i], met[2, i], on, met[7, i], law)
        for field, value in enumerate(state):
            found[field, i] = value


_SEVERAL = {law.record: law.several or _one_by_one for law in LAWS.values()}
by_type(tractions, "law", _SEVERAL)
by_type(stiffened, "law", {law.record: _stiffener(law.record) for law in LAWS.values()})
by_type(law_at, "like", _READ, passed=("rows", "i"))


@kernel
def _each(states: tuple[np.ndarray, ...], law: Any, result: np.ndarray) -> None:
    slip_speed, speed, load, mu_cd, tau, layer = states
    for i in range(result.size):
        on = Surface(mu_cd[i], law.mu_cr, layer[i], 0.0)
        f = traction(slip_speed[i], speed[i], load[i], on, tau[i], law).f
        result[i] = f if slip_speed[i] >= 0.0 else -f


def adhesion_under(
    law: Any, slip_speed: ArrayLike, speed: ArrayLike, normal_load: ArrayLike, mu_cd: ArrayLike, tau: ArrayLike,
    layer: ArrayLike = 1.0,
) -> np.ndarray:  # fmt: skip
    """Return the adhesion coefficient f = T / N [-] under any law; arguments as of `degraded_adhesion`, broadcast."""
    if isinstance(law, DegradedLaw):
        return degraded_adhesion(slip_speed, speed, normal_load, mu_cd, tau, law, layer)
    arrays = np.broadcast_arrays(
        *(np.asarray(x, dtype=np.float64) for x in (slip_speed, speed, normal_load, mu_cd, tau, layer))
    )
    result: np.ndarray = np.empty(arrays[0].shape)
    _each(tuple(np.ascontiguousarray(x).reshape(-1) for x in arrays), law, result.reshape(-1))
    return result[()]
