"""Gymnasium environments on the plant; importing this package registers them."""

import gymnasium as gym

#: The ids with the vehicle of each.
IDS = {
    "wsp_env/Wheelset-v1": "wheelset",
    "wsp_env/Bogie-v1": "bogie",
    "wsp_env/Coach-v1": "coach",
    "wsp_env/Train-v1": "train",
}

# A train is so many coaches, whose first wheels clean the rail for the last.
_OPTIONS = {"train": {"vehicle_name": "coach", "coaches": 10, "mechanisms": {"leading_axle_cleaning": {}}}}

for _id, _vehicle in IDS.items():
    if _id not in gym.registry:
        gym.register(
            _id,
            entry_point="wsp_env.envs.single:BrakingEnv",
            vector_entry_point="wsp_env.envs.vector:BrakingVectorEnv",
            kwargs=_OPTIONS.get(_vehicle, {"vehicle_name": _vehicle}),
        )
