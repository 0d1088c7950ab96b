"""From a trained network to a policy folder that anybody can run; `agents.train` writes one at its end, and is the command."""

import dataclasses
import hashlib
import json
import logging
import tempfile
import warnings
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution, MultiCategoricalDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecNormalize

import wsp_env
from agents.steering import Steering
from agents.worlds import CUT_OUT_MPS, REFERENCE, observed
from wsp_env.envs.task import Task
from wsp_env.evaluation.network import INPUT, MEMORY_INPUT, MEMORY_OUTPUT
from wsp_env.evaluation.policy import (
    CONTRACT,
    CONTRACT_VERSION,
    NETWORK,
    OUTPUTS,
    Contract,
    describe_measurement,
    describe_observation,
    observer_constants,
)
from wsp_env.observer.estimate import full_brake
from wsp_env.observer.observation import Observer
from wsp_env.parameters.uic_z1 import VEHICLES

#: Largest difference of the exported network from the trained one over random observations [-].
AGREEMENT = 1e-5


class ExportedPolicy(torch.nn.Module, ABC):
    """What is exported: normalisation, clipping, the policy's network, the choice of the command and the cut-out.

    A subclass has `forward`, from observations (N, size) and the memory of a network that has one.
    """

    mean: torch.Tensor
    deviation: torch.Tensor

    def __init__(self, policy: ActorCriticPolicy, normalisation: VecNormalize, steering: Steering | None = None) -> None:
        super().__init__()
        statistics = observed(normalisation)
        self.register_buffer("mean", torch.tensor(statistics.mean, dtype=torch.float32))
        self.register_buffer("deviation", torch.tensor(np.sqrt(statistics.var + normalisation.epsilon), dtype=torch.float32))
        self.bound = float(normalisation.clip_obs)
        self.steering = steering
        self.valve = isinstance(policy.action_space, spaces.MultiDiscrete)
        self.mlp_extractor = policy.mlp_extractor
        self.action_net = policy.action_net
        self.memory = 0  # numbers that it keeps from one decision to the next

    def normal(self, observation: torch.Tensor) -> torch.Tensor:
        """Return normalised observations (N, size)."""
        return torch.clamp((observation - self.mean) / self.deviation, -self.bound, self.bound)

    def raw(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the last layer (N, L) of a network without memory from observations (N, size)."""
        last: torch.Tensor = self.action_net(self.mlp_extractor.forward_actor(self.normal(observation)))
        return last

    def decided(self, observation: torch.Tensor, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return commands (N, axles) and the last layer from observations and what the layers are fed (N, features)."""
        raw = self.action_net(self.mlp_extractor.forward_actor(features))
        if self.valve:
            command = torch.argmax(raw.reshape(raw.shape[0], -1, 3), dim=2).to(torch.float32) - 1.0
        elif self.steering:
            command = self.steering.commands(observation, raw)
        else:
            command = torch.clamp(raw, -1.0, 1.0)
        slow = observation[:, REFERENCE : REFERENCE + 1] < CUT_OUT_MPS / Observer.SPEED_SCALE
        return torch.where(slow, 1.0, command), raw

    def infer(self, observation: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return commands and memory as the exported network would."""
        inputs = (observation, memory) if self.memory else (observation,)
        with torch.no_grad():
            found = [part.numpy() for part in self(*map(torch.as_tensor, inputs))]
        return found[0], found[2] if self.memory else memory

    @abstractmethod
    def distribution(self, policy: ActorCriticPolicy, normal: torch.Tensor, memory: torch.Tensor) -> Distribution:
        """Return the distribution of actions by SB3's own way from normalised observations."""


class Actor(ExportedPolicy):
    """A policy without memory."""

    def forward(self, observation: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return commands (N, axles) and the last layer from observations (N, size)."""
        return self.decided(observation, self.normal(observation))

    def distribution(self, policy: ActorCriticPolicy, normal: torch.Tensor, memory: torch.Tensor) -> Distribution:
        """Return the distribution of actions by SB3's own way from normalised observations."""
        return policy.get_distribution(normal)


def disagreement(
    policy: ActorCriticPolicy,
    normalisation: VecNormalize,
    actor: ExportedPolicy,
    given: tuple[np.ndarray, ...],
    raw: np.ndarray,
) -> float:
    """Return the largest difference of SB3's own distribution of actions from an exported last layer (N, L).

    Of valves the log-probabilities are compared (logits have a free constant), of pressures, also those wanted, the means.
    `given` are the observations, and the memory of a network that has one.
    """
    with torch.no_grad():
        normal = torch.as_tensor(normalisation.normalize_obs(given[0]))
        own = actor.distribution(policy, normal, torch.as_tensor(given[-1]))
    if not isinstance(own, MultiCategoricalDistribution):
        return float(np.abs(own.mode().numpy() - raw).max())
    logits = np.concatenate([axle.logits.numpy() for axle in own.distribution], axis=1)
    exported = torch.log_softmax(torch.as_tensor(raw).reshape(len(raw), -1, 3), dim=2).reshape(raw.shape)
    return float(np.abs(logits - exported.numpy()).max())


def describe(
    vehicle: str,
    task: Task,
    limits: dict[str, Any] | None = None,
    training: dict[str, Any] | None = None,
    sha256: str = "",
    memory: int = 0,
) -> Contract:
    """Return the contract of a policy trained for a task."""
    axles = VEHICLES[vehicle].axles
    return Contract(
        contract=CONTRACT_VERSION,
        wsp_env=wsp_env.__version__,
        vehicle=vehicle,
        axles=axles,
        control_interval_s=task.control_interval_s,
        action=task.action,
        pressure_sensors=task.pressure_sensors,
        measurement=describe_measurement(axles, task.pressure_sensors),
        observation=describe_observation(axles, task.pressure_sensors),
        observer=observer_constants(),
        output=OUTPUTS | (MEMORY_OUTPUT if memory else {}),
        limits=limits or {},
        training=training or {},
        sha256=sha256,
    )


def export(
    policy: ActorCriticPolicy,
    normalisation: VecNormalize,
    actor: ExportedPolicy,
    vehicle: str,
    task: Task,
    folder: Path,
    training: dict[str, Any],
) -> float:
    """Write network and contract; return the largest difference from the trained policy over random observations.

    `RuntimeError` if they differ by more than `AGREEMENT`: nothing is written then.
    """
    import onnxruntime

    actor.eval()
    sizes = [len(describe_observation(VEHICLES[vehicle].axles, task.pressure_sensors)), actor.memory]
    names = [INPUT, MEMORY_INPUT][: 2 if actor.memory else 1]
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # else it tells that torchvision, which is not needed, is missing
    with tempfile.TemporaryDirectory() as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter warns of itself
        path = Path(temporary) / NETWORK
        torch.onnx.export(
            actor,
            tuple(torch.zeros(2, size) for _, size in zip(names, sizes, strict=False)),
            path,
            input_names=names,
            output_names=[*OUTPUTS, *MEMORY_OUTPUT][: 1 + len(names)],
            dynamic_shapes=({0: torch.export.Dim("N")},) * len(names),
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        content = without_traces(path.read_bytes())
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    given = {name: rng.normal(0.0, 1.0, (1000, size)).astype(np.float32) for name, size in zip(names, sizes, strict=False)}
    difference = disagreement(policy, normalisation, actor, tuple(given.values()), session.run(["raw"], given)[0])
    if difference > AGREEMENT:
        raise RuntimeError(f"the exported network differs from the trained one by {difference:.2g}")
    limits = dataclasses.asdict(task.distributions) | {"mechanisms": task.mechanisms}
    limits["full_brake_adhesion"] = round(full_brake(task.make_vehicle(vehicle)), 4)
    contract = describe(vehicle, task, limits, training, hashlib.sha256(content).hexdigest(), actor.memory)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / NETWORK).write_bytes(content)
    (folder / CONTRACT).write_text(json.dumps(dataclasses.asdict(contract), indent=2) + "\n", encoding="utf-8")
    return difference


def without_traces(content: bytes) -> bytes:
    """Return a network without what the exporter notes of its making: file names and line numbers of this machine."""
    import onnx

    model = onnx.load_from_string(content)
    model.doc_string = model.graph.doc_string = ""
    parts = [model.graph, *model.functions]
    for holder in [model, *parts, *(node for part in parts for node in part.node)]:
        del holder.metadata_props[:]
    for node in (node for part in parts for node in part.node):
        node.doc_string = ""
    for value in [*model.graph.input, *model.graph.output, *model.graph.value_info, *model.graph.initializer]:
        del value.metadata_props[:]
    return bytes(model.SerializeToString())
