"""The screen of columns: which column is which channel, beside the curves that they hold."""

from collections.abc import Callable
from typing import Any

import numpy as np
from nicegui import ui

from wsp_env.recordings import channels as kinds
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.guessing import FASTEST_MPS
from wsp_env.studio import plots, shell
from wsp_env.studio.files import Column, File, channel_words
from wsp_env.studio.workspace import RefusedError, Workspace

#: Radius [m] by which turning wheels are drawn as a speed before the vehicle is known (assumption: a worn coach wheel).
_RADIUS_M = 0.445

_UNITS = {
    "time": ["s", "ms", "min"],
    "vehicle_speed": ["m/s", "km/h", "mph"],
    "wheel_speed": ["rad/s", "rpm", "km/h", "m/s", "turn/s", "deg/s"],
    "brake_torque": ["N m", "kN m"],
    "cylinder_pressure": ["bar", "kPa", "mbar", "psi", "Pa"],
}
_HEADS = {
    "wheel_speed": "Wheel speeds",
    "brake_torque": "Brake torques, per wheelset",
    "cylinder_pressure": "Cylinder pressures",
}
_MARKS = {"remove": "no column", "auto_awesome": "suggested", "check": "chosen"}
_PANELS = (("speed [km/h]", ("vehicle_speed", "wheel_speed"), 3.6), ("brake torque [kN m]", ("brake_torque",), 1e-3),
           ("cylinder pressure [bar]", ("cylinder_pressure",), 1.0))  # fmt: skip


