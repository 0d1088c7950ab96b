"""Vehicle files: what is written is read again exactly, every fault is named, and `wsp vehicle` says what a vehicle is."""

import dataclasses
import itertools
import json
import string

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wsp_env.cli import main
from wsp_env.contact.port import LAWS
from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE, COACH, VEHICLES
from wsp_env.parameters.vehicle import Brake, Tachometer, Vehicle, train, usual_bodies
from wsp_env.parameters.vehicle_figures import deceleration_mps2, figures, filling_s, remarks, stopping_distance_m
from wsp_env.parameters.vehicle_file import REQUIRED, find_vehicle, left_out, read_vehicle, write_vehicle

KEYS = [field.name for field in dataclasses.fields(Vehicle)]
GOOD = (
    'name = "mine"\naxle_positions_m = [0.0, 3.0, 6.0]\nmass_kg = 60000\nwheelset_inertia_kgm2 = 200.0\nwheel_radius_m = 0.5\n'
)


def records(record):
    """Any values that a record allows, whole numbers among them."""
    values = {}
    for field in dataclasses.fields(record):
        if "unit" in field.metadata and not isinstance(field.default, tuple):
            low, high = field.metadata["low"], min(field.metadata["high"], 1e12)
            real = st.floats(low, high, exclude_min=field.metadata["open_low"], allow_nan=False)
            values[field.name] = real | st.integers(int(low) + 1, int(high)) if int(low) + 1 <= int(high) else real
        elif field.name == "traction_law":
            values[field.name] = st.sampled_from(list(LAWS))
    return st.fixed_dictionaries(values)


@st.composite
def vehicles(draw):
    axles = draw(st.integers(1, 64))
    gaps = itertools.cycle(draw(st.lists(st.floats(0.1, 15.0), min_size=1, max_size=4)))
    places = list(itertools.accumulate(itertools.islice(gaps, axles - 1), initial=0.0))
    contact = draw(records(ContactParameters))
    contact["kinetic_friction_d"] = min(contact["kinetic_friction_d"], contact["kinetic_friction_r"])
    bodies = usual_bodies(axles) if draw(st.booleans()) else ()
    return Vehicle(
        name="x" + draw(st.text(max_size=20)),
        axle_positions_m=tuple(places),
        bodies=bodies,
        contact=ContactParameters(**contact),
        brake=Brake(**draw(records(Brake))),
        tachometer=Tachometer(**draw(records(Tachometer))),
        **draw(records(Vehicle)),
    )


@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture])
@given(vehicle=vehicles())
def test_what_is_written_is_read_again_exactly(tmp_path, vehicle):
    file = tmp_path / "any.toml"
    file.write_text(write_vehicle(vehicle), encoding="utf-8")
    assert read_vehicle(file) == vehicle
    assert {figure.unit for figure in figures(vehicle)} >= {"t", "s", "m", "m/s2", "mm"}
    assert isinstance(remarks(vehicle), tuple)


@pytest.mark.parametrize("name", sorted(VEHICLES))
def test_every_value_has_its_unit_and_source_behind_it(name, tmp_path):
    text = write_vehicle(VEHICLES[name])
    for line in text.replace(",\n", ",").replace("[\n", "[").splitlines():
        assert not line or line[0] in "#[" or "  # " in line, line
    assert "[kg] " in text
    assert "mass_kg = 43000.0  # [kg] seed paper, Table 1" in text or name != "coach"
    assert "state your source" in text or name == "coach"  # the paper's figure is not the bogie's


