"""What a vehicle on two bogies is beside its longitudinal motion: bodies, suspensions, dampers, stops, heights.

Masses, inertias and stiffnesses are those of the seed paper (Tables 5 and 6) for the coach UIC-Z1. What the paper does not give
is that of the Manchester Benchmark's vehicle 1 (S. Iwnicki (ed.), The Manchester Benchmarks for rail vehicle simulation,
Vehicle System Dynamics 30 (1998), 295 to 313), whose wheelbase and bogie distance are the same: read in public parameter files,
not in the paper itself, so assumptions.
"""

import dataclasses

from wsp_env.parameters.quantity import Checked, ParameterError, quantity, shown

_5 = "seed paper, Table 5"
_6 = "seed paper, Table 6"
_M1 = "assumption: Manchester vehicle 1"
_STOP_MM = (25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0)
_STOP_N = (0.0, 600.0, 1760.0, 3730.0, 6870.0, 11_580.0, 17_170.0, 29_200.0, 230_000.0)


@dataclasses.dataclass(frozen=True)
class Multibody(Checked):
    """Bodies and force elements; the carbody has what is left of the vehicle's mass.

    Suspension values are of one element: the primary one on each axle box, the secondary one on each side of a bogie, traction
    rod, anti-roll bar and bump-stop once a bogie. Heights are above the rails' tops. The wheelset's inertia about its axle is
    the vehicle's `wheelset_inertia_kgm2`.
    """

    carbody_mass_kg: float = quantity(29_000.0, "kg", _5 + "; the mass that its inertias belong to", 0.0, 1e6, True)
    carbody_inertia_xx_kgm2: float = quantity(76_400.0, "kg m2", _5 + "; in proportion to the carbody's mass", 0.0, 1e9, True)
    carbody_inertia_yy_kgm2: float = quantity(1_494_400.0, "kg m2", _5 + "; as xx", 0.0, 1e9, True)
    carbody_inertia_zz_kgm2: float = quantity(1_467_160.0, "kg m2", _5 + "; as xx", 0.0, 1e9, True)
    carbody_height_m: float = quantity(1.8, "m", _M1 + "; centre of mass", 0.0, 5.0)
    bogie_mass_kg: float = quantity(3000.0, "kg", _5 + "; frame", 0.0, 1e5, True)
    bogie_inertia_xx_kgm2: float = quantity(2400.0, "kg m2", _5, 0.0, 1e7, True)
    bogie_inertia_yy_kgm2: float = quantity(1900.0, "kg m2", _5, 0.0, 1e7, True)
    bogie_inertia_zz_kgm2: float = quantity(4000.0, "kg m2", _5, 0.0, 1e7, True)
    bogie_height_m: float = quantity(0.6, "m", _M1 + "; centre of mass", 0.0, 3.0)
    wheelset_mass_kg: float = quantity(1300.0, "kg", _5, 0.0, 1e5, True)
    wheelset_inertia_xx_kgm2: float = quantity(800.0, "kg m2", _5 + "; about x and z", 0.0, 1e6, True)
    axle_box_mass_kg: float = quantity(200.0, "kg", _5, 0.0, 1e4, True)
    axle_box_inertia_xx_kgm2: float = quantity(3.0, "kg m2", _5, 0.0, 1e4, True)
    axle_box_inertia_yy_kgm2: float = quantity(12.0, "kg m2", _5, 0.0, 1e4, True)
    axle_box_inertia_zz_kgm2: float = quantity(12.0, "kg m2", _5, 0.0, 1e4, True)
    primary_stiffness_x_n_per_m: float = quantity(8.44e5, "N/m", _6, 0.0, 1e10)
    primary_stiffness_y_n_per_m: float = quantity(8.44e5, "N/m", _6, 0.0, 1e10)
    primary_stiffness_z_n_per_m: float = quantity(7.9e5, "N/m", _6, 0.0, 1e10, True)
    primary_rotation_x_nm_per_rad: float = quantity(10_700.0, "N m/rad", _6, 0.0, 1e9)
    primary_rotation_y_nm_per_rad: float = quantity(10_700.0, "N m/rad", _6, 0.0, 1e9)
    primary_damping_x_ns_per_m: float = quantity(15_000.0, "N s/m", _M1, 0.0, 1e8)
    primary_damping_y_ns_per_m: float = quantity(2000.0, "N s/m", _M1, 0.0, 1e8)
    primary_damping_z_ns_per_m: float = quantity(4000.0, "N s/m", _M1, 0.0, 1e8)
    primary_rotation_damping_nms_per_rad: float = quantity(
        36.0, "N m s/rad", "assumption: 5 % of critical for an axle box on its axle, about x and y", 0.0, 1e6
    )
    primary_half_spacing_m: float = quantity(1.0, "m", _M1, 0.0, 2.0, True)
    primary_height_m: float = quantity(0.445, "m", "assumption: at the axle's height", 0.0, 3.0)
    secondary_stiffness_x_n_per_m: float = quantity(1.24e5, "N/m", _6 + "; read as one spring on each side", 0.0, 1e10)
    secondary_stiffness_y_n_per_m: float = quantity(1.24e5, "N/m", _6 + "; as x", 0.0, 1e10)
    secondary_stiffness_z_n_per_m: float = quantity(3.4e5, "N/m", _6 + "; as x", 0.0, 1e10, True)
    secondary_damping_x_ns_per_m: float = quantity(0.0, "N s/m", _M1 + "; a yaw damper on each side", 0.0, 1e8)
    secondary_damping_y_ns_per_m: float = quantity(32_000.0, "N s/m", _M1 + "; read as one on each side", 0.0, 1e8)
    secondary_damping_z_ns_per_m: float = quantity(20_000.0, "N s/m", _M1 + "; read as one on each side", 0.0, 1e8)
    secondary_half_spacing_m: float = quantity(1.0, "m", _M1, 0.0, 2.0, True)
    secondary_height_m: float = quantity(0.8275, "m", _M1, 0.0, 3.0)
    anti_roll_bar_nm_per_rad: float = quantity(2.5e6, "N m/rad", _6, 0.0, 1e10)
    traction_rod_stiffness_n_per_m: float = quantity(5e6, "N/m", _M1 + ", from memory", 0.0, 1e10)
    traction_rod_damping_ns_per_m: float = quantity(25_000.0, "N s/m", _M1 + ", from memory", 0.0, 1e8)
    traction_rod_height_m: float = quantity(0.6, "m", "assumption: at the height of the bogie's centre of mass", 0.0, 3.0)
    bump_stop_height_m: float = quantity(0.65, "m", _M1, 0.0, 3.0)
    bump_stop_deflection_m: tuple[float, ...] = quantity(
        tuple(x / 1000.0 for x in _STOP_MM),
        "m",
        _M1 + "; lateral, the same to both sides; the first is the clearance",
        0.0,
        1.0,
    )
    bump_stop_force_n: tuple[float, ...] = quantity(_STOP_N, "N", _M1 + "; at these deflections", 0.0, 1e8)
    contact_damping_s_per_m: float = quantity(
        1.7, "s/m", "assumption: 5 % of critical for a wheel of 53 kN on the rail; N = k p^1.5 (1 + this dp/dt)", 0.0, 100.0
    )

    def __post_init__(self) -> None:
        """Refuse impossible values, and a bump-stop whose curve does not rise."""
        super().__post_init__()
        x, force = self.bump_stop_deflection_m, self.bump_stop_force_n
        if len(x) != len(force) or len(x) < 2 or list(x) != sorted(set(x)) or list(force) != sorted(force) or force[0] != 0.0:
            raise ParameterError(
                f"bump_stop_deflection_m = {shown(x)}, bump_stop_force_n = {shown(force)}: give as many forces as deflections, "
                "two or more, both rising, the first force 0"
            )

    @property
    def drawing_height_m(self) -> float:
        """Height [m] at which a bogie draws the body: traction rod and secondary springs side by side."""
        rod, springs = self.traction_rod_stiffness_n_per_m, 2.0 * self.secondary_stiffness_x_n_per_m
        if not rod + springs > 0.0:
            return self.traction_rod_height_m
        return (rod * self.traction_rod_height_m + springs * self.secondary_height_m) / (rod + springs)

    def carbody_kg(self, vehicle_kg: float, axles: int) -> float:
        """Return the carbody's mass [kg] in a vehicle of so many [kg] on two bogies; `ParameterError` if nothing is left."""
        rest = vehicle_kg - 2.0 * self.bogie_mass_kg - axles * (self.wheelset_mass_kg + 2.0 * self.axle_box_mass_kg)
        if not rest > 0.0:
            raise ParameterError(
                f"a vehicle of {vehicle_kg:g} kg leaves {rest:g} kg for its carbody: bogies, wheelsets, axle boxes weigh more"
            )
        return rest
