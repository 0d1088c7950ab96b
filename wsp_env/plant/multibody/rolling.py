"""Wheel and rail of a vehicle on a track: profiles, radii, and what their contacts share."""

from pathlib import Path

from wsp_env.contact.geometry.measured import read_rail, read_wheel
from wsp_env.contact.geometry.patch import make_patch_table
from wsp_env.contact.geometry.profile import Profile
from wsp_env.contact.geometry.standard import s1002, uic60
from wsp_env.contact.geometry.track import Track, Wheelset, make_pair
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.track_geometry import TrackGeometry
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.multibody.bodies import Rolling
from wsp_env.plant.multibody.static import centred_radius, lowered

#: Lateral shift and lift [m] of a wheelset beyond which it has derailed: half the width of a rail's head, the flange's height.
WIDEST_M, HIGHEST_M = 0.035, 0.028


def rolling_of(vehicle: Vehicle, track: TrackGeometry) -> Rolling:
    """Return what the contacts of all wheels share; `ParameterError` for profiles on which the vehicle cannot stand."""
    contact = vehicle.contact
    table = make_patch_table(2.0 * contact.shear_modulus_pa * (1.0 + contact.poisson_ratio), contact.poisson_ratio)
    damping = vehicle.multibody.contact_damping_s_per_m
    try:
        wheel, rail = profiles(track)
        lie = Track(track.gauge_m, inclination=track.rail_inclination)
        # The vehicle's wheel radius is the rolling radius of the centred wheelset, as in longitudinal motion: the taping line's
        # is larger (by 0.24 mm for S1002 on UIC60 1:20), and every distance would be shorter in proportion.
        taping = vehicle.wheel_radius_m
        taping += taping - centred_radius(make_pair(wheel, rail, Wheelset(radius_m=taping), lie))
        pair = make_pair(wheel, rail, Wheelset(radius_m=taping), lie)
        rolling = Rolling(pair, table, damping, 1.0, vehicle.wheel_radius_m, WIDEST_M, HIGHEST_M)
        settled = lowered(vehicle.static_wheel_load_n, rolling)
    except ParameterError:
        raise
    except ValueError as error:  # a profile's file, a wheel that does not reach its rail
        raise ParameterError(f"track geometry: {error}") from None
    return rolling._replace(reference=settled.stiffness)


def profiles(track: TrackGeometry) -> tuple[Profile, Profile]:
    """Return the profiles of wheel and rail; `ProfileError` for a file that cannot be used."""
    return (
        read_wheel(Path(track.wheel_profile)).profile if track.wheel_profile else s1002(),
        read_rail(Path(track.rail_profile)).profile if track.rail_profile else uic60(),
    )
