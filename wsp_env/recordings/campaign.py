"""Campaigns of recorded stops: reading and checking them.

A campaign is a folder with `campaign.toml` and one file (CSV, Parquet, MDF4 or MAT) per stop:

- `[campaign]` name, tune, validate (names of runs: groups A and B of the seed paper), sample_time_s
- `[vehicle]` see `CampaignVehicle`
- `[contact]` fields of `ContactParameters`; what is left out comes from the named `set` (default "velim", Table 2)
- `[runs.NAME]` file; optionally start_position_m, mass_kg, kinetic_friction_d, gradient, direction, notes, missing_axles. Where
  start_position_m is left out, or the same in all of several runs, nobody knows it: such runs share no place (`laid_out`)
- `[channels]` optional: other people's columns and units, see `channels`

Columns of a file in the native format: `time_s`, `vehicle_speed_mps`, and per axle k from 1
`axle{k}_wheel_speed_radps` and `axle{k}_brake_torque_nm` (per wheelset, positive in braking); optionally those of
`channels.CHANNELS`; others are ignored.
"""

import dataclasses
from importlib.resources import files
from pathlib import Path

import numpy as np

from wsp_env.parameters import velim
from wsp_env.parameters.campaign_vehicle import FROM_PRESSURE, CampaignVehicle, check_missing
from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.document import DocumentError, read_toml
from wsp_env.parameters.quantity import ParameterError, number, replace, shown
from wsp_env.recordings import channels
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.reading import read_recording
from wsp_env.recordings.recording import Recording

#: Parameter sets that `[contact] set` may name.
CONTACT_SETS = {"velim": velim.CONTACT}

_SAMPLE_TIMES_S = (1e-4, 1.0)  # loggers take up to some thousand samples a second; beyond a second no slide is seen
_APART_M = 50.0  # between stretches of track that belong to single runs: longer than anything that varies along it
_TABLES = ("campaign", "vehicle", "contact", "channels", "runs")
_CAMPAIGN_KEYS = ("name", "tune", "validate", "sample_time_s")
_RUN_KEYS = ("file", "start_position_m", "mass_kg", "kinetic_friction_d", "gradient", "direction", "notes", "missing_axles")


_REQUIRED_VEHICLE_KEYS = ("axles", "mass_kg", "wheelset_inertia_kgm2", "wheel_radius_m")


@dataclasses.dataclass(frozen=True)
class Campaign:
    """Several stops of one vehicle on one contaminated track."""

    name: str
    tune: tuple[str, ...]  # runs to tune on: the paper's group A
    validate: tuple[str, ...]  # runs only scored: group B
    sample_time_s: float  # [s]
    vehicle: CampaignVehicle
    contact: ContactParameters
    runs: dict[str, Recording]

    def __post_init__(self) -> None:
        """Raise `CampaignError` for runs with other axles than the vehicle; files are refused earlier, by their columns."""
        for name, run in self.runs.items():
            if run.wheel_speed_radps.shape[1:] != (self.vehicle.axles,):
                raise CampaignError(
                    f"campaign {self.name}: [vehicle] says {self.vehicle.axles} axles, but run {name} has wheel speeds of "
                    f"shape {run.wheel_speed_radps.shape}, (samples, axles)"
                )


def demo_campaign() -> Path:
    """Return the folder of the small campaign that travels with the package; see wsp_env/data/README.md."""
    return Path(str(files("wsp_env") / "data" / "demo_campaign"))


def concealed_campaign() -> Path:
    """Return the folder of a campaign that travels with the package and conceals an effect; see wsp_env/data/README.md."""
    return Path(str(files("wsp_env") / "data" / "concealed_campaign"))


