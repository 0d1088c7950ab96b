"""Damaged files at every door: refused in one line or read, never a traceback, a crash of native code or a hang."""

import contextlib
import json
import tomllib
import warnings

import pytest
from fuzzing import CORPUS, NAMES, REFUSALS, TOKENS, damaged, doors
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from synthetic_stops import stop, write_campaign

from wsp_env.envs.model import read_model
from wsp_env.parameters.vehicle_file import read_vehicle
from wsp_env.recordings import CampaignError, CampaignWarning, read_campaign

#: Together some 200 a run; `make fuzz` tries 20 thousand.
EXAMPLES = 12

quickly = settings(
    max_examples=EXAMPLES, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


@pytest.fixture(scope="module")
def ways_in(tmp_path_factory):
    return doors(tmp_path_factory.mktemp("doors"))


def test_every_door_is_named_and_takes_its_sound_file(ways_in, tmp_path):
    assert set(ways_in) == set(NAMES)
    for name in NAMES:
        (tmp_path / name).mkdir()
        assert ways_in[name].try_out(ways_in[name].content, tmp_path / name) == "", name


@pytest.mark.parametrize("name", NAMES)
def test_damaged_files(ways_in, tmp_path, name):
    @quickly
    @given(seed=st.integers(0, 2**32))
    def tried(seed):
        ways_in[name].try_out(damaged(ways_in[name].content, seed), tmp_path)

    tried()


@pytest.mark.parametrize("file", sorted(CORPUS.glob("*--*")), ids=lambda file: file.name)
def test_what_once_went_wrong(ways_in, tmp_path, file):
    ways_in[file.name.partition("--")[0]].try_out(file.read_bytes(), tmp_path)


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.sampled_from([10**400, "1e400", "nan"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
KEYS = ("tau_m_per_J", "mu_cd", "contact", "mechanisms", "vehicle", "axles", "mass_kg", "kinetic_friction_d", "load_transfer")


@quickly
@given(document=st.dictionaries(st.sampled_from(KEYS), values | st.dictionaries(st.sampled_from(KEYS), values), max_size=5))
def test_any_json_as_a_model(tmp_path, document):
    (tmp_path / "x.json").write_text(json.dumps(document), encoding="utf-8")
    with contextlib.suppress(*REFUSALS):
        read_model(str(tmp_path / "x.json"))


@quickly
@given(text=st.lists(st.sampled_from([*TOKENS, b"mass_kg", b" = ", b"[brake]\n", b"name", b"{", b"}"]), max_size=30))
def test_any_toml_as_a_vehicle(tmp_path, text):
    (tmp_path / "x.toml").write_bytes(b"".join(text))
    try:
        read_vehicle(tmp_path / "x.toml")
    except REFUSALS:
        return
    assert tomllib.loads((tmp_path / "x.toml").read_text(encoding="utf-8"))


UNITS = {
    "time_s": (1e3, 1e6, 1.0 / 60.0, 1.0 / 3600.0),
    "vehicle_speed_mps": (3.6, 2.2369, 1e3),
    "wheel_speed_radps": (9.5493, 1.0 / 6.2832, 57.2958),
    "brake_torque_nm": (1e-3, 1e3, -1.0),
}


@pytest.mark.parametrize(("column", "factor"), [(column, factor) for column, all_ in UNITS.items() for factor in all_])
def test_no_wrong_unit_is_taken_in_silence(tmp_path, column, factor):
    columns = stop(2e-4, 0.06, duration_s=8.0, noise=1.0)
    wrong = {name: factor * values if name.endswith(column) else values for name, values in columns.items()}
    folder = write_campaign(tmp_path, {"A1": wrong})
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", CampaignWarning)
        try:
            read_campaign(folder)
        except CampaignError:
            return
    assert said
