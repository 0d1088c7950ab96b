"""What a training is watched by: the same few stops for the policy and for the rule-based WSP."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from agents.drawn import Believing, under, world
from agents.export import ExportedPolicy, describe
from agents.measure import WATCHED, Yardstick, means
from agents.teacher import ideal, taught
from wsp_env.envs.task import Task
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.policy import Policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.parameters.uic_z1 import VEHICLES

#: A stop that is watched ends after so long [s]: what a beginner needs minutes for is bad enough.
GIVEN_UP = Conduct(time_limit_s=120.0)

LAWS = ("recovering", "classic")


class Watch:
    """Compares the policy with the rule-based WSP on a few stops as it learns.

    Parameters
    ----------
    slide_price : metres travelled that a metre of sliding is worth
    classic_share : weight of the stops under the classic law
    count : stops under each law, of each world
    varied : they are those of three worlds, see `agents.drawn.world`; else of the first alone

    """

    def __init__(
        self, vehicle: str, task: Task, slide_price: float, classic_share: float, count: int, varied: bool = False
    ) -> None:  # fmt: skip
        self.vehicle, self.task = vehicle, task
        self.slide_price, self.classic_share = slide_price, classic_share
        self.believed = VEHICLES[vehicle]
        self.parts, of_law = list[Yardstick](), list[str]()
        for name in ("nominal", "drawn brakes", "all") if varied else ("nominal",):
            found = [world(name, under(self.believed, law), law, count, WATCHED) for law in LAWS]
            for each in zip(*found, strict=True):  # both laws on the same vehicle
                own, mechanisms, _ = each[0]
                stops = [(stop, law) for law, (_, _, some) in zip(LAWS, each, strict=True) for stop in some]
                conduct = dataclasses.replace(GIVEN_UP, mechanisms=mechanisms)
                self.parts.append(Yardstick(own, [stop for stop, _ in stops], conduct))
                of_law += [law for _, law in stops]
        self.rows = {law: np.array(of_law) == law for law in LAWS}
        self.rules = self.means(load("rule-based"))
        self.marks = self._marks()

    def look(self, actor: ExportedPolicy) -> dict[str, float]:
        """Return the policy's figures by law, and their ratios to those of the rules."""
        own = self.means(Policy(describe(self.vehicle, self.task), actor.infer, actor.memory))
        found = {"score": self.score(own)} | self.marks
        for law, figures in own.items():
            for name in ("distance_m", "mean_slip_mps", "slip_deviation_mps", "contact_energy_mj", "air_nl"):
                found[f"{law}_{name}_ratio"] = figures[name] / self.rules[law][name]
                found[f"{law}_{name}"] = figures[name]
            found |= {f"{law}_locked_s": figures["locked_s"], f"{law}_ran_on": figures["ran_on"]}
        return found

    def score(self, own: dict[str, dict[str, float]]) -> float:
        """Return what training is after, over the same of the rules: metres travelled plus the price of those slid.

        The laws count by their share; a stop that ran on counts as one more.
        """
        shares = {"recovering": 1.0 - self.classic_share, "classic": self.classic_share}
        return sum(
            share * (self._paid(own[law]) / self._paid(self.rules[law]) + own[law]["ran_on"]) for law, share in shares.items()
        )

    def _paid(self, figures: dict[str, float]) -> float:
        return figures["distance_m"] + self.slide_price * figures["slide_distance_m"]

    def _marks(self) -> dict[str, float]:
        """Return the scores of the teacher and of the ideal stop, and the bound of the distance by law, over the rules'."""
        found = _joined([part.judged(taught(part.vehicle, part.stops, self.slide_price, part.conduct)) for part in self.parts])
        limit = GIVEN_UP.time_limit_s
        each = [np.array(ideal(part.vehicle, part.stops, self.slide_price, limit)) for part in self.parts]
        way, slid = np.concatenate(each, axis=1)
        perfect = {
            law: {"distance_m": way[rows].mean(), "slide_distance_m": slid[rows].mean(), "ran_on": 0.0}
            for law, rows in self.rows.items()
        }
        bound = np.concatenate([part.top.shortest()[0] for part in self.parts])
        marks = {"teacher_score": self.score(self._by_law(found)), "ideal_score": self.score(perfect)}
        return marks | {
            f"{law}_bound_ratio": float(bound[rows].mean()) / self.rules[law]["distance_m"] for law, rows in self.rows.items()
        }

    def means(self, controller: Controller) -> dict[str, dict[str, float]]:
        """Return the figures of a controller that is told the nominal vehicle, by law."""
        return self._by_law(_joined([part.figures(Believing(controller, self.believed)) for part in self.parts]))

    def _by_law(self, found: Mapping[str, np.ndarray]) -> dict[str, dict[str, float]]:
        return {law: means({name: values[rows] for name, values in found.items()}) for law, rows in self.rows.items()}

    def words(self, curve: list[dict[str, float]]) -> str:
        """Return the last row of a curve in words."""
        row = curve[-1]
        laws = (
            f"{law}: distance x{row[f'{law}_distance_m_ratio']:.3f}, slip x{row[f'{law}_mean_slip_mps_ratio']:.2f}, "
            f"energy x{row[f'{law}_contact_energy_mj_ratio']:.2f}, locked {row[f'{law}_locked_s']:.1f} s, "
            f"{row[f'{law}_ran_on']:.0%} ran on"
            for law in self.rules
        )
        bounds = ", ".join(f"{law} x{row[f'{law}_bound_ratio']:.3f}" for law in self.rules)
        marks = f"(teacher {row['teacher_score']:.3f}, ideal {row['ideal_score']:.3f}, bound of the distance {bounds})"
        return f"score {row['score']:.3f} {marks}, of the rules' " + "; ".join(laws)

    def runs_on(self, row: Mapping[str, float]) -> str:
        """Return a warning where a policy does not come to a stand in watched stops that the rules end; empty else."""
        worse = [
            f"{row[f'{law}_ran_on']:.0%} of the watched stops under the {law} law (the rules: {rules['ran_on']:.0%})"
            for law, rules in self.rules.items()
            if row[f"{law}_ran_on"] > rules["ran_on"]
        ]
        limit = f"after {GIVEN_UP.time_limit_s:g} s it still runs in "
        return f"WARNING: this policy runs on: {limit}{', '.join(worse)}" if worse else ""

    def briefly(self, curve: list[dict[str, float]]) -> str:
        """Return the stopping distances of the last row in words."""
        if not curve:
            return "not yet watched"
        return "of the rules' distance: " + ", ".join(f"{law} {curve[-1][f'{law}_distance_m_ratio']:.3f}" for law in self.rules)


def _joined(found: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([own[name] for own in found]) for name in found[0]}
