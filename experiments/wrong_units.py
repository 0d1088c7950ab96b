"""Wrong units in otherwise sound campaigns: how many are noticed before any number is believed, kind by kind.

`python experiments/wrong_units.py --each 20 --log out/units.jsonl`. A campaign of two stops, drawn anew each time, has one
quantity in another unit than its `campaign.toml` says: on all axles, or on one. Noticed is an error or a warning of the reader,
or a suspect channel as `wsp tune` reports it. What the log holds is not done again.
"""

import argparse
import importlib
import json
import random
import sys
import tempfile
import warnings
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from wsp_env.recordings import CampaignError, CampaignWarning, read_campaign
from wsp_env.recordings.suspect import warn_of_suspects

#: Unit that stands in the file in place of the native one -> end of the column's name, factor.
WRONG = {
    "time in ms": ("time_s", 1e3),
    "time in us": ("time_s", 1e6),
    "time in min": ("time_s", 1.0 / 60.0),
    "speed in km/h": ("vehicle_speed_mps", 3.6),
    "speed in mph": ("vehicle_speed_mps", 2.2369),
    "speed in mm/s": ("vehicle_speed_mps", 1e3),
    "wheel in rpm": ("wheel_speed_radps", 9.5493),
    "wheel in Hz": ("wheel_speed_radps", 1.0 / 6.2832),
    "wheel in deg/s": ("wheel_speed_radps", 57.2958),
    "wheel at its rim in m/s": ("wheel_speed_radps", 0.445),
    "torque in kN m": ("brake_torque_nm", 1e-3),
    "torque in lbf ft": ("brake_torque_nm", 0.7376),
    "torque in kgf m": ("brake_torque_nm", 0.10197),
    "torque per wheel": ("brake_torque_nm", 0.5),
    "torque of the wrong sign": ("brake_torque_nm", -1.0),
}
SOUND = "nothing wrong"


def tried(kind: str, axle: int | None, seed: int) -> bool:
    """Return whether a wrong unit is noticed; `axle` from 1, None: all."""
    made, generator = _stops(), random.Random(seed)
    speed, peak = generator.uniform(20.0, 42.0), generator.uniform(0.1, 0.3)
    frictions = [generator.uniform(0.045, 0.07) for _ in range(2)]
    drawn = made.stops(
        generator.uniform(1.5e-4, 3e-4), frictions, speed, 10.0, peak, generator.uniform(0.7, 1.6), [seed, seed + 1], 0.02
    )
    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", CampaignWarning)
        runs = {f"A{k + 1}": _wrong(columns, kind, axle) for k, columns in enumerate(drawn)}
        folder = made.write_campaign(Path(place), runs)
        try:
            warn_of_suspects(read_campaign(folder))
        except CampaignError:
            return True
    return any(issubclass(one.category, CampaignWarning) for one in said)


def _wrong(columns: Mapping[str, np.ndarray], kind: str, axle: int | None) -> dict[str, np.ndarray]:
    end, factor = WRONG.get(kind, ("", 1.0))
    ends = f"axle{axle}_{end}" if axle else end
    return {name: factor * values if kind in WRONG and name.endswith(ends) else values for name, values in columns.items()}


def _stops() -> ModuleType:
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    return importlib.import_module("synthetic_stops")


def main(arguments: Sequence[str] | None = None) -> int:
    """Try every kind so many times; print the share that is noticed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=20)
    parser.add_argument("--log", type=Path, default=Path("out/units.jsonl"))
    given = parser.parse_args(arguments)
    given.log.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in given.log.read_text(encoding="utf-8").splitlines()] if given.log.exists() else []
    noticed = {(one["kind"], one["axle"], one["seed"]): one["noticed"] for one in done}
    cases: list[tuple[str, int | None]] = [(SOUND, None), *((kind, None) for kind in WRONG)]
    cases += [(kind, 2) for kind, (end, _) in WRONG.items() if end.startswith(("wheel", "brake"))]
    for seed in range(given.each):
        for kind, axle in cases:
            if (kind, axle, seed) not in noticed:
                noticed[kind, axle, seed] = tried(kind, axle, seed)
                with given.log.open("a", encoding="utf-8") as stream:
                    one = {"kind": kind, "axle": axle, "seed": seed, "noticed": noticed[kind, axle, seed]}
                    stream.write(json.dumps(one) + "\n")
    table: defaultdict[tuple[str, int | None], list[bool]] = defaultdict(list)
    for (kind, axle, _), seen in noticed.items():
        table[kind, axle].append(seen)
    for (kind, axle), all_seen in table.items():
        print(f"{kind:26} {'one axle' if axle else 'all':9} {sum(all_seen):4} of {len(all_seen)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
