"""How far the exported C is from the Python that it is made from, over many states: `python -m experiments.exported_bits`.

Every unit is built with sanitizers and gets so many times its test vectors that there are at least 100,000 steps.
Its runner says how far C and Python are apart; with `--single` floats are compared with the Python's doubles.
"""

import math
import re
import subprocess
import tempfile
from pathlib import Path

import tyro

from experiments.exported import compiler
from wsp_env.contact.port import LAWS
from wsp_env.export.files import FLAGS, vectors, write_unit
from wsp_env.export.law import law_unit
from wsp_env.export.make import make_unit
from wsp_env.export.single import single as in_single
from wsp_env.export.unit import Unit
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.velim import CONTACT

_TRAINED = Path(__file__).parents[1] / "agents" / "trained" / "bogie"

#: What stops at the first error of memory or undefined behaviour.
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def named(what: str) -> Unit:
    """Return a unit: the name of a law, or what `wsp export c` takes, for a bogie."""
    if what in LAWS:
        return law_unit(LAWS[what].make(CONTACT))
    return make_unit(str(_TRAINED) if what == "policy" else what, VEHICLES["bogie"])


def compare(unit: Unit, times: int, folder: Path) -> str:
    """Run so many times a unit's vectors; return what its runner says."""
    write_unit(unit, folder)
    subprocess.run(
        [str(compiler()), *FLAGS, *SANITIZERS, "-o", "runner", f"{unit.name}.c", "runner.c", "-lm"], cwd=folder, check=True
    )
    with subprocess.Popen(
        [folder / "runner", "/dev/stdin"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="ascii"
    ) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        for line in vectors(unit, times):
            running.stdin.write(line)
        running.stdin.close()
        return running.stdout.read().strip()


def main(
    units: tuple[str, ...] = (*LAWS, "plant", "rule-based", "adaptive", "policy"), steps: int = 100_000, single: bool = False
) -> None:
    """Compare and print.

    Parameters
    ----------
    units
        Names of laws, plant, rule-based, adaptive, slip, policy (of a bogie).
    steps
        At least.
    single
        Floats in place of doubles.

    """
    for what in units:
        unit = named(what)
        if single and unit.why_double:
            print(f"{what}: only doubles, {unit.why_double}", flush=True)
            continue
        unit = in_single(unit) if single else unit
        with tempfile.TemporaryDirectory() as folder:
            once = sum(1 for kind, *_ in unit.reference(1) if kind == "step")
            said = compare(unit, math.ceil(steps / once), Path(folder))
        print(f"{what}: {re.sub(r'(?m)^wsp_[a-z_]*: ', '', said)}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
