"""The room of the driving desk: choose two stops, watch them, compare them, take them along as programs."""

import functools
import json
from typing import Any

from nicegui import ui

from wsp_env.diagnosis.words import parameter_words, unit_words
from wsp_env.evaluation.controller import SHORT_NAMES
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.scenario import TRACKS
from wsp_env.studio import plots, shell
from wsp_env.studio.desk import MECHANISMS, Desk, laws

_WATCH_S = 0.3
_NAMES = ("A", "B")
#: Draws the track as soon as its script and its place are there.
_WHEN_THERE = """(function go(left) {
  if (window.wspTrack && document.getElementById("PLACE")) wspTrack("PLACE", STOPS);
  else if (left) setTimeout(() => go(left - 1), 100);
})(100)"""
_TRACK_WORDS = {"constant": "alike everywhere", "varying": "varying a little", "patches": "slippery patches"}
_CONTROLLERS = {
    "none": "none: brakes whatever the wheels do", "rule-based": "rule-based: thresholds", "slip": "slip: holds a creepage",
    "extremum": "extremum: climbs the adhesion", "adaptive": "adaptive: steers by the rail it estimates",
}  # fmt: skip


class DeskRoom:
    """One tab's view of a desk."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._seen = desk, -1
        self._said: Any = None
        ui.add_head_html('<script src="/studio/track.js"></script>')
        with shell.page("Driving desk"):
            shell.heading(
                "Driving desk", "Two stops, all else equal but what you change. Brake them, watch them, take them along."
            )
            with ui.row().classes("w-full no-wrap items-stretch").style("gap: 1rem"):
                self._cards = [ui.column().classes("card").style("flex: 1; gap: .6rem; min-width: 0") for _ in _NAMES]
            self._actions = ui.row().classes("items-center w-full").style("gap: .6rem")
            self._below = ui.column().classes("w-full").style("gap: 1rem")
        for number in range(2):
            self._choices(number)
        self._watch()
        ui.timer(_WATCH_S, self._watch)

    def _watch(self) -> None:
        desk = self._desk
        if desk.version != self._seen:
            self._seen = desk.version
            self._act()
            self._results()
        if desk.job is not None and desk.job.running and self._said is not None:
            self._said.set_text(f"braking {desk.job.step} · {desk.job.seconds:.0f} s")

    def _act(self) -> None:
        """Show the one action, or how far it is."""
        desk = self._desk
        self._actions.clear()
        self._said = None
        with self._actions:
            if desk.job is not None and desk.job.running:
                ui.spinner(size="sm")
                self._said = ui.label("braking").classes("quiet").props("role=status aria-live=polite")
                shell.secondary("Cancel", lambda: shell.begin(self._cancel()))
                return
            shell.primary("Brake both stops", lambda: shell.begin(desk.brake()))
            shell.secondary("Make B like A", self._copy)
            if desk.job is not None and desk.job.state == "failed":
                shell.note(desk.job.message)
            if desk.job is None:
                ui.label("A first run on a new machine compiles its code: half a minute.").classes("quiet small")

    async def _cancel(self) -> None:
        if self._desk.job is not None:
            await self._desk.job.cancel()
            self._desk.version += 1

    def _copy(self) -> None:
        self._desk.choices[1] = self._desk.choices[0]
        self._choices(1)

    # What is chosen

    def _choices(self, number: int) -> None:
        card, now = self._cards[number], self._desk.choices[number]
        card.clear()
        with card:
            ui.html(f"<h2>Stop {_NAMES[number]}</h2>", sanitize=False)
            self._select(number, "controller", "Controller", {name: _CONTROLLERS.get(name, name) for name in SHORT_NAMES})
            with ui.grid(columns=2).classes("w-full").style("gap: .6rem"):
                self._select(number, "vehicle", "Vehicle", {name: name for name in VEHICLES})
                self._number(number, "speed_kmh", "From [km/h]", now.speed_kmh)
                self._number(number, "demand", "Brake demand [%]", 100 * now.demand, 0.01)
                self._number(number, "load", "Payload [%]", 100 * now.load, 0.01)
                self._number(number, "mu_cd", "Rail: friction mu_cd [-]", now.mu_cd)
                self._number(number, "tau", "Recovery rate tau [1e-4 m/J]", 1e4 * now.tau, 1e-4)
                self._select(number, "track", "Along the track", {name: _TRACK_WORDS.get(name, name) for name in TRACKS})
                self._number(number, "seed", "Draw", now.seed, whole=True)
            self._select(number, "law", "Contact law", {name: f"{name}: {what}" for name, what in laws().items()})
            ui.switch(
                "Sliding cleans the rail",
                value=now.recovering,
                on_change=lambda e: self._desk.choose(number, recovering=e.value),
            )
            for mechanism in now.mechanisms:
                self._mechanism(number, mechanism)
            left = {name: card.summary for name, card in MECHANISMS.items() if name not in now.mechanisms}
            more = ui.select({"": "", **left}, value="", label="Add what differs from the book", with_input=True)
            more.on_value_change(lambda e: self._add(number, e.value))
            more.props("dense outlined options-dense").classes("w-full")

    def _mechanism(self, number: int, name: str) -> None:
        values = self._desk.choices[number].mechanisms[name]
        with ui.column().classes("w-full").style("border-left: 3px solid #56B4E9; padding-left: .8rem; gap: .4rem"):
            with ui.row().classes("w-full no-wrap items-center"):
                ui.label(MECHANISMS[name].summary).classes("grow small")
                ui.button(icon="close", on_click=lambda: self._drop(number, name)).props(
                    f"flat round dense color=grey-7 aria-label='take away {name.replace('_', ' ')}'"
                )
            with ui.grid(columns=2).classes("w-full").style("gap: .4rem"):
                for one in MECHANISMS[name].parameters:
                    label = f"{parameter_words(one.name)} [{'-' if one.unit == '-' else unit_words(one.unit)}]"
                    field = ui.number(label, value=values[one.name], min=one.low, max=one.high)
                    field.props("dense outlined step=any")
                    field.on_value_change(lambda e, p=one.name: self._set(number, name, p, e.value))

    def _set(self, number: int, mechanism: str, parameter: str, value: float | None) -> None:
        if value is not None:
            shell.tried(lambda: self._desk.set(number, mechanism, parameter, float(value)))()

    def _add(self, number: int, mechanism: str) -> None:
        if not mechanism:
            return
        self._desk.add(number, mechanism)
        self._choices(number)

    def _drop(self, number: int, mechanism: str) -> None:
        self._desk.drop(number, mechanism)
        self._choices(number)

    def _select(self, number: int, field: str, label: str, options: dict[str, str]) -> None:
        now = getattr(self._desk.choices[number], field)
        chosen = ui.select(options, value=now, label=label, on_change=lambda e: self._desk.choose(number, **{field: e.value}))
        chosen.props("dense outlined options-dense").classes("w-full").style("min-width: 0")

    def _number(self, number: int, field: str, label: str, value: float, factor: float = 1.0, whole: bool = False) -> None:
        def change(event: Any) -> None:
            if event.value is not None:
                given = int(event.value) if whole else round(factor * float(event.value), 12)
                shell.tried(lambda: self._desk.choose(number, **{field: given}))()

        shown = ui.number(label, value=round(value, 6), on_change=change)
        shown.props("dense outlined step=any").classes("w-full")

    # What came out

    def _results(self) -> None:
        self._below.clear()
        if not (stops := self._desk.stops):
            return
        with self._below:
            shell.note(self._desk.sentence, "good")
            with ui.element("section").classes("card"):
                place = f"track-{self._seen}-{id(self)}"
                ui.html(f"<div id='{place}'></div>", sanitize=False).classes("w-full")
                ui.label("Wheels: green rolls, amber slides, red slides by more than 30 %. Bars: cylinder pressure.").classes(
                    "quiet small"
                )
                data = json.dumps([{key: one[key] for key in one if key != "words"} for one in stops])
                ui.run_javascript(_WHEN_THERE.replace("PLACE", place).replace("STOPS", data))
            with ui.row().classes("w-full no-wrap items-start").style("gap: 1rem"):
                for name, stop in zip(_NAMES, stops, strict=True):
                    with ui.element("section").classes("card").style("flex: 1; min-width: 0"):
                        ui.html(f"<h2>Stop {name}</h2>", sanitize=False)
                        ui.label(stop["words"]).classes("quiet small")
                        figure = plots.stop_panels(stop)
                        ui.plotly(figure).classes("w-full").style(f"min-height: {figure['layout']['height']}px")
            with ui.element("section").classes("card column").style("gap: .8rem"):
                shell.table(_figures(stops))
                self._programs()

    def _programs(self) -> None:
        for number, name in enumerate(_NAMES):
            choice = self._desk.braked[number]
            with ui.expansion(f"Stop {name} as a Python program").classes("w-full"):
                ui.code(choice.code(f"Stop {name}"), language="python").classes("w-full")
                file = f"stop_{name.lower()}.py"
                shell.secondary(f"Download {file}", functools.partial(ui.download.content, choice.code(f"Stop {name}"), file))


def _figures(stops: list[dict[str, Any]]) -> dict[str, Any]:
    """Return both stops' figures as a table."""
    header = ("", "distance [m]", "time [s]", "mean slip [m/s]", "longest lock [s]", "air [Nl]")
    rows = [
        (f"Stop {name}: {one['words']}", f"{one['distance_m']:.1f}" if one["stopped"] else "ran on", f"{one['time_s']:.1f}",
         f"{one['mean_slip_mps']:.2f}", f"{one['locked_s']:.1f}", f"{one['air_nl']:.0f}")
        for name, one in zip(_NAMES, stops, strict=True)
    ]  # fmt: skip
    return {"header": header, "rows": rows}
