"""Measured profiles of wheel or rail, from a text file of two columns."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.contact.geometry.profile import COLUMNS, POLYNOMIAL, Profile, evaluate

Array = NDArray[np.float64]
_UNITS = {"mm": 1e-3, "m": 1.0}
_FEWEST = 20


class ProfileError(ValueError):
    """A profile file that cannot be used; the message names the file, what is wrong, and where."""


@dataclass(frozen=True)
class Reading:
    """How a file is read. Its columns, y and z, are turned into those of `wsp_env.contact.geometry.profile`."""

    unit: str = "mm"
    mirror_y: bool = False  # where y counts towards the middle of the track
    mirror_z: bool = False  # where a wheel's flange, or the top of a rail, has the smallest z
    noise_m: float = 1e-5  # standard deviation of the points [m]; assumption: 10 um, of a good profile gauge. 0: interpolate
    keep_origin: bool = False  # of z; else a wheel is shifted to 0 at y = 0, the taping line, and a rail to 0 at its top

    def __post_init__(self) -> None:
        if self.unit not in _UNITS:
            raise ValueError(f"unit must be one of {', '.join(_UNITS)}, got {self.unit!r}")
        if not 0.0 <= self.noise_m <= 1e-3:
            raise ValueError(f"the noise of the points must lie between 0 and 1 mm, got {self.noise_m!r} m")


class MeasuredProfile(NamedTuple):
    """A profile, and what smoothing has done to the points."""

    profile: Profile
    points: int
    rms_m: float  # of the distance between points and profile, along z [m]
    largest_m: float  # the largest of them [m]
    largest_at_m: float  # and its y [m]

    def __str__(self) -> str:
        return (
            f"{self.points} points, {len(self.profile.pieces)} pieces; smoothing moved the profile by {self.rms_m * 1e6:.2g} um "
            f"(rms), {self.largest_m * 1e6:.2g} um at most, at y = {self.largest_at_m * 1e3:.2f} mm"
        )


def read_wheel(file: Path, reading: Reading | None = None) -> MeasuredProfile:
    """Return the wheel's profile in a file; `ProfileError` as `read_rail`, and where the flange is not inside the tread."""
    reading = reading or Reading()
    y, z = _points(file, reading)
    if not y[0] < 0.0 < y[-1]:
        raise ProfileError(f"{file}: a wheel's y must be 0 at the taping line; it runs from {y[0]:.4g} to {y[-1]:.4g} m")
    if y[int(np.argmax(z))] >= 0.0:
        raise ProfileError(
            f"{file}: the highest point, the flange, must have a negative y, it has {y[int(np.argmax(z))] * 1e3:.4g} mm: y counts "
            "from the taping line to the field side, z is what the radius has beyond the nominal one; see mirror_y, mirror_z"
        )
    return _smoothed(y, z - (0.0 if reading.keep_origin else float(np.interp(0.0, y, z))), reading)


def read_rail(file: Path, reading: Reading | None = None) -> MeasuredProfile:
    """Return the rail's profile in a file of two columns, y and z, apart by blanks, tabs, commas or semicolons.

    Lines that begin with `#`, `!`, `%` or `"`, and one heading, are passed over.

    Raises
    ------
    ProfileError
        No such file; a line that is not two finite numbers; fewer than 20 points; a profile that folds back, so that a place
        across has two heights; a rail whose highest point is at its edge.

    """
    reading = reading or Reading()
    y, z = _points(file, reading)
    top = int(np.argmax(z))
    if top in (0, len(z) - 1):
        raise ProfileError(f"{file}: the highest point of a rail lies at its edge, y = {y[top] * 1e3:.4g} mm; see mirror_z")
    return _smoothed(y, z - (0.0 if reading.keep_origin else z[top]), reading)


def _points(file: Path, reading: Reading) -> tuple[Array, Array]:
    """Return y, rising, and z [m] of the points."""
    try:
        lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as why:
        raise ProfileError(f"{file}: cannot be read as text: {why}") from None
    rows: list[tuple[float, float]] = []
    heading = True
    for number, line in enumerate(lines, 1):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or line.lstrip()[0] in '#!%"':
            continue
        try:
            y, z = map(float, words)
        except ValueError:
            if not rows and heading:
                heading = False
                continue
            raise ProfileError(f"{file}, line {number}: two numbers, y and z, expected, got {line.strip()[:60]!r}") from None
        if not (np.isfinite(y) and np.isfinite(z)):
            raise ProfileError(f"{file}, line {number}: y and z must be finite, got {line.strip()[:60]!r}")
        rows.append((y, z))
    if len(rows) < _FEWEST:
        raise ProfileError(f"{file}: {len(rows)} points, but a profile needs {_FEWEST} or more")
    table = np.array(rows) * _UNITS[reading.unit] * [-1.0 if reading.mirror_y else 1.0, -1.0 if reading.mirror_z else 1.0]
    if table[-1, 0] < table[0, 0]:
        table = table[::-1]
    back = np.flatnonzero(np.diff(table[:, 0]) <= 0.0)
    if back.size:
        at = table[back[0]]
        raise ProfileError(
            f"{file}: the profile folds back at y = {at[0] * 1e3:.4g} mm, z = {at[1] * 1e3:.4g} mm ({back.size} places): y must "
            "rise from point to point. Cut off the back of the flange or the sides of the rail's head, and check for loops"
        )
    if not 0.01 < table[-1, 0] - table[0, 0] < 0.3:
        raise ProfileError(f"{file}: a width of {table[-1, 0] - table[0, 0]:.4g} m is no wheel's or rail's; see the unit")
    return table[:, 0].copy(), table[:, 1].copy()


def _smoothed(y: Array, z: Array, reading: Reading) -> MeasuredProfile:
    """Return the smoothing spline of degree 5, whose curvature is smooth, with residuals of the size of the noise."""
    from scipy.interpolate import PPoly, UnivariateSpline  # here, as it takes longer to import than all the rest

    spline = UnivariateSpline(y, z, k=5, s=len(y) * reading.noise_m**2)
    pieces = PPoly.from_spline(spline._eval_args)
    keep = np.diff(pieces.x) > 0.0
    rows = np.zeros((int(keep.sum()), COLUMNS))
    rows[:, 0], rows[:, 1] = POLYNOMIAL, pieces.x[:-1][keep]
    rows[:, 2:8] = pieces.c[::-1, keep].T
    profile = Profile(np.append(pieces.x[:-1][keep], pieces.x[-1]), rows)
    off = evaluate(profile, y)[0] - z
    worst = int(np.argmax(abs(off)))
    return MeasuredProfile(profile, len(y), float(np.sqrt(np.mean(off**2))), float(abs(off[worst])), float(y[worst]))
