"""Exported C and FMUs on other platforms: built by ziglang (pip install ziglang), and run where there is an emulator.

    python -m experiments.other_platforms --emulators linux-aarch64 "qemu-aarch64 -L /usr/aarch64-linux-gnu" win64 wine64

Of every unit its test vectors are run twice: by the C itself, and by the FMU's binary, which a small host loads and drives by
FMI's functions. Both say how far they are from the Python; a platform without an emulator is built only.
"""

import dataclasses
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import tyro
from rich.console import Console

from wsp_env.export.files import FLAGS, ROUNDING, runner, vectors
from wsp_env.export.fmu import PLATFORMS, build, here, sources, token
from wsp_env.export.make import make_unit
from wsp_env.export.unit import Unit, header, source
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.report import Table, terminal_table

#: A test vector.
Row = tuple[str, Sequence[float], Sequence[float]]

_TRAINED = Path(__file__).parents[1] / "agents" / "trained" / "bogie"

#: The functions of a unit, done by the binary of its FMU (FMI 3.0).
_HOST = """#include "{name}.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#ifdef _WIN32
#include <windows.h>
#define OPEN(file) (void *)LoadLibraryA(file)
#define FIND(name) (void *)GetProcAddress((HMODULE)library, name)
#else
#include <dlfcn.h>
#define OPEN(file) dlopen(file, RTLD_NOW)
#define FIND(name) dlsym(library, name)
#endif

enum {{ P = {parameters}, U = {inputs}, Y = {outputs}, CLOCK = {clock} }};

static void *library, *instance;
static double now;

static void check(int right, const char *what)
{{
    if (!right) {{
        fprintf(stderr, "%s failed\\n", what);
        exit(3);
    }}
}}

static void *function(const char *name)
{{
    void *found;
    if (!library) {{
        library = OPEN("{library}");
        check(library != NULL, "loading the library");
    }}
    found = FIND(name);
    check(found != NULL, name);
    return found;
}}

static void values(const char *name, unsigned first, size_t count, double *at)
{{
    int (*const access)(void *, const unsigned *, size_t, double *, size_t) =
        (int (*)(void *, const unsigned *, size_t, double *, size_t))function(name);
    unsigned numbers[{most}];
    for (size_t n = 0; n < count; n++) {{
        numbers[n] = first + (unsigned)n;
    }}
    check(count == 0 || access(instance, numbers, count, at, count) == 0, name);
}}

static void make(void)
{{
    void *(*const instantiate)(const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t,
        void *, void *, void *) = (void *(*)(const char *, const char *, const char *, bool, bool, bool, bool,
        const unsigned *, size_t, void *, void *, void *))function("fmi3InstantiateCoSimulation");
    instance = instantiate("one", "{token}", NULL, false, false, false, false, NULL, 0, NULL, NULL, NULL);
    check(instance != NULL, "fmi3InstantiateCoSimulation");
}}

void {name}_defaults({name}_parameters *p)
{{
    make();
    values("fmi3GetFloat64", 0, P, (double *)p);
}}

void {name}_start({name} *self, const {name}_parameters *p)
{{
    double given[P + 1];
    (void)self;
    for (size_t n = 0; n < P; n++) {{
        given[n] = ((const double *)p)[n];
    }}
    check(((int (*)(void *))function("fmi3Reset"))(instance) == 0, "fmi3Reset");
    values("fmi3SetFloat64", 0, P, given);
    check(((int (*)(void *, bool, double, double, bool, double))function("fmi3EnterInitializationMode"))(
        instance, false, 0.0, 0.0, false, 0.0) == 0, "fmi3EnterInitializationMode");
    check(((int (*)(void *))function("fmi3ExitInitializationMode"))(instance) == 0, "fmi3ExitInitializationMode");
    now = 0.0;
}}

void {name}_step({name} *self, const {name}_input *u, {name}_output *y)
{{
    double given[U + CLOCK + 1], last;
    bool event, terminate, early;
    (void)self;
    for (size_t n = 0; n < U + CLOCK; n++) {{
        given[n] = ((const double *)u)[n];
    }}
    now = CLOCK ? given[0] : now;
    values("fmi3SetFloat64", P, U, given + CLOCK);
    check(((int (*)(void *, double, double, bool, bool *, bool *, bool *, double *))function("fmi3DoStep"))(
        instance, now, {interval}, true, &event, &terminate, &early, &last) == 0, "fmi3DoStep");
    now += {interval};
    values("fmi3GetFloat64", P + U, Y, (double *)y);
}}
"""


