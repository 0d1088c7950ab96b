"""The state of a training between two segments, written whole or not at all; arrays only, nothing is pickled."""

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

#: Files of a run's folder: the last state, and the one with the best score so far.
CHECKPOINT, BEST = "checkpoint.npz", "best.npz"


def save(
    path: Path, model: OnPolicyAlgorithm, normalisation: VecNormalize, segment: int, curve: list[dict[str, float]]
) -> None:
    """Write weights, optimiser, normalisation, counters and the curve so far, after `segment` segments."""
    arrays: dict[str, Any] = {"segment": segment, "steps": model.num_timesteps, "updates": model._n_updates}
    for name, value in model.policy.state_dict().items():
        arrays[f"weight/{name}"] = value.numpy()
    for index, state in model.policy.optimizer.state_dict()["state"].items():
        for name, value in state.items():
            arrays[f"optimiser/{index}/{name}"] = value.numpy()
    for name, statistics in (("observation", normalisation.obs_rms), ("return", normalisation.ret_rms)):
        for part in ("mean", "var", "count"):
            arrays[f"normalisation/{name}/{part}"] = getattr(statistics, part)
    for name in curve[0] if curve else ():
        arrays[f"curve/{name}"] = np.array([row[name] for row in curve])
    write(path, arrays)


def write(path: Path, arrays: dict[str, Any]) -> None:
    """Write an npz file at once: whoever is killed meanwhile leaves the old one."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **arrays)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def load(path: Path, model: OnPolicyAlgorithm, normalisation: VecNormalize) -> tuple[int, list[dict[str, float]]]:
    """Put a checkpoint, if there is one, into model and normalisation; return segments done and the curve so far."""
    if not path.exists():
        return 0, []
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    model.policy.load_state_dict(
        {name[7:]: torch.tensor(value) for name, value in arrays.items() if name.startswith("weight/")}
    )
    optimiser = model.policy.optimizer.state_dict()
    optimiser["state"] = {}
    for name, value in arrays.items():
        if name.startswith("optimiser/"):
            _, index, part = name.split("/")
            optimiser["state"].setdefault(int(index), {})[part] = torch.tensor(value)
    model.policy.optimizer.load_state_dict(optimiser)
    for name, statistics in (("observation", normalisation.obs_rms), ("return", normalisation.ret_rms)):
        for part in ("mean", "var", "count"):
            value = arrays[f"normalisation/{name}/{part}"]
            setattr(statistics, part, value if value.ndim else float(value))
    model.num_timesteps, model._n_updates = int(arrays["steps"]), int(arrays["updates"])
    columns = {name[6:]: value for name, value in arrays.items() if name.startswith("curve/")}
    rows = [dict(zip(columns, map(float, row), strict=True)) for row in zip(*columns.values(), strict=True)]
    return int(arrays["segment"]), rows
