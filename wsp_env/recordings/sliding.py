"""How much the wheels slide in a recorded file, before anybody knows its units or its vehicle."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wsp_env.recordings.inspection import InspectedChannel
from wsp_env.recordings.readers import open_file

_MOVING = 0.2  # of the highest speed [-]: below that a sensor's resolution counts for slip
_ROLLING = 95.0  # percentile of wheel over vehicle at which it rolls: in every stop it does for a while


def slid(file: Path, channels: Sequence[InspectedChannel]) -> float:
    """Return the mean share [-] of its speed that the wheel which slides most lacks; 0 where that cannot be told.

    Wheel over vehicle is compared with what it is while the wheel rolls, so that units and radius do not matter.
    """
    guessed = {channel.guess: channel.name for channel in channels if channel.guess}
    wheels = [name for guess, name in guessed.items() if guess.endswith("_wheel_speed")]
    if "vehicle_speed" not in guessed or not wheels:
        return 0.0
    read = open_file(file).read([guessed["vehicle_speed"], *wheels])
    vehicle = read[guessed["vehicle_speed"]]
    most = 0.0
    for name in wheels:
        wheel = read[name]
        values = wheel.values
        if wheel.time_s is not None and vehicle.time_s is not None and len(values) > 1:
            values = np.interp(vehicle.time_s, wheel.time_s, values)
        if len(values) != len(vehicle.values):
            continue
        both = np.isfinite(values) & np.isfinite(vehicle.values)
        speed, values = vehicle.values[both], values[both]
        moving = speed > _MOVING * np.max(speed, initial=0.0)
        ratio = values[moving] / speed[moving]
        rolling = float(np.percentile(ratio, _ROLLING)) if len(ratio) else 0.0
        if np.isfinite(rolling) and rolling > 0.0:
            most = max(most, float(np.mean(np.clip(1.0 - ratio / rolling, 0.0, 1.0))))
    return most
