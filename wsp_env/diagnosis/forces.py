"""Effect of small force changes on the residuals: of the wheels, of the vehicle, and of all wheels by the estimated speed."""

from collections.abc import Callable

import numpy as np

from wsp_env.diagnosis.balances import Balances, Blocks
from wsp_env.diagnosis.evaluate import Evaluation, Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import smooth_wheels
from wsp_env.diagnosis.thinning import averaged
from wsp_env.plant.card import APPLIED_SHARE


class Forces:
    """Columns of the residuals for changes of forces, linearised about a model.

    Slow changes are contained in the recorded speed and thus in the estimated speed. Fast changes, as at a brake application,
    are not; they also change the estimated speed.
    """

    def __init__(self, balances: Balances | Replica, model: Model) -> None:
        self._balances = balances
        self._parts: list[tuple[Blocks, Evaluation]] = list(zip(balances.parts, balances.evaluate(model), strict=True))
        self._largest = max(float(np.abs(one.braking).max(initial=0.0)) for _, one in self._parts)
        self._recorded = max(float(np.abs(one.torque).max(initial=0.0)) for _, one in self._parts)
        nominal = [part.joined(brakes=part.wheel_rows(one.braking)) for part, one in self._parts]
        self.nominal = np.concatenate(nominal)
        # A return spring reduces the effect of the pressure, and the sensor has a zero error: torque over pressure is a line
        # that does not pass through zero.
        held = [part.joined(brakes=part.wheel_rows(self._spring_torques(one))) for part, one in self._parts]
        zero = [part.joined(brakes=part.wheel_rows(np.full(one.braking.shape, self._largest))) for part, one in self._parts]
        self.springs = np.column_stack([np.concatenate(held), np.concatenate(zero)])
        self.gain = self._torque(lambda time: np.ones((len(time), 1)), slow=False)[0]

    def _spring_torques(self, one: Evaluation) -> np.ndarray:
        """Return torques (T, A) held back by return springs, per share of the largest; rising up to `APPLIED_SHARE` of it."""
        return np.minimum(one.braking / APPLIED_SHARE, self._largest)

    def turning(self) -> np.ndarray:
        """Columns (n, A) for a relative change of each wheelset's inertia."""
        balances, found = self._balances, []
        for part, one in self._parts:
            moment = balances.inertia * part.stop.wheel_rate
            lost = balances.inertia * part.stop.wheel / (balances.radius * one.mass)
            found.append(self._rows(part, one, moment, lost))
        return np.vstack(found)

    def zeros(self) -> np.ndarray:
        """Columns (n, A) for an offset of each axle's torque, relative to the largest recorded one."""
        found = []
        for part, one in self._parts:
            moment = np.full(one.torque.shape, self._recorded)
            lost = self._lost(part, one, moment)
            found.append(self._rows(part, one, moment, lost, moment, slow=True))
        return np.vstack(found)

    def late_wheels(self) -> np.ndarray:
        """Columns (n, A) for the lead of each recorded wheel speed over the other channels [s]."""
        balances, found = self._balances, []
        for part, one in self._parts:
            stop = part.stop
            lost = balances.inertia * stop.wheel_rate / (balances.radius * one.mass)
            mine = np.nonzero(part.used)[1][:, None] == np.arange(balances.axles)
            less_slip = part.joined(part.wheel_rows(one.stiffness * balances.radius * stop.wheel_rate)[:, None] * mine)
            found.append(self._rows(part, one, balances.inertia * stop.wheel_jerk, lost) + less_slip)
        return np.vstack(found)

    def unround_wheels(self) -> np.ndarray:
        """Columns (n, 2 A runs) for a periodic error of each wheel sensor in each run, relative to the wheel's speed.

        An eccentric pulse wheel reads too fast in one half of a turn. The error has a sine and a cosine part, because the
        initial wheel angle is unknown.
        """
        balances, found = self._balances, []
        for i, ((part, one), stop) in enumerate(zip(self._parts, balances.sources, strict=True)):
            angle = np.cumsum(stop.wheel, axis=0) * stop.step_s
            mine = np.nonzero(part.used)[1][:, None] == np.arange(balances.axles)
            columns = []
            for wave in (np.sin(angle), np.cos(angle)):
                smoothed = smooth_wheels(stop.wheel * wave, np.zeros_like(wave), stop.step_s)
                shown, rate = (averaged(values, stop.step_s) for values in smoothed[:2])
                lost = balances.inertia * shown / (balances.radius * one.mass)
                less_slip = part.joined(part.wheel_rows(one.stiffness * balances.radius * shown)[:, None] * mine)
                columns.append(self._rows(part, one, balances.inertia * rate, lost) + less_slip)
            wide = np.zeros((len(columns[0]), len(self._parts), 2 * balances.axles))
            wide[:, i] = np.column_stack(columns)
            found.append(wide.reshape(len(wide), -1))
        return np.vstack(found)

    def late_torques(self) -> np.ndarray:
        """Columns (n, A) for the lead of each recorded torque over the other channels [s]."""
        found = []
        for part, one in self._parts:
            moment = np.gradient(one.torque, part.stop.step_s, axis=0)
            lost = self._lost(part, one, moment)
            found.append(self._rows(part, one, moment, lost, moment))
        return np.vstack(found)

    def courses(self, apart_s: float) -> np.ndarray:
        """Columns for relative changes of each axle's torque in time, interpolated between nodes, in each run."""
        nodes, rows = self._nodes(apart_s), self._balances.rows
        found = self._torque(
            lambda time: np.column_stack([np.interp(time, nodes, unit) for unit in np.eye(len(nodes))]), slow=True
        )
        return np.column_stack([columns * (rows.run == i)[:, None] for columns in found for i in range(len(self._parts))])

    def onsets(self, apart_s: float, nodes: int) -> np.ndarray:
        """Columns for each axle's torque after its first application in each run, at nodes; relative to the largest."""
        axles, found = self._balances.axles, []
        for i, (part, one) in enumerate(self._parts):
            applied = np.abs(one.torque) > APPLIED_SHARE * self._recorded
            since = part.stop.time[:, None] - part.stop.time[applied.argmax(axis=0)]
            mine = []
            for node in range(nodes):
                moment = self._recorded * np.clip(1.0 - np.abs(since / apart_s - node), 0.0, None) * applied.any(axis=0)
                lost = self._lost(part, one, moment)
                mine.append(self._rows(part, one, moment, lost, moment))
            wide = np.zeros((len(mine[0]), len(self._parts), nodes * axles))
            wide[:, i] = np.column_stack(mine)
            found.append(wide.reshape(len(wide), -1))
        return np.vstack(found)

    def on_vehicle(self, apart_s: float) -> np.ndarray:
        """Columns for a force on the vehicle in time, interpolated between nodes, in each run; as a share of its weight."""
        nodes, found = self._nodes(apart_s), []
        for i, (part, _) in enumerate(self._parts):
            hats = np.column_stack([np.interp(part.stop.time, nodes, unit) for unit in np.eye(len(nodes))])
            lost = np.column_stack([part.summed(hat) for hat in hats.T]) * self._balances.vehicle.gravity_mps2
            columns = part.joined(vehicle=np.column_stack([part.vehicle_rows(x) for x in lost.T]))
            wide = np.zeros((len(columns), len(nodes) * len(self._parts)))
            wide[:, i * len(nodes) : (i + 1) * len(nodes)] = columns
            found.append(wide)
        return np.vstack(found)

    def _nodes(self, apart_s: float) -> np.ndarray:
        end = max(float(part.stop.time[-1]) for part, _ in self._parts)
        return np.arange(0.0, end + apart_s, apart_s)

    def _torque(self, over: Callable[[np.ndarray], np.ndarray], slow: bool) -> list[np.ndarray]:
        """Columns (n, A) for a relative change of each axle's torque, one array for each weight function of `over` (T, K)."""
        found = []
        weights = [over(part.stop.time) for part, _ in self._parts]
        for k in range(weights[0].shape[1]):
            pieces = []
            for (part, one), weight in zip(self._parts, weights, strict=True):
                moment = weight[:, [k]] * one.torque
                pieces.append(self._rows(part, one, moment, self._lost(part, one, moment), moment, slow))
            found.append(np.vstack(pieces))
        return found

    def _lost(self, part: Blocks, one: Evaluation, moment: np.ndarray) -> np.ndarray:
        """Return the loss of vehicle speed (T, A) [m/s] due to each wheelset's moment (T, A) [N m]."""
        return np.column_stack([part.summed(x) for x in moment.T / (self._balances.radius * one.mass)])

    def _rows(
        self, part: Blocks, one: Evaluation, moment: np.ndarray, lost: np.ndarray, braking: np.ndarray | None = None,
        slow: bool = False,
    ) -> np.ndarray:  # fmt: skip
        """Rows (n, A) of one stop for each wheelset's moment (T, A) [N m] and the vehicle's loss of speed by it [m/s]."""
        mine = np.nonzero(part.used)[1][:, None] == np.arange(self._balances.axles)
        share = part.wheel_rows(moment / (2.0 * self._balances.radius * one.believed_load))[:, None] * mine
        vehicle = np.column_stack([part.vehicle_rows(x) for x in lost.T])
        brakes = None if braking is None else part.wheel_rows(braking)[:, None] * mine
        return part.joined(share if slow else share + self._slower(part, one, lost), vehicle, brakes)

    @staticmethod
    def _slower(part: Blocks, one: Evaluation, lost: np.ndarray) -> np.ndarray:
        """Rows (w, K) of the wheels for losses of vehicle speed (T, K) [m/s] that forces predict.

        The estimated speed follows the predicted speed in fast changes, and the recorded speed in slow ones.
        """
        stop = part.stop
        slower = lost - np.column_stack([stop.estimator(stop.time, x) for x in lost.T])
        return np.column_stack([part.wheel_rows(one.stiffness * x[:, None]) for x in slower.T])
