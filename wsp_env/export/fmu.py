"""FMUs: a unit of C with the functions of FMI 2.0 or 3.0 for co-simulation around it, its source and a binary for this machine.

Nothing of Python is in them. The C of a unit is the same as that of `wsp export c`. Binaries of other platforms are built where
the package ziglang is installed.
"""

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from xml.sax.saxutils import quoteattr

from wsp_env.export.files import FLAGS
from wsp_env.export.unit import Unit, Variable, header, source
from wsp_env.output import ready, write_whole
from wsp_env.parameters.quantity import ParameterError

_C = Path(__file__).parent / "c"

#: Platforms: name in FMI 2.0, in FMI 3.0, target of ziglang, ending of a library.
PLATFORMS = {
    "linux64": ("linux64", "x86_64-linux", "x86_64-linux-gnu.2.17", ".so"),
    "linux-aarch64": ("", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
    "win64": ("win64", "x86_64-windows", "x86_64-windows-gnu", ".dll"),
    "darwin64": ("darwin64", "x86_64-darwin", "x86_64-macos", ".dylib"),
    "darwin-aarch64": ("", "aarch64-darwin", "aarch64-macos", ".dylib"),
}

#: Units by the exponents of SI's base units; a factor where they are not SI.
_UNITS = {
    "s": "s='1'", "m": "m='1'", "kg": "kg='1'", "rad": "rad='1'", "m/s": "m='1' s='-1'", "m/s2": "m='1' s='-2'",
    "rad/s": "rad='1' s='-1'", "N": "kg='1' m='1' s='-2'", "J": "kg='1' m='2' s='-2'", "J/m": "kg='1' m='1' s='-2'",
    "m/J": "kg='-1' m='-1' s='2'", "s/m": "m='-1' s='1'", "s2/m": "m='-1' s='2'", "1/m": "m='-1'",
    "bar": "kg='1' m='-1' s='-2' factor='1e5'", "Nl": "m='3' factor='0.001'", "1": "",
}  # fmt: skip


def here() -> str:
    """Return this machine's platform, one of `PLATFORMS` or something else."""
    arm = platform.machine().lower() in ("arm64", "aarch64")
    system = {"linux": "linux", "win32": "win", "darwin": "darwin"}.get(sys.platform, sys.platform)
    return f"{system}-aarch64" if arm else f"{system}64"


def variables(unit: Unit) -> list[tuple[str, Variable, str, str, float]]:
    """Return every variable: name, what it belongs to, causality, where it is in an instance, its start; in FMI's order.

    The time is FMI's own.
    """
    groups = (("parameter", "p", unit.parameters), ("input", "u", unit.inputs), ("output", "y", unit.outputs))
    found = []
    for causality, member, group in groups:
        for variable in group:
            if variable.name == "time":
                continue
            for n, (place, start) in enumerate(variable.elements()):
                name = variable.name if variable.size is None else f"{variable.name}[{n + 1}]"
                found.append((name, variable, causality, f"{member}.{place}", start))
    names = [name for name, *_ in found]
    assert len(set(names)) == len(names), f"{unit.name} has two variables of one name"  # FMI asks for it
    return found


def write_fmu(unit: Unit, file: Path, version: int = 2, platforms: Sequence[str] = ()) -> list[str]:
    """Write an FMU; return the platforms that it holds a binary for.

    `platforms` beside this machine's need ziglang; `ParameterError` where it is missing, or the platform unknown.
    """
    if version not in (2, 3):
        raise ParameterError(f"FMI {version}: valid: 2, 3")
    if unit.single:
        raise ParameterError("an FMU has doubles: its variables are Real or Float64; floats are for wsp export c")
    texts = sources(unit, version)
    built: dict[str, bytes] = {}
    for name in dict.fromkeys((here(), *platforms)):
        if name not in PLATFORMS:
            if name in platforms:
                raise ParameterError(f"unknown platform {name!r}; valid: {', '.join(PLATFORMS)}")
            continue
        place = PLATFORMS[name][0 if version == 2 else 1]
        if not place:
            if name in platforms:
                raise ParameterError(f"FMI 2.0 has no name for the platform {name}; take FMI 3.0")
            continue
        library = build(unit, texts, version, name)
        if library is not None:
            built[f"binaries/{place}/{unit.name}{PLATFORMS[name][3]}"] = library
    ready(file)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", description(unit, version))
        for name, text in texts.items():
            archive.writestr(f"sources/{name}", text)
        if version == 3:
            archive.writestr("sources/buildDescription.xml", _build_description(unit))
        for name, content in built.items():
            archive.writestr(name, content)
    write_whole(file, lambda out: out.write(packed.getvalue()))
    return [name.split("/")[1] for name in built]


def sources(unit: Unit, version: int) -> dict[str, str]:
    """Return the files of C."""
    named = variables(unit)
    causes = [causality for _, _, causality, _, _ in named]
    first_input = causes.count("parameter")
    first_output = first_input + causes.count("input")
    clock = any(variable.name == "time" for variable in unit.inputs)
    offsets = ",\n    ".join(f"offsetof(instance, {place})" for *_, place, _ in named)
    starts = "\n    ".join(f"own->{place} = {start!r};" for *_, causality, place, start in named if causality != "parameter")
    read = f"{unit.name}_read(&own->self, &own->y);"
    first = "evaluate(own);" if unit.interval_s is None else (read if unit.read else "/* nothing was decided yet */")
    values = {
        "name": unit.name, "interval": repr(unit.interval_s or 0.0), "count": str(len(named)), "first_input": str(first_input),
        "first_output": str(first_output), "offsets": offsets, "starts": starts, "first_outputs": first,
        "set_time": "own->u.time = own->time;" if clock else "", "token": token(unit, version),
        "known_derivatives": _known_derivatives(unit, named), "clock": str(len(named)) if version == 3 else "0xFFFFFFFFu",
    }  # fmt: skip

    def filled(name: str) -> str:
        text = (_C / name).read_text(encoding="utf-8")
        for key, value in values.items():
            text = text.replace(f"@{key}@", value)
        return text

    return {
        f"{unit.name}.h": header(unit),
        f"{unit.name}.c": source(unit),
        "common.c": filled("common.c"),
        f"fmi{version}.c": filled(f"fmi{version}.c"),
    }


def _known_derivatives(unit: Unit, named: Sequence[tuple[str, Variable, str, str, float]]) -> str:
    """Return the C of the derivatives that a law gives exactly."""
    at = {(causality, name): number for number, (name, _, causality, _, _) in enumerate(named)}
    if ("output", "df_ds") not in at:
        return ""
    return (
        f"if (of == {at['output', 'f']} && by == {at['input', 'slip_speed']}) {{\n"
        "        return own->u.slip_speed < 0.0 ? -own->y.df_ds : own->y.df_ds;\n    }\n"
        f"    if (of == {at['output', 'f']} && by == {at['input', 'speed']}) {{\n"
        "        return own->u.speed < 0.0 ? -own->y.df_dv : own->y.df_dv;\n    }"
    )


def token(unit: Unit, version: int) -> str:
    """Return the token by which description and binary belong together."""
    digest = hashlib.sha256(f"{version}{header(unit)}{source(unit)}".encode()).digest()
    return "{" + str(uuid.UUID(bytes=digest[:16])) + "}"


def build(unit: Unit, texts: dict[str, str], version: int, name: str) -> bytes | None:
    """Return the library of a platform; None on this one without a compiler. `ParameterError` where it cannot be built."""
    command = [sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[name][2]]
    if name == here() and (compiler := shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")):
        command = [compiler]
    elif find_spec("ziglang") is None:
        if name == here():
            return None
        raise ParameterError(f"a binary for {name} needs a cross-compiler: pip install ziglang")
    with tempfile.TemporaryDirectory() as folder:
        for file, text in texts.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        out = Path(folder) / "library"
        flags = ["-shared", *(() if name == "win64" else ("-fPIC", "-fvisibility=hidden")), *FLAGS]
        files = [f"{unit.name}.c", f"fmi{version}.c"]
        done = subprocess.run(
            [*command, *flags, "-o", str(out), *files, *(() if name == "win64" else ("-lm",))],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise ParameterError(f"the library of {name} cannot be built: {done.stderr[:600]}")
        return out.read_bytes()


def description(unit: Unit, version: int) -> str:
    """Return modelDescription.xml."""
    named = variables(unit)
    outputs = [number for number, (_, _, causality, _, _) in enumerate(named) if causality == "output"]
    own = "true" if unit.interval_s is None else "false"
    state, several = ("FMUstate", "") if version == 2 else ("FMUState", "s")
    abilities = " ".join(
        (
            f'modelIdentifier="{unit.name}" canHandleVariableCommunicationStepSize="{own}" canGetAndSet{state}="true"',
            f'canSerialize{state}="true" providesDirectionalDerivative{several}="{own}"',
            f'fixedInternalStepSize="{unit.interval_s:g}"' if version == 3 and unit.interval_s else "",
        )
    ).strip()
    head = f'modelName="{unit.name}" description={quoteattr(unit.title)} generationTool="wsp-env"'
    head += ' variableNamingConvention="structured"'
    step = f' stepSize="{unit.interval_s:g}"' if unit.interval_s else ""
    units = "\n".join(f"    {_unit(one)}" for one in dict.fromkeys(variable.unit for _, variable, *_ in named))
    listed = "\n".join(_variable(version, number, *one) for number, one in enumerate(named))
    if version == 2:
        files = "".join(f'\n      <File name="{name}"/>' for name in (f"{unit.name}.c", "fmi2.c"))
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" guid="{token(unit, 2)}" {head}>
  <CoSimulation {abilities}>
    <SourceFiles>{files}
    </SourceFiles>
  </CoSimulation>
  <UnitDefinitions>
{units}
  </UnitDefinitions>
  <DefaultExperiment startTime="0"{step}/>
  <ModelVariables>
{listed}
  </ModelVariables>
  <ModelStructure>
    <Outputs>
{_unknowns("Unknown index", [number + 1 for number in outputs], 6)}
    </Outputs>
    <InitialUnknowns>
{_unknowns("Unknown index", [number + 1 for number in outputs], 6)}
    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""
    time = f'    <Float64 name="time" valueReference="{len(named)}" causality="independent" variability="continuous" unit="s"/>'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" instantiationToken="{token(unit, 3)}" {head}>
  <CoSimulation {abilities}/>
  <UnitDefinitions>
{units if '    <Unit name="s">' in units else units + chr(10) + "    " + _unit("s")}
  </UnitDefinitions>
  <DefaultExperiment startTime="0"{step}/>
  <ModelVariables>
{listed}
{time}
  </ModelVariables>
  <ModelStructure>
{_unknowns("Output valueReference", outputs, 4)}
{_unknowns("InitialUnknown valueReference", outputs, 4)}
  </ModelStructure>
</fmiModelDescription>
"""


def _unknowns(start: str, numbers: Sequence[int], indent: int) -> str:
    return "\n".join(f'{" " * indent}<{start}="{number}"/>' for number in numbers)


def _unit(name: str) -> str:
    base = _UNITS.get(name)
    return (
        f"<Unit name={quoteattr(name)}/>"
        if base is None
        else f"<Unit name={quoteattr(name)}><BaseUnit {base}/></Unit>".replace(" /", "/")
    )


def _variable(version: int, number: int, name: str, variable: Variable, causality: str, place: str, start: float) -> str:
    said = f'name={quoteattr(name)} valueReference="{number}" description={quoteattr(variable.meaning)} causality="{causality}"'
    variability = {"parameter": "fixed", "input": "continuous", "output": "continuous"}[causality]
    begin = "" if causality == "output" else f' start="{start!r}"'
    if version == 2:
        own = f"unit={quoteattr(variable.unit)}{begin}"
        return f'    <ScalarVariable {said} variability="{variability}"><Real {own}/></ScalarVariable>'
    return f'    <Float64 {said} variability="{variability}" unit={quoteattr(variable.unit)}{begin}/>'


def _build_description(unit: Unit) -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{unit.name}">
    <SourceFileSet language="C99" compilerOptions="-ffp-contract=off">
      <SourceFile name="{unit.name}.c"/>
      <SourceFile name="fmi3.c"/>
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""
