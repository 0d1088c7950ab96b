"""Whatever stands in a JSON or TOML file, and whatever number in an option: accepted, or refused in one line."""

import json
import sys

import gymnasium as gym
import pytest
from synthetic_stops import stop, write_campaign
from test_policy import contract
from test_policy import write as write_policy

from wsp_env.evaluation.policy import CONTRACT, load_policy
from wsp_env.evaluation.programme import STANDARD, read_programme
from wsp_env.parameters.document import DocumentError, read_json, read_toml
from wsp_env.parameters.quantity import ParameterError, readable
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle_file import read_vehicle, write_vehicle
from wsp_env.recordings import CampaignError, read_campaign
from wsp_env.recordings.creep_curves import read_creep_curves

#: Values that both forms write alike.
BOTH = {
    "bool": "true",
    "text": '"x"',
    "long text": '"' + "a" * 5000 + '"',
    "line break": r'"a\nb\u001b[31m"',
    "zero byte": r'"a\u0000b"',
    "negative": "-1",
    "zero": "0",
    "beyond 64 bits": "1" + "0" * 400,
    "thousands of digits": "1" + "0" * 5000,
    "1e400": "1e400",
    "1e300": "1e300",
    "1e-300": "1e-300",
    "numbers": "[1, 2]",
    "texts": '["a"]',
    "empty list": "[]",
    "empty table": "{}",
    "nested lists": "[" * 5000 + "]" * 5000,
}
JSON = BOTH | {
    "null": "null",
    "nan": "NaN",
    "object": '{"a": 1}',
    "nested": '{"a":' * 5000 + "1" + "}" * 5000,
    "half": r'"\ud800"',
}
TOML = BOTH | {
    "nan": "nan",
    "inf": "inf",
    "table": "{a = 1}",
    "nested": "{a = " * 5000 + "1" + "}" * 5000,
    "date": "2020-01-01",
}


def refuses_in_a_line(read, what):
    """Read; what is refused must be refused by an error of this project, in a line that a screen holds."""
    try:
        read()
    except (ParameterError, CampaignError) as error:
        lines = str(error).split("\n  ")  # faults of a vehicle file stand one to a line
        assert all(len(line) < 1100 and line.isprintable() for line in lines), what


def lines_of(text):
    return [(number, line.split("=")[0].strip()) for number, line in enumerate(text.splitlines()) if "=" in line]


def with_line(text, number, line):
    lines = text.splitlines()
    return "\n".join([*lines[:number], line, *lines[number + 1 :]])


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return write_campaign(tmp_path_factory.mktemp("campaign"), {"A1": stop(2e-4, 0.06, duration_s=1.5)})


@pytest.mark.parametrize("name", TOML)
def test_every_value_of_a_campaign(campaign, tmp_path, name):
    text = (campaign / "campaign.toml").read_text(encoding="utf-8")
    (tmp_path / "A1.csv").write_bytes((campaign / "A1.csv").read_bytes())
    more = {"[vehicle]": ("resistance_n", "missing_axles"), "[contact]": ("kalker_c11",), "[runs.A1]": ("mass_kg", "notes")}
    variants = [with_line(text, number, f"{key} = {TOML[name]}") for number, key in lines_of(text)]
    variants += [text.replace(table, f"{table}\n{key} = {TOML[name]}", 1) for table, keys in more.items() for key in keys]
    source = 'column = "time_s", '
    for key in ("column", "unit", "scale", "time"):
        entry = f"{{{'' if key == 'column' else source}{key} = {TOML[name]}}}"
        variants.append(f"{text}\n[channels]\nvehicle_speed = {entry}\n")
    for variant in variants:
        (tmp_path / "campaign.toml").write_text(variant, encoding="utf-8")
        refuses_in_a_line(lambda: read_campaign(tmp_path), variant[:2000])
    (tmp_path / "campaign.toml").write_text(f"campaign = {TOML[name]}\ncurves = {TOML[name]}\ncontact = {TOML[name]}")
    refuses_in_a_line(lambda: read_creep_curves(tmp_path), name)


@pytest.mark.parametrize("name", TOML)
def test_every_value_of_a_programme_and_of_a_vehicle(tmp_path, name):
    for text, read in ((STANDARD.read_text(encoding="utf-8"), read_programme), (write_vehicle(COACH), read_vehicle)):
        seen = set()
        for number, key in lines_of(text):
            if key not in seen:
                seen.add(key)
                (tmp_path / "x.toml").write_text(with_line(text, number, f"{key} = {TOML[name]}"), encoding="utf-8")
                refuses_in_a_line(lambda read=read: read(tmp_path / "x.toml"), f"{key} = {name}")
        for table in ("programme", "scenario", "case", "requirement"):
            (tmp_path / "x.toml").write_text(f"{table} = {TOML[name]}", encoding="utf-8")
            refuses_in_a_line(lambda read=read: read(tmp_path / "x.toml"), f"{table} = {name}")


