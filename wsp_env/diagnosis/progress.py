"""Progress of a diagnosis: its steps as shares of the whole time."""

import re

#: Steps of a diagnosis of stops, with the share of the time [-] at which each begins. Measured on campaigns of three to five
#: stops with one or two rounds; estimated for later rounds. A diagnosis without findings ends before the rounds.
STEPS = {
    "checking the data": 0.0,
    "fitting the baseline": 0.02,
    "searching": 0.15,
    "refitting 1 of 3": 0.4,
    "refitting 2 of 3": 0.6,
    "refitting 3 of 3": 0.75,
    "judging": 0.9,
}
_COUNTED = re.compile(r"(?P<name>.*?)s? (?P<done>\d+) of (?P<of>\d+)")


class Advance:
    """Tracks the progress of a diagnosis; a step of creep curves, unknown in advance, takes half of the remaining time."""

    def __init__(self) -> None:
        """Start before the first step."""
        self.share = 0.0
        self._name, self._span = "", (0.0, 0.0)

    def enters(self, step: str) -> bool:
        """Whether a text reports another step than the last one."""
        return _parsed(step)[0] != self._name

    def reach(self, step: str) -> float:
        """Return the share of the whole [-] that is done when a step "name" or "name 3 of 10" is reported."""
        name, inside = _parsed(step)
        if name != self._name:
            self._name = name
            later = [start for start in (*STEPS.values(), 1.0) if start > STEPS.get(name, 1.0)]
            self._span = (STEPS[name], later[0]) if name in STEPS else (self.share, 0.5 + 0.5 * self.share)
        start, end = self._span
        self.share = max(self.share, start + inside * (end - start))
        return self.share


def _parsed(step: str) -> tuple[str, float]:
    """Return the name of a step and the share of it [-] that is done; rounds of stops are separate steps."""
    if step in STEPS:
        return step, 0.0
    counted = _COUNTED.fullmatch(step)
    return (f"{counted['name']}s", int(counted["done"]) / int(counted["of"])) if counted else (step, 0.0)
