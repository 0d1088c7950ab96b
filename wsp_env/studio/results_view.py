"""The screens of work: check, tune, validate, diagnose, each with progress, cancel and what came out."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from wsp_env.diagnosis.words import capital
from wsp_env.studio import shell
from wsp_env.studio.workspace import STEPS, Workspace

_LEADS = {
    "check": ("The recordings as read", "What was repaired, and which channels contradict the others."),
    "tune": ("How fast sliding cleans the rail", "The recovery rate tau, and the friction mu_cd of each stop's rail."),
    "validate": ("Does the tuned law hold?", "On the stops it was not tuned on, and in the vehicle, as the seed paper does."),
    "diagnose": ("Which physics is missing?", "Where recordings and law differ, what explains it, and how sure that is."),
}
_ACTIONS = {"check": "Check", "tune": "Tune", "validate": "Validate", "diagnose": "Diagnose"}
_WORDS = {"report.html": "The report, one page (HTML)", "report.pdf": "On paper (PDF)", "report.xlsx": "Every table (Excel)",
          "diagnosis.json": "The diagnosis as data (JSON)", "model.json": "The law with what was found (JSON)"}  # fmt: skip
_MOST_WARNINGS = 12


class ResultsView:
    """One tab's view of the work on a workspace."""

    def __init__(self, space: Workspace, key: str) -> None:
        self._space, self._key = space, key
        self._bar: Any = None
        self._said: Any = None
        self._task = ""

    def tick(self) -> None:
        """Show how far the running work is."""
        job = self._space.jobs.get(self._task)
        if job is None or not job.running or self._bar is None:
            return
        self._bar.set_value(round(job.share, 3))
        self._said.set_text(f"{job.step} · {100 * job.share:.0f} % · {job.seconds:.0f} s")

    def draw(self, task: str) -> None:
        """Show the screen of a task."""
        space, self._task, self._bar = self._space, task, None
        job = space.jobs.get(task)
        with ui.element("main").classes("card column").style("gap: 1rem"):
            shell.heading(*_LEADS[task])
            if job is not None and job.running:
                self._working(job)
                return
            if job is not None and job.state == "failed":
                shell.note(job.message)
            if job is not None and job.state == "cancelled":
                shell.note("Cancelled; nothing is left of it.")
            if job is not None and job.state == "done":
                shows: dict[str, Callable[[Any], None]] = {
                    "check": self._checked, "tune": self._tuned, "validate": self._validated, "diagnose": self._diagnosed,
                }  # fmt: skip
                shows[task](job)
            self._actions(task, job is not None and job.state == "done")
        if job is not None and job.state == "done" and task in ("check", "validate", "diagnose"):
            name = "signals.html" if task == "check" else "report.html"
            ui.element("iframe").props(f'src="{self._address(task, name)}" title="the page" sandbox="allow-scripts"').classes(
                "report"
            )

    def _working(self, job: Any) -> None:
        with ui.row().classes("w-full items-center no-wrap"):
            self._bar = ui.linear_progress(value=job.share, show_value=False, size="10px").classes("grow").props("rounded")
            shell.secondary("Cancel", lambda: shell.begin(self._cancel(job)))
        self._said = ui.label(job.step).classes("quiet").props("role=status aria-live=polite")

    async def _cancel(self, job: Any) -> None:
        await job.cancel()
        self._space.changed()

    def _actions(self, task: str, done: bool) -> None:
        following = STEPS[STEPS.index(task.capitalize()) + 1] if task != "diagnose" else ""
        with ui.row().classes("items-center").style("gap: .6rem"):
            if not done:
                shell.primary(_ACTIONS[task], shell.tried(lambda: self._start(task)))
            elif following:
                shell.primary(f"Continue: {following.lower()}", lambda: self._go(following))
            else:
                ui.button("Download the report", on_click=lambda: self._download(task)).props("unelevated no-caps")
            shell.secondary("Back", lambda: self._go(STEPS[STEPS.index(task.capitalize()) - 1]))

    def _go(self, step: str) -> None:
        self._space.step = STEPS.index(step)
        self._space.changed()

    def _start(self, task: str) -> None:
        space = self._space
        if task == "check":
            space.write_campaign()
        shell.begin(space.start(task, {"pdf": True}))

    def _address(self, task: str, name: str, how: str = "left") -> str:
        """Return where a file is: "left" to look at, "file" to take along."""
        return f"/{how}/{self._key}/{task}/{name}"

    def _download(self, task: str) -> None:
        job = self._space.jobs[task]
        best = "report.pdf" if "report.pdf" in job.result["files"] else "report.html"
        ui.download.from_url(self._address(task, best, "file"))

    def _links(self, task: str, files: list[str]) -> None:
        with ui.row().classes("items-center").style("gap: 1.4rem"):
            for name in files:
                ui.link(_WORDS[name], self._address(task, name, "file")).props(f'download="{name}"')
            ui.link("campaign.toml", self._address("campaign", "campaign.toml", "file")).props('download="campaign.toml"')

    # What came out

    def _checked(self, job: Any) -> None:
        for one in job.result["suspects"]:
            shell.note(f"{one['channel']}: {one['suspicion']}. {capital(one['remedy'])}.")
        if not job.result["suspects"]:
            shell.note("No channel contradicts the others.", "good")
        repaired = job.warnings[:_MOST_WARNINGS]
        if repaired:
            with ui.expansion(f"{len(job.warnings)} things were repaired or left out", value=len(repaired) <= 4).classes(
                "w-full"
            ):
                for words in repaired:
                    ui.label(words).classes("small").style("overflow-wrap: anywhere")

    def _tuned(self, job: Any) -> None:
        shell.note(f"{job.result['sentence']}.", "good" if job.result["determined"] else "warn")
        for one in job.result["absurd"]:
            shell.note(f"{capital(one)}.")
        shell.table(job.result["table"])
        ui.label(f"{capital(job.result['table']['caption'])}.").classes("quiet small")

    def _validated(self, job: Any) -> None:
        shell.note(job.result["verdict"], "good")
        shell.table(job.result["table"])
        self._links("validate", job.result["files"])

    def _diagnosed(self, job: Any) -> None:
        shell.note(job.result["sentence"], "good")
        ui.label(f"Next test: {job.result['next_test']}").style("max-width: 60rem")
        self._links("diagnose", job.result["files"])
