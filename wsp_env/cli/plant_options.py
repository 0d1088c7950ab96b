"""What computes the vehicle's motion, and physics beside the paper's: options that several commands share."""

import dataclasses
import json
from typing import Annotated, Any

import tyro

from wsp_env.evaluation.runner import Conduct
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.track_geometry import find_track_geometry
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import make_plant
from wsp_env.plant.port import Setup


@dataclasses.dataclass(frozen=True)
class PlantOptions:
    """What computes the vehicle's motion.

    Parameters
    ----------
    plant
        longitudinal, multibody, or a class of your own, which is run as Python (PYTHONPATH=. finds one in this folder).
    track_geometry
        File with curves, irregularities and rails for plant multibody, see docs/multibody.md; none: straight and smooth.

    """

    plant: Annotated[str, tyro.conf.arg(metavar="NAME|PACKAGE.MODULE:CLASS")] = "longitudinal"
    track_geometry: Annotated[str, tyro.conf.arg(metavar="FILE")] = ""

    def conduct(self, **more: Any) -> Conduct:
        """Return how stops are run; `more` are other fields of `Conduct`."""
        track = find_track_geometry(self.track_geometry) if self.track_geometry else None
        return Conduct(plant=self.plant, track_geometry=track, **more)

    def check(self, vehicle: Vehicle) -> None:
        """Refuse a plant, a track or mechanisms that cannot be had before anything is computed."""
        conduct = self.conduct()
        setup = Setup(track_geometry=conduct.track_geometry, mechanisms=conduct.mechanisms)
        make_plant(vehicle, setup=setup, name=self.plant)


@dataclasses.dataclass(frozen=True)
class PhysicsOptions(PlantOptions):
    """What computes the vehicle's motion, and physics beyond the paper's.

    Parameters
    ----------
    mechanisms
        As JSON: {"leading_axle_cleaning": {"removal_m_per_j": 1e-4}}; {"load_transfer": {}} for typical values.
    cap_recovery
        The recovery grows no further beyond the creepages at which the law was fitted: law "capped", locked wheels stay so.

    """

    mechanisms: Annotated[str, tyro.conf.arg(metavar="JSON")] = "{}"
    cap_recovery: bool = False

    def conduct(self, **more: Any) -> Conduct:
        """Return how stops are run, see `PlantOptions.conduct`; `ParameterError` for mechanisms that are no JSON."""
        try:
            found = json.loads(self.mechanisms)
        except ValueError as error:
            raise ParameterError(f"--mechanisms {self.mechanisms!r} is no JSON: {error}") from None
        if not isinstance(found, dict):
            raise ParameterError(f'--mechanisms {self.mechanisms!r} must be as {{"load_transfer": {{}}}}')
        return super().conduct(mechanisms=found, **more)

    def on(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle with the law that is asked for."""
        if not self.cap_recovery:
            return vehicle
        if vehicle.contact.traction_law not in ("degraded", "capped"):
            raise ParameterError(f"--cap-recovery caps the law degraded, not the vehicle's {vehicle.contact.traction_law}")
        return dataclasses.replace(vehicle, contact=dataclasses.replace(vehicle.contact, traction_law="capped"))
