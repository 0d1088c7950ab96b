"""Wheelset and track as parameters, and the pair of wheel and rail that compiled code takes."""

import math
from dataclasses import dataclass

import numpy as np

from wsp_env.contact.geometry.port import Pair
from wsp_env.contact.geometry.profile import Profile, evaluate

#: What touches within the next milliseconds is nearer to the rail than this [m]: 1 mm closes in 5 ms at 0.2 m/s.
_FAR = 1e-3

#: The wheel's profile is searched up to a slope of 1:20 off the vertical: beyond lie crest and back of the flange.
_STEEPEST = 20.0


@dataclass(frozen=True)
class Track:
    """A track of two equal rails.

    Raises `ValueError` where a value is impossible.
    """

    gauge_m: float = 1.435  # seed paper, section 3.2
    gauge_depth_m: float = 0.014  # below the rails' tops, where the gauge is measured (EN 13848-1)
    inclination: float = 1.0 / 20.0  # of the rails towards the middle, "cant" of a rail [-]; seed paper, section 3.2
    curvature_1pm: float = 0.0  # [1/m], positive to the left; 1 / 300 is a narrow curve
    superelevation_m: float = 0.0  # height of the outer rail above the inner one; tilts the frame

    def __post_init__(self) -> None:
        if not 0.9 < self.gauge_m < 2.0:
            raise ValueError(f"gauge must lie between 0.9 and 2 m, got {self.gauge_m!r}")
        if not 0.0 < self.gauge_depth_m < 0.03:
            raise ValueError(f"the gauge is measured 0 to 30 mm below the rails' tops, got {self.gauge_depth_m!r} m")
        if not -0.2 < self.inclination < 0.2:
            raise ValueError(f"the inclination of a rail must lie between -0.2 and 0.2, got {self.inclination!r}")
        if not abs(self.curvature_1pm) < 0.1:
            raise ValueError(f"the curvature of the track must be below 0.1 /m, got {self.curvature_1pm!r}")
        if not abs(self.superelevation_m) < 0.3:
            raise ValueError(f"the superelevation must be below 0.3 m, got {self.superelevation_m!r}")

    @property
    def tilt_rad(self) -> float:
        """Angle of the track frame about x [rad] due to the superelevation, over a rail distance of gauge + 65 mm (head)."""
        return -math.copysign(math.asin(self.superelevation_m / (self.gauge_m + 0.065)), self.curvature_1pm)


@dataclass(frozen=True)
class Wheelset:
    """Two equal wheels on an axle."""

    radius_m: float = 0.445  # at the taping line; seed paper, section 3.2
    back_to_back_m: float = 1.360  # UIC 510-2; the paper's d_w of 1.5 m between the taping lines is the same
    taping_m: float = 0.070  # taping line from the back of the flange, EN 13715

    def __post_init__(self) -> None:
        if not 0.1 < self.radius_m < 1.0:
            raise ValueError(f"wheel radius must lie between 0.1 and 1 m, got {self.radius_m!r}")
        if not 0.8 < self.back_to_back_m < 2.0:
            raise ValueError(f"distance of the flange backs must lie between 0.8 and 2 m, got {self.back_to_back_m!r}")
        if not 0.0 < self.taping_m < 0.2:
            raise ValueError(f"the taping line must lie 0 to 0.2 m from the flange back, got {self.taping_m!r}")

    @property
    def half_distance_m(self) -> float:
        """Distance of a taping line from the middle of the wheelset [m]."""
        return 0.5 * self.back_to_back_m + self.taping_m


def make_pair(wheel: Profile, rail: Profile, wheelset: Wheelset, track: Track, step_m: float = 1e-3) -> Pair:
    """Return wheel and rail of one side; `step_m` is that of a scan over the wheel's profile.

    Raises `ValueError` where the rail's profile does not reach down to where the gauge is measured, or the wheel has no tread.
    """
    angle = math.atan(track.inclination)
    cosine, sine = math.cos(angle), math.sin(angle)
    y = np.linspace(rail.breaks[0], rail.breaks[-1], 20001)
    z = evaluate(rail, y)[0]
    across, up = y * cosine - z * sine, y * sine + z * cosine
    top = int(np.argmax(up))
    inner = slice(0, top + 1)
    depth = up[top] - up[inner]
    if depth[0] < track.gauge_depth_m:
        raise ValueError(
            f"the rail's profile must reach {track.gauge_depth_m * 1e3:g} mm below its top on the gauge side, where the gauge "
            f"is measured; it ends {depth[0] * 1e3:.3g} mm below"
        )
    face = float(np.interp(track.gauge_depth_m, depth[::-1], across[inner][::-1]))
    face = min(face, float(np.min(across[inner][depth <= track.gauge_depth_m])))
    first, last = _searched(wheel)
    return Pair(
        wheel, rail, wheelset.radius_m, wheelset.half_distance_m, 0.5 * track.gauge_m - face, -float(up[top]), cosine, sine,
        track.curvature_1pm, first, last, step_m, _FAR,
    )  # fmt: skip


def _searched(wheel: Profile) -> tuple[float, float]:
    """Return the part of the wheel's profile that may touch: from the crest of the flange, or the steepest place, outwards."""
    y = np.linspace(wheel.breaks[0], wheel.breaks[-1], 4001)
    z, slope, _ = evaluate(wheel, y)
    near = np.flatnonzero(abs(slope) < _STEEPEST)
    if near.size < 2:
        raise ValueError("the wheel's profile has no part that could roll on a rail: it is vertical everywhere")
    crest = int(near[np.argmax(z[near])])
    first = crest if y[crest] < 0.0 else int(near[0])
    return float(y[first]), float(y[near[-1]])