FAULTS = [
    ("", ["name is missing; add name", "mass_kg is missing; add it in kg"]),
    (GOOD + "mas_kg = 1", [r"unknown key 'mas_kg'; did you mean mass_kg\? valid: name, axle_positions_m"]),
    (
        GOOD + "[brake]\ndeadtime = 1",
        [r"\[brake\] unknown key 'deadtime'; did you mean dead_time_s\? valid: full_pr"],
    ),
    (GOOD.replace("60000", '"heavy"'), ["mass_kg must be a number in kg, got 'heavy'"]),
    (GOOD.replace("60000", "'43000'"), ["mass_kg must be a number in kg, got '43000'"]),
    (GOOD.replace("60000", "true"), ["mass_kg must be a number in kg, got True"]),
    (GOOD.replace("60000", "-1"), [r"mass_kg = -1 kg is impossible: it must be finite and in \(0, 1e\+06\]"]),
    (GOOD.replace("60000", "nan"), ["mass_kg = nan kg is impossible"]),
    (GOOD.replace("60000", "1e999"), ["mass_kg = inf kg is impossible"]),
    (GOOD.replace("60000", "0x" + "f" * 9999), ["mass_kg = .* kg is impossible"]),
    (GOOD.replace("60000", "[1, 2]"), ["mass_kg must be a number in kg, got"]),
    (GOOD.replace("60000", "{kg = 1}"), ["mass_kg must be a number in kg, got"]),
    (GOOD.replace("60000", "1979-05-27"), ["mass_kg must be a number in kg, got"]),
    (GOOD.replace("[0.0, 3.0, 6.0]", "3.0"), [r"axle_positions_m = 3.0 must be a list of numbers in m, such as \[0.0, 2.56\]"]),
    (GOOD.replace("[0.0, 3.0, 6.0]", "[[0.0], 3.0]"), ["axle_positions_m, number 1, must be a number in m"]),
    (GOOD.replace("[0.0, 3.0, 6.0]", "[]"), ["must hold 1 to 64 rising distances"]),
    (GOOD.replace("[0.0, 3.0, 6.0]", "[1.0, 3.0]"), ["must hold 1 to 64 rising distances .* start with 0"]),
    (GOOD.replace("[0.0, 3.0, 6.0]", "[0.0, 3.0, 3.0]"), ["rising distances"]),
    (GOOD.replace("[0.0, 3.0, 6.0]", str(list(range(65)))), ["must hold 1 to 64 rising distances"]),
    (GOOD + "bodies = [[2, 2]]", ["stand on 4 axles, but the vehicle has 3; correct the one or the other"]),
    (GOOD + "bodies = [3]", [r"bodies = \[3\] must be a list of lists"]),
    (GOOD + "bodies = [[3.0]]", ["must list the axles of each bogie"]),
    (GOOD + "bodies = [[3], []]", ["must list the axles of each bogie"]),
    (GOOD.replace('"mine"', "7"), ["name = 7 must be a text in quotes"]),
    (GOOD.replace('"mine"', '"  "'), ["name = .* must be a text in quotes"]),
    (GOOD + "brake = 3", [r"brake = 3 must be a table: write \[brake\]"]),
    (GOOD + "[contact]\nkinetic_friction_d = 0.5", [r"kinetic_friction_d \(mu_cd\) = 0.5 exceeds"]),
    (
        GOOD + "[brake]\ndead_time_s = -1\n[tachometer]\npulses_per_turn = 0",
        [r"\[brake\] dead_time_s", r"\[tachometer\] pulses"],
    ),
    ("mass_kg = ", ["is not valid TOML"]),
    ("x = " + "[" * 9999, ["is not valid TOML: nested too deep"]),
    ("#" * 1_000_001, ["is larger than 1000000 bytes"]),
    (b"name = '\xff'", ["is no text in UTF-8"]),
]


