"""Irregularities of both rails along a track: from a measured file, or drawn from a standard spectrum.

The spectra are those of ORE (now ERRI) B 176 for track of low and of high disturbance, as power densities over the angular
wave number Omega [rad/m]:

    S_vertical = A_v O_c^2 / ((Omega^2 + O_r^2) (Omega^2 + O_c^2)),  S_lateral the same with A_a [m2 / (rad/m)]
    S_roll     = A_v / b^2 O_c^2 Omega^2 / ((Omega^2 + O_r^2) (Omega^2 + O_c^2) (Omega^2 + O_s^2)) [rad2 / (rad/m)]

The report is not public. The numbers are those that public programs for vehicle and track dynamics share ("German spectrum of
low and high disturbance": the vertical density in seven of them, the lateral one in four), read there and not in print; Claus
and Schiehlen (Modeling and simulation of railway bogie structural vibrations, Vehicle System Dynamics 29, supplement, 1998) are
said to print them. They are read as one-sided densities, and both rails have one lateral irregularity, so that the gauge does
not vary: assumptions.
"""

import csv
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wsp_env.parameters.quantity import Checked, ParameterError, quantity, shown

Array = NDArray[np.float64]

#: Level -> A_v, A_a [m2 rad/m] of ORE B 176, as public programs have them.
LEVELS = {"low": (4.032e-7, 2.119e-7), "high": (1.080e-6, 6.125e-7)}

#: O_c, O_r, O_s [rad/m] and b [m], half the distance of the contact points, of the same.
O_C, O_R, O_S, HALF_M = 0.8246, 0.0206, 0.4380, 0.75

#: Columns of a measured file [m]: place, then left and right rail across (positive to the left) and up.
COLUMNS = ("place_m", "left_y_m", "left_z_m", "right_y_m", "right_z_m")

#: A table grows from nothing over this length [m] and falls to nothing over as much; its last `SMOOTH_M` are smooth: there a
#: stop begins, its vehicle at rest on smooth rails, and there the table is repeated (assumption).
GROWS_M, SMOOTH_M = 25.0, 50.0

_MOST_POINTS = 1_000_000
_LARGEST_M = 0.05  # of one irregularity: beyond the flange's height no wheel stays on the rail