class ColumnsView:
    """One tab's view of the columns."""

    def __init__(self, space: Workspace, changed: Callable[[], None]) -> None:
        self._space, self._changed = space, changed
        self._file, self._other = "", ""
        self._plot: Any = None
        self._left: Any = None
        self._missing: Any = None

    def draw(self) -> None:
        """Show the screen."""
        space = self._space
        shell.heading(
            "Which column is what",
            "Suggested by names, units and numbers. Wheels and vehicle should run together while nothing brakes.",
        )
        files = {file.name: file.name for file in space.usable}
        self._file = self._file if self._file in files else next((file.name for file in space.runs), next(iter(files), ""))
        with ui.row().classes("w-full no-wrap items-start").style("gap: 1.6rem"):
            with ui.column().style("width: 27rem; flex: none; gap: .35rem"):
                self._rows()
            with ui.column().classes("grow").style("gap: .5rem; min-width: 0; position: sticky; top: 70px"):
                with ui.row().classes("w-full items-center"):
                    shown = ui.select(files, value=self._file, on_change=lambda e: self._show(e.value, self._other))
                    shown.props("dense outlined options-dense label='Stop shown'").style("min-width: 13rem")
                    unused = self._unused()
                    self._other = self._other if self._other in unused else ""
                    other = ui.select({"": "none", **{name: name for name in unused}}, value=self._other)
                    other.on_value_change(lambda e: self._show(self._file, e.value))
                    other.props("dense outlined options-dense label='Look at another column'").style("min-width: 13rem")
                self._plot = ui.plotly(self._figure()).classes("w-full").style("min-height: 26rem")
                self._left = ui.label(self._words()).classes("quiet small")
        self._missing = ui.label().classes("warn w-full").props("role=status")
        self._refresh()

    def _refresh(self) -> None:
        """Show what a choice changes, and leave the fields alone: somebody is at them."""
        lacks = self._space.missing
        self._missing.set_text(f"Still missing: {', '.join(lacks)}.")
        self._missing.set_visibility(bool(lacks))
        self._left.set_text(self._words())
        self._plot.update_figure(self._figure())

    def _rows(self) -> None:
        space = self._space
        columns = {one.name: one for file in space.usable for one in file.channels}
        options = {"": "none"} | {
            name: f"{name}  [{one.unit}]" if one.unit and one.unit not in name else name for name, one in columns.items()
        }
        for channel in ("time", "vehicle_speed"):
            self._row(channel, channel, options)
        for kind, head in _HEADS.items():
            # Torques or pressures: where the one is there, the other is asked for behind a fold.
            other = {"brake_torque": "cylinder_pressure", "cylinder_pressure": "brake_torque"}.get(kind, "")
            here, there = (any(name.endswith(f"_{one}") for name in space.columns) for one in (kind, other or "-"))
            holder: ui.element
            if there and not here:
                holder = ui.expansion(f"{head}: none").classes("w-full").props("dense header-class=q-pl-none")
            else:
                ui.html(f"<h2>{head}</h2>", sanitize=False).classes("q-mt-sm")
                holder = ui.column().classes("w-full").style("gap: .35rem")
            with holder:
                for k in range(1, space.axles + 1):
                    self._row(f"axle{k}_{kind}", kind, options)
        axles = ui.number("Axles", value=space.axles, min=1, max=64, on_change=lambda e: self._axles(e.value))
        axles.props("dense outlined").style("width: 7rem").classes("q-mt-sm")

    def _row(self, channel: str, kind: str, options: dict[str, str]) -> None:
        column = self._space.columns.get(channel)
        with ui.row().classes("w-full no-wrap items-center").style("gap: .5rem"):
            ui.label(_short(channel, kind)).style("width: 6.2rem; flex: none")
            name = column.name if column else ""
            many = len(options) > 25
            chosen = ui.select(options if name in options else {**options, name: name}, value=name, with_input=many)
            chosen.props(f"dense outlined options-dense aria-label='column of {channel_words(channel)}'")
            chosen.classes("grow").style("min-width: 0")
            units = _UNITS[kind]
            unit = column.unit if column else ""
            known = units if unit in units or not unit else [unit, *units]
            given = ui.select({"": "?"} | {one: one for one in known}, value=unit)
            given.props(f"dense outlined options-dense aria-label='unit of {channel_words(channel)}'").style(
                "width: 6.4rem; flex: none"
            )
            mark = ui.icon(_mark(column), size="xs").style("color: #9aa5b1")
            with mark:
                tip = ui.tooltip(_MARKS[_mark(column)])

        def change(by_column: bool) -> None:
            wanted = ("" if by_column else given.value) or self._usual(chosen.value, kind)
            before = self._space.columns.get(channel)
            if before is not None and (before.name, before.unit) == (chosen.value, wanted):
                return
            try:
                self._space.choose(channel, chosen.value or "", wanted)
            except RefusedError as error:
                ui.notify(str(error), type="warning", multi_line=True)
                return
            now = self._space.columns.get(channel)
            unit = now.unit if now else ""
            given.set_options({"": "?"} | {one: one for one in known} | {unit: unit or "?"}, value=unit)
            mark.set_name(_mark(now))
            tip.set_text(_MARKS[_mark(now)])
            self._refresh()
            self._changed()

        chosen.on_value_change(lambda: change(True))
        given.on_value_change(lambda: change(False))

    def _usual(self, column: str, kind: str) -> str:
        """Return the unit of a column that is chosen without one: as its file states it, else as it may be."""
        found = next((one for file in self._space.usable for one in file.channels if one.name == column), None)
        if found is None:
            return ""
        fast = kind == "vehicle_speed" and found.quality.highest > FASTEST_MPS
        return found.unit or ("km/h" if fast else _UNITS[kind][0])

    def _axles(self, value: float | None) -> None:
        if value is not None and 1 <= value <= 64 and int(value) != self._space.axles:
            self._space.axles = int(value)
            for channel in [one for one in self._space.columns if one not in self._space.shown and one.startswith("axle")]:
                self._space.columns.pop(channel)
            self._space.changed()

    def _unused(self) -> list[str]:
        used = {column.name for column in self._space.columns.values()}
        return list(dict.fromkeys(one.name for file in self._space.usable for one in file.channels if one.name not in used))

    def _words(self) -> str:
        names = self._unused()
        more = f" and {len(names) - 8} more" if len(names) > 8 else ""
        return f"Not used: {', '.join(names[:8])}{more}." if names else "Every column is used."

    def _show(self, file: str, other: str) -> None:
        self._file, self._other = file, other
        self._plot.update_figure(self._figure())

    def _figure(self) -> dict[str, Any]:
        """Return the mapped columns, converted as they are read: what does not run together is mapped or measured wrongly."""
        file = self._space.files.get(self._file)
        if file is None:
            return plots.panels([("nothing to draw", [])])
        rows = []
        for title, panel, factor in _PANELS:
            curves = [curve for channel in self._space.shown if (curve := self._curve(file, channel, panel, factor))]
            rows += [(title, curves)] if curves else []
        if self._other and (drawn := self._space.curve(file, self._other)) is not None:
            rows.append((self._other[:24], [plots.line(drawn[0], drawn[1], self._other, "#1f2933")]))
        return plots.panels(rows or [("nothing mapped yet", [])])

    def _curve(self, file: File, channel: str, panel: tuple[str, ...], factor: float) -> dict[str, Any] | None:
        kind = channel.split("_", 1)[1] if channel.startswith("axle") else channel
        column = self._space.columns.get(channel)
        if kind not in panel or column is None or column.name not in {one.name for one in file.channels}:
            return None
        drawn = self._space.curve(file, column.name)
        if drawn is None:
            return None
        radius = self._space.vehicle.get("wheel_radius_m", _RADIUS_M)
        try:
            factor *= kinds.factor(column.unit, channel, radius, "") if column.unit else 1.0
        except CampaignError:
            return None
        factor *= radius if kind == "wheel_speed" else 1.0
        name, colour = "vehicle", "#1f2933"
        if channel.startswith("axle"):
            name = _short(channel, kind)
            colour = plots.colour(int(name.split()[-1]) - 1)
        return plots.line(drawn[0], factor * np.asarray(drawn[1], dtype=float), name, colour)


def _mark(column: Column | None) -> str:
    """Return the icon of where a column comes from."""
    return "remove" if column is None else "auto_awesome" if column.suggested else "check"


def _short(channel: str, kind: str) -> str:
    """Return the axle of a channel of one in words, else its name in words."""
    words = channel_words(channel)
    return words.removesuffix(kind.replace("_", " ")).strip() if kind in _HEADS else words
