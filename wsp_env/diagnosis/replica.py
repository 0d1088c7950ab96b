"""The replica of a campaign: the recording without noise that the baseline predicts for the recorded stops.

Recorded slip and force are noisy, and so is everything computed from them. If a change of the model is evaluated on noisy
channels, its noise is correlated with that of the residual, and a fit explains noise. Residuals are therefore computed from the
recordings only once, at the baseline. Every change of the model is evaluated on the replica (an instrumental variable in
regression with errors in variables). The replica keeps the estimated speed and, where a wheel slides, its creepage. On the
steep part of the creep curve, the measured slip is mostly noise. There the replica's slip is the one at which the baseline
gives the recorded force. For the same reason the residual is linear in measured slip minus replica slip. Friction turns the
wheel and the WSP reacts. Changes of the model are therefore evaluated at slip and torque predicted before each block of time
(`wsp_env.diagnosis.loop`); the residuals of the recordings are evaluated at the actual slip. Changes of a delay, and of play in
a brake, show in the torque's own course and are evaluated under the recorded torque.

A replica of a mechanism also needs the mechanism's effect on the recordings at the actual slips and torques. That effect
differs from the one at the predicted slips by an unpredicted part: what friction and WSP did within the block. The library's
mechanisms of brakes and vehicle act on measured torques at once. But whether friction and wheel loads change as fast as in the
library is a question of form (a load may follow each wheel's force, or only the vehicle's deceleration), and of terms for
unknown physics nothing is known. `Replica.unpredicted` is this part for contact and terms, and
`wsp_env.diagnosis.baseline.replica_of` estimates which share of it the recordings show.
"""

import copy
import dataclasses
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.diagnosis.balances import ADHESION, Balances, Blocks, Rows, Whitening
from wsp_env.diagnosis.evaluate import Choice, Evaluation, Evaluator, Model
from wsp_env.diagnosis.loop import predicted, prompt_gain
from wsp_env.diagnosis.readings import correct_readings, misread_wheels, on_sensors, readings_of, simulate_readings
from wsp_env.diagnosis.replica_slips import braked, larger_radii, required_slips, rolling, true_slips
from wsp_env.diagnosis.stops import PreparedStop
from wsp_env.diagnosis.thinning import averaged
from wsp_env.plant.mechanisms import ALL, discovered
from wsp_env.plant.mechanisms.terms import Feature

#: Share kept of the measured slip from which on a wheel slides: its friction, not its slip, fluctuates with load and rail.
_SLIDES = 0.5
OF_TIME = tuple(name for name, card in ALL.items() if any(one.unit == "s" and one.fitted for one in card.sizes))
#: Features that follow the course of the torque, as delays do.
OF_TORQUE = frozenset({float(Feature.TORQUE_MEMORY), float(Feature.TORQUE_PLAY)})