@dataclasses.dataclass(frozen=True)
class Irregularities(Checked):
    """Irregularities from a spectrum of one of `LEVELS`, or the points of a measured file (see `COLUMNS`); none by default."""

    spectrum: str = ""
    seed: int = 1
    scale: float = quantity(1.0, "-", "factor on every irregularity", 0.0, 10.0)
    length_m: float = quantity(4000.0, "m", "of what is drawn, which is then repeated: as long as a stop", 100.0, 1e5)
    shortest_m: float = quantity(3.0, "m", "wavelength; EN 13848-1, range D1 begins there", 1.0, 1e3)
    longest_m: float = quantity(70.0, "m", "wavelength; EN 13848-1, range D2 ends there", 2.0, 1e4)
    node_m: float = quantity(0.25, "m", "assumption: distance of the nodes of the cubic between them", 0.05, 1.0)
    points: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        super().__post_init__()
        if not isinstance(self.spectrum, str) or (self.spectrum and self.spectrum not in LEVELS):
            raise ParameterError(f"irregularities: spectrum {shown(self.spectrum)} is unknown; valid: {', '.join(LEVELS)}")
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise ParameterError(f"irregularities: seed = {shown(self.seed)} must be a whole number, 0 or more")
        if not self.longest_m > self.shortest_m >= 4.0 * self.node_m:
            raise ParameterError(
                f"irregularities: wavelengths from shortest_m = {self.shortest_m:g} to longest_m = {self.longest_m:g} m with "
                f"nodes {self.node_m:g} m apart: the longest must be above the shortest, the shortest four nodes or more"
            )
        if self.spectrum and self.points:
            raise ParameterError("irregularities: give a spectrum or a file, not both")

    def rails(self) -> Array:
        """Return the irregularities of the left rail across and up, and of the right rail (nodes, 4) [m]; none: (0, 4)."""
        if not (self.points or self.spectrum):
            return np.zeros((0, 4))
        rails = _resampled(np.array(self.points), self.node_m) if self.points else self.drawn()
        return self.scale * window(len(rails), self.node_m)[:, None] * rails

    def drawn(self) -> Array:
        """Return the table (nodes, 4) [m] before it is scaled and made to begin and end smoothly.

        It is a sum of waves with the spectrum's amplitudes and with phases from the seed.
        """
        nodes = round(self.length_m / self.node_m)
        waves = np.arange(nodes // 2 + 1)
        omega: Array = np.asarray(2.0 * math.pi * waves / (nodes * self.node_m), dtype=np.float64)
        inside = (omega >= 2.0 * math.pi / self.longest_m) & (omega <= 2.0 * math.pi / self.shortest_m)
        generator = np.random.default_rng(self.seed)

        def wave(density: Array) -> Array:
            amplitude = np.where(inside, np.sqrt(2.0 * density * omega[1]), 0.0)
            phase = generator.uniform(0.0, 2.0 * math.pi, waves.size)
            return np.fft.irfft(0.5 * nodes * amplitude * np.exp(1j * phase), nodes)

        vertical, lateral, roll = (wave(density) for density in densities(omega, self.spectrum))
        return np.column_stack([lateral, vertical + HALF_M * roll, lateral, vertical - HALF_M * roll])


def densities(omega: Array, level: str) -> tuple[Array, Array, Array]:
    """Return the one-sided densities over the wave number [rad/m]: vertical, lateral [m2/(rad/m)], roll [rad2/(rad/m)]."""
    a_v, a_a = LEVELS[level]
    squared = omega * omega
    shape = O_C**2 / ((squared + O_R**2) * (squared + O_C**2))
    return a_v * shape, a_a * shape, a_v / HALF_M**2 * shape * squared / (squared + O_S**2)


def _resampled(points: Array, node_m: float) -> Array:
    """Return measured points (n, 5) on nodes (nodes, 4)."""
    place = points[:, 0] - points[0, 0]
    nodes = node_m * np.arange(int(place[-1] / node_m) + 1)
    return np.column_stack([np.interp(nodes, place, points[:, column]) for column in range(1, 5)])


def window(nodes: int, node_m: float) -> Array:
    """Return the share (nodes,) of every irregularity that lies there: smooth at both ends, see `GROWS_M`."""
    place = node_m * np.arange(nodes)
    rising = np.clip(np.minimum(place, place[-1] - SMOOTH_M - place) / GROWS_M, 0.0, 1.0)
    share: Array = rising * rising * (3.0 - 2.0 * rising)
    return share


def read_points(file: Path) -> tuple[tuple[float, ...], ...]:
    """Return the points of a measured file, comma-separated with the heading `COLUMNS`, places rising.

    `ParameterError` names the file, the line and what is wrong.
    """
    try:
        with file.open(encoding="utf-8-sig", newline="") as lines:
            return _points(file, csv.reader(lines))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(f"irregularities {file}: cannot be read as text: {error}") from None


def _points(file: Path, lines: Any) -> tuple[tuple[float, ...], ...]:
    heading = [name.strip() for name in next(lines, [])]
    if missing := [name for name in COLUMNS if name not in heading]:
        raise ParameterError(f"irregularities {file}: columns {', '.join(missing)} are missing; needed: {', '.join(COLUMNS)}")
    columns = [heading.index(name) for name in COLUMNS]
    points: list[tuple[float, ...]] = []
    for number, line in enumerate(lines, 2):
        if not line:
            continue
        try:
            point = tuple(float(line[column]) for column in columns)
        except (ValueError, IndexError):
            raise ParameterError(f"irregularities {file}, line {number}: five numbers in metres expected") from None
        if not all(math.isfinite(value) for value in point):
            raise ParameterError(f"irregularities {file}, line {number}: numbers must be finite")
        if max(map(abs, point[1:])) > _LARGEST_M:
            raise ParameterError(f"irregularities {file}, line {number}: beyond {_LARGEST_M * 1e3:g} mm; are they in metres?")
        if points and point[0] <= points[-1][0]:
            raise ParameterError(f"irregularities {file}, line {number}: the place must rise from line to line")
        points.append(point)
        if len(points) > _MOST_POINTS:
            raise ParameterError(f"irregularities {file}: more than {_MOST_POINTS} points")
    if len(points) < 2 or points[-1][0] - points[0][0] < 2.0 * SMOOTH_M:
        raise ParameterError(f"irregularities {file}: a table needs {2.0 * SMOOTH_M:g} m of track or more")
    return tuple(points)
