"""Six stops as a logger of somebody else writes them: UTF-16, semicolons, decimal commas, a preamble, names of its own."""

from pathlib import Path

import numpy as np
from synthetic_stops import AXLES, RADIUS_M, stops

TAU = 2.2e-4

#: Of the six, the one column that no rule can know: the vehicle's speed, in km/h.
NAMELESS = "Kanal 07 links"


def write_six(folder: Path, duration_s: float = 12.0, rate: int = 1) -> list[Path]:
    """Write six stops on rails of different friction; `rate`: one sample of so many is kept."""
    frictions = [0.045, 0.05, 0.055, 0.06, 0.065, 0.07]
    kept = stops(TAU, frictions, duration_s=duration_s, noise=1.0, seeds=range(6))
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for number, columns in enumerate(kept):
        table = {"Zeit [ms]": 1000.0 * columns["time_s"], NAMELESS: 3.6 * columns["vehicle_speed_mps"]}
        for k in range(1, AXLES + 1):
            table[f"V_Rad_{k} [km/h]"] = 3.6 * RADIUS_M * columns[f"axle{k}_wheel_speed_radps"]
            table[f"M_Brems_{k} [kNm]"] = columns[f"axle{k}_brake_torque_nm"] / 1e3
        table["T_Luft [degC]"] = 8.0 + 0.01 * columns["time_s"]
        rows = np.stack(list(table.values()), axis=1)[::rate]
        lines = [f"Messfahrt {number + 1}", ";".join(table)]
        lines += [";".join(f"{value:.5f}".replace(".", ",") for value in row) for row in rows]
        files.append(folder / f"Fahrt {number + 1:02d}.csv")
        files[-1].write_text("\r\n".join(lines) + "\r\n", encoding="utf-16")
    return files
