"""Pictures and texts of a stop: speeds, slip, pressures, adhesion against its limits."""

from typing import Any

import numpy as np

from wsp_env.envs.batch import BrakingBatch

_SHOWN = ("time_s", "speed_mps", "wheel_speed_radps", "slip_speed_mps", "pressure_bar", "adhesion", "adhesion_d", "adhesion_r")

#: Lines that matplotlib draws in colours of their own.
_COLOURS = 10


class Recorder:
    """Keeps the history of the first stop of a batch and draws it."""

    def __init__(self, batch: BrakingBatch) -> None:
        self.batch = batch
        self.history: dict[str, list[Any]] = {}
        self._figure: Any = None

    def begin(self) -> None:
        """Forget the last stop and take the first sample of a new one."""
        self.history = {name: [] for name in _SHOWN}
        self.add()

    def add(self) -> None:
        """Take a sample."""
        truth = self.batch.truth()
        for name in _SHOWN:
            self.history[name].append(truth[name][0])

    def text(self) -> str:
        """Return the present state as a small table."""
        now = {name: np.atleast_1d(values[-1]) for name, values in self.history.items()}
        radius = self.batch.plant.conditions.radius[0]
        lines = [
            f"t {now['time_s'][0]:7.2f} s   v {now['speed_mps'][0]:6.2f} m/s",
            "axle   r w [m/s]  slip [m/s]  p [bar]      f    f_d    f_r",
        ]
        for k in range(self.batch.vehicle.axles):
            lines.append(
                f"{k + 1:4d}   {radius[k] * now['wheel_speed_radps'][k]:9.2f}  {now['slip_speed_mps'][k]:10.2f}  "
                f"{now['pressure_bar'][k]:7.2f}  {now['adhesion'][k]:5.3f}  {now['adhesion_d'][k]:5.3f}  "
                f"{now['adhesion_r'][k]:5.3f}"
            )
        return "\n".join(lines)

    def picture(self) -> np.ndarray:
        """Return the stop so far as an RGB picture (600, 900, 3) uint8."""
        figure = self._draw()
        figure.canvas.draw()
        return np.array(figure.canvas.buffer_rgba(), dtype=np.uint8)[..., :3].copy()

    def show(self) -> None:
        """Draw the stop so far in a window, at most ten times a second of its own time."""
        every = max(1, round(0.1 / self.batch.task.control_interval_s))
        if (len(self.history["time_s"]) - 1) % every:
            return
        figure = self._draw(window=True)
        figure.canvas.draw_idle()
        figure.canvas.flush_events()

    def close(self) -> None:
        """Close the window, if any."""
        if self._figure is not None:
            import matplotlib.pyplot as plt

            plt.close(self._figure)
            self._figure = None

    def _draw(self, window: bool = False) -> Any:
        try:
            from matplotlib import colormaps
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.figure import Figure
        except ImportError as error:
            raise ImportError("rendering needs matplotlib: pip install 'wsp-env[report]'") from error
        if self._figure is None:
            if window:
                import matplotlib.pyplot as plt

                plt.ion()
                self._figure = plt.figure(figsize=(9, 6), dpi=100)
            else:
                self._figure = Figure(figsize=(9, 6), dpi=100)
                FigureCanvasAgg(self._figure)
        self._figure.clear()
        axes = self._figure.subplots(2, 2, sharex=True)
        data = {name: np.array(values) for name, values in self.history.items()}
        time, radius = data["time_s"], self.batch.plant.conditions.radius[0]
        axes[0, 0].plot(time, data["speed_mps"], color="black", label="vehicle")
        axles = self.batch.vehicle.axles
        for k in range(axles):
            # As many as matplotlib has colours; of more, from the first to the last, these two are named.
            colour: Any = f"C{k}" if axles <= _COLOURS else colormaps["viridis"](k / (axles - 1))
            label = f"axle {k + 1}" if axles <= _COLOURS or k in (0, axles - 1) else None
            axes[0, 0].plot(time, radius[k] * data["wheel_speed_radps"][:, k], color=colour, label=label)
            axes[0, 1].plot(time, data["slip_speed_mps"][:, k], color=colour)
            axes[1, 0].plot(time, data["pressure_bar"][:, k], color=colour)
            axes[1, 1].plot(time, data["adhesion"][:, k], color=colour)
            for name, style in (("adhesion_d", ":"), ("adhesion_r", "--")):
                axes[1, 1].plot(time, data[name][:, k], color=colour, linestyle=style, linewidth=0.8)
        titles = ("speed [m/s]", "slip speed [m/s]", "cylinder pressure [bar]", "adhesion f (dotted $f_d$, dashed $f_r$)")
        for axis, title in zip(axes.flat, titles, strict=True):
            axis.set_title(title, fontsize=9)
            axis.grid(alpha=0.3)
        axes[0, 0].legend(fontsize=7, loc="upper right")
        for axis in axes[1]:
            axis.set_xlabel("time [s]")
        self._figure.tight_layout()
        return self._figure