class Replica:
    """The balances of recorded stops about a baseline; has the interface of `Balances`.

    Errors of smoothing are the same in the wheel rows of replica and recordings; they are subtracted.

    If a model says that speeds are read late or wrong, the recordings are corrected first, and the replica contains the
    readings of such sensors. With a wrong wheel radius, the reading is right and stays in the replica; the radius determines
    where the wheel slides.
    """

    def __init__(self, recorded: Balances, model: Model) -> None:
        readings = readings_of(model)
        rest = _choosing(model, lambda name: name not in readings)
        baseline = without_sensors(rest)
        self.recorded, self.about, self.baseline = recorded, model, baseline
        self._readings: Choice = {}
        campaign = recorded.campaign
        right = recorded.like(correct_readings(campaign, recorded.sources, readings)) if readings else recorded
        larger, misread = larger_radii(right, baseline), misread_wheels(model, recorded.axles)
        wrong = (larger != 0.0) | misread  # wheels whose sensor does not show their slip
        evaluator = Evaluator(campaign, right.sources)
        found = evaluator(baseline)
        true = true_slips(found, found if rest is baseline else evaluator(rest), right.sources, np.where(misread, 0.0, larger))
        needed, kept = required_slips(right, evaluator, baseline, found, true)
        made = [rolling(right, one, i, needed[i], kept[i], true[i], wrong) for i, one in enumerate(found)]
        forces = Evaluator(campaign, made)(baseline)
        balanced = [braked(right, stop, one) for stop, one in zip(made, forces, strict=True)]
        self._copy = self.timed = right.like(balanced)
        self.rows = _rows_of_true_slips(right.rows, self._copy.rows, wrong)
        self._kept = threading.local()  # each thread keeps its last evaluation
        # The replica contains the true slip of such a wheel; the reading of its sensor is linear in the radius, or the error.
        shares = [averaged(share, stop.step_s) for share, stop in zip(kept, right.sources, strict=True)]
        #: Shares (T, A) of the measured slips that it keeps, of each stop: 1 where a wheel slides, 0 where it grips.
        self.kept_slips = [share * ~wrong for share in shares]
        slid = self._at_true_slips(baseline, on_sensors(rest))
        self._slopes = [one.slope for one in slid]
        if rest is not baseline:
            self.rows = _rows_as_they_slide(self.rows, self._copy.parts, slid)
        slides = [part.joined(part.wheel_rows(share) > _SLIDES) for part, share in zip(right.parts, shares, strict=True)]
        self.rows = dataclasses.replace(self.rows, slides=np.concatenate(slides) & (self.rows.balance == ADHESION))
        gains = [
            part.joined(part.wheel_rows(prompt_gain(_damping(right.radius, one), part.block_s, right.radius, one.inertia)))
            for part, one in zip(self._copy.parts, slid, strict=True)
        ]
        #: -2 log of the derivative of the residuals by the recorded forces of sliding wheels, see `wsp_env.diagnosis.loop`.
        self.determinant = -2.0 * float(np.log(np.concatenate(gains)[self.rows.slides]).sum())
        smoothing = self._changed(baseline) * right.rows.wheels  # residual of an exact balance due to smoothing
        residuals = self._residuals(right, baseline, self._slopes) - smoothing
        prompt = _choosing(baseline, lambda name: not _may_act_slower(name))
        if prompt is not baseline:
            slopes = [one.slope for one in self._at_true_slips(prompt, on_sensors(rest))]
            of_prompt = self._residuals(right, prompt, slopes) - smoothing
        turned = zip(*_predicted_stops(right, balanced, forces, [share > _SLIDES for share in kept]), strict=True)
        self._copy, self.timed = (
            right.like(simulate_readings(campaign, stops, readings) if readings else stops) for stops in turned
        )
        self._kept, self._readings = threading.local(), readings
        self._offset = residuals - self._changed(self.physical(baseline))
        #: Part (n,) of the effect on the recordings that is not predicted; None without mechanisms that may act slower.
        self.unpredicted: np.ndarray | None = None
        if prompt is not baseline:
            self.unpredicted = self._offset - (of_prompt - self._changed(self.physical(prompt)))

    def __getattr__(self, name: str) -> Any:
        """Delegate other attributes to the replica's balances."""
        if name.startswith("__") or name == "_copy":
            raise AttributeError(name)
        return getattr(self._copy, name)

    def evaluate(self, model: Model, beside: Model | None = None) -> list[Evaluation]:
        """Evaluate a model along every stop of the replica; the last result is cached.

        Parameters
        ----------
        beside : model of which a derivative is asked for. If delays and play are the same in both, what they change against the
            replica's is taken as the same: a derivative of their effect by other parameters is of second order

        """
        last: tuple[Model, Model | None, list[Evaluation]] | None = getattr(self._kept, "last", None)
        if last is None or last[:2] != (model, beside):
            last = self._kept.last = (model, beside, self._of_times(model, beside))
        return last[2]

    def _of_times(self, model: Model, beside: Model | None) -> list[Evaluation]:
        """Evaluate a model; changes of delays and play, against the replica's, are evaluated under the recorded torques."""
        prompt = self._as_prompt(model)
        if prompt.choice == model.choice or self.timed is self._copy:
            return self._evaluated(self._copy, model)
        if beside is None or _of_time(model) != _of_time(beside):
            beside = model
        late, less = self._late(beside)
        return [one.changed(*two) for one, *two in zip(self._with_known_times(prompt), late, less, strict=True)]

    def _late(self, model: Model) -> tuple[list[Evaluation], list[Evaluation]]:
        """Evaluate a model under the recorded torques, and with the delays and the play of the replica; the last is cached."""
        kept: tuple[Model, list[Evaluation], list[Evaluation]] | None = getattr(self._kept, "late", None)
        if kept is None or kept[0] != model:
            prompt = self._as_prompt(model)
            before: tuple[Model, list[Evaluation]] | None = getattr(self._kept, "less", None)
            if before is None or before[0] != prompt:  # many consecutive models differ in what is late only
                before = self._kept.less = prompt, self._evaluated(self.timed, prompt)
            kept = self._kept.late = model, self._evaluated(self.timed, model), before[1]
        return kept[1:]

    def _with_known_times(self, prompt: Model) -> list[Evaluation]:
        """Evaluate a model with the delays and the play of the replica; the last result is cached."""
        kept: tuple[Model, list[Evaluation]] | None = getattr(self._kept, "prompt", None)
        if kept is None or kept[0] != prompt:
            kept = self._kept.prompt = prompt, self._evaluated(self._copy, prompt)
        return kept[1]

    def _as_prompt(self, model: Model) -> Model:
        """Return a model with the delays and the play of the replica."""
        return dataclasses.replace(model, choice=_prompt(model.choice, {**self.baseline.choice, **self._readings}))

    def _evaluated(self, copy: Balances, model: Model) -> list[Evaluation]:
        """Evaluate a model along a copy, with the readings of its sensors.

        The recordings' residual is linear in measured slip minus replica slip. A sensor's error is therefore also taken as
        linear, with the slope at the baseline, to the extent that the measured slip is not kept. Evaluated nonlinearly, the two
        would not cancel.
        """
        if on_sensors(model) == self._readings:
            return copy.evaluate(model)
        whole, without, errors, slid = self._slid(copy, model)
        return [
            dataclasses.replace(
                one,
                adhesion=there.adhesion - (1.0 - kept) * slope * error,
                slope=kept * there.slope + (1.0 - kept) * other.slope,
                slip=other.slip - kept * error,
                misread=(kept - 1.0) * error,
            )
            for one, other, there, kept, slope, error in zip(
                whole, without, slid, self.kept_slips, self._slopes, errors, strict=True
            )
        ]

    def _slid(
        self, copy: Balances, model: Model
    ) -> tuple[list[Evaluation], list[Evaluation], list[np.ndarray], list[Evaluation]]:
        """Evaluate a model: forces only, with the replica's sensors only, its slip errors (T, A), and at the true slips."""
        whole, without = copy.evaluate_forces(model), copy.evaluate(self.physical(model))
        errors = [one.slip - other.slip for one, other in zip(without, whole, strict=True)]
        slid = copy.evaluate_slid(model, [(1.0 - kept) * error for kept, error in zip(self.kept_slips, errors, strict=True)])
        return whole, without, errors, slid

    def _at_true_slips(self, model: Model, sensors: Choice) -> list[Evaluation]:
        """Evaluate a model without sensors at the true slips, whatever `sensors` show."""
        if not sensors:
            return self._copy.evaluate(model)
        return self._slid(self._copy, dataclasses.replace(model, choice={**model.choice, **sensors}))[-1]

    def physical(self, model: Model) -> Model:
        """Return a model with the sensors of the replica."""
        if on_sensors(model) == self._readings:
            return model
        true = without_sensors(model)
        return dataclasses.replace(true, choice={**true.choice, **self._readings})

    def whitening(self, model: Model) -> Whitening:
        """Return the whitening of the rows' noise at the slips of a model."""
        return self._copy.whitening_of(self.evaluate(model))

    def raw(self, model: Model, beside: Model | None = None) -> np.ndarray:
        """Residuals (n,) of a model: those of the recordings at the baseline plus the change by the model.

        `beside` is as in `evaluate`.
        """
        return self._changed(model, beside) + self._offset

    def without(self, share: float) -> "Replica":
        """Return the replica with a share of the unpredicted part removed from the residuals of the recordings."""
        if self.unpredicted is None or share == 0.0:
            return self
        result = copy.copy(self)
        result._offset, result.unpredicted = self._offset - share * self.unpredicted, (1.0 - share) * self.unpredicted
        return result

    def _changed(self, model: Model, beside: Model | None = None) -> np.ndarray:
        parts = zip(self._copy.parts, self.evaluate(model, beside), strict=True)
        return np.concatenate([part.residuals(one) for part, one in parts])

    def _residuals(self, right: Balances, model: Model, slopes: Sequence[np.ndarray]) -> np.ndarray:
        """Residuals (n,) of the recordings at a model, with the slopes (T, A) of its curve at the replica's slips."""
        result, rows = right.raw(model), self.rows
        for i, (one, mine) in enumerate(zip(right.evaluate(model), self.evaluate(model), strict=True)):
            expected = mine.adhesion + slopes[i] * (one.slip - mine.slip)
            wheels = right.parts[i].wheel_rows(dataclasses.replace(one, load=mine.load).unbalanced(expected))
            result[(rows.run == i) & rows.wheels] = wheels
        return result


