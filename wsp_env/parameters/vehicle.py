"""What describes a braked vehicle: masses, axles and what they carry, brake, wheel-speed sensors; and trains of vehicles."""

import dataclasses
import itertools
from typing import Any

from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.multibody import Multibody
from wsp_env.parameters.quantity import Checked, ParameterError, quantity, shown
from wsp_env.parameters.resistance import Resistance

_BRAKE = "assumption: the seed paper does not give the brake of the coach"
_FILLING = "assumption: distributor practice for passenger brakes, 3 to 5 s (UIC 540, second-hand)"
_RESERVOIR = "assumption: no reservoirs are known of this coach"

#: Pressure of one normal atmosphere [bar]: a normal litre is a litre of air at this pressure.
ATMOSPHERE_BAR = 1.01325

#: Most wheelsets of a vehicle: a train of sixteen coaches.
MOST_AXLES = 64


@dataclasses.dataclass(frozen=True)
class Brake(Checked):
    """Pneumatic disc brake of one axle: a distributor fills at its own pace, a dump valve applies, holds or vents."""

    full_pressure_bar: float = quantity(3.8, "bar", _BRAKE + "; UIC 540 maximum cylinder pressure", 0.0, 10.0, True)
    torque_per_bar_nm: float = quantity(
        1500.0, "N m/bar", _BRAKE + "; 1.2 m/s2 at 3.8 bar and 43 t without the wheels' inertia", 0.0, 1e5, True
    )
    demand_rise_s: float = quantity(4.0, "s", _FILLING, 0.0, 60.0, True)
    fill_time_constant_s: float = quantity(0.25, "s", _BRAKE + "; dump valve open to the distributor", 0.0, 10.0, True)
    vent_time_constant_s: float = quantity(0.15, "s", _BRAKE + "; dump valve open to the air", 0.0, 10.0, True)
    dead_time_s: float = quantity(0.04, "s", _BRAKE + "; from command to valve stroke", 0.0, 1.0)
    cylinder_volume_l: float = quantity(8.0, "l", _BRAKE + "; cylinders and pipes of one axle", 0.0, 100.0, True)
    reservoir_volume_l: float = quantity(0.0, "l", _RESERVOIR + "; of one axle; 0: the supply never ends", 0.0, 1e4)
    reservoir_pressure_bar: float = quantity(8.5, "bar", _RESERVOIR + "; main reservoir pipe at 8 to 10 bar", 0.0, 20.0, True)
    reservoir_supply_nlps: float = quantity(0.0, "Nl/s", _RESERVOIR + "; what refills those of a vehicle", 0.0, 1e4)


@dataclasses.dataclass(frozen=True)
class Tachometer(Checked):
    """Pulse wheel on each axle; the speed is the number of pulses over the time between their first and last edge."""

    pulses_per_turn: float = quantity(100.0, "-", "assumption: EN 15595, 60 to 300 pulses a turn", 1.0, 1e4)


@dataclasses.dataclass(frozen=True)
class Vehicle(Checked):
    """A vehicle in longitudinal motion; a wheelset, a bogie, a coach and a train differ in these numbers only.

    All axles carry the same load at rest, have the same wheelsets, brakes and sensors.
    """

    name: str
    axle_positions_m: tuple[float, ...] = quantity((0.0,), "m", "behind the leading axle", 0.0, 1000.0)
    # axles of each bogie, body by body from the front; (): `usual_bodies`
    bodies: tuple[tuple[int, ...], ...] = ()
    length_m: float = quantity(26.4, "m", "assumption: UIC-Z1 coaches over buffers; counts in trains only", 0.0, 1000.0, True)
    mass_kg: float = quantity(43000.0, "kg", "seed paper, Table 1 (the bodies of Table 5 sum to 41 800 kg)", 0.0, 1e6, True)
    payload_kg: float = quantity(6000.0, "kg", "assumption: 80 passengers of 75 kg; Table 1's mass is taken as empty", 0.0)
    wheelset_inertia_kgm2: float = quantity(160.0, "kg m2", "seed paper, Table 5 and eq. (11)", 0.0, 1e4, open_low=True)
    wheel_radius_m: float = quantity(0.445, "m", "seed paper, Table 1: diameter 0.89 m", 0.1, 2.0)
    gravity_mps2: float = quantity(9.81, "m/s2", "standard value, rounded", 0.0, 20.0, open_low=True)
    resistance_a_n: float = quantity(0.0, "N", "assumption: no running resistance, as in the recordings", 0.0, 1e5)
    resistance_b_ns_per_m: float = quantity(0.0, "N s/m", "as resistance_a_n", 0.0, 1e4)
    resistance_c_ns2_per_m2: float = quantity(0.0, "N s2/m2", "as resistance_a_n", 0.0, 1e3)
    max_speed_mps: float = quantity(55.6, "m/s", "assumption: coaches of the UIC-Z1 series run up to 200 km/h", 0.0, 150.0)
    contact: ContactParameters = dataclasses.field(default_factory=ContactParameters)
    brake: Brake = dataclasses.field(default_factory=Brake)
    tachometer: Tachometer = dataclasses.field(default_factory=Tachometer)
    multibody: Multibody = dataclasses.field(default_factory=Multibody)  # the multibody plant asks for it

    def __post_init__(self) -> None:
        """Refuse impossible values, axles that are not in order, bodies that do not stand on these axles."""
        super().__post_init__()
        positions = self.axle_positions_m
        if not 1 <= len(positions) <= MOST_AXLES or positions[0] != 0.0 or list(positions) != sorted(set(positions)):
            raise ParameterError(
                f"{self.name}: axle_positions_m = {shown(positions)} must hold 1 to {MOST_AXLES} rising distances [m] that "
                "start with 0, the leading axle"
            )
        try:
            check_bodies(self.bodies, len(positions))
        except ParameterError as error:
            raise ParameterError(f"{self.name}: {error}") from None

    @property
    def running_gear(self) -> tuple[tuple[int, ...], ...]:
        """Axles of each bogie, body by body from the front: `bodies`, or the usual ones.

        Left-over axles too far apart for a bogie carry their body each, as those of a two-axle wagon.
        """
        if self.bodies:
            return self.bodies
        *coaches, last = usual_bodies(self.axles)
        if len(last) == 1 and _farthest(self.axle_positions_m[-last[0] :]) > _FARTHEST_M:
            last = (1,) * last[0]
        return (*coaches, last)

    @property
    def axles(self) -> int:
        """Number of wheelsets."""
        return len(self.axle_positions_m)

    @property
    def resistance(self) -> Resistance:
        """The running resistance."""
        return Resistance(self.resistance_a_n, self.resistance_b_ns_per_m, self.resistance_c_ns2_per_m2)

    @property
    def static_wheel_load_n(self) -> float:
        """Load of one wheel at rest [N]: half an axle load."""
        return self.mass_kg * self.gravity_mps2 / (2 * self.axles)

    @property
    def full_brake_torque_nm(self) -> float:
        """Torque of one axle [N m] at full cylinder pressure."""
        return self.brake.full_pressure_bar * self.brake.torque_per_bar_nm


