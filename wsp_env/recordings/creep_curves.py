"""Creep curves: adhesion measured over creepage, the second kind of recording that a diagnosis reads.

A folder with `campaign.toml` and one table per curve:

- `[campaign]` name, kind = "creep_curve"
- `[contact]` fields of `CreepContact`: wheel_load_n and wheel_radius_m, and what is believed of contact and friction
- `[curves.NAME]` file, speed_mps; optionally notes

Columns of a file: `creepage` and `adhesion_coefficient`, both [-] and positive; others are ignored.
"""

import dataclasses
from importlib.resources import files
from pathlib import Path

import numpy as np

from wsp_env.contact.hertz import hertz
from wsp_env.contact.kalker import Patch, kalker_coefficients
from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.document import DocumentError, read_toml
from wsp_env.parameters.quantity import Checked, number, quantity, replace, shown
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.readers import open_file

KIND = "creep_curve"
#: Fewer points than this in all curves are refused: a curve of three to five parameters and its scatter need more (assumption).
LEAST_POINTS = 20
_COLUMNS = ("creepage", "adhesion_coefficient")
_TABLE_2 = "seed paper, Table 2"


@dataclasses.dataclass(frozen=True)
class CreepContact(Checked):
    """What is known of the wheel and believed of its contact."""

    wheel_load_n: float = quantity(53e3, "N", "of the test; default: a quarter of a coach's bogie", 0.0, 1e6, open_low=True)
    wheel_radius_m: float = quantity(0.445, "m", "of the test; default: the seed paper's coach", 0.0, 2.0, open_low=True)
    lateral_curvature_per_m: float = quantity(
        1.0 / 0.6,
        "1/m",
        "sum B: conical wheel, rail head of 0.3 m radius (EN 13674-1, 60E1)",
        0.0,
        100.0,
        open_low=True,
    )
    shear_modulus_pa: float = quantity(8.0e10, "Pa", _TABLE_2, 0.0, 1e12, open_low=True)
    poisson_ratio: float = quantity(0.28, "-", "steel", 0.0, 0.5)
    friction_ratio: float = quantity(1.0, "-", "kinetic over static friction A; 1: constant friction", 0.0, 1.0, open_low=True)
    friction_decrease_spm: float = quantity(
        ContactParameters.friction_decrease_r_spm, "s/m", _TABLE_2 + ", clean rail", 0.0, 10.0, open_low=True
    )

    def patch(self) -> Patch:
        """Return the contact by Hertz and Kalker's table; `ValueError` where the ellipse is too slender for it."""
        youngs = 2.0 * self.shear_modulus_pa * (1.0 + self.poisson_ratio)
        rolling = 0.5 / self.wheel_radius_m
        ellipse = hertz(rolling, self.lateral_curvature_per_m, self.wheel_load_n, youngs, self.poisson_ratio)
        a, b = float(ellipse.semi_axis_a_m), float(ellipse.semi_axis_b_m)
        return Patch(a, b, self.shear_modulus_pa, *map(float, kalker_coefficients(a / b, self.poisson_ratio)))


@dataclasses.dataclass(frozen=True)
class CreepCurve:
    """The points of one curve, n of them, by rising creepage."""

    speed_mps: float  # [m/s]
    creepage: np.ndarray  # (n,) [-]
    adhesion: np.ndarray  # (n,) [-]


@dataclasses.dataclass(frozen=True)
class CreepCurves:
    """Creep curves of one wheel."""

    name: str
    contact: CreepContact
    curves: dict[str, CreepCurve]


def eurosprinter_curve() -> Path:
    """Return the folder of the measured Eurosprinter points that travel with the package; see wsp_env/data/README.md."""
    return Path(str(files("wsp_env") / "data" / "eurosprinter"))


def holds_creep_curves(folder: Path) -> bool:
    """Whether a folder's campaign.toml says that it holds creep curves; False for one that is missing or damaged too."""
    try:
        document = read_toml(Path(folder) / "campaign.toml")
    except DocumentError:
        return False
    head = document.get("campaign")
    return isinstance(head, dict) and head.get("kind") == KIND


def read_creep_curves(folder: Path) -> CreepCurves:
    """Read and check a folder of creep curves.

    Raises
    ------
    CampaignError
        naming file, key, column or point, and how to repair it

    """
    path = Path(folder) / "campaign.toml"
    try:
        document = read_toml(path)
    except DocumentError as error:
        raise CampaignError(f"{path} {error}") from None
    _keys(path, "the top level", document, ("campaign", "contact", "curves"), ())
    head = _keys(path, "[campaign]", document["campaign"], ("name", "kind"), ())
    if head["kind"] != KIND:
        raise CampaignError(
            f'{path}: [campaign] kind = {shown(head["kind"])} is unknown; valid: "{KIND}", or no kind for stops'
        )
    if not isinstance(document["contact"], dict) or {"wheel_load_n", "wheel_radius_m"} - set(document["contact"]):
        raise CampaignError(f"{path}: [contact] needs wheel_load_n [N] and wheel_radius_m [m]; add them")
    try:
        contact = replace(CreepContact(), document["contact"], "key in [contact]")
        contact.patch()
    except ValueError as error:  # ParameterError is one
        raise CampaignError(f"{path}: {error}") from None
    if not isinstance(document["curves"], dict) or not document["curves"]:
        raise CampaignError(f"{path}: [curves] is empty; describe each curve as [curves.NAME] with file and speed_mps")
    curves = {name: _curve(path, name, entry) for name, entry in document["curves"].items()}
    points = sum(len(one.creepage) for one in curves.values())
    if points < LEAST_POINTS:
        raise CampaignError(f"{path}: the curves have {points} points together, a diagnosis needs at least {LEAST_POINTS}")
    return CreepCurves(str(head["name"]), contact, curves)


def _curve(path: Path, name: str, entry: object) -> CreepCurve:
    where = f"[curves.{name}]"
    table = _keys(path, where, entry, ("file", "speed_mps"), ("notes",))
    speed, file = table["speed_mps"], path.parent / str(table["file"])
    if not number(speed) > 0.0:
        raise CampaignError(f"{path}: {where} speed_mps must be a finite number above 0, got {shown(speed)}")
    opened = open_file(file)
    opened.require(list(_COLUMNS))
    read = opened.read(list(_COLUMNS))
    creepage, adhesion = (np.asarray(read[column].values, dtype=np.float64) for column in _COLUMNS)
    for column, values, highest in zip(_COLUMNS, (creepage, adhesion), (1.0, np.inf), strict=True):
        wrong = ~(np.isfinite(values) & (values > 0.0) & (values <= highest))
        if wrong.any():
            first = int(np.argmax(wrong))
            bound = " and at most 1" if highest == 1.0 else ""
            raise CampaignError(
                f"{file}: point {first + 1} has {column} = {values[first]:g}; it must be a number above 0{bound} "
                "(a curve in traction: both columns with their sign turned)"
            )
    order = np.argsort(creepage, kind="stable")
    return CreepCurve(number(speed), creepage[order], adhesion[order])


def _keys(path: Path, where: str, table: object, required: tuple[str, ...], optional: tuple[str, ...]) -> dict[str, object]:
    if not isinstance(table, dict):
        raise CampaignError(f"{path}: {where} must be a table, got {shown(table)}")
    if missing := [key for key in required if key not in table]:
        raise CampaignError(f"{path}: {where} lacks {', '.join(missing)}; add it")
    if unknown := sorted(set(table) - {*required, *optional}):
        raise CampaignError(f"{path}: unknown key {', '.join(unknown)} in {where}; valid: {', '.join((*required, *optional))}")
    return table
