"""`wsp export`: laws, controllers, policies and the plant as C99 or as FMUs, and a template for one's own WSP."""

import dataclasses
from pathlib import Path
from typing import Annotated

import tyro

from wsp_env.cli.out import OutFile, OutFolder
from wsp_env.export.fmu import write_fmu
from wsp_env.export.make import make_unit, write_c, write_template
from wsp_env.export.plant import PlantOptions
from wsp_env.export.single import single
from wsp_env.export.unit import Unit
from wsp_env.parameters.vehicle_file import find_vehicle

_What = Annotated[str, tyro.conf.arg(metavar="law|plant|rule-based|POLICY")]
_Named = Annotated[str, tyro.conf.arg(metavar="NAME|FILE")]


@dataclasses.dataclass(frozen=True)
class C:
    """Write C99: source, header, CMakeLists.txt, test vectors and a program that runs them."""

    what: tyro.conf.Positional[_What]
    """A contact law, the longitudinal plant, a controller by rules, or a policy's folder."""
    vehicle: _Named = "coach"
    """A name (wsp vehicle list) or a vehicle file; a policy knows its own."""
    law: str = ""
    """Of `law`: one of degraded, capped, classic, polach, kalker, fastsim; empty: the vehicle's."""
    mechanisms: tuple[str, ...] = ()
    """Of `plant`: mechanisms that act in it, with their typical values."""
    plant: Annotated[PlantOptions, tyro.conf.arg(name="")] = dataclasses.field(default_factory=PlantOptions)
    """How the plant is run."""
    single: tyro.conf.FlagCreatePairsOff[bool] = False
    """Floats in place of doubles."""
    out: OutFolder = Path("out/export")
    """Folder of the files."""

    def unit(self) -> Unit:
        """Return what is written."""
        made = make_unit(self.what, find_vehicle(self.vehicle), self.plant, self.mechanisms, self.law)
        return single(made) if self.single else made

    def run(self) -> None:
        """Write the files."""
        unit = self.unit()
        names = write_c(unit, self.out)
        print(f"{unit.title}\n{self.out}/: {', '.join(names)}")
        print(f"\ncd {self.out} && cmake -S . -B build && cmake --build build && ctest --test-dir build")


@dataclasses.dataclass(frozen=True)
class Fmu(C):
    """Write an FMU for co-simulation, FMI 2.0 or 3.0, with its source and a binary for this machine."""

    out: OutFile = Path("out/wsp.fmu")
    """The file."""
    fmi: int = 2
    """Version, 2 or 3."""
    platforms: tuple[str, ...] = ()
    """Further binaries: linux64, linux-aarch64, win64, darwin64, darwin-aarch64 (need pip install ziglang)."""

    def run(self) -> None:
        """Write the file."""
        unit = self.unit()
        built = write_fmu(unit, self.out, self.fmi, self.platforms)
        print(f"{unit.title}\n{self.out}: FMI {self.fmi}.0, source, {', '.join(built) or 'no binary (no C compiler here)'}")


@dataclasses.dataclass(frozen=True)
class Template:
    """Write the header and a template of a WSP of one's own in C."""

    out: OutFolder = Path("my_wsp")
    """Folder of the files."""

    def run(self) -> None:
        """Write the files."""
        names = write_template(self.out)
        print(f"{self.out}/: {', '.join(names)}\n")
        print(f"cd {self.out} && gcc -std=c99 -O2 -shared -fPIC -o my_wsp.so my_wsp.c")
        print(f"wsp evaluate --controllers rule-based {self.out}/my_wsp.so --draws 1")


@tyro.conf.configure(tyro.conf.OmitArgPrefixes)
def main(
    action: Annotated[C, tyro.conf.subcommand("c", prefix_name=False)]
    | Annotated[Fmu, tyro.conf.subcommand("fmu", prefix_name=False)]
    | Annotated[Template, tyro.conf.subcommand("template", prefix_name=False)],
) -> None:
    """Write laws, controllers, policies and the plant for other tools.

    What is written needs no Python, and comes with a test; adaptive and slip are exported as rule-based is.

      wsp export c law --out law                       a contact law with its derivatives
      wsp export c rule-based --out rules              a controller, also as a library for wsp evaluate
      wsp export c agents/trained/coach --out policy   a trained policy
      wsp export c plant --vehicle mine.toml --out plant
      wsp export fmu plant --fmi 3 --out plant.fmu     an FMU
      wsp export template --out my_wsp                 a WSP of one's own in C
    """
    action.run()
