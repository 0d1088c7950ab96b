"""One engineer's recordings on their way to a report: files, columns, vehicle, and the work done on them. No page in here."""

import dataclasses
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.output import write_text
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.vehicle_file import read_vehicle
from wsp_env.recordings import channels as kinds
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.folder import ASKED, in_order, of_vehicle, open_questions, run_names, split, with_vehicle
from wsp_env.recordings.inspection import InspectedChannel, draft
from wsp_env.recordings.readers import FORMATS
from wsp_env.studio.files import Column, File, channel_of, channel_words, speed_of
from wsp_env.studio.jobs import Job

#: What one workspace takes: files, and bytes of all of them.
MOST_FILES, MOST_BYTES = 100, 8 * 10**9

#: Channels of a file that are drawn; the suggested ones come first.
MOST_CURVES = 60

#: The steps in their order.
STEPS = ("Files", "Columns", "Vehicle", "Check", "Tune", "Validate", "Diagnose")

_SUFFIXES = tuple(suffix for group in FORMATS for suffix in group)


class RefusedError(Exception):
    """What a person gave and what cannot be; the message says why."""


class Workspace:
    """Everything of one workspace; pages show it, and show it anew when `version` has grown."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.recordings = folder / "campaign"
        self.recordings.mkdir(parents=True, exist_ok=True)
        self.files: dict[str, File] = {}
        self.columns: dict[str, Column] = {}
        self.axles = 4
        self.vehicle: dict[str, float] = {}  # what is asked for
        self.described: dict[str, Any] = {}  # what else a vehicle file says
        self.vehicle_from = ""
        self.step = 0
        self.jobs: dict[str, Job] = {}  # task -> the last one
        self.version = 0

    def changed(self) -> None:
        """Let the pages know."""
        self.version += 1

    @property
    def busy(self) -> Job | None:
        """The job at work, if any; one at a time, so that a tab cannot change what another one computes from."""
        return next((job for job in self.jobs.values() if job.running), None)

    def done(self, task: str) -> bool:
        """Whether a task has its result."""
        return task in self.jobs and self.jobs[task].state == "done"

    # Files

    def place(self, name: str, size: int) -> Path:
        """Return where a new file goes; `RefusedError` for one that is not taken."""
        plain = re.sub(r"[^\w .()+-]", "_", Path(name.replace("\\", "/")).name).strip(" .")[-120:]
        if Path(plain).suffix.lower() not in _SUFFIXES:
            raise RefusedError(f"{name[:120]}: only {', '.join(_SUFFIXES)} are recordings")
        if plain not in self.files and len(self.files) >= MOST_FILES:
            raise RefusedError(f"a workspace takes {MOST_FILES} files")
        held = sum(file.path.stat().st_size for file in self.files.values() if file.path.exists())
        if held + size > MOST_BYTES:
            raise RefusedError(f"a workspace takes {MOST_BYTES / 1e9:.0f} GB of files")
        return self.recordings / plain

    def add(self, path: Path) -> None:
        """Take a file that lies at its place."""
        self.files[path.name] = File(path)
        self.forget("check")
        self.changed()

    def remove(self, name: str) -> None:
        """Forget a file."""
        self.files.pop(name).path.unlink(missing_ok=True)
        self._suggest()
        self.forget("check")
        self.changed()

    def forget(self, task: str) -> None:
        """Forget results that no longer hold, of a task and of all later ones; what is still at it is ended."""
        order = [step.lower() for step in STEPS]
        for later in order[order.index(task) :]:
            if (job := self.jobs.pop(later, None)) is not None:
                job.end()

    async def start(self, task: str, request: Mapping[str, Any], then: Callable[[], None] = lambda: None) -> None:
        """Do a task to its end; `RefusedError` while another one is at work."""
        if self.busy is not None:
            raise RefusedError("another piece of work is still running; wait for it or cancel it")
        job = Job(task, self.folder / task, {"campaign": str(self.recordings), "hide": str(self.recordings), **request})
        self.jobs[task] = job
        self.changed()
        try:
            await job.run()
            then()
        finally:
            self.changed()

    async def look(self) -> None:
        """Inspect the files that nobody has looked at."""
        waiting = [file for file in self.files.values() if not file.looked]
        request = {"files": [str(file.path) for file in waiting], "most_curves": MOST_CURVES}
        await self.start("look", request, lambda: self._looked(waiting))

    def _looked(self, waiting: list[File]) -> None:
        job = self.jobs["look"]
        for file in waiting:
            if job.state == "cancelled":
                self.files.pop(file.name, None)
                continue
            try:
                answer = json.loads((job.folder / f"{file.name}.json").read_text(encoding="utf-8"))
            except (OSError, ValueError):
                answer = {"error": f"{file.name} could not be read: {job.message or 'its reader ended'}"}
            file.looked, file.error = True, answer.get("error", "")
            if not file.error:
                file.channels, file.rows = [channel_of(one) for one in answer["channels"]], answer["rows"]
                file.slid = answer["slid"]
        self._suggest()

    @property
    def usable(self) -> list[File]:
        """The files that were read, slow stops first, as far as their speed is known."""
        return sorted((file for file in self.files.values() if file.usable), key=lambda file: (speed_of(file), file.name))

    @property
    def runs(self) -> list[File]:
        """The files that take part: read, with every mapped column, not left out."""
        needed = {column.name for column in self.columns.values()}
        return [file for file in self.usable if file.group != "left out" and needed <= {one.name for one in file.channels}]

    # Columns

    def _suggest(self) -> None:
        """Take the suggestions of the most files that share their columns; tune and validate as `wsp inspect` does."""
        groups: dict[frozenset[tuple[str, str]], list[File]] = {}
        for file in self.usable:
            key = frozenset((one.guess, one.name) for one in file.channels if one.guess)
            groups.setdefault(key, []).append(file)
        if not groups:
            self.columns = {}
            return
        chosen = max(groups.values(), key=len)
        suggested = {one.guess: Column(one.name, one.guessed_unit) for one in chosen[0].channels if one.guess}
        kept = {name: column for name, column in self.columns.items() if not column.suggested}
        self.columns = suggested | kept
        axles = [int(match[1]) for name in self.columns if (match := re.match(r"axle(\d+)_", name))]
        self.axles = max(axles, default=self.axles)
        _, validates = split(tuple(file.path for file in sorted(chosen, key=lambda file: file.slid)))
        for file in self.usable:
            if file.group != "left out":
                file.group = "validate" if file.path in validates else "tune"

    def choose(self, channel: str, name: str, unit: str) -> None:
        """Map a channel to a column by hand; `RefusedError` for a unit that does not fit; "" for no column."""
        if not name:
            self.columns.pop(channel, None)
        else:
            if unit:
                try:
                    kinds.factor(unit, channel, 1.0, channel_words(channel))
                except CampaignError as error:
                    raise RefusedError(str(error)) from None
            self.columns[channel] = Column(name, unit, suggested=False)
        self.forget("check")

    @property
    def shown(self) -> list[str]:
        """The channels that are offered, in the order of the page."""
        each = ("wheel_speed", "brake_torque", "cylinder_pressure")
        return ["time", "vehicle_speed", *(f"axle{k}_{kind}" for kind in each for k in range(1, self.axles + 1))]

    @property
    def missing(self) -> list[str]:
        """Say what the columns still lack."""
        lacks = []
        clocked = all(channel.rate_hz for file in self.runs[:1] for channel in file.channels)
        lacks += [] if "time" in self.columns or clocked else ["the time"]
        lacks += [] if "vehicle_speed" in self.columns else ["the vehicle's speed"]
        lacks += [] if any(name.endswith("_wheel_speed") for name in self.columns) else ["the wheels' speeds"]
        if not any(name.endswith(("_brake_torque", "_cylinder_pressure")) for name in self.columns):
            lacks.append("torques or cylinder pressures")
        if not any(file.group == "tune" for file in self.runs):
            lacks.append("a run to tune on that has all these columns")
        return lacks

    def curve(self, file: File, name: str) -> np.ndarray | None:
        """Return (2, points) of a column: time [s], and lowest and highest values as the file has them; None where not kept."""
        with np.load(self.folder / "look" / f"{file.name}.npz") as kept:
            names = kept["names"].tolist()
            return np.asarray(kept[f"c{names.index(name)}"]) if name in names else None

    # Vehicle

    @property
    def asked(self) -> dict[str, str]:
        """What only a person knows of the vehicle."""
        torques = any(name.endswith("_brake_torque") for name in self.columns)
        return {key: words for key, words in ASKED.items() if key != "torque_per_bar_nm" or not torques}

    def take_vehicle(self, vehicle: Vehicle, source: str) -> None:
        """Take mass, inertia, radius and torque per bar of a described vehicle."""
        self.described, self.vehicle_from = of_vehicle(vehicle), source
        self.vehicle = {key: value for key, value in self.described.items() if key in ASKED and isinstance(value, float)}
        self.forget("check")
        self.changed()

    def take_vehicle_file(self, path: Path) -> None:
        """Take those of a vehicle file; `RefusedError` says what is wrong with it."""
        try:
            self.take_vehicle(read_vehicle(path), path.name)
        except ParameterError as error:
            raise RefusedError(str(error).replace(f"{path.parent}/", "")) from None

    # The campaign

    def campaign_text(self) -> str:
        """Return campaign.toml; `RefusedError` where something is still open."""
        if self.missing:
            raise RefusedError(f"still missing: {', '.join(self.missing)}")
        runs = self.runs
        by_column = {column.name: (channel, column.unit) for channel, column in self.columns.items()}
        mapped = [_mapped(channel, by_column) for channel in runs[0].channels]
        paths = tuple(file.path for file in runs)
        text = draft(paths[0], mapped, in_order(paths), self.recordings)
        names = run_names(paths, self.recordings)
        others = f" and {len(runs) - 1} more" if len(runs) > 1 else ""
        text = _with(text, "\nname = ", f"name = {json.dumps(paths[0].stem + others, ensure_ascii=False)}")
        for group in ("tune", "validate"):
            chosen = in_order([file.path for file in runs if file.group == group])
            listed = json.dumps([names[path] for path in chosen], ensure_ascii=False)
            text = _with(text, f"\n{group} = ", f"{group} = {listed}")
        text = with_vehicle(text, {**self.described, **self.vehicle})
        if still := open_questions(text):
            raise RefusedError(f"still missing: {', '.join(ASKED[key] for key in still)}")
        text = text.replace("   # guessed", "").replace(" EDIT:", "")
        return text.replace(text.partition("\n")[0], "# Written by `wsp studio`.", 1)

    def write_campaign(self) -> None:
        """Write campaign.toml beside the files."""
        write_text(self.recordings / "campaign.toml", self.campaign_text())


def _with(text: str, begins: str, line: str) -> str:
    start = text.find(begins) + 1
    return f"{text[:start]}{line}\n{text[text.index(chr(10), start) + 1 :]}" if start else text


def _mapped(channel: InspectedChannel, by_column: Mapping[str, tuple[str, str]]) -> InspectedChannel:
    name, unit = by_column.get(channel.name, ("", ""))
    return dataclasses.replace(
        channel, guess=name, guessed_unit=unit or channel.unit or (kinds.channel(name).unit if name else "")
    )