@pytest.mark.parametrize(("text", "says"), FAULTS)
def test_a_fault_is_named_with_what_would_be_right(tmp_path, capsys, text, says):
    file = tmp_path / "bad.toml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    for words in says:
        with pytest.raises(ParameterError, match=words) as caught:
            read_vehicle(file)
    assert str(caught.value).startswith("vehicle file ")
    assert len(str(caught.value)) < 3000
    assert main(["vehicle", "check", str(file)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "Traceback" not in printed.err


LITERALS = (
    "1", "-1", "1e308", "nan", "-inf", "true", '"x"', "[]", "[[]]", "[[2, 2]]", "[0.0, 1]", "[0, [1]]", "[{}]", "{}", "{a = 1}",
    "1979-05-27T07:32:00Z", "0xffffffffffffffffffffffff", "''", "0.445", "43000", "[0, 1e-300]",
)  # fmt: skip


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.dictionaries(st.sampled_from(KEYS) | st.text(string.ascii_lowercase, min_size=1), st.sampled_from(LITERALS)),
    st.dictionaries(
        st.sampled_from(
            [f"{part}.{key}" for part, key in (("brake", "dead_time_s"), ("contact", "kalker_c11"), ("mass_kg", "x"))]
        ),
        st.sampled_from(LITERALS),
    ),
)
def test_absurd_values_give_a_vehicle_or_one_error(tmp_path, top, nested):
    file = tmp_path / "absurd.toml"
    file.write_text("".join(f"{key} = {value}\n" for key, value in (top | nested).items()), encoding="utf-8")
    try:
        vehicle = read_vehicle(file)
    except ParameterError as error:
        assert str(file) in str(error)  # noqa: PT017  # either is right
    else:
        assert figures(vehicle)


def test_what_a_file_leaves_out_is_the_coachs_and_told(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(GOOD + "[brake]\ndead_time_s = 0.1\n", encoding="utf-8")
    vehicle = read_vehicle(file)
    assert vehicle.brake == dataclasses.replace(COACH.brake, dead_time_s=0.1)
    assert vehicle.running_gear == ((3,),)
    out = left_out(file)
    assert not set(REQUIRED) & set(out)
    assert {"payload_kg", "brake.full_pressure_bar", "contact.kalker_c11"} <= set(out)
    assert "brake.dead_time_s" not in out


def test_one_function_finds_names_files_and_values(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(GOOD, encoding="utf-8")
    assert find_vehicle("coach") is COACH
    assert find_vehicle(str(file)) == find_vehicle(file) == read_vehicle(file)
    assert find_vehicle({"mass_kg": 1e4}, BOGIE) == dataclasses.replace(BOGIE, mass_kg=1e4)
    for given_, words in (("tram", "unknown vehicle 'tram'; valid: wheelset, bogie, coach, train, or a vehicle file"),
                          ("tram.toml", "tram.toml cannot be read"), (tmp_path, "cannot be read"), (7, "unknown vehicle 7"),
                          ({"mass_kg": 1.0}, "must be a name")):  # fmt: skip
        with pytest.raises(ParameterError, match=words):
            find_vehicle(given_)


def test_a_train_is_its_coaches_one_behind_the_other():
    three = train(COACH, 3)
    assert three.axles == 12
    assert three.axle_positions_m[4:8] == tuple(COACH.length_m + x for x in COACH.axle_positions_m)
    assert three.static_wheel_load_n == pytest.approx(COACH.static_wheel_load_n, rel=1e-15)
    assert deceleration_mps2(three, three.mass_kg) == pytest.approx(deceleration_mps2(COACH, COACH.mass_kg), rel=1e-14)
    assert train(COACH, 1) is COACH
    assert VEHICLES["train"] == train(COACH, 10)
    for coaches in (0, 17, 2.0, True, "ten"):
        with pytest.raises(ParameterError, match=r"coaches = .* is impossible: .* takes 1 to 16"):
            train(COACH, coaches)
    with pytest.raises(ParameterError, match="no train can be made"):
        train(dataclasses.replace(COACH, length_m=20.0), 2)


def test_figures_follow_from_the_parameters():
    found = {figure.name: figure.value for figure in figures(COACH)}
    assert found["axle load, laden"] == pytest.approx((43.0 + 6.0) / 4)
    force = 4 * 3.8 * 1500.0 / 0.445
    assert found["deceleration at full brake, empty"] == pytest.approx(force / (43_000.0 + 4 * 160.0 / 0.445**2))
    distance = stopping_distance_m(COACH, COACH.mass_kg, 120.0 / 3.6)
    assert found["braked weight percentage, empty"] == pytest.approx(83_634.0 / distance - 8.8)
    lag = COACH.brake.fill_time_constant_s
    at_ramp_end = 1.0 - lag / 4.0  # of the lagged ramp, once the start is forgotten
    assert filling_s(COACH.brake, 4.0) == pytest.approx(4.0 + lag * (0.95 - at_ramp_end) / at_ramp_end, abs=0.1)
    assert filling_s(COACH.brake, 1e-9) + COACH.brake.dead_time_s == pytest.approx(filling_s(COACH.brake, 0.0), abs=1e-6)
    assert any("3.95 for the ellipse" in sentence for sentence in remarks(COACH))


def test_the_value_of_c11_says_what_it_belongs_to():
    assert ContactParameters(poisson_ratio=0.25).table_c11 == pytest.approx(3.82, abs=0.01)
    assert ContactParameters(poisson_ratio=0.3).table_c11 == pytest.approx(4.05, abs=0.01)
    round_ = ContactParameters(semi_axis_a_m=0.006, semi_axis_b_m=0.006, poisson_ratio=0.25)
    assert round_.table_c11 == pytest.approx(round_.kalker_c11, abs=0.005)


def test_the_command_checks_shows_and_lists(tmp_path, capsys):
    assert main(["vehicle", "show", "coach"]) == 0
    text = capsys.readouterr().out
    file = tmp_path / "mine.toml"
    file.write_text(text, encoding="utf-8")
    assert read_vehicle(file) == COACH
    assert main(["vehicle", "check", str(file)]) == 0
    said = capsys.readouterr().out
    for words in ("4 axles (2'2')", "braked weight percentage", "m/s2", "time to 95% of full pressure"):
        assert words in said
    assert "Left out, so as the coach's: bodies" in said
    assert main(["vehicle", "check", str(file), "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert plain["axles"] == 4
    assert {"name", "value", "unit"} == set(plain["figures"][0])
    assert main(["vehicle", "show", "bogie", "--json"]) == 0
    assert find_vehicle(json.loads(capsys.readouterr().out), COACH) == BOGIE
    assert main(["vehicle", "list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(VEHICLES)
    assert main(["vehicle", "check", "tram"]) == 2
    assert "unknown vehicle 'tram'" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["check"], ["show"], ["list"]])
def test_help_teaches(arguments, capsys):
    with pytest.raises(SystemExit) as left:
        main(["vehicle", *arguments, "--help"])
    assert left.value.code == 0
    assert "vehicle" in capsys.readouterr().out