@pytest.mark.parametrize("name", JSON)
def test_every_value_of_a_model_and_of_a_contract(tmp_path, name):
    pytest.importorskip("onnxruntime")
    file, value = tmp_path / "model.json", JSON[name]
    vehicle = f'"axles": 4, "mass_kg": {value}, "wheelset_inertia_kgm2": 160, "wheel_radius_m": 0.4'
    inner = [f'"mu_cd": {{"A1": 0.05, "A2": {value}}}', f'"mechanisms": {{"load_transfer": {value}}}']
    inner += [f'"contact": {{"kinetic_friction_d": {value}}}', f'"vehicle": {{{vehicle}}}']
    inner += [f'"mechanisms": {{"load_transfer": {{"body_height_m": {value}}}}}']
    keys = ("tau_m_per_J", "mu_cd", "contact", "mechanisms", "vehicle")
    for text in (value, *(f'{{"{key}": {value}}}' for key in keys), *(f"{{{one}}}" for one in inner)):
        file.write_text(text, encoding="utf-8")
        refuses_in_a_line(lambda: gym.make("wsp_env/Coach-v1", model=str(file)), text[:200])
    write_policy(tmp_path)
    good = json.loads((tmp_path / CONTRACT).read_text())
    for key in [*contract(), None]:
        entries = [f'"{own}": {value if own == key else json.dumps(there)}' for own, there in good.items()]
        (tmp_path / CONTRACT).write_text("{" + ", ".join(entries) + "}" if key else value, encoding="utf-8")
        refuses_in_a_line(lambda: load_policy(tmp_path), f"{key}: {name}")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 5000, "nested too deep"),
        ("a." * 200 + "b = 1", "more than 50 dots"),
        ("a = " + "9" * 5000, "thousands of digits"),
        ("a = 1 #" + "x" * 1_000_001, "larger than 1000000 bytes"),
        ("a = ", "not valid TOML"),
    ],
)
def test_documents_beyond_the_limits(tmp_path, text, said):
    (tmp_path / "x.toml").write_text(text)
    with pytest.raises(DocumentError, match=said):
        read_toml(tmp_path / "x.toml")


def test_brackets_in_texts_and_comments_are_no_levels(tmp_path):
    (tmp_path / "x.toml").write_text(f"# {'[' * 99}\na = '{'[' * 99}'\nb = \"{'{' * 99}\" # it's {'[' * 99}\n")
    assert read_toml(tmp_path / "x.toml")["a"] == "[" * 99
    (tmp_path / "x.json").write_text(json.dumps({"a": '\\"' + "[" * 99}))
    assert read_json(tmp_path / "x.json")["a"] == '\\"' + "[" * 99


def test_what_is_no_file(tmp_path):
    (tmp_path / "bytes").write_bytes(b"\xff\xfe")
    with pytest.raises(DocumentError, match="UTF-8"):
        read_json(tmp_path / "bytes")
    for name, said in (
        ("", "is a folder; name the file in it"),
        ("nowhere", "No such file"),
        ("a\0b", "no file can be called so"),
    ):
        with pytest.raises(DocumentError, match=said):
            read_json(tmp_path / name)
    if sys.platform != "win32":
        import os

        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(DocumentError, match="no file"):
            read_json(tmp_path / "pipe")


@pytest.mark.parametrize(
    "value", [10**400, 10**5000, 1e-9, 1e300, float("nan"), "x", [1], {"a": 1}, -1, True, object()], ids=range(11)
)
def test_every_option_of_an_environment(value):
    def made(**options):
        return lambda: gym.make("wsp_env/Bogie-v1", disable_env_checker=True, **options).reset(seed=0)

    for name in (
        "control_interval_s",
        "substep_s",
        "time_limit_s",
        "track_limit_m",
        "slide_limit",
        "model",
        "coaches",
        "plant",
    ):
        refuses_in_a_line(made(**{name: value}), name)
    for name in ("mu_cd", "patch_length", "variation_length", "variation", "initial_speed"):
        refuses_in_a_line(made(scenario={name: (value, value), "tracks": ["patches"]}), name)
    refuses_in_a_line(made(vehicle={"mass_kg": value, "brake": {"dead_time_s": value}}), "vehicle")
    refuses_in_a_line(made(mechanisms={"load_transfer": {"body_height_m": value}}), "mechanisms")


@pytest.mark.parametrize("options", [{"control_interval_s": 1e-9}, {"scenario": {"patch_length": (1e-9, 1.0)}}])
def test_numbers_that_would_take_all_memory_are_refused(options):
    with pytest.raises(ParameterError, match="is impossible"):
        gym.make("wsp_env/Bogie-v1", **options)


def test_messages_keep_to_a_line():
    assert readable("a\x1b[31m\nb\n  c") == "a\\x1b[31m\\nb\n  c"
    assert len(readable("x" * 10**6)) < 1100
