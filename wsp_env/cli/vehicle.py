"""`wsp vehicle`: what a vehicle file says, a file to start from, the vehicles that have names."""

import dataclasses
import json
import math
import sys
from typing import Annotated, Any

import tyro

from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.vehicle_figures import VehicleFigure, figures, remarks
from wsp_env.parameters.vehicle_file import find_vehicle, left_out, write_vehicle

_Named = Annotated[str, tyro.conf.arg(metavar="NAME|FILE")]
_Json = Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff]


@dataclasses.dataclass(frozen=True)
class Check:
    """Check a vehicle file and say what it is: axles, loads, decelerations, braked weight, times of the brake.

    Exit status 0 for a vehicle that can brake, 2 with one line for every fault: key, what is wrong, what would be right.
    """

    vehicle: tyro.conf.Positional[_Named]
    """The file, or a name (wsp vehicle list)."""
    as_json: _Json = False
    """Print JSON."""

    def run(self) -> None:
        """Print what the vehicle is."""
        vehicle = find_vehicle(self.vehicle)
        defaults = () if self.vehicle in VEHICLES else left_out(self.vehicle)
        if self.as_json:
            print(json.dumps(_plain(vehicle, defaults), indent=2))
            return
        print(f"{vehicle.name}: {_axles(vehicle)}")
        found = figures(vehicle)
        width = max(len(figure.name) for figure in found)
        print("\n".join(f"  {figure.name:{width}}  {_number(figure):>9} {figure.unit}" for figure in found))
        print("Braked weights: second-hand formula for a stop from 120 km/h, see the documentation; they certify nothing.")
        if defaults:
            print(f"Left out, so as the coach's: {', '.join(defaults)}")
        for sentence in remarks(vehicle):
            print(f"Note: {sentence}")


@dataclasses.dataclass(frozen=True)
class Show:
    """Print a vehicle as a file, unit and source behind each value: wsp vehicle show coach > mine.toml is where to start."""

    vehicle: tyro.conf.Positional[_Named]
    """A name (wsp vehicle list) or a file, which is then printed whole."""
    as_json: _Json = False
    """Print the values as JSON, as gym.make(..., vehicle={...}) takes them."""

    def run(self) -> None:
        """Print the file."""
        vehicle = find_vehicle(self.vehicle)
        sys.stdout.write(json.dumps(dataclasses.asdict(vehicle), indent=2) + "\n" if self.as_json else write_vehicle(vehicle))


@dataclasses.dataclass(frozen=True)
class List:
    """List the vehicles that have names."""

    as_json: _Json = False
    """Print JSON."""

    def run(self) -> None:
        """Print a line for each."""
        if self.as_json:
            print(json.dumps([_plain(vehicle, ()) for vehicle in VEHICLES.values()], indent=2))
            return
        width = max(map(len, VEHICLES))
        for name, vehicle in VEHICLES.items():
            print(f"{name:{width}}  {vehicle.mass_kg / 1000.0:6.1f} t  {_axles(vehicle)}")


@tyro.conf.configure(tyro.conf.OmitArgPrefixes)
def main(
    action: Annotated[Check, tyro.conf.subcommand("check", prefix_name=False)]
    | Annotated[Show, tyro.conf.subcommand("show", prefix_name=False)]
    | Annotated[List, tyro.conf.subcommand("list", prefix_name=False)],
) -> None:
    """Describe vehicles as data.

    A vehicle is a TOML file; evaluate, compare, inspect, diagnose and replay take it as --vehicle FILE, environments as
    gym.make("wsp_env/Coach-v1", vehicle="mine.toml").

      wsp vehicle show coach > mine.toml    a file to start from, with unit and source behind each value
      wsp vehicle check mine.toml           what it is, or what is wrong with it
      wsp evaluate --vehicle mine.toml      put controllers through the test programme on it
    """
    action.run()


def _axles(vehicle: Vehicle) -> str:
    """Return number and order of the axles in the usual notation: 2'2' is a body on two bogies of two axles."""
    bodies = ["".join(f"{axles}'" for axles in body) for body in vehicle.running_gear]
    same = f"{len(bodies)} x {bodies[0]}" if len(bodies) > 1 and len(set(bodies)) == 1 else " + ".join(bodies)
    counted = "1 axle" if vehicle.axles == 1 else f"{vehicle.axles} axles"
    return f"{counted} ({same}) over {vehicle.axle_positions_m[-1]:.2f} m"


def _number(figure: VehicleFigure) -> str:
    return f"{figure.value:.{figure.digits}f}" if abs(figure.value) < 1e7 else f"{figure.value:.3g}"


def _plain(vehicle: Vehicle, defaults: tuple[str, ...]) -> dict[str, Any]:
    found = figures(vehicle)
    return {
        "name": vehicle.name,
        "axles": vehicle.axles,
        "bodies": vehicle.running_gear,
        "figures": [
            {"name": one.name, "value": one.value if math.isfinite(one.value) else None, "unit": one.unit} for one in found
        ],
        "left_out": defaults,
        "notes": remarks(vehicle),
    }