#: Largest distance of neighbouring axles of a bogie [m] (assumption: bogies have 1.8 to 3 m, two-axle wagons 6 to 10 m).
_FARTHEST_M = 5.0


def check_vehicle(given: object) -> None:
    """Raise `ParameterError` for what is no `Vehicle`, such as the name of one."""
    if not isinstance(given, Vehicle):
        raise ParameterError(
            f"vehicle = {shown(given)} must be a Vehicle; wsp_env.parameters.vehicle_file.find_vehicle gives the one of a name"
        )


def _farthest(positions_m: tuple[float, ...]) -> float:
    """Return the largest distance of neighbours [m]; 0 of a single axle."""
    return max((behind - ahead for ahead, behind in itertools.pairwise(positions_m)), default=0.0)


def usual_bodies(axles: int) -> tuple[tuple[int, ...], ...]:
    """Return the bogies of each body where nobody says (assumption).

    Six axles are a body on two bogies of three; otherwise coaches on two bogies of two from the front, and the one to three
    axles that are left are a bogie with a body of its own.
    """
    if axles == 6:
        return ((3, 3),)
    coaches, rest = divmod(axles, 4)
    return ((2, 2),) * coaches + (((rest,),) if rest else ())


def train(vehicle: Vehicle, coaches: int, name: str = "train") -> Vehicle:
    """Return several vehicles of a kind as one longitudinal mass: rigid couplings, every axle with its own brake and sensor.

    Masses and resistances add up (assumption: the leading vehicle meets no more air than the others). `ParameterError` for a
    number of vehicles that gives more than `MOST_AXLES` axles, or vehicles that are shorter than the way between their axles.
    """
    if isinstance(coaches, bool) or not isinstance(coaches, int) or not 1 <= coaches * vehicle.axles <= MOST_AXLES:
        raise ParameterError(
            f"coaches = {shown(coaches)} is impossible: a train of vehicles with {vehicle.axles} axles takes 1 to "
            f"{MOST_AXLES // vehicle.axles} of them"
        )
    if coaches == 1:
        return vehicle
    if vehicle.length_m <= vehicle.axle_positions_m[-1]:
        raise ParameterError(
            f"{vehicle.name}: length_m = {vehicle.length_m:g} is not above the distance of the outer axles, "
            f"{vehicle.axle_positions_m[-1]:g} m: no train can be made of such vehicles"
        )
    return dataclasses.replace(
        vehicle,
        name=name,
        axle_positions_m=tuple(k * vehicle.length_m + x for k in range(coaches) for x in vehicle.axle_positions_m),
        bodies=vehicle.running_gear * coaches,
        length_m=coaches * vehicle.length_m,
        mass_kg=coaches * vehicle.mass_kg,
        payload_kg=coaches * vehicle.payload_kg,
        resistance_a_n=coaches * vehicle.resistance_a_n,
        resistance_b_ns_per_m=coaches * vehicle.resistance_b_ns_per_m,
        resistance_c_ns2_per_m2=coaches * vehicle.resistance_c_ns2_per_m2,
    )


def check_bodies(bodies: object, axles: int) -> None:
    """Raise `ParameterError` unless `bodies` is empty or lists the axles of each bogie of a vehicle, body by body."""
    if not isinstance(bodies, tuple) or not all(map(_carried, bodies)):
        raise ParameterError(
            f"bodies = {shown(bodies)} must list the axles of each bogie body by body, from the front: "
            "[[2, 2]] is a coach on two bogies of two axles"
        )
    carrying = sum(map(sum, bodies))
    if bodies and carrying != axles:
        raise ParameterError(
            f"bodies = {shown(bodies)} stand on {carrying} axles, but the vehicle has {axles}; correct the one or the other"
        )


def _carried(body: Any) -> bool:
    """Whether it lists the axles of each bogie under a body."""
    if not isinstance(body, tuple) or not body:
        return False
    return all(isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= MOST_AXLES for n in body)
