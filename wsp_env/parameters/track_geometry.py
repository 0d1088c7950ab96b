"""Where a track runs and how its rails lie: gauge, inclination, curves, irregularities, profiles; a TOML file or a dictionary.

    gauge_m = 1.435
    rail_inclination = 0.05        # 1:20
    wheel_profile = "wheel.txt"    # two columns [mm], in place of S1002; see `wsp_env.contact.geometry.measured`
    rail_profile = "rail.txt"      # in place of UIC60

    [[curves]]
    begin_m = 100.0                # where the first transition begins; a stop begins at 0 m, on straight track
    transition_m = 60.0            # length of each transition, in which curvature and cant grow linearly
    length_m = 300.0               # between the transitions
    radius_m = 300.0               # positive to the left
    cant_m = 0.15                  # of the outer rail over the inner one

    [irregularities]
    spectrum = "low"               # ORE B 176, low or high; or file = "measured.csv"

Only a plant whose wheels run on rails in space takes it; see docs/multibody.md.
"""

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wsp_env.parameters.document import DocumentError, read_toml
from wsp_env.parameters.irregularities import Irregularities, read_points
from wsp_env.parameters.quantity import Checked, ParameterError, quantity, replace, shown

_NARROWEST_M = 100.0  # radius of curve that small displacements between bodies still describe (assumption)


@dataclasses.dataclass(frozen=True)
class Curve(Checked):
    """One curve with equal transitions (clothoids) before and after it."""

    begin_m: float = quantity(100.0, "m", "where its first transition begins", 0.0, 1e6)
    transition_m: float = quantity(60.0, "m", "length of each transition", 1.0, 1e5)
    length_m: float = quantity(300.0, "m", "between the transitions", 0.0, 1e6)
    radius_m: float = quantity(300.0, "m", "positive to the left", -1e6, 1e6)
    cant_m: float = quantity(0.0, "m", "of the outer rail over the inner one", -0.3, 0.3)

    def __post_init__(self) -> None:
        """Refuse a curve that is too narrow."""
        super().__post_init__()
        if abs(self.radius_m) < _NARROWEST_M:
            raise ParameterError(
                f"curve: radius_m = {self.radius_m:g} m is too narrow: {_NARROWEST_M:g} m or more to either side"
            )

    @property
    def end_m(self) -> float:
        """Where the track is straight again [m]."""
        return self.begin_m + 2.0 * self.transition_m + self.length_m


@dataclasses.dataclass(frozen=True)
class TrackGeometry(Checked):
    """A track; straight and smooth by default, with the gauge, rails and profiles of the seed paper."""

    gauge_m: float = quantity(1.435, "m", "seed paper, section 3.2", 0.9, 2.0)
    rail_inclination: float = quantity(0.05, "-", "seed paper, section 3.2: 1:20", -0.2, 0.2)
    wheel_profile: str = ""
    rail_profile: str = ""
    curves: tuple[Curve, ...] = ()
    irregularities: Irregularities = dataclasses.field(default_factory=Irregularities)

    def __post_init__(self) -> None:
        """Refuse curves that overlap."""
        super().__post_init__()
        for before, after in zip(self.curves, self.curves[1:], strict=False):
            if after.begin_m < before.end_m:
                raise ParameterError(
                    f"curves: the one that begins at {after.begin_m:g} m begins before the last one ends, at {before.end_m:g} m"
                )


def find_track_geometry(given: str | os.PathLike[str] | Mapping[str, Any]) -> TrackGeometry:
    """Return the track of a file, or of a dictionary with the same keys; `ParameterError` says what is wrong and valid."""
    if isinstance(given, Mapping):
        return _made(given, Path(), "track_geometry")
    if not isinstance(given, str | os.PathLike):
        raise ParameterError(f"track_geometry = {shown(given)} must be a file's path as text, or a dictionary of its keys")
    path = Path(given)
    try:
        document = read_toml(path)
    except DocumentError as error:
        raise ParameterError(f"track geometry {path} {error}") from None
    return _made(document, path.parent, f"track geometry {path}")


def _made(document: Mapping[str, Any], folder: Path, where: str) -> TrackGeometry:
    values = dict(document)
    for name in ("wheel_profile", "rail_profile"):
        if name in values:
            values[name] = _path(values[name], folder, f"{where}: {name}")
    try:
        values["curves"] = tuple(_part(Curve(), one, "curve") for one in _listed(values.get("curves", ())))
        rough = dict(_table(values.get("irregularities", {}), "irregularities"))
        if "points" in rough:
            raise ParameterError("irregularities: give the points in a file: file = ...")
        if file := rough.pop("file", ""):
            rough["points"] = read_points(Path(_path(file, folder, "irregularities: file")))
        values["irregularities"] = _part(Irregularities(), rough, "irregularities")
        return replace(TrackGeometry(), values, "key")
    except ParameterError as error:
        raise ParameterError(f"{where}: {error}") from None


def _part(record: Any, values: Any, what: str) -> Any:
    return replace(record, _table(values, what), f"key of {what}")


def _table(value: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ParameterError(f"{what} = {shown(value)} must be a table of keys and values")
    return value


def _listed(value: Any) -> Any:
    if not isinstance(value, list | tuple):
        raise ParameterError(f"curves = {shown(value)} must be a list of tables: write [[curves]] above the keys of each")
    return value


def _path(value: Any, folder: Path, what: str) -> str:
    if not isinstance(value, str) or not value:
        raise ParameterError(f"{what} = {shown(value)} must be a file's path as text")
    return str(folder / value)
