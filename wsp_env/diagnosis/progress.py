"""How far a diagnosis is: the steps that it reports, as a share of its whole time."""

import re

#: Steps of a diagnosis of stops and the share of its time [-] after which each begins (measured on campaigns of three to five
#: stops that took one round or two; of later rounds a guess; one that nothing is missing in ends before the rounds).
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
    """How far a diagnosis is; the steps of creep curves are not known before, each takes half of what is left."""

    def __init__(self) -> None:
        """Stand before the first step."""
        self.share = 0.0
        self._name, self._span = "", (0.0, 0.0)

    def enters(self, step: str) -> bool:
        """Whether a text is of another step than the last one."""
        return _parsed(step)[0] != self._name

    def reach(self, step: str) -> float:
        """Return the share of the whole [-] that is done when a step, "name" or "name 3 of 10", is reported."""
        name, inside = _parsed(step)
        if name != self._name:
            self._name = name
            later = [start for start in (*STEPS.values(), 1.0) if start > STEPS.get(name, 1.0)]
            self._span = (STEPS[name], later[0]) if name in STEPS else (self.share, 0.5 + 0.5 * self.share)
        start, end = self._span
        self.share = max(self.share, start + inside * (end - start))
        return self.share


def _parsed(step: str) -> tuple[str, float]:
    """Return the name of a step and the share of it [-] that is done; rounds of stops are steps of their own."""
    if step in STEPS:
        return step, 0.0
    counted = _COUNTED.fullmatch(step)
    return (f"{counted['name']}s", int(counted["done"]) / int(counted["of"])) if counted else (step, 0.0)
