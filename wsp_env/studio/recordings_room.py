"""The room of recordings: from dropped files to a report that one forwards, a step a screen."""

import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.studio import shell
from wsp_env.studio.columns_view import ColumnsView
from wsp_env.studio.results_view import ResultsView
from wsp_env.studio.workspace import STEPS, RefusedError, Workspace

_LOOK_AFTER_S = 0.6  # without a further file, before the ones that came are looked at: they come one by one
_WATCH_S = 0.3  # between two looks of a page at its workspace

_GROUPS = {"tune": "tune", "validate": "validate", "left out": "leave out"}


class RecordingsRoom:
    """One tab's view of a workspace."""

    def __init__(self, space: Workspace, key: str, most_bytes: int, suffixes: tuple[str, ...]) -> None:
        self._space, self._most_bytes, self._suffixes = space, most_bytes, suffixes
        self._seen, self._step, self._came = -1, -1, 0.0
        self._columns, self._results = ColumnsView(space, self._quietly), ResultsView(space, key)
        self._steps: list[Any] = []
        self._onward: Any = None
        self._body = shell.page("Recordings")
        self._watch()
        ui.timer(_WATCH_S, self._watch)

    def _watch(self) -> None:
        """Draw the page anew where the workspace has changed, by this tab or another one."""
        space = self._space
        waiting = any(not file.looked for file in space.files.values())
        if waiting and space.busy is None and time.monotonic() > self._came + _LOOK_AFTER_S:
            shell.begin(space.look())
        if space.version != self._seen:
            self._seen = space.version
            self._draw()
        self._results.tick()

    def _draw(self) -> None:
        space = self._space
        self._body.clear()
        with self._body:
            self._rail()
            screens: list[Callable[[], None]] = [self._files, self._columns.draw, self._vehicle]
            if space.step < len(screens):
                with ui.element("main").classes("card column").style("gap: 1rem"):
                    screens[space.step]()
                    self._actions()
            else:
                self._results.draw(STEPS[space.step].lower())
        if self._step not in (-1, space.step):
            with self._body:
                shell.focus_top()
        self._step = space.step

    def _quietly(self) -> None:
        """Take a change that this tab shows already; other tabs draw the page anew.

        Fields and buttons stay the same elements: somebody is at them, and a click on one that is replaced meanwhile is lost.
        """
        self._space.changed()
        self._seen = self._space.version
        furthest = self._furthest()
        for number, button in enumerate(self._steps):
            button.set_enabled(number <= furthest)
        self._onward.set_enabled(self._may_go_on())

    def _rail(self) -> None:
        """Show the steps; those that can be gone to are buttons."""
        furthest, self._steps = self._furthest(), []
        with ui.element("nav").classes("row items-center no-wrap").props("aria-label='steps'").style("gap: .1rem"):
            for number, name in enumerate(STEPS):
                button = ui.button(f"{number + 1}  {name}", on_click=lambda n=number: self._go(n)).props("flat dense no-caps")
                now = number == self._space.step
                button.classes("step q-px-sm" + (" now" if now else ""))
                if now:
                    button.props("aria-current=step")
                button.set_enabled(number <= furthest)
                self._steps.append(button)

    def _furthest(self) -> int:
        """Return the last step that can be gone to."""
        space = self._space
        if not space.usable or space.busy is not None:
            return space.step if space.busy is not None else 0
        if space.missing:
            return 1
        if any(key not in space.vehicle for key in space.asked):
            return 2
        return 6 if space.done("check") else 3

    def _go(self, step: int) -> None:
        self._space.step = step
        self._space.changed()

    def _actions(self) -> None:
        """Show the one action that leads on."""
        step = self._space.step
        words, act = (
            ("Continue: columns", lambda: self._go(1)),
            ("Continue: vehicle", lambda: self._go(2)),
            ("Check the recordings", shell.tried(self._check)),
        )[step]
        with ui.row().classes("items-center").style("gap: .6rem"):
            self._onward = shell.primary(words, act, not self._may_go_on())
            if step:
                shell.secondary("Back", lambda: self._go(step - 1))

    def _may_go_on(self) -> bool:
        """Whether nothing is missing on the screens of files and of columns; the vehicle's says itself what it lacks."""
        space = self._space
        if space.step == 0:
            return bool(space.usable) and space.busy is None
        return space.step != 1 or not space.missing

    def _check(self) -> None:
        space = self._space
        space.write_campaign()
        space.step = STEPS.index("Check")
        space.changed()
        if not space.done("check"):
            shell.begin(space.start("check", {}))

    # Files

    def _files(self) -> None:
        space = self._space
        shell.heading(
            "Recorded stops", "One file a stop, of any logger: CSV, Parquet, MDF4 or MATLAB. They stay on this machine."
        )
        words = "Drop the files here" if not space.files else "Drop more files here"
        shell.drop(words, "Choose files", self._take, self._most_bytes, True, self._suffixes)
        if space.busy is not None:
            with ui.row().classes("items-center"):
                ui.spinner(size="sm")
                ui.label("Reading the files").classes("quiet").props("role=status")
                shell.secondary("Cancel", lambda: shell.begin(space.jobs["look"].cancel()))
        for file in [file for file in space.files.values() if file.error]:
            with ui.row().classes("warn w-full items-center no-wrap"):
                ui.label(f"Cannot be read: {file.error}").classes("grow")
                shell.secondary("Remove", functools.partial(space.remove, file.name)).props(f"aria-label='remove {file.name}'")
        if space.usable:
            kept_back = "A third of the stops, gentle and hard ones, is kept back to validate what the others tune."
            ui.label(kept_back).classes("quiet small")
            with ui.grid(columns="minmax(12rem, 2fr) 1fr 1fr 1fr auto").classes("w-full items-center").style("gap: .4rem 1rem"):
                for head in ("file", "rows", "highest speed", "used to", ""):
                    ui.label(head).classes("quiet small")
                for file in space.usable:
                    self._file(file)

    def _file(self, file: Any) -> None:
        space = self._space
        needed = {column.name for column in space.columns.values()}
        lacking = sorted(needed - {one.name for one in file.channels})
        column = space.columns.get("vehicle_speed")
        speed = next((one for one in file.channels if column and one.name == column.name), None)
        with ui.column().style("gap: 0"):
            ui.label(file.name).style("overflow-wrap: anywhere")
            if lacking:
                ui.label(f"left out: it lacks {', '.join(lacking[:3])}").classes("small").style(f"color: {shell.WARN}")
        ui.label(f"{file.rows:,}")
        ui.label("" if speed is None else f"{speed.quality.highest:.4g} {column.unit if column else ''}")
        chosen = ui.select(_GROUPS, value=file.group, on_change=lambda e, f=file: self._group(f, e.value))
        chosen.props(f"dense outlined options-dense aria-label='use of {file.name}'")
        ui.button(icon="close", on_click=lambda: space.remove(file.name)).props(
            f"flat round dense color=grey-7 aria-label='remove {file.name}'"
        )

    def _group(self, file: Any, group: str) -> None:
        file.group = group
        self._space.forget("check")
        self._space.changed()

    async def _take(self, event: Any) -> None:
        """Take a file that a browser has sent."""
        space = self._space
        try:
            if space.busy is not None and space.busy.task != "look":
                raise RefusedError("wait for the work that is running, or cancel it")
            place = space.place(event.file.name, event.file.size())
        except RefusedError as error:
            ui.notify(str(error), type="warning", multi_line=True, timeout=8000)
            return
        await event.file.save(place)
        self._came = time.monotonic()
        space.add(place)

    # Vehicle

    def _vehicle(self) -> None:
        space = self._space
        shell.heading(
            "Vehicle as tested", "What no recording tells. From a vehicle file, one of those with names, or typed in."
        )
        fields: dict[str, Any] = {}

        def named(event: Any) -> None:
            if event.value:
                space.take_vehicle(VEHICLES[event.value], event.value)

        with ui.row().classes("w-full no-wrap").style("gap: 1.5rem"):
            with ui.column().classes("grow").style("gap: .8rem"):
                for key, words in space.asked.items():
                    fields[key] = ui.number(
                        words, value=space.vehicle.get(key), on_change=lambda e, k=key: self._value(k, e.value)
                    )
                    fields[key].props("outlined dense step=any").classes("w-full")
            with ui.column().style("width: 24rem; gap: .8rem"):
                choice = ui.select({"": "none of these"} | {name: name for name in VEHICLES}, value="", on_change=named)
                choice.props("outlined dense label='A vehicle with a name'").classes("w-full")
                shell.drop("Drop a vehicle.toml here", "Choose a vehicle file", self._take_vehicle, 10**6, False, (".toml",))
        if space.vehicle_from:
            ui.label(f"Taken from {space.vehicle_from}.").classes("quiet small")

    def _value(self, key: str, value: float | None) -> None:
        self._space.forget("check")
        if value is None or not 0.0 < value < float("inf"):
            self._space.vehicle.pop(key, None)
        else:
            self._space.vehicle[key] = float(value)
        self._quietly()

    async def _take_vehicle(self, event: Any) -> None:
        place = self._space.folder / "vehicle" / (Path(event.file.name).name[-80:] or "vehicle.toml")
        await event.file.save(place)
        shell.tried(lambda: self._space.take_vehicle_file(place))()