def read_campaign(folder: Path, refuse: bool = True) -> Campaign:
    """Read and check a campaign folder.

    Parameters
    ----------
    refuse : whether a channel in another unit, or of the wrong sign, is an error; otherwise its recording tells of it

    Raises
    ------
    CampaignError
        naming file, key, column or line, and how to repair it

    """
    path = Path(folder) / "campaign.toml"
    if is_file(Path(folder)):
        raise CampaignError(f"{folder} is a file; a campaign is a folder: give {Path(folder).parent}")
    if not Path(folder).is_dir():
        raise CampaignError(f"there is no folder {folder}")
    if not is_file(path):
        raise CampaignError(
            f"{path} does not exist: a campaign is a folder that holds campaign.toml and one table per run; "
            "wsp inspect FOLDER --vehicle FILE writes it"
        )
    try:
        document = read_toml(path)
    except DocumentError as error:
        raise CampaignError(f"{path} {error}") from None
    _known(path, "the top level", document, _TABLES)
    head = _table(path, document, "campaign")
    _known(path, "[campaign]", head, _CAMPAIGN_KEYS)
    _required(path, "[campaign]", head, ("name", "tune", "sample_time_s"))
    sample_time = _number(path, "[campaign] sample_time_s", head["sample_time_s"], above=0.0)
    if not _SAMPLE_TIMES_S[0] <= sample_time <= _SAMPLE_TIMES_S[1]:
        low, high = _SAMPLE_TIMES_S
        raise CampaignError(
            f"{path}: [campaign] sample_time_s = {sample_time:g} s is impossible: it must lie in [{low:g}, {high:g}]"
        )
    described = _table(path, document, "runs")
    tune, validate = _groups(path, head, described)
    try:
        vehicle = _vehicle(path, _table(path, document, "vehicle"))
        contact = _contact(path, document.get("contact", {}))
    except ParameterError as error:
        raise CampaignError(f"{path}: {error}") from None
    mapping = channels.parse(path, document.get("channels", {}), vehicle.axles)
    runs = {}
    for name, entry in described.items():
        file, blank = _described(path, name, entry, vehicle, contact)
        runs[name] = read_recording(file, blank, mapping, vehicle, sample_time, refuse)
    runs = laid_out(runs, vehicle)
    if any(run.torque_from_pressure for run in runs.values()):
        vehicle = dataclasses.replace(vehicle, brake_torque_source=FROM_PRESSURE)
    return Campaign(str(head["name"]), tune, validate, sample_time, vehicle, contact, runs)


def laid_out(runs: dict[str, Recording], vehicle: CampaignVehicle) -> dict[str, Recording]:
    """Give every run whose start nobody knows a stretch of track of its own, behind all others.

    Runs that all say the same start were measured by nobody: stops differ by metres at least.
    """
    starts = [run.start_position_m for run in runs.values() if run.start_is_known]
    if len(runs) > 1 and len(starts) == len(runs) and len(set(starts)) == 1:
        runs = {name: dataclasses.replace(run, start_is_known=False) for name, run in runs.items()}
    elif len(starts) == len(runs) or len(runs) == 1:
        return runs
    apart = max(vehicle.axle_positions_m, default=0.0) + _APART_M
    end = max((run.start_position_m + _travelled(run) + apart for run in runs.values() if run.start_is_known), default=0.0)
    placed = {}
    for name, run in runs.items():
        placed[name] = run if run.start_is_known else dataclasses.replace(run, start_position_m=end)
        end += 0.0 if run.start_is_known else _travelled(run) + apart
    return placed


def _travelled(run: Recording) -> float:
    return float(np.trapezoid(np.maximum(run.vehicle_speed_mps, 0.0), run.time_s))


