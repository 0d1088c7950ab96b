"""How far a policy stays behind the teacher that knows all: `python -m agents.taught --vehicle bogie`.

Held-out stops with nominal brakes. The teacher brakes them with the real valves at several prices of sliding. The policy's
distance is put over that of the teacher's front at the policy's own mean slip, and what it pays (metres travelled and priced
metres slid) over what the teacher of that price pays, with standard errors over the stops.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.drawn import KEPT, RESAMPLED
from agents.measure import HELD_OUT, Yardstick
from agents.rivals import at_slip
from agents.teacher import taught
from wsp_env.evaluation.policy import load_policy

#: What is kept of every stop.
_KEPT = (*KEPT, "duration_s")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is compared."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    policy: Path = Path()  # folder; none: agents/trained/VEHICLE
    prices: tuple[float, ...] = (0.5, 1.0, 1.5, 2.0, 3.0, 4.3, 6.0)  # of sliding, of the teacher
    price: float = 4.3  # one of these, at which what is paid is compared: that of the bogie's and the coach's training
    stops: int = 48  # under each law
    drawn_by: int = HELD_OUT  # their seed


def paid(found: Mapping[str, np.ndarray], price: float) -> np.ndarray:
    """Return metres travelled and priced metres slid (N,) [m]."""
    return found["distance_m"] + price * found["mean_slip_mps"] * found["duration_s"]


def over_front(own: Mapping[str, np.ndarray], front: Sequence[Mapping[str, np.ndarray]], chosen: np.ndarray) -> float:
    """Return the mean distance of the chosen stops over that of the front at the same mean slip."""
    mine, *others = ({name: float(np.mean(one[name][chosen])) for name in KEPT} for one in (own, *front))
    return mine["distance_m"] / at_slip(others, mine["mean_slip_mps"])["distance_m"]


def compare(arguments: Arguments) -> list[dict[str, Any]]:
    """Return a row for each law."""
    folder = arguments.policy if arguments.policy != Path() else Path("agents/trained") / arguments.vehicle
    policy, rows = load_policy(folder), list[dict[str, Any]]()
    for law in ("recovering", "classic"):
        yardstick = Yardstick.drawn(arguments.vehicle, law, arguments.stops, arguments.drawn_by)
        own = yardstick.figures(policy)
        front = {
            price: yardstick.judged(taught(yardstick.vehicle, yardstick.stops, price, yardstick.conduct))
            for price in (*arguments.prices, arguments.price)
        }
        slips = [float(np.mean(one["mean_slip_mps"])) for one in front.values()]
        rng, every = np.random.default_rng(0), np.arange(arguments.stops)
        drawn = [rng.choice(every, len(every)) for _ in range(RESAMPLED)]
        pays = paid(own, arguments.price), paid(front[arguments.price], arguments.price)
        row: dict[str, Any] = {"law": law, "distance_m": float(np.mean(own["distance_m"]))}
        row |= {"slip_mps": float(np.mean(own["mean_slip_mps"])), "slips": (min(slips), max(slips))}
        row["over"] = over_front(own, list(front.values()), every)
        row["error"] = np.std([over_front(own, list(front.values()), chosen) for chosen in drawn], ddof=1)
        row["paid"] = pays[0].mean() / pays[1].mean()
        row["paid_error"] = np.std([pays[0][chosen].mean() / pays[1][chosen].mean() for chosen in drawn], ddof=1)
        rows.append(row | {"locked_s": float(own["locked_s"].max())})
    return rows


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| law | distance [m] | slip [m/s] | the teacher's slips [m/s] | / teacher, same slip | paid / teacher | locked [s] |",
        "|:--|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        cells = [row["law"], f"{row['distance_m']:.0f}", f"{row['slip_mps']:.2f}", "{:.2f} to {:.2f}".format(*row["slips"])]
        cells += [f"{row['over']:.3f} ± {row['error']:.3f}", f"{row['paid']:.3f} ± {row['paid_error']:.3f}"]
        lines.append("| " + " | ".join([*cells, f"{row['locked_s']:.2f}"]) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(compare(tyro.cli(Arguments))))
