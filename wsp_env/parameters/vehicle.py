"""What describes a braked vehicle: masses, wheelsets, brake, wheel-speed sensors."""

import dataclasses

from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.quantity import Checked, ParameterError, quantity

_BRAKE = "assumption: the seed paper does not give the brake of the coach"


@dataclasses.dataclass(frozen=True)
class Brake(Checked):
    """Pneumatic disc brake of one axle: a distributor fills at its own pace, a dump valve applies, holds or vents."""

    full_pressure_bar: float = quantity(3.8, "bar", _BRAKE + "; UIC 540 maximum cylinder pressure", 0.0, 10.0, True)
    torque_per_bar_nm: float = quantity(
        1500.0, "N m/bar", _BRAKE + "; 1.2 m/s2 at 3.8 bar and 43 t without the wheels' inertia", 0.0, 1e5, True
    )
    demand_rise_s: float = quantity(4.0, "s", "assumption: EN 15595 passenger brakes fill in 3 to 5 s", 0.0, 60.0, True)
    fill_time_constant_s: float = quantity(0.25, "s", _BRAKE + "; dump valve open to the supply", 0.0, 10.0, True)
    vent_time_constant_s: float = quantity(0.15, "s", _BRAKE + "; dump valve open to the air", 0.0, 10.0, True)
    dead_time_s: float = quantity(0.04, "s", _BRAKE + "; from command to valve stroke", 0.0, 1.0)
    cylinder_volume_l: float = quantity(8.0, "l", _BRAKE + "; cylinders and pipes of one axle", 0.0, 100.0, True)


@dataclasses.dataclass(frozen=True)
class Tachometer(Checked):
    """Pulse wheel on each axle; the speed is the number of pulses over the time between their first and last edge."""

    pulses_per_turn: float = quantity(100.0, "-", "assumption: EN 15595, 60 to 300 pulses a turn", 1.0, 1e4)


@dataclasses.dataclass(frozen=True)
class Vehicle(Checked):
    """A vehicle in longitudinal motion; a wheelset, a bogie and a coach differ in these numbers only."""

    name: str
    axle_positions_m: tuple[float, ...] = quantity((0.0,), "m", "behind the leading axle", 0.0, 100.0)
    mass_kg: float = quantity(43000.0, "kg", "seed paper, Table 1 (the bodies of Table 5 sum to 41 800 kg)", 0.0, 1e6, True)
    payload_kg: float = quantity(6000.0, "kg", "assumption: 80 passengers of 75 kg; Table 1's mass is taken as empty", 0.0)
    wheelset_inertia_kgm2: float = quantity(160.0, "kg m2", "seed paper, Table 5 and eq. (11)", 0.0, 1e4, open_low=True)
    wheel_radius_m: float = quantity(0.445, "m", "seed paper, Table 1: diameter 0.89 m", 0.0, 2.0, open_low=True)
    gravity_mps2: float = quantity(9.81, "m/s2", "standard value, rounded", 0.0, 20.0, open_low=True)
    resistance_a_n: float = quantity(0.0, "N", "assumption: no running resistance, as in the recordings", 0.0, 1e5)
    resistance_b_ns_per_m: float = quantity(0.0, "N s/m", "as resistance_a_n", 0.0, 1e4)
    resistance_c_ns2_per_m2: float = quantity(0.0, "N s2/m2", "as resistance_a_n", 0.0, 1e3)
    max_speed_mps: float = quantity(55.6, "m/s", "assumption: coaches of the UIC-Z1 series run up to 200 km/h", 0.0, 150.0)
    contact: ContactParameters = dataclasses.field(default_factory=ContactParameters)
    brake: Brake = dataclasses.field(default_factory=Brake)
    tachometer: Tachometer = dataclasses.field(default_factory=Tachometer)

    def __post_init__(self) -> None:
        """Refuse impossible values and axles that are not in order."""
        super().__post_init__()
        positions = self.axle_positions_m
        if len(positions) not in (1, 2, 4) or positions[0] != 0.0 or list(positions) != sorted(set(positions)):
            raise ParameterError(
                f"{self.name}: axle_positions_m = {positions} must hold 1, 2 or 4 rising distances [m] that start with 0"
            )

    @property
    def axles(self) -> int:
        """Number of wheelsets."""
        return len(self.axle_positions_m)

    @property
    def static_wheel_load_n(self) -> float:
        """Load of one wheel at rest [N]: half an axle load."""
        return self.mass_kg * self.gravity_mps2 / (2 * self.axles)

    @property
    def full_brake_torque_nm(self) -> float:
        """Torque of one axle [N m] at full cylinder pressure."""
        return self.brake.full_pressure_bar * self.brake.torque_per_bar_nm
