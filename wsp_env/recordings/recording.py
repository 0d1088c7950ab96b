"""One recorded stop, as the rest of the package uses it."""

import dataclasses

import numpy as np

from wsp_env.recordings.errors import ContradictionError

#: Speeds [m/s] below which the vehicle, whose recorded speed is noisy, and every wheel stand: assumption.
_STANDS_MPS, _TURNS_MPS = 1.0, 0.3


@dataclasses.dataclass(frozen=True)
class Recording:
    """One recorded stop; T samples at the campaign's sample time."""

    name: str
    time_s: np.ndarray  # (T,) [s]
    vehicle_speed_mps: np.ndarray  # (T,) [m/s]
    wheel_speed_radps: np.ndarray  # (T, axles) [rad/s]
    brake_torque_nm: np.ndarray  # (T, axles) [Nm] per wheelset, positive in braking
    start_position_m: float  # [m] of the leading axle along the track
    mass_kg: float  # [kg] of the whole vehicle in this run
    kinetic_friction_d: float  # [-] mu_cd as believed by the test team
    gradient: float = 0.0  # [-] rise per metre, positive uphill
    direction: str = ""
    notes: str = ""
    wheel_load_n: np.ndarray | None = None  # (T, axles) [N], where recorded on every axle; so the next two
    cylinder_pressure_bar: np.ndarray | None = None
    valve_command: np.ndarray | None = None  # -1 vent, 0 hold, 1 apply
    position_m: np.ndarray | None = None  # (T,) [m]
    suspect: np.ndarray | None = None  # (T, axles) bool: repaired samples, never compared with the law; None: none
    warnings: tuple[str, ...] = ()  # what was repaired or looks wrong, and where
    torque_from_pressure: bool = False  # whether the file has no torques, so that pressures times `torque_per_bar_nm` stand in
    start_is_known: bool = True  # whether somebody measured start_position_m
    missing_axles: tuple[int, ...] = ()  # from 1: without a usable sensor; their channels here stand in, see `missing`
    dead_channels: tuple[str, ...] = ()  # those of them whose channel is there and says nothing
    contradiction: ContradictionError | None = None  # that was not refused when it was read

    def under_way(self, wheel_radius_m: float) -> "Recording":
        """Return it without standstill before and after: there brakes hold, and slow nothing."""
        turning = wheel_radius_m * np.abs(self.wheel_speed_radps).max(axis=1)
        moves = np.flatnonzero((np.abs(self.vehicle_speed_mps) > _STANDS_MPS) | (turning > _TURNS_MPS))
        if not len(moves):
            return self
        part = slice(max(moves[0] - 1, 0), moves[-1] + 2)
        arrays = {name: value[part] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        return dataclasses.replace(self, **arrays)  # type: ignore[arg-type]  # fields by name
