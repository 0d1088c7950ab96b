"""The passenger coach UIC-Z1, a half and a quarter of it as bogie and wheelset, and ten of them as a train.

Source: seed paper (Meli, Ridolfi et al.), Tables 1, 5 and 6. What this set does not claim: the brake, the sensors and the
running resistance (see `Brake`, `Tachometer`, `Vehicle`: assumptions), dampers and bump-stops, which the paper does not give.
"""

import dataclasses

from wsp_env.parameters.quantity import Checked, quantity
from wsp_env.parameters.vehicle import Vehicle, train

#: Table 1: bogie wheelbase [m], distance of the bogie centres [m], natural frequencies of the suspended masses [Hz].
BOGIE_WHEELBASE_M = 2.56
BOGIE_DISTANCE_M = 19.0
COACH_LENGTH_M = 26.4  # over buffers; assumption: the usual length of the UIC's coaches of this kind, not in the paper
PRIMARY_FREQUENCY_HZ = 4.5
SECONDARY_FREQUENCY_HZ = 0.8


@dataclasses.dataclass(frozen=True)
class Body(Checked):
    """Inertia of one rigid body of Table 5."""

    mass_kg: float = quantity(0.0, "kg", "Table 5", 0.0, 1e6, open_low=True)
    inertia_xx_kgm2: float = quantity(0.0, "kg m2", "Table 5", 0.0, 1e8)
    inertia_yy_kgm2: float = quantity(0.0, "kg m2", "Table 5", 0.0, 1e8)
    inertia_zz_kgm2: float = quantity(0.0, "kg m2", "Table 5", 0.0, 1e8)


#: Table 5. The coach has 1 carbody, 2 bogies, 4 wheelsets and 8 axleboxes.
CARBODY = Body(29_000.0, 76_400.0, 1_494_400.0, 1_467_160.0)
BOGIE_FRAME = Body(3000.0, 2400.0, 1900.0, 4000.0)
WHEELSET_BODY = Body(1300.0, 800.0, 160.0, 800.0)
AXLEBOX = Body(200.0, 3.0, 12.0, 12.0)


@dataclasses.dataclass(frozen=True)
class Suspension(Checked):
    """Linear stiffness of one element of Table 6."""

    x_n_per_m: float = quantity(0.0, "N/m", "Table 6", 0.0, 1e9)
    y_n_per_m: float = quantity(0.0, "N/m", "Table 6", 0.0, 1e9)
    z_n_per_m: float = quantity(0.0, "N/m", "Table 6", 0.0, 1e9)
    rotation_x_nm_per_rad: float = quantity(0.0, "N m/rad", "Table 6", 0.0, 1e9)
    rotation_y_nm_per_rad: float = quantity(0.0, "N m/rad", "Table 6", 0.0, 1e9)
    rotation_z_nm_per_rad: float = quantity(0.0, "N m/rad", "Table 6", 0.0, 1e9)


#: Table 6.
PRIMARY_SUSPENSION = Suspension(8.44e5, 8.44e5, 7.9e5, 10_700.0, 10_700.0)
SECONDARY_SUSPENSION = Suspension(1.24e5, 1.24e5, 3.4e5)
ANTI_ROLL_BAR = Suspension(rotation_x_nm_per_rad=2.5e6)


def usual_positions(bodies: tuple[tuple[int, ...], ...]) -> tuple[float, ...]:
    """Return where the axles of such bodies (see `Vehicle.bodies`) stand [m] if spaced as this coach's (assumption)."""
    return tuple(
        k * COACH_LENGTH_M + bogie * BOGIE_DISTANCE_M + axle * BOGIE_WHEELBASE_M
        for k, body in enumerate(bodies)
        for bogie, axles in enumerate(body)
        for axle in range(axles)
    )


COACH = Vehicle("coach", axle_positions_m=usual_positions(((2, 2),)), length_m=COACH_LENGTH_M)
BOGIE = Vehicle(
    "bogie",
    axle_positions_m=usual_positions(((2,),)),
    length_m=COACH.length_m / 2,
    mass_kg=COACH.mass_kg / 2,
    payload_kg=COACH.payload_kg / 2,
)
WHEELSET = Vehicle(
    "wheelset",
    axle_positions_m=usual_positions(((1,),)),
    length_m=COACH.length_m / 4,
    mass_kg=COACH.mass_kg / 4,
    payload_kg=COACH.payload_kg / 4,
)
TRAIN = train(COACH, 10)

#: The vehicles by name.
VEHICLES = {vehicle.name: vehicle for vehicle in (WHEELSET, BOGIE, COACH, TRAIN)}
