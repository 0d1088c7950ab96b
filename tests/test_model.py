"""`gym.make(..., model="model.json")`: the law and mechanisms that a diagnosis found."""

import json

import gymnasium as gym
import pytest

import wsp_env  # noqa: F401  # registers the environments
from wsp_env.parameters.quantity import ParameterError

MODEL = {
    "tau_m_per_J": 2.5e-4,
    "mu_cd": {"A1": 0.05, "A2": 0.04},
    "contact": {"kinetic_friction_r": 0.3},
    "mechanisms": {"leading_axle_cleaning": {"removal_m_per_j": 1.5e-5}},
    "note": "of whoever wrote it",
}


def write(tmp_path, document):
    path = tmp_path / "model.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document), encoding="utf-8")
    return str(path)


def test_the_environment_brakes_with_the_tuned_law_and_the_found_mechanisms(tmp_path):
    env = gym.make("wsp_env/Bogie-v1", model=write(tmp_path, MODEL))
    plant = env.unwrapped.batch.plant
    assert plant.setup.mechanisms == {"leading_axle_cleaning": {"removal_m_per_j": 1.5e-5}}
    assert plant.vehicle.contact.law.mu_cr == 0.3
    for seed in range(5):
        _, info = env.reset(seed=seed)
        assert info["tau_m_per_j"] == pytest.approx(2.5e-4, rel=1e-12)
        assert 0.04 <= info["mu_cd"] <= 0.05
    again = gym.make(type(env.spec).from_json(env.spec.to_json()))
    assert again.unwrapped.batch.plant.vehicle.contact.law == plant.vehicle.contact.law


def test_options_given_by_hand_go_before_the_model(tmp_path):
    env = gym.make("wsp_env/Bogie-v1", model=write(tmp_path, MODEL), mechanisms={"leading_axle_cleaning": {}})
    assert env.unwrapped.batch.plant.setup.mechanisms == {"leading_axle_cleaning": {}}


@pytest.mark.parametrize(
    ("document", "says"),
    [
        ("{", "is not JSON"),
        ("[]", "must hold an object"),
        ("{}", "is empty; it holds any of tau_m_per_J"),
        ({"mechanism": {"load_transfer": {}}}, "'mechanism' unknown; valid: tau_m_per_J"),
        ({"verdict": "adequate", "mechanisms": []}, "is the answer of a diagnosis; give the model.json beside it"),
        ({"mu_cd": 0.05}, "mu_cd = 0.05 must be an object"),
        ({"tau_m_per_J": "big"}, "must be a number"),
        ({"mechanisms": {"sandstorm": {}}}, "unknown mechanism sandstorm"),
        ({"contact": {"colour": 1}}, "unknown vehicle parameter contact: colour"),
    ],
)
def test_a_wrong_model_is_refused(tmp_path, document, says):
    with pytest.raises(ParameterError, match=says):
        gym.make("wsp_env/Bogie-v1", model=write(tmp_path, document))


def test_a_missing_model_is_named():
    with pytest.raises(ParameterError, match="cannot be read"):
        gym.make("wsp_env/Bogie-v1", model="no such file.json")
