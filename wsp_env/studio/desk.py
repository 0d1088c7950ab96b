"""The driving desk: two stops that are chosen, braked in a child process and compared. No page in here."""

import dataclasses
from pathlib import Path
from typing import Any

from wsp_env.contact.port import LAWS
from wsp_env.parameters.quantity import ParameterError
from wsp_env.plant.mechanisms import ALL
from wsp_env.studio.jobs import Job
from wsp_env.studio.stop import Choice
from wsp_env.studio.workspace import RefusedError

#: What a desk begins with: the same stop under two protections.
FIRST = (Choice(controller="rule-based"), Choice(controller="adaptive"))

#: Mechanisms that can be chosen by hand; terms without a name come from a diagnosis only.
MECHANISMS = {name: card for name, card in ALL.items() if card.named}


class Desk:
    """Two stops."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.choices = list(FIRST)
        self.braked = list(FIRST)  # what was chosen when they were braked last
        self.job: Job | None = None
        self.version = 0

    def choose(self, number: int, **changes: Any) -> None:
        """Change what is chosen for a stop; `RefusedError` for what cannot be."""
        try:
            self.choices[number] = dataclasses.replace(self.choices[number], **changes)
        except (ParameterError, TypeError) as error:
            raise RefusedError(str(error)) from None

    def add(self, number: int, mechanism: str) -> None:
        """Give a stop a mechanism, at the size at which it is usually studied."""
        card = MECHANISMS[mechanism]
        values = {one.name: one.typical for one in card.parameters} | dict(card.study)
        self.choose(number, mechanisms={**self.choices[number].mechanisms, mechanism: values})

    def drop(self, number: int, mechanism: str) -> None:
        """Take a mechanism away."""
        left = {name: values for name, values in self.choices[number].mechanisms.items() if name != mechanism}
        self.choose(number, mechanisms=left)

    def set(self, number: int, mechanism: str, parameter: str, value: float) -> None:
        """Change a parameter of a mechanism."""
        known = self.choices[number].mechanisms
        self.choose(number, mechanisms={**known, mechanism: {**known[mechanism], parameter: value}})

    @property
    def stops(self) -> list[dict[str, Any]]:
        """The stops that were braked last."""
        return self.job.result["stops"] if self.job is not None and self.job.state == "done" else []

    async def brake(self) -> None:
        """Brake both stops."""
        if self.job is not None and self.job.running:
            raise RefusedError("the stops are still being braked")
        self.braked = list(self.choices)
        request = {"stops": [dataclasses.asdict(choice) for choice in self.choices]}
        self.job = Job("brake", self.folder / "brake", request)
        self.version += 1
        try:
            await self.job.run()
        finally:
            self.version += 1

    @property
    def sentence(self) -> str:
        """What the two stops come to."""
        a, b = self.stops
        if not (a["stopped"] and b["stopped"]):
            running = " and ".join(name for name, stop in (("A", a), ("B", b)) if not stop["stopped"])
            return f"{running} did not stop within {max(a['time_s'], b['time_s']):.0f} s."
        apart = b["distance_m"] - a["distance_m"]
        if abs(apart) < 0.5:
            return f"Both stop after {a['distance_m']:.0f} m."
        return (
            f"A stops after {a['distance_m']:.0f} m, B after {b['distance_m']:.0f} m: B needs {abs(apart):.0f} m "
            f"{'more' if apart > 0 else 'less'}, {100 * abs(apart) / a['distance_m']:.0f} %."
        )


def laws() -> dict[str, str]:
    """Return the contact laws with what each is."""
    return {name: law.summary for name, law in LAWS.items()}