def _groups(path: Path, head: dict[str, object], described: dict[str, object]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    groups = []
    for key in ("tune", "validate"):
        names = head.get(key, [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise CampaignError(
                f'{path}: [campaign] {key} must be a list of run names such as ["A1", "A2"], got {shown(names)}'
            )
        for name in names:
            if name not in described:
                raise CampaignError(
                    f"{path}: run {shown(name)} is in [campaign] {key} but not described; add [runs.{name}] "
                    f"(described: {', '.join(described) or 'none'})"
                )
        groups.append(tuple(dict.fromkeys(names)))
    tune, validate = groups
    if not tune:
        raise CampaignError(f"{path}: [campaign] tune is empty: name at least one run to tune on")
    if both := sorted(set(tune) & set(validate)):
        raise CampaignError(f"{path}: {', '.join(both)} in both tune and validate: a run tuned on cannot validate")
    return tune, validate


def _vehicle(path: Path, table: dict[str, object]) -> CampaignVehicle:
    _required(path, "[vehicle]", table, _REQUIRED_VEHICLE_KEYS)
    changes = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items()}
    if type(changes["axles"]) is not int:
        raise ParameterError(f"[vehicle] axles must be a whole number, got {shown(changes['axles'])}")
    return replace(CampaignVehicle(), changes, "key in [vehicle]")


def _contact(path: Path, table: object) -> ContactParameters:
    if not isinstance(table, dict):
        raise CampaignError(f'{path}: [contact] must be a table such as set = "velim", got {shown(table)}')
    changes = dict(table)
    name = changes.pop("set", "velim")
    if not isinstance(name, str) or name not in CONTACT_SETS:
        raise CampaignError(f"{path}: [contact] set = {shown(name)} is unknown; valid: {', '.join(CONTACT_SETS)}")
    return replace(CONTACT_SETS[name], changes, "key in [contact]")


def _described(
    path: Path, name: str, entry: object, vehicle: CampaignVehicle, contact: ContactParameters
) -> tuple[Path, Recording]:
    """Return a run's file, and what campaign.toml says of it as a recording without samples."""
    where = f"[runs.{name}]"
    if not isinstance(entry, dict):
        raise CampaignError(f"{path}: {where} must be a table with at least file, got {shown(entry)}")
    _known(path, where, entry, _RUN_KEYS)
    _required(path, where, entry, ("file",))
    if not isinstance(entry["file"], str):
        raise CampaignError(f"{path}: {where} file must be the name of a file, got {shown(entry['file'])}")
    file = path.parent / entry["file"]
    if not is_file(file):
        raise CampaignError(f"{file} does not exist: {path} names it as the file of run {name}; correct `file` or add it")
    friction = _number(path, f"{where} kinetic_friction_d", entry.get("kinetic_friction_d", contact.kinetic_friction_d), 0.0)
    if friction >= contact.kinetic_friction_r:
        raise CampaignError(
            f"{path}: {where} kinetic_friction_d = {friction} is not below kinetic_friction_r = {contact.kinetic_friction_r}"
        )
    none = np.zeros(0)
    return file, Recording(
        name,
        time_s=none,
        vehicle_speed_mps=none,
        wheel_speed_radps=none,
        brake_torque_nm=none,
        start_position_m=_number(path, f"{where} start_position_m", entry.get("start_position_m", 0.0)),
        mass_kg=_number(path, f"{where} mass_kg", entry.get("mass_kg", vehicle.mass_kg), above=0.0),
        kinetic_friction_d=friction,
        gradient=_number(path, f"{where} gradient", entry.get("gradient", 0.0)),
        direction=str(entry.get("direction", "")),
        notes=str(entry.get("notes", "")),
        start_is_known="start_position_m" in entry,
        missing_axles=_missing(path, where, entry.get("missing_axles", []), vehicle),
    )


def _missing(path: Path, where: str, given: object, vehicle: CampaignVehicle) -> tuple[int, ...]:
    """Return the axles without sensors in a run: the vehicle's and its own."""
    try:
        check_missing(tuple(given) if isinstance(given, list) else given, vehicle.axles)
    except ParameterError as error:
        raise CampaignError(f"{path}: {where} {error}") from None
    return tuple(sorted({*vehicle.missing_axles, *given}))  # type: ignore[misc]  # checked above


def _table(path: Path, document: dict[str, object], key: str) -> dict[str, object]:
    table = document.get(key)
    if not isinstance(table, dict):
        raise CampaignError(f"{path} lacks the table [{key}]; a campaign needs [campaign], [vehicle] and [runs.NAME]")
    return table


def _known(path: Path, where: str, table: dict[str, object], valid: tuple[str, ...]) -> None:
    if unknown := sorted(set(table) - set(valid)):
        raise CampaignError(f"{path}: unknown key {', '.join(unknown)} in {where}; valid: {', '.join(valid)}")


def _required(path: Path, where: str, table: dict[str, object], keys: tuple[str, ...]) -> None:
    if missing := [key for key in keys if key not in table]:
        raise CampaignError(f"{path}: {where} lacks {', '.join(missing)}; add it")


def _number(path: Path, what: str, value: object, above: float = -np.inf) -> float:
    if not above < (found := number(value)) < np.inf:
        bound = "" if above == -np.inf else f" above {above:g}"
        raise CampaignError(f"{path}: {what} must be a finite number{bound}, got {shown(value)}")
    return found


def is_file(path: Path) -> bool:
    """Whether there is such a file; False too for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