def without_sensors(model: Model) -> Model:
    """Return a model without mechanisms on sensors; the same object if it has none."""
    sensors = on_sensors(model)
    return _choosing(model, lambda name: name not in sensors)


def _prompt(choice: Choice, known: Choice) -> Choice:
    """Return a choice with delays, and terms that follow the course of the torque, as they are known."""
    others = {name: values for name, values in choice.items() if name not in OF_TIME}
    result = others | {name: known[name] for name in OF_TIME if name in known}
    terms = choice.get(discovered.CARD.name, {})
    held = known.get(discovered.CARD.name, {})
    timed = _of_torque(terms)
    if timed:
        terms = {**terms, **{f"coefficient{end}": held.get(f"coefficient{end}", 0.0) for end in timed}}
        result.pop(discovered.CARD.name)
        if any(terms.get(f"coefficient_{n}") for n in range(1, discovered.TERMS + 1)):
            result[discovered.CARD.name] = terms
    return result


def _of_time(model: Model) -> Choice:
    """Return the delays of a model, and its terms that follow the course of the torque."""
    terms = model.choice.get(discovered.CARD.name, {})
    timed = _of_torque(terms)
    own = {name: value for name, value in terms.items() if name.endswith(timed)} if timed else {}
    return {name: values for name, values in model.choice.items() if name in OF_TIME} | {discovered.CARD.name: own}


