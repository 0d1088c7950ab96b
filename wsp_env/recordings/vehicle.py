"""The vehicle of a campaign."""

import dataclasses

from wsp_env.parameters.quantity import Checked, ParameterError, quantity

_SOURCE = "the campaign"


@dataclasses.dataclass(frozen=True)
class CampaignVehicle(Checked):
    """The vehicle as the test team believed it to be; every wheelset alike, the load shared equally."""

    axles: int = quantity(4, "-", _SOURCE, 1, 64)
    mass_kg: float = quantity(43000.0, "kg", _SOURCE, 0.0, 1e7, open_low=True)
    wheelset_inertia_kgm2: float = quantity(160.0, "kg m2", _SOURCE, 0.0, 1e5, open_low=True)
    wheel_radius_m: float = quantity(0.445, "m", _SOURCE, 0.05, 2.0)
    gravity_mps2: float = quantity(9.81, "m/s2", _SOURCE, 9.0, 10.0)
    axle_positions_m: tuple[float, ...] = quantity((), "m", _SOURCE, 0.0, 1e4)  # behind the leading axle
    resistance_n: tuple[float, ...] = quantity((0.0, 0.0, 0.0), "N, N s/m, N s2/m2", _SOURCE, 0.0, 1e6)  # A + B v + C v2
    # [Nm/bar] of a wheelset, for files with cylinder pressures but no torques; 0: the files have torques
    torque_per_bar_nm: float = quantity(0.0, "N m/bar", _SOURCE, 0.0, 1e6)
    brake_torque_source: str = "measured"  # or "cylinder pressure times the nominal gain": then itself a model

    @property
    def torque_is_measured(self) -> bool:
        """Whether the brake torque was measured, not computed from the cylinder pressure."""
        return self.brake_torque_source == "measured" and self.torque_per_bar_nm == 0.0

    def __post_init__(self) -> None:
        """Check the ranges, and that tuples are as long as they must be."""
        super().__post_init__()
        if self.axle_positions_m and len(self.axle_positions_m) != self.axles:
            raise ParameterError(f"axle_positions_m has {len(self.axle_positions_m)} values for {self.axles} axles")
        if len(self.resistance_n) != 3:
            raise ParameterError(f"resistance_n must be the three numbers [A, B, C], got {list(self.resistance_n)}")
        if self.brake_torque_source != "measured" and "pressure" not in self.brake_torque_source:
            raise ParameterError(
                f'brake_torque_source = {self.brake_torque_source!r} is unknown; valid: "measured", '
                '"cylinder pressure times the nominal gain"'
            )
