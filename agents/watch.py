"""What a training is watched by: the same few stops for the policy and for the rule-based WSP."""

from collections.abc import Mapping

import numpy as np

from agents.export import ExportedPolicy, describe
from agents.measure import WATCHED, Yardstick, low_adhesion, means
from agents.teacher import ideal, taught
from wsp_env.envs.task import Task
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.policy import Policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle

#: A stop that is watched ends after so long [s]: what a beginner needs minutes for is bad enough.
GIVEN_UP = Conduct(time_limit_s=120.0)


class Watch:
    """Compares the policy with the rule-based WSP on a few stops as it learns.

    Parameters
    ----------
    slide_price : metres travelled that a metre of sliding is worth
    classic_share : weight of the stops under the classic law
    count : stops under each law

    """

    def __init__(self, vehicle: str, task: Task, slide_price: float, classic_share: float, count: int) -> None:
        self.vehicle, self.task = vehicle, task
        self.slide_price, self.classic_share = slide_price, classic_share
        kind = VEHICLES[vehicle]
        laws = {law: low_adhesion(kind, law, count, WATCHED) for law in ("recovering", "classic")}
        self.rows = {law: slice(count * i, count * (i + 1)) for i, law in enumerate(laws)}
        self.yardstick = Yardstick(self.vehicle, [stop for stops in laws.values() for stop in stops], GIVEN_UP)
        self.rules = self.means(load("rule-based"))
        self.marks = self._marks(kind)

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

    def _marks(self, vehicle: Vehicle) -> dict[str, float]:
        """Return the scores of the teacher and of the ideal stop, and the bound of the distance by law, over the rules'."""
        stops = self.yardstick.stops
        found = self.yardstick.judged(taught(vehicle, stops, self.slide_price, GIVEN_UP))
        way, slid = ideal(vehicle, stops, self.slide_price, GIVEN_UP.time_limit_s)
        perfect = {
            law: {"distance_m": way[rows].mean(), "slide_distance_m": slid[rows].mean(), "ran_on": 0.0}
            for law, rows in self.rows.items()
        }
        bound = self.yardstick.top.shortest()[0]
        marks = {"teacher_score": self.score(self._by_law(found)), "ideal_score": self.score(perfect)}
        return marks | {
            f"{law}_bound_ratio": float(bound[rows].mean()) / self.rules[law]["distance_m"] for law, rows in self.rows.items()
        }

    def means(self, controller: Controller) -> dict[str, dict[str, float]]:
        """Return a controller's figures, by law."""
        return self._by_law(self.yardstick.figures(controller))

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
        limit = f"after {self.yardstick.conduct.time_limit_s:g} s it still runs in "
        return f"WARNING: this policy runs on: {limit}{', '.join(worse)}" if worse else ""

    def briefly(self, curve: list[dict[str, float]]) -> str:
        """Return the stopping distances of the last row in words."""
        if not curve:
            return "not yet watched"
        return "of the rules' distance: " + ", ".join(f"{law} {curve[-1][f'{law}_distance_m_ratio']:.3f}" for law in self.rules)
