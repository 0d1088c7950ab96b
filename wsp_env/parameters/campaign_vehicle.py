"""The vehicle as campaign.toml and model.json describe it, and the one that the plant brakes with in its place."""

import dataclasses

from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.quantity import Checked, ParameterError, quantity, shown
from wsp_env.parameters.uic_z1 import usual_positions
from wsp_env.parameters.vehicle import MOST_AXLES, Brake, Vehicle, check_bodies, usual_bodies

_SOURCE = "the campaign"
#: A `brake_torque_source` other than "measured".
FROM_PRESSURE = "cylinder pressure times the nominal gain"


@dataclasses.dataclass(frozen=True)
class CampaignVehicle(Checked):
    """The vehicle as the test team believed it to be; every wheelset alike, the load shared equally."""

    axles: int = quantity(4, "-", _SOURCE, 1, MOST_AXLES)
    mass_kg: float = quantity(43000.0, "kg", _SOURCE, 0.0, 1e7, open_low=True)
    wheelset_inertia_kgm2: float = quantity(160.0, "kg m2", _SOURCE, 0.0, 1e5, open_low=True)
    wheel_radius_m: float = quantity(0.445, "m", _SOURCE, 0.05, 2.0)
    gravity_mps2: float = quantity(9.81, "m/s2", _SOURCE, 9.0, 10.0)
    axle_positions_m: tuple[float, ...] = quantity((), "m", _SOURCE, -1e4, 1e4)  # rising; made to start with 0
    resistance_n: tuple[float, ...] = quantity((0.0, 0.0, 0.0), "N, N s/m, N s2/m2", _SOURCE, 0.0, 1e6)  # A + B v + C v2
    # [Nm/bar] nominal, of a wheelset; needed where files have cylinder pressures but no torques. 0: unknown
    torque_per_bar_nm: float = quantity(0.0, "N m/bar", _SOURCE, 0.0, 1e6)
    bodies: tuple[tuple[int, ...], ...] = ()  # axles of each bogie, body by body from the front; empty: the usual ones
    missing_axles: tuple[int, ...] = ()  # from 1: without sensors; their mass and brake stay
    brake_torque_source: str = "measured"  # or `FROM_PRESSURE`: then itself a model

    @property
    def torque_is_measured(self) -> bool:
        """Whether the brake torque was measured, not computed from the cylinder pressure."""
        return self.brake_torque_source == "measured"

    def __post_init__(self) -> None:
        """Check the ranges, and that tuples are as long as they must be; count the axles' positions from the leading one."""
        super().__post_init__()
        if not isinstance(self.axles, int):
            raise ParameterError(f"axles = {shown(self.axles)} must be a whole number")
        if self.axle_positions_m and len(self.axle_positions_m) != self.axles:
            raise ParameterError(f"axle_positions_m has {len(self.axle_positions_m)} values for {self.axles} axles")
        if list(self.axle_positions_m) != sorted(set(self.axle_positions_m)):
            raise ParameterError(
                f"axle_positions_m = {shown(list(self.axle_positions_m))} must rise from the leading axle to the last: "
                "distances behind any point of the vehicle [m]"
            )
        object.__setattr__(self, "axle_positions_m", tuple(x - self.axle_positions_m[0] for x in self.axle_positions_m))
        check_bodies(self.bodies, self.axles)
        check_missing(self.missing_axles, self.axles)
        if len(self.resistance_n) != 3:
            raise ParameterError(f"resistance_n must be the three numbers [A, B, C], got {list(self.resistance_n)}")
        if self.brake_torque_source != "measured" and "pressure" not in str(self.brake_torque_source):
            raise ParameterError(
                f'brake_torque_source = {shown(self.brake_torque_source)} is unknown; valid: "measured", "{FROM_PRESSURE}"'
            )


def check_missing(missing: object, axles: int) -> None:
    """Raise `ParameterError` unless `missing` are axles from 1, each once, with one left."""
    whole = isinstance(missing, tuple) and all(type(k) is int and 1 <= k <= axles for k in missing)
    if not whole or len(set(missing)) != len(missing) or len(missing) >= axles:  # type: ignore[arg-type,call-overload]  # whole: a tuple
        raise ParameterError(
            f"missing_axles = {list(missing) if isinstance(missing, tuple) else missing!r} must be a list of axles from 1 to "
            f"{axles}, each once, and leave one"
        )


def plant_vehicle(
    described: CampaignVehicle,
    contact: ContactParameters,
    name: str,
    base: Vehicle | None = None,
    mass_kg: float | None = None,
    payload_kg: float | None = None,
    brake: Brake | None = None,
) -> Vehicle:
    """Return a described vehicle as the plant takes it.

    Parameters
    ----------
    described : masses, wheels, resistances; axle positions where they are given
    contact : of its wheels
    name : what it is called
    base : gives what is not described: valve times, sensors, payload, and where it is left out, which axles form a bogie.
        None: the coach's, with as many axles as needed (`usual_bodies`). `ParameterError` for one with another number of
        axles than described
    mass_kg, payload_kg, brake : in place of the described mass, and of the base's payload and brake

    """
    axles = described.axles
    if base is None:
        base = Vehicle(name, axle_positions_m=usual_positions(described.bodies or usual_bodies(axles)))
    elif base.axles != axles:
        raise ParameterError(
            f"{name} is of a vehicle with {axles} axles, the {base.name} has {base.axles}: give a vehicle of {axles} axles"
        )
    a, b, c = described.resistance_n
    return dataclasses.replace(
        base,
        name=name,
        axle_positions_m=described.axle_positions_m or base.axle_positions_m,
        bodies=described.bodies or base.bodies,
        mass_kg=described.mass_kg if mass_kg is None else mass_kg,
        payload_kg=base.payload_kg if payload_kg is None else payload_kg,
        wheelset_inertia_kgm2=described.wheelset_inertia_kgm2,
        wheel_radius_m=described.wheel_radius_m,
        gravity_mps2=described.gravity_mps2,
        resistance_a_n=a,
        resistance_b_ns_per_m=b,
        resistance_c_ns2_per_m2=c,
        contact=contact,
        brake=brake or base.brake,
    )
