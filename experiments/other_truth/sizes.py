"""How large an effect has to be to move the stops by a drawn amount, found by simulating them with it and without."""

from typing import NamedTuple

import numpy as np

from experiments.other_truth.campaign import Campaign, Rows
from experiments.other_truth.effects import EFFECTS
from experiments.other_truth.plant import ROW_S
from experiments.other_truth.records import Array, Sizes

#: The least effect: it moves the length of a stop (relative) or an axle's mean slip [m/s] by as much in three stops of ten.
LEAST_LENGTH, LEAST_SLIP_MPS = 0.015, 0.15
#: Effects are aimed at 1 to LARGEST times the least one.
LARGEST = 7.0 / 3.0
#: What counts as reached; a vehicle on which an effect does not reach it is replaced by another.
REACHED = (0.85, 2.8)


class Concealed(NamedTuple):
    """An effect of the size that was found."""

    effect: str
    size: float
    axles: list[int]  # from 0
    aimed: float  # times the least effect
    reached: float
    length_changes: list[float]  # relative, of every stop
    slip_changes_mps: list[float]  # mean over the axles, of every stop

    @property
    def in_range(self) -> bool:
        """Whether it moves the stops by what was asked for."""
        return REACHED[0] < self.reached < REACHED[1]

    @property
    def too_small(self) -> bool:
        """Whether it moves them by less."""
        return self.reached <= REACHED[0]


def conceal(campaign: Campaign, name: str, plain: list[Rows]) -> Concealed:
    """Search the size of an effect, alone, in up to seven trials; `plain` are the stops without it."""
    effect = EFFECTS[name]
    axles = list(range(2 if name == "coupled_axles" else campaign.axles))
    if effect.axle:
        axles = [getattr(campaign.places, effect.axle)]
    aimed = campaign.rng.uniform(1.0, LARGEST)
    sign, size, low, high = float(campaign.rng.choice(effect.signs)), effect.guess, 0.0, effect.cap
    for _ in range(7):
        tried = sign * size
        lengths, slips = moved(campaign, Sizes()._replace(**{name: tried}), plain, axles)
        times = max(np.quantile(np.abs(lengths), 0.7) / LEAST_LENGTH, np.quantile(np.abs(slips), 0.7) / LEAST_SLIP_MPS)
        ratio = float(times / aimed)
        if abs(ratio - 1.0) < 0.1 or (size >= 0.999 * effect.cap and ratio < 1.0):
            break
        low, high = (size, high) if ratio < 1.0 else (low, size)
        step = size / max(ratio, 0.2)
        between = 0.5 * (low + high) if ratio > 1.0 or high < effect.cap else high
        size = step if low < step < high else between
    return Concealed(name, tried, axles, aimed, ratio * aimed, lengths, slips)


def moved(campaign: Campaign, sizes: Sizes, plain: list[Rows], axles: list[int]) -> tuple[list[float], list[float]]:
    """Return by how much each stop's length (relative) and the mean slip of some axles [m/s] move against the plain stops."""
    lengths, slips = [], []
    for i, before in enumerate(plain):
        after = campaign.stop(i, sizes)
        lengths.append(float((after.length) / before.length - 1.0))
        slip = read_slip(after, campaign.vehicle.radius_m, sizes.clock_offset) - read_slip(
            before, campaign.vehicle.radius_m, 0.0
        )
        slips.append(float(np.abs(slip[axles]).mean()))
    return lengths, slips


def read_slip(rows: Rows, radius: float, late_s: float) -> Array:
    """Return the mean slip of each axle (A,) [m/s] as a reader with the nominal radius and one clock sees it."""
    clock = ROW_S * np.arange(len(rows.speed))
    speed = np.interp(clock - late_s, clock, rows.speed)
    slip: Array = (speed[:, None] - radius * rows.wheel).mean(axis=0)
    return slip
