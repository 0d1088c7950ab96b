"""What was found in the robot's runs, in tables and a picture."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.measured import lone, robot
from experiments.measured.files import ONE_SURFACE, TWO_SURFACES, one_surface, two_surfaces
from experiments.measured.page import pyplot, save, table
from experiments.measured.robot import Blocks, Surface
from wsp_env.diagnosis.terms import Chosen, Selection


class Case(NamedTuple):
    """A model of one surface, and runs from it or onto it."""

    pair: str
    model: str
    other: str


CASES = tuple(Case(pair, *order) for pair, ends in TWO_SURFACES.items() for order in (ends, ends[::-1]))


@dataclasses.dataclass(frozen=True)
class Report:
    """All runs and the models of the three surfaces."""

    alone: dict[str, list[Blocks]]  # runs on one surface
    across: dict[str, list[Blocks]]  # runs on two
    models: dict[str, Surface]
    mm_per_pixel: float

    @classmethod
    def of(cls, folder: Path) -> "Report":
        """Read all runs and identify the models."""
        ones = {name: one_surface(folder, name) for name in ONE_SURFACE}
        twos = {name: two_surfaces(folder, name) for name in TWO_SURFACES}
        mm = robot.scale([run for runs in (*ones.values(), *twos.values()) for run in runs])
        alone = {name: [robot.blocks(run, mm) for run in runs] for name, runs in ones.items()}
        across = {name: [robot.blocks(run, mm) for run in runs] for name, runs in twos.items()}
        return cls(alone, across, {name: robot.identify(name, runs) for name, runs in alone.items()}, mm)

    def blocks(self) -> dict[str, str]:
        """Return the tables."""
        return {
            "robot_models": self._models(),
            "robot_found": self._found(),
            "robot_place": self._place(),
            "robot_runs": self._runs(),
            "robot_null": self._null(),
        }

    def _models(self) -> str:
        rows = []
        for name, model in self.models.items():
            runs = self.alone[name]
            speeds = ", ".join(f"{one:g}" for one in model.speeds)
            force, slip = (float(np.mean([getattr(one, what).mean() for one in runs])) for what in ("force", "slip"))
            scatter = [f"{model.run_deviation:.2f} N", f"{model.row_deviation:.1f} N"]
            rows.append([name, str(len(runs)), f"{speeds} m/s", f"{force:.1f} N", *scatter, f"{100.0 * slip:.0f} %"])
        return table(["surface", "runs", "speeds", "force", "a run off the model", "a row off its run", "slip by camera"], rows)

    def _found(self) -> str:
        rows = []
        for case in CASES:
            model, runs = self.models[case.model], self.across[case.pair]
            data = robot.campaign(runs, model)
            found = robot.find(data, model)
            # Of the surfaces' own models, at the directions and speeds of these runs.
            own = float(np.mean([self.models[case.other].level(one) - model.level(one) for one in runs]))
            name = f"{case.pair.replace('_', ', ')}; model of the {case.model}"
            rows += [
                [name, f"{len(data.terms)}", *_words(one), f"{own:+.1f} N", *_left(data, one, model)] for one in found.chosen
            ]
            rows.append([name, "", _stopped(found), *[""] * 5])
        head = [
            "runs; model",
            "candidates",
            "found",
            "change",
            "size",
            "between the models",
            "held-out reduction",
            "rms held out",
        ]
        return table(head, rows)

    def _place(self) -> str:
        rows = []
        for pair, (first, _) in TWO_SURFACES.items():
            runs = self.across[pair]
            slip = lone.border(runs, [one.slip for one in runs])[0]
            force = lone.border(runs, [one.force - self.models[first].level(one) for one in runs])[0]
            off = (force - slip) * self.mm_per_pixel / 10.0
            rows.append([pair.replace("_", ", "), f"x = {slip:.0f}", f"x = {force:.0f}", f"{off:+.1f} cm"])
        return table(["runs", "border by slip", "border by force", "difference"], rows)

    def _runs(self) -> str:
        rows = []
        for case in CASES:
            runs, model = self.across[case.pair], self.models[case.model]
            level = lone.level_of(lone.null(case.model, self.alone[case.model]))
            found = [lone.change(one, model) for one in runs]
            # The border as the other runs' slip shows it.
            others = [[one for one in runs if one is not run] for run in runs]
            line = np.array([lone.border(rest, [one.slip for one in rest])[0] for rest in others])
            crossed = [lone.crossings(run, at) for run, at in zip(runs, line, strict=True)]
            own = [lone.crossings(run, one.line) for run, one in zip(runs, found, strict=True)]
            crosses = np.array([np.isfinite(one).any() for one in crossed])
            off = np.abs([one.line for one in found] - line)[crosses] * self.mm_per_pixel / 10.0
            path = np.abs(np.array(own) - np.array(crossed))
            seen, all_crossings = np.isfinite(path), int(np.isfinite(crossed).sum())
            change = np.median([one.change for one, yes in zip(found, crosses, strict=True) if yes])
            name = f"{case.pair.replace('_', ', ')}; model of the {case.model}"
            detected = sum(one.reduction > level for one in found)
            where = [f"{np.median(off):.1f} cm", f"{np.quantile(off, 0.9):.1f} cm", f"{np.median(path[seen]):.1f} cm"]
            rows.append(
                [
                    name,
                    f"{detected} of {len(runs)}",
                    f"{crosses.sum()}",
                    *where,
                    f"{seen.sum()} of {all_crossings}",
                    f"{change:+.1f} N",
                ]
            )
        head = [
            "runs; model",
            "change found",
            "runs that cross",
            "off the border, median",
            "9 of 10 within",
            "along the path, median",
        ]
        return table([*head, "crossings seen", "change, median"], rows)

    def _null(self) -> str:
        rows: list[list[str]] = []
        alarms, every = 0, []
        for name, runs in self.alone.items():
            found = lone.null(name, runs)
            mine = lone.false_alarms(found)
            alarms += mine
            halves = []
            for half in (0, 1):
                model = robot.identify(name, runs[half::2])
                chosen = robot.find(robot.campaign(runs[1 - half :: 2], model), model).chosen
                every.append(chosen)
                halves.append("; ".join(f"{one.term.name}, {_change(one)}" for one in chosen) or "nothing")
            speeds = ", ".join(f"{one:g}" for one in self.models[name].speeds)
            rate = f"{mine} of {len(runs)} ({100.0 * mine / len(runs):.1f} %)"
            rows.append([name, f"{speeds} m/s", rate, *halves])
        count = sum(len(runs) for runs in self.alone.values())
        runs_alone = f"Runs alone: {alarms} of {count} ({100.0 * alarms / count:.1f} %) are false alarms."
        searches = f"Searches: {sum(bool(one) for one in every)} of {len(every)} accept a term."
        head = ["surface", "speeds", "false alarms, runs alone", "search, one half", "search, other half"]
        return table(head, rows) + f"\n{runs_alone} {searches}\n"

    def draw(self, docs: Path) -> None:
        """Draw where the force is what, and one run along its path."""
        plt = pyplot()
        figure, panels = plt.subplots(1, 3, figsize=(12.0, 3.8))
        for axes, (pair, ends) in zip(panels, TWO_SURFACES.items(), strict=False):
            self._map(axes, pair, *ends)
        self._along(panels[2], "table_gray", "table", "gray")
        figure.tight_layout()
        save(plt, figure, docs, "robot")

    def _map(self, axes: Any, pair: str, first: str, other: str) -> None:
        runs = self.across[pair]
        here, there = self.models[first], self.models[other]
        share = np.concatenate([(one.force - here.level(one)) / (there.level(one) - here.level(one)) for one in runs])
        place = np.concatenate([one.place for one in runs])
        dots = axes.scatter(*place.T, c=share, s=3, vmin=0.0, vmax=1.0, cmap="viridis")
        slip = lone.border(runs, [one.slip for one in runs])[0]
        axes.axvline(slip, color="black", linewidth=1.0)
        axes.invert_yaxis()
        axes.set(xlabel="x [pixel]", ylabel="y [pixel]", title=f"{pair.replace('_', ', ')}: force, 0 {first}, 1 {other}")
        axes.figure.colorbar(dots, ax=axes)

    def _along(self, axes: Any, pair: str, first: str, other: str) -> None:
        """Draw the run in which most wheels cross the border, about the model and with what was found."""
        runs, model = self.across[pair], self.models[first]
        chosen = robot.find(robot.campaign(runs, model), model, most=1).chosen
        x = chosen[0].term.columns @ chosen[0].amplitude if chosen else np.zeros(sum(len(one.time) for one in runs))
        column = np.split(x * model.row_deviation, np.cumsum([len(one.time) for one in runs])[:-1])
        line = lone.border(runs, [one.slip for one in runs])[0]
        held = np.flatnonzero(robot.held_out(runs))
        best = max(held, key=lambda i: (np.isfinite(lone.crossings(runs[i], line)).sum(), np.ptp(runs[i].path)))
        run = runs[best]
        axes.plot(run.path, run.force, color="0.7", linewidth=0.8, label="measured")
        axes.axhline(model.level(run), color="C0", label=f"model of the {first}")
        axes.plot(
            run.path,
            model.level(run) + column[best],
            color="C1",
            label="with what was found",
        )
        axes.axhline(self.models[other].level(run), color="C2", linestyle=":", label=f"model of the {other}")
        for at in lone.crossings(run, line):
            axes.axvline(at, color="black", linewidth=0.6)
        axes.set(xlabel="path [cm]", ylabel="force [N]", title=f"{pair.replace('_', ', ')}, {run.name}, held out")
        axes.legend(fontsize=7)


def _change(one: Chosen) -> str:
    error = np.sqrt(np.diag(one.covariance))
    return ", ".join(f"{a:+.1f} ± {e:.1f} N" for a, e in zip(one.amplitude, error, strict=True))


def _words(one: Chosen) -> list[str]:
    also = f" (or {', '.join(one.alternatives)})" if one.alternatives else ""
    return [one.term.name + also, _change(one), f"{one.multiple:.1f}"]


def _left(data: robot.Campaign, one: Chosen, model: Surface) -> list[str]:
    """Held-out reduction with its error, and the rms of the held-out rows before and after [N]."""
    rest = data.residual - one.term.columns @ one.amplitude
    before, after = (float(np.sqrt(np.mean(x[data.held_out] ** 2))) * model.row_deviation for x in (data.residual, rest))
    held = one.reduction_held_out
    return [f"{100.0 * one.removed:.0f} % ({held.total:.0f} ± {held.error:.0f})", f"{before:.1f}, then {after:.1f} N"]


def _stopped(found: Selection) -> str:
    refused = f": {found.refused.term.name}" if found.refused else ""
    return f"stops: {found.why}{refused}"
