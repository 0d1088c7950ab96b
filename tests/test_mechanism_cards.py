"""All that is known of a mechanism stands on its card: no other file names one, and one more is found everywhere."""

import io
import json
import os
import re
import subprocess
import sys
import tokenize
from pathlib import Path

import numpy as np
import pytest

from wsp_env.parameters.quantity import ParameterError
from wsp_env.plant.card import ACTS_ON, BALANCES, SLOTS, Recorded, check_card
from wsp_env.plant.mechanisms import ALL, LIBRARY
from wsp_env.plant.mechanisms.__main__ import table

ROOT = Path(__file__).parent.parent
every = pytest.mark.parametrize("name", ALL)

#: Files beside the cards that name a mechanism, and why.
EXCEPTIONS = {
    "wsp_env/plant/mechanisms/__init__.py": "the list of the files",
    "wsp_env/envs/__init__.py": "what Train-v1 is made for, and switches on by default",
    "wsp_env/plant/mechanisms/term_words.py": "the words for what a term without a name looks like, some of them cards' names",
    "agents/card.py": "a published benchmark, with one mechanism at a stated size; its figures are stored",
    "agents/drawn.py": "the worlds of a comparison, whose brakes differ from axle to axle",
    "agents/tolerances.py": "the worlds of a table: a brake that differs from what it is told",
    "agents/varied.py": "the world to train in: a wheel of another radius",
    "agents/together.py": "what the wheels of a vehicle owe to each other where the leading ones clean the rail",
    "wsp_env/cli/plant_options.py": "examples in a help text",
    "agents/behaviour.py": "the worlds of a drawn picture, which its page discusses",
}
#: Names that are also a function's, of eq. (7) in `wsp_env.contact.polach`: they count where they are a whole string.
HOMONYMS = {"falling_friction"}
#: Places where wheels slid [m].
PLACES_M = np.linspace(0.0, 500.0, 200)


def names_in(file: Path) -> set[str]:
    """Return the mechanisms that a source names, in code, strings or comments."""
    with tokenize.open(file) as source:
        tokens = list(tokenize.generate_tokens(io.StringIO(source.read()).readline))
    found: set[str] = set()
    for token in tokens:
        if token.type in (tokenize.NAME, tokenize.STRING, tokenize.COMMENT):
            whole = {token.string.strip("\"'")} if token.type == tokenize.STRING else set()
            found |= (set(re.findall(r"\w+", token.string)) - HOMONYMS | whole) & set(LIBRARY)
    return found


def test_no_file_but_its_own_names_a_mechanism():
    named = {}
    for folder in ("wsp_env", "baselines", "agents"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            own = {file.stem} if file.parent.name == "mechanisms" else set()
            where = file.relative_to(ROOT).as_posix()
            if (names := names_in(file) - own) and where not in EXCEPTIONS:
                named[where] = sorted(names)
    assert named == {}


def test_the_exceptions_are_needed():
    assert all(names_in(ROOT / where) for where in EXCEPTIONS)


@every
def test_a_card_says_all_that_the_diagnosis_asks(name):
    card = ALL[name]
    signature = card.signature
    parameters = {one.name: one for one in card.parameters}
    assert signature.balances
    assert signature.balances <= set(BALANCES)
    assert signature.acts_on in ACTS_ON
    assert signature.next_test
    assert "{" not in card.summary
    assert {one.name for one in card.sizes if one.fitted} <= {one.parameter for one in signature.said} <= set(parameters)
    assert all(one.kind == "shape" for one in card.parameters if one.refit_step)
    assert set(signature.normal) | set(card.study) <= set(parameters)
    if signature.rolls_freely:
        assert parameters[signature.rolls_freely.size].kind == "size"
    if signature.friction_pattern:
        assert len([one for one in card.sizes if one.fitted]) == 1
    axles = {one.name for one in card.parameters if one.kind == "axle"}
    for fixed in signature.variants(Recorded(4, PLACES_M)):
        assert axles <= set(fixed) <= set(parameters) - {one.name for one in card.sizes}
    if signature.creep_curve:
        assert signature.acts_on == "contact"
        assert set(signature.creep_curve.null_at_constant_friction) <= set(parameters)


def test_the_page_of_the_mechanisms_is_current():
    page = (ROOT / "docs" / "mechanisms.md").read_text(encoding="utf-8")
    assert table() in page, "write docs/mechanisms.md anew with `python -m wsp_env.plant.mechanisms`"


CARD = '''
"""Friction that swings along the track."""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.plant.card import Card, Parameter, Said, Signature, percent


class Parameters(NamedTuple):
    depth: float
    period_m: float


@inlined
def friction_factor(p, place_m):
    if p.depth == 0.0:
        return 1.0
    return 1.0 + p.depth * math.sin(2.0 * math.pi * place_m / p.period_m)


CARD = Card(
    name="rail_joints",
    summary="friction of the contaminated rail swings along the track",
    parameters=(
        Parameter("depth", "-", 0.0, 0.3, -0.9, 0.9, "assumption: of this test"),
        Parameter("period_m", "m", 40.0, 40.0, 1.0, 1000.0, "assumption: of this test", "shape"),
    ),
    record=Parameters,
    acts={"contaminated_friction": friction_factor},
    signature=Signature(
        balances=frozenset({"adhesion"}),
        trace="adhesion: swings with the place",
        acts_on="contact",
        next_test="a stop on welded rail",
        said=(Said("depth", "%", percent, "friction swings by {size} with every joint", "friction swings back by {size}"),),
        over="place",
        variants=lambda recorded: [{"period_m": 40.0}],
    ),
)
'''


@pytest.mark.slow
@pytest.mark.long
def test_one_more_mechanism_is_one_file(tmp_path):
    """Environment, diagnosis, report and table know a mechanism of another package from its module alone."""
    package = tmp_path / "site"
    info = package / "rail_joints-1.0.dist-info"
    info.mkdir(parents=True)
    (package / "rail_joints.py").write_text(CARD, encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rail-joints\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text("[wsp_env.mechanisms]\nrail_joints = rail_joints\n", encoding="utf-8")
    path = os.pathsep.join([str(package), str(ROOT), str(ROOT / "tests")])
    environment = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    script = ROOT / "tests" / "further_mechanism.py"
    ran = subprocess.run(
        [sys.executable, str(script), str(tmp_path)], env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout)
    assert abs(found["slower_mps"]) > 1e-3
    (one,) = found["diagnosis"]["mechanisms"]
    assert one["name"] == "rail_joints"
    low, high = one["parameters"]["depth"]["interval90"]
    assert low < 0.3 < high
    assert "friction swings by" in found["diagnosis"]["sentence"]
    assert found["diagnosis"]["next_test"] == "a stop on welded rail"
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "The fitted mechanism: rail joints" in page
    assert "How it shows: adhesion: swings with the place" in page
    assert "| `rail_joints` | friction of the contaminated rail swings along the track |" in found["table"]


def test_cards_that_name_what_does_not_exist_are_refused():
    card = ALL["load_transfer"]
    wrong = [card._replace(acts={"forse": abs}), card._replace(signature=card.signature._replace(acts_on="weather"))]
    for one in wrong:
        with pytest.raises(ParameterError, match=r"card load_transfer names (forse|weather), which is none; slots: mass"):
            check_card(one, "somewhere")
    assert all(set(one.acts) <= set(SLOTS) for one in ALL.values())
