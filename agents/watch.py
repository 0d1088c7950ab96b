"""What a training is watched by: the same few stops for the policy and for the rule-based WSP."""

from agents.export import ExportedPolicy, describe
from agents.measure import WATCHED, Yardstick, low_adhesion, means
from wsp_env.envs.task import Task
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.policy import Policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.parameters.uic_z1 import VEHICLES

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

    def look(self, actor: ExportedPolicy) -> dict[str, float]:
        """Return the policy's figures by law, and their ratios to those of the rules."""
        own = self.means(Policy(describe(self.vehicle, self.task), actor.infer, actor.memory))
        found = {"score": self.score(own)}
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

    def means(self, controller: Controller) -> dict[str, dict[str, float]]:
        """Return a controller's figures, by law."""
        found = self.yardstick.figures(controller)
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
        return f"score {row['score']:.3f}, of the rules' " + "; ".join(laws)

    def briefly(self, curve: list[dict[str, float]]) -> str:
        """Return the stopping distances of the last row in words."""
        if not curve:
            return "not yet watched"
        return "of the rules' distance: " + ", ".join(f"{law} {curve[-1][f'{law}_distance_m_ratio']:.3f}" for law in self.rules)
