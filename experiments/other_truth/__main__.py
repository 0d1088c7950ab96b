"""Command: `python -m experiments.other_truth make | calibrate | tables`."""

import dataclasses
import json
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from experiments.other_truth.campaign import draw
from experiments.other_truth.effects import EFFECTS, plan
from experiments.other_truth.labels import label
from experiments.other_truth.record import draw_recorders, write
from experiments.other_truth.records import Sizes
from experiments.other_truth.sizes import Concealed, conceal
from experiments.other_truth.sound import MOST_LENGTH, MOST_SLIP_MPS, SOUND

ATTEMPTS = 5  # vehicles that are tried until an effect moves the stops as it should
SEEDS = 1000  # between the campaigns of one seed and of the next
AGAIN = 500  # between a campaign's first vehicle and the next


def make_campaign(seed: int, index: int, kind: str, names: list[str], folder: Path) -> dict[str, Any]:
    """Make the campaign with an index into a new folder, with its label, which is returned."""
    folder.mkdir(parents=True)
    for attempt in range(ATTEMPTS):
        campaign = draw(seed * SEEDS + index + AGAIN * attempt)
        plain = [campaign.stop(i, Sizes()) for i in range(len(campaign.runs))] if names else []
        concealed: list[Concealed] = [conceal(campaign, name, plain) for name in names]
        if all(one.in_range for one in concealed):
            break
    recorders = draw_recorders(campaign, names)
    sizes = Sizes()._replace(**{one.effect: one.size for one in concealed})
    content = label(campaign, kind, concealed, recorders, write(campaign, sizes, recorders, folder))
    (folder / "label.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return content


@dataclasses.dataclass(frozen=True)
class Make:
    """Make campaigns, each in a folder of its own with campaign.toml and label.json."""

    out: tyro.conf.Positional[Path]  # folder of the campaigns i000, i001, ...
    seed: int  # of all of them
    campaigns: int = 40  # how many
    only: tuple[int, ...] = ()  # numbers of those to make; all where left out

    def run(self) -> None:
        """Run."""
        for index, (kind, names) in enumerate(plan(self.seed, self.campaigns)):
            if self.only and index not in self.only:
                continue
            content = make_campaign(self.seed, index, kind, names, self.out / f"i{index:03d}")
            found = [f"{one['effect']} {one['size']:.6g} ({one['reached']:.2f})" for one in content["details"]]
            print(f"i{index:03d}", kind, *found, flush=True)


@dataclasses.dataclass(frozen=True)
class Calibrate:
    """Print how far all sound variation together moves the stops."""

    seed: int  # of the campaigns
    campaigns: int = 20  # how many are drawn

    def run(self) -> None:
        """Run."""
        drawn = (draw(self.seed * SEEDS + index) for index in range(self.campaigns))
        moved = np.array([campaign.spread(i) for campaign in drawn for i in range(len(campaign.runs))])
        print(f"{len(moved)} stops of {self.campaigns} campaigns")
        for name, values in (("length [%]", 100.0 * moved[:, 0]), ("slip [m/s]", moved[:, 1])):
            print(f"{name}: median {np.median(values):.4f}, 95 % {np.quantile(values, 0.95):.4f}, largest {values.max():.4f}")
        print(f"within both limits: {100.0 * np.mean((moved < (MOST_LENGTH, MOST_SLIP_MPS)).all(axis=1)):.1f} %")


@dataclasses.dataclass(frozen=True)
class Tables:
    """Print the tables of the documentation."""

    def run(self) -> None:
        """Run."""
        print(tables())


def tables() -> str:
    """Return the tables of effects and of sound variation."""
    effects = ["| effect | slot | size at most | unit |", "|---|---|---|---|"]
    for name, one in EFFECTS.items():
        sign = "±" if len(one.signs) > 1 else ""
        effects.append(f"| `{name}`{'' if one.library else ' *'} | {one.slot} | {sign}{one.cap:g} | {one.unit} |")
    sound = ["| kind | size | of | acts on the |", "|---|---|---|---|"]
    sound += [f"| {name} | {kind.size:g} | {kind.of} | {kind.acts_on} |" for name, kind in SOUND.items()]
    return "\n".join([*effects, "", *sound])


_Command = (
    Annotated[Make, tyro.conf.subcommand("make")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Tables, tyro.conf.subcommand("tables")]
)


def main() -> int:
    """Run the command line; 1 after an error that the user can repair."""
    try:
        tyro.cli(_Command, prog="python -m experiments.other_truth", description=__doc__).run()
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
