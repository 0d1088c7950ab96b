"""What describes one wheel-rail contact on a contaminated rail."""

import dataclasses
import math
from typing import Any

from wsp_env.contact.kalker import kalker_coefficients
from wsp_env.contact.polach import contact_stiffness
from wsp_env.contact.port import LAWS
from wsp_env.parameters.quantity import Checked, ParameterError, quantity, shown

#: Wheel load [N] of which the default ellipse is typical.
ELLIPSE_LOAD_N = 53e3
_TABLE_2 = "seed paper, Table 2"
_NOT_IN_PAPER = (
    "assumption: not in the paper, which derives it from the profiles S1002 / UIC60; typical of a wheel load of 53 kN"
)

# Kept although it does not belong to the ellipse above (a/b = 0.706), for which the table has 3.82 at nu = 0.25 and 4.05 at
# nu = 0.3: the law was tuned with it, and k_a and k_s, which multiply it, are known no better. See `table_c11`.
_C11 = "Kalker's table at nu = 0.25, a/b = 1, which is not the ellipse's (3.82 at nu = 0.25, 4.05 at 0.3); assumption: as above"


@dataclasses.dataclass(frozen=True)
class ContactParameters(Checked):
    """One wheel on the rail: ellipse, stiffness and the two friction curves (eqs. 5 to 7).

    The defaults are the seed paper's Table 2, whose misprints k_gr and mu_cs are read as k_ar and mu_cr.
    """

    semi_axis_a_m: float = quantity(0.00488, "m", _NOT_IN_PAPER, 0.0, 0.1, open_low=True)  # rolling direction
    semi_axis_b_m: float = quantity(0.00691, "m", _NOT_IN_PAPER, 0.0, 0.1, open_low=True)  # lateral direction
    kalker_c11: float = quantity(4.12, "-", _C11, 0.0, 50.0, open_low=True)
    shear_modulus_pa: float = quantity(8.0e10, "Pa", _TABLE_2, 0.0, 1e12, open_low=True)
    poisson_ratio: float = quantity(0.28, "-", "assumption: not in the paper; steel, as in Polach's example (2005)", 0.0, 0.5)
    polach_k_ad: float = quantity(0.3, "-", _TABLE_2, 0.0, 1.0)
    polach_k_sd: float = quantity(0.1, "-", _TABLE_2, 0.0, 1.0)
    polach_k_ar: float = quantity(1.0, "-", _TABLE_2 + " (misprinted k_gr)", 0.0, 1.0)
    polach_k_sr: float = quantity(0.4, "-", _TABLE_2, 0.0, 1.0)
    friction_ratio_d: float = quantity(0.4, "-", _TABLE_2, 0.0, 1.0, open_low=True)
    friction_ratio_r: float = quantity(0.4, "-", _TABLE_2, 0.0, 1.0, open_low=True)
    friction_decrease_d_spm: float = quantity(0.2, "s/m", _TABLE_2, 0.0, 10.0)
    friction_decrease_r_spm: float = quantity(0.6, "s/m", _TABLE_2, 0.0, 10.0)
    kinetic_friction_r: float = quantity(0.28, "-", _TABLE_2 + " (misprinted mu_cs)", 0.0, 1.0, open_low=True)
    kinetic_friction_d: float = quantity(0.06, "-", _TABLE_2, 0.0, 1.0, open_low=True)
    traction_law: str = "degraded"  # one of `wsp_env.contact.port.LAWS`

    def __post_init__(self) -> None:
        """Refuse impossible values, and a contaminated rail with more friction than a clean one."""
        super().__post_init__()
        if not isinstance(self.traction_law, str) or self.traction_law not in LAWS:
            raise ParameterError(f"traction_law = {shown(self.traction_law)} is unknown; valid: {', '.join(LAWS)}")
        if self.kinetic_friction_d > self.kinetic_friction_r:
            raise ParameterError(
                f"kinetic_friction_d (mu_cd) = {self.kinetic_friction_d} exceeds kinetic_friction_r (mu_cr) = "
                f"{self.kinetic_friction_r}: a contaminated rail cannot have more friction than a clean one"
            )

    @property
    def stiffness_n(self) -> float:
        """Polach's contact stiffness pi G a b c11 / 4 [N], eq. (6)."""
        return float(contact_stiffness(self.semi_axis_a_m, self.semi_axis_b_m, self.shear_modulus_pa, self.kalker_c11))

    def ellipse_uncertainty(self, wheel_load_n: float) -> float:
        """Return the standard deviation [-] of the logarithm of a b that comes from another wheel load than the default's.

        By Hertz, a b grows as the load to the power 2/3. Whether the default is meant for the vehicle's own load is not known;
        an ellipse that differs from the default is.
        """
        default = ContactParameters()
        own = (self.semi_axis_a_m, self.semi_axis_b_m) != (default.semi_axis_a_m, default.semi_axis_b_m)
        return 0.0 if own else 2.0 / 3.0 * abs(math.log(wheel_load_n / ELLIPSE_LOAD_N))

    @property
    def table_c11(self) -> float:
        """Kalker's c11 [-] of this ellipse at this Poisson's ratio, to compare with the `kalker_c11` that is used.

        `ValueError` for an ellipse beyond Kalker's table.
        """
        return float(kalker_coefficients(self.semi_axis_a_m / self.semi_axis_b_m, self.poisson_ratio).c11)

    @property
    def law(self) -> Any:
        """The record of the traction law that compiled code takes, see `wsp_env.contact.port`."""
        return LAWS[self.traction_law].make(self)
