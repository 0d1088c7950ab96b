"""What computes the vehicle's motion: options that `wsp evaluate`, `wsp compare` and `wsp replay` share."""

import dataclasses
from typing import Annotated, Any

import tyro

from wsp_env.evaluation.runner import Conduct
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
        """Refuse a plant or a track that cannot be had before anything is computed."""
        make_plant(vehicle, setup=Setup(track_geometry=self.conduct().track_geometry), name=self.plant)
