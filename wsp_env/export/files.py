"""The files of an exported unit: C, header, CMake, test vectors and the runner that checks them."""

from collections.abc import Iterator
from pathlib import Path

from wsp_env.export.single import in_floats
from wsp_env.export.unit import Unit, Variable, header, source
from wsp_env.output import ready, write_text

#: Flags that keep what is computed equal to the Python, and the code clean.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror")

#: What a test on another C library allows, relative from 1 on: its elementary functions may differ in the last digit, and a
#: plant sums them up (2.2e-16 was seen, see docs/export_platforms.md; the rest is assumption).
ROUNDING = "1e-9"


def write_unit(unit: Unit, folder: Path) -> list[str]:
    """Write a unit's files into a folder; return their names."""
    written = in_floats if unit.single else str
    texts = {
        f"{unit.name}.h": written(header(unit)),
        f"{unit.name}.c": written(source(unit)),
        "vectors.txt": "".join(vectors(unit)),
        "runner.c": runner(unit),
        "CMakeLists.txt": cmake(unit),
    }
    ready(*(folder / name for name in texts))
    for name, text in texts.items():
        write_text(folder / name, text)
    return list(texts)


def vectors(unit: Unit, times: int = 1) -> Iterator[str]:
    """Yield the lines of the test vectors: what the Python makes, as exact hexadecimal numbers."""
    yield f"# {unit.title}\n"
    yield f"# start: {' '.join(_names(unit.parameters))}\n"
    yield f"# step: {' '.join(_names(unit.inputs))} -> {' '.join(_names(unit.outputs))}\n"
    for what, given, made in unit.reference(times):
        yield " ".join([what, *(float(value).hex() for value in (*given, *made))]) + "\n"
    yield "end\n"


def _names(variables: tuple[Variable, ...]) -> list[str]:
    return [name for variable in variables for name, _ in variable.elements()]


def runner(unit: Unit) -> str:
    """Return the program that runs the vectors and says how far C and Python are apart."""
    name = unit.name

    def pointers(group: str, variables: tuple[Variable, ...]) -> str:
        listed = ",\n        ".join(f"&{group}.{one}" for one in _names(variables)) or "&none"
        return f"{unit.real} *const {group}_at[] = {{\n        {listed}}};"

    cast = "(float)" if unit.single else ""
    counts = {group: len(_names(variables)) for group, variables in zip("puy", unit.groups.values(), strict=True)}
    return f"""/* Runs the test vectors through {name}.c and says how far it is from the Python: runner [FILE [ALLOWED]]. */
#include "{name}.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int number(FILE *file, {unit.real} *value)
{{
    char text[64];
    if (fscanf(file, "%63s", text) != 1) {{
        return 0;
    }}
    *value = {cast}strtod(text, NULL);
    return 1;
}}

int main(int count, char **arguments)
{{
    static {name} self;
    {name}_parameters p;
    {name}_input u;
    {name}_output y;
    {unit.real} none = 0;
    {pointers("p", unit.parameters)}
    {pointers("u", unit.inputs)}
    {pointers("y", unit.outputs)}
    const double rounding = count > 2 ? strtod(arguments[2], NULL) : 0.0; /* of another C library */
    const double tolerance = fmax({unit.tolerance!r}, rounding), share = {unit.allowed_share!r};
    double worst = 0.0;
    {unit.real} expected = 0;
    long steps = 0, wrong = 0;
    char word[64];
    FILE *file = fopen(count > 1 ? arguments[1] : "vectors.txt", "r");
    if (!file) {{
        fprintf(stderr, "no vectors.txt here\\n");
        return 2;
    }}
    memset(&u, 0, sizeof u);
    memset(&y, 0, sizeof y);
    (void)none;
    (void)p_at;
    (void)u_at;
    {name}_defaults(&p);
    {name}_start(&self, &p);
    while (fscanf(file, "%63s", word) == 1 && strcmp(word, "end") != 0) {{
        if (word[0] == '#') {{
            int sign = 0;
            while (sign != '\\n' && sign != EOF) {{
                sign = fgetc(file);
            }}
        }} else if (strcmp(word, "start") == 0) {{
            for (size_t n = 0; n < {counts["p"]}; n++) {{
                if (!number(file, p_at[n])) {{
                    return 2;
                }}
            }}
            {name}_start(&self, &p);
        }} else {{
            for (size_t n = 0; n < {counts["u"]}; n++) {{
                if (!number(file, u_at[n])) {{
                    return 2;
                }}
            }}
            {name}_step(&self, &u, &y);
            steps++;
            for (size_t n = 0; n < {counts["y"]}; n++) {{
                if (!number(file, &expected)) {{
                    return 2;
                }}
                const double off = fabs((double)*y_at[n] - (double)expected) / fmax(1.0, fabs((double)expected));
                if (*y_at[n] != expected && !(isnan(expected) && isnan(*y_at[n]))) {{
                    worst = off > worst ? off : worst;
                    if (!(off <= tolerance) && wrong++ == 0) {{
                        printf("step %ld, output %zu: %.17g in C, %.17g in Python\\n", steps, n + 1, (double)*y_at[n],
                            (double)expected);
                    }}
                }}
            }}
        }}
    }}
    fclose(file);
    printf("{name}: %ld steps, largest difference %g, allowed %g, %ld of %ld numbers beyond, allowed %g\\n", steps, worst,
        tolerance, wrong, {counts["y"]} * steps, share * {counts["y"]} * (double)steps);
    return steps > 0 && (double)wrong <= share * {counts["y"]} * (double)steps ? 0 : 1;
}}
""".replace("for (size_t n = 0; n < 0; n++)", "for (size_t n = 1; n < 1; n++)")


def cmake(unit: Unit) -> str:
    """Return the CMakeLists.txt."""
    name = unit.name
    return f"""cmake_minimum_required(VERSION 3.10)
project({name} C)
set(CMAKE_C_STANDARD 99)
set(CMAKE_C_EXTENSIONS OFF)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
if(NOT MSVC)
  add_compile_options(-ffp-contract=off -Wall -Wextra -Wpedantic)
  set(MATH m)
endif()
add_library({name} STATIC {name}.c)
target_link_libraries({name} PUBLIC ${{MATH}})
add_executable(runner runner.c)
target_link_libraries(runner {name})
enable_testing()
# Another C library than glibc may round exp, log and pow otherwise in the last digit.
if(CMAKE_SYSTEM_NAME STREQUAL "Linux")
  set(ROUNDING 0)
else()
  set(ROUNDING {ROUNDING})
endif()
add_test(NAME vectors COMMAND runner ${{CMAKE_CURRENT_SOURCE_DIR}}/vectors.txt ${{ROUNDING}})
""" + (_LIBRARY.format(name=name) if unit.controller else "")


#: A controller as a library for `wsp evaluate`.
_LIBRARY = """
# wsp evaluate --controllers {name}_controller.so
add_library({name}_controller MODULE controller.c {name}.c)
target_link_libraries({name}_controller ${{MATH}})
set_target_properties({name}_controller PROPERTIES PREFIX "")
"""