def _of_torque(terms: Mapping[str, float]) -> tuple[str, ...]:
    """Return the ends of the names of terms that follow the course of the torque."""
    numbers = range(1, discovered.TERMS + 1)
    return tuple(f"_{n}" for n in numbers if terms.get(f"feature_{n}") in OF_TORQUE)


def _may_act_slower(name: str) -> bool:
    """Whether a mechanism may act more slowly than its form: on friction or wheel loads, or a term for unknown physics."""
    return name == discovered.CARD.name or ALL[name].signature.acts_on == "contact"


def _choosing(model: Model, kept: Callable[[str], bool]) -> Model:
    """Return a model with the mechanisms whose name passes `kept`; the same object if all do."""
    choice = {name: values for name, values in model.choice.items() if kept(name)}
    return model if len(choice) == len(model.choice) else dataclasses.replace(model, choice=choice)


def _predicted_stops(
    right: Balances, braked: Sequence[PreparedStop], evaluations: Sequence[Evaluation], slides: Sequence[np.ndarray]
) -> list[tuple[PreparedStop, PreparedStop]]:  # fmt: skip
    """Return the stops with the slips predicted before each block: under the expected and under the recorded torques.

    Parameters
    ----------
    evaluations : of the baseline
    slides : (T, A) bool of each stop, where a wheel slides

    """
    found = []
    for mine, sliding, stop, part, one in zip(braked, slides, right.sources, right.parts, evaluations, strict=True):
        block = part.length * round(part.stop.step_s / stop.step_s)
        found.append(predicted(mine, sliding, stop.torque, _damping(right.radius, one), block, right.radius, one.inertia))
    return found


def _damping(radius: float, one: Evaluation) -> np.ndarray:
    """Return the derivative (T, A) of the law's torque on a wheel by its slip [N m s/m]."""
    result: np.ndarray = 2.0 * radius * one.load * one.slope
    return result


def _rows_of_true_slips(recorded: Rows, copied: Rows, wrong: np.ndarray) -> Rows:
    """Return the recorded rows, with the replica's slip and work for wheels (A,) bool whose sensors do not show them."""
    turned = recorded.wheels & wrong[recorded.axle]
    slip, work = (np.where(turned, copy, own) for copy, own in ((copied.slip, recorded.slip), (copied.work, recorded.work)))
    return dataclasses.replace(recorded, slip=slip, work=work)


def _rows_as_they_slide(rows: Rows, parts: Sequence[Blocks], slid: Sequence[Evaluation]) -> Rows:
    """Return rows with the true slip and work of the wheels, whatever their sensors show."""
    found: dict[str, list[np.ndarray]] = {"slip": [], "work": []}
    for part, one in zip(parts, slid, strict=True):
        work = one.force * one.slip / np.maximum(one.speed, 1.0)[:, None]
        for name, values in (("slip", one.slip), ("work", work)):
            mine = part.wheel_rows(values)
            found[name].append(part.joined(mine, brakes=mine))
    return dataclasses.replace(rows, **{name: np.concatenate(values) for name, values in found.items()})