def unit_of(name: str) -> Unit:
    """Return what is built, for a bogie; what the Python computes is computed once."""
    made = make_unit(str(_TRAINED) if name == "policy" else name, VEHICLES["bogie"])
    return with_rows(made, list(made.reference(1)))


def with_rows(unit: Unit, rows: list[Row]) -> Unit:
    """Return a unit with these test vectors."""
    return dataclasses.replace(unit, reference=lambda times: iter(rows))


def without_time(unit: Unit) -> Unit:
    """Return a unit whose outputs leave out the time: an FMU's is that of its tool."""
    if not any(variable.name == "time" for variable in unit.outputs):
        return unit
    assert unit.outputs[0].name == "time"
    rows = [(what, given, made[1:]) for what, given, made in unit.reference(1)]
    return with_rows(dataclasses.replace(unit, outputs=unit.outputs[1:]), rows)


def host(unit: Unit, library: str, made_from: Unit) -> str:
    """Return the C of the host: of a unit by the FMU of the one that it was made from."""
    counts = [
        sum(len(list(variable.elements())) for variable in group if variable.name != "time") for group in unit.groups.values()
    ]
    return _HOST.format(
        name=unit.name, library=library, token=token(made_from, 3), interval=repr(unit.interval_s or 0.02),
        most=max(*counts, 1), clock=int(any(variable.name == "time" for variable in unit.inputs)),
        **dict(zip(("parameters", "inputs", "outputs"), counts, strict=True)),
    )  # fmt: skip


def ran(folder: Path, emulator: Sequence[str]) -> str:
    """Run the vectors in a folder; return how far they are from the Python."""
    done = subprocess.run(
        [*emulator, str(folder / "runner.exe"), "vectors.txt", ROUNDING],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    found = re.search(r"(\d+) steps, largest difference ([^,]+)", done.stdout)
    if found is None:
        return f"failed: {(done.stderr or done.stdout)[-200:].strip()}"
    return f"{found[1]} steps, {float(found[2]):.2g}" + ("" if done.returncode == 0 else " (more than allowed)")


def compile_for(platform: str, folder: Path, files: Sequence[str], texts: Mapping[str, str], unit: Unit) -> None:
    """Build a program that runs a unit's vectors."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in {**texts, "vectors.txt": "".join(vectors(unit)), "runner.c": runner(unit)}.items():
        (folder / name).write_text(text, encoding="utf-8")
    math = [] if platform == "win64" else ["-lm"]
    command = [sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[platform][2], *FLAGS, "-Wno-pedantic"]
    subprocess.run([*command, "-o", "runner.exe", *files, "runner.c", *math], cwd=folder, check=True)


def measure(platform: str, unit: Unit, folder: Path, emulator: Sequence[str] | None) -> tuple[str, str]:
    """Build a unit's C and FMU for a platform; return what running them said, or that they were built."""
    own = {f"{unit.name}.h": header(unit), f"{unit.name}.c": source(unit)}
    compile_for(platform, folder / "c", [f"{unit.name}.c"], own, unit)
    library = build(unit, sources(unit, 3), 3, platform)
    assert library is not None
    build(unit, sources(unit, 2), 2, platform)
    place, file = folder / "fmu", f"{unit.name}{PLATFORMS[platform][3]}"
    place.mkdir()
    (place / file).write_bytes(library)
    clear = without_time(unit)
    texts = {f"{unit.name}.h": header(clear), "host.c": host(clear, file if platform == "win64" else f"./{file}", unit)}
    compile_for(platform, place, ["host.c"], texts, clear)
    return ("built", "built") if emulator is None else (ran(folder / "c", emulator), ran(place, emulator))


def main(
    emulators: tuple[tuple[str, str], ...] = (),
    platforms: tuple[str, ...] = tuple(PLATFORMS),
    units: tuple[str, ...] = ("law", "plant", "rule-based", "adaptive", "policy"),
) -> None:
    """Build and run.

    Parameters
    ----------
    emulators
        Platforms, each with the command that runs its programs.
    platforms
        What is built for.
    units
        What is built: law, plant, policy or a controller.

    """
    commands, given = {here(): "", **dict(emulators)}, {name: unit_of(name) for name in units}
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for platform in platforms:
            emulator = shlex.split(commands[platform]) if platform in commands else None
            for name, unit in given.items():
                rows.append((platform, name, *measure(platform, unit, Path(folder) / platform / name, emulator)))
                print(*rows[-1], sep=" | ", flush=True)
    Console(width=140).print(terminal_table(Table(("platform", "unit", "C", "FMU 3.0"), rows)))


if __name__ == "__main__":
    tyro.cli(main)
