"""What a child process of the studio does: one task, with progress as lines of JSON and its result as a file.

The tasks call what `wsp inspect`, `tune`, `validate` and `diagnose` call, and write the same pages.
"""

import json
import os
import sys
import warnings
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from wsp_env.output import OutputError, write_text, write_whole
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import CampaignError, CampaignWarning, read_campaign
from wsp_env.report import PageOptions

Request = dict[str, Any]
Tell = Callable[[str, float], None]  # what is done now, and the share of the whole [-] that is done

#: Points of a curve of the lowest and of the highest values: a screen shows no more.
BUCKETS = 600


def main(task: str, place: str) -> int:
    """Do a task whose request lies in a folder; return the exit status."""
    folder = Path(place)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)  # what anything else prints is no answer

    def say(**words: Any) -> None:
        answers.write(json.dumps(words) + "\n")

    warnings.simplefilter("always", CampaignWarning)
    warnings.showwarning = lambda message, kind, *_: say(warning=str(message)) if kind is CampaignWarning else None
    request = json.loads((folder / "request.json").read_text(encoding="utf-8"))
    try:
        result = TASKS[task](folder, request, lambda step, share: say(step=step, share=share))
        write_text(folder / "result.json", json.dumps(result, allow_nan=False))
    except (CampaignError, ParameterError, OutputError, ModuleNotFoundError) as error:
        say(error=str(error).replace(f"{request.get('hide', '')}{os.sep}", ""))
        return 2
    except MemoryError:
        say(error="the machine's memory does not suffice")
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def look(folder: Path, request: Request, tell: Tell) -> Request:
    """Inspect files: their channels, what these may be, and curves of the lowest and highest values to draw.

    Each file's answer is written as it is found: `NAME.json`, and `NAME.npz` with its curves.
    """
    files = [Path(file) for file in request["files"]]
    for number, file in enumerate(files):
        tell(f"reading {file.name}", number / len(files))
        try:
            answer = _looked(folder, file, request)
        except CampaignError as error:
            answer = {"error": str(error).replace(f"{file.parent}{os.sep}", "")}
        write_text(folder / f"{file.name}.json", json.dumps(answer, allow_nan=False))
    return {}


def _looked(folder: Path, file: Path, request: Request) -> Request:
    from wsp_env.recordings.inspection import inspect, suspicions
    from wsp_env.recordings.sliding import slid

    found = inspect(file)
    names = [channel.name for channel in found if channel.guess] + [channel.name for channel in found if not channel.guess]
    write_whole(folder / f"{file.name}.npz", _curves(file, names[: request["most_curves"]], found))
    channels = [asdict(channel) | {"quality": _finite(asdict(channel.quality))} for channel in found]
    rows = max(channel.samples for channel in found)
    return {"channels": channels, "suspicions": suspicions(found), "rows": rows, "slid": slid(file, found)}


def _curves(file: Path, names: list[str], found: list[Any]) -> Callable[[Any], None]:
    """Return what writes the envelopes of channels: per channel (2, points) time [s] or sample number, and value."""
    import numpy as np

    from wsp_env.recordings import channels as kinds
    from wsp_env.recordings.readers import open_file

    opened = open_file(file)
    clock = next((channel for channel in found if channel.guess == "time"), None)
    shared = None
    if clock is not None:
        shared = opened.read([clock.name])[clock.name].values * kinds.factor(clock.guessed_unit or "s", "time", 1.0, "")
        shared = shared - (np.nanmin(shared) if np.isfinite(shared).any() else 0.0)
    curves = {}
    for number, name in enumerate(names):
        samples = opened.read([name])[name]
        time = samples.time_s if samples.time_s is not None else shared
        if time is None or len(time) != len(samples.values):
            time = np.arange(len(samples.values), dtype=float)
        curves[f"c{number}"] = envelope(time, samples.values)
    return lambda stream: np.savez(stream, names=np.array(names), **curves)


def envelope(time: Any, values: Any) -> Any:
    """Return (2, points): a curve through the lowest and the highest value of each of `BUCKETS` stretches of samples."""
    import numpy as np

    kept = np.isfinite(values) & np.isfinite(time)
    time, values = time[kept], values[kept]
    if len(values) <= 2 * BUCKETS:
        return np.stack([time, values]).astype(np.float32)
    starts = np.linspace(0, len(values), BUCKETS, endpoint=False).astype(int)
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    return np.stack([np.repeat(time[starts], 2), np.stack([low, high], axis=1).ravel()]).astype(np.float32)


def _finite(values: Request) -> Request:
    """Return numbers as JSON has them: what is no finite number is left out."""
    return {key: value for key, value in values.items() if not isinstance(value, float) or abs(value) < float("inf")}


def check(folder: Path, request: Request, tell: Tell) -> Request:
    """Read a campaign as every command does; say what was repaired, what contradicts itself; write the page of signals."""
    from wsp_env.recordings.origin import origin
    from wsp_env.recordings.signals import write_signals
    from wsp_env.recordings.suspect import suspects

    place = Path(request["campaign"])
    tell("reading the recordings", 0.1)
    campaign = read_campaign(place)
    tell("comparing the channels", 0.5)
    found = [{"channel": one.channel, "suspicion": one.suspicion, "remedy": one.remedy} for one in suspects(campaign)]
    tell("drawing the signals", 0.8)
    write_signals(folder / "signals.html", campaign, origin("wsp studio", campaign, place), PageOptions(standalone=True))
    return {"suspects": found, "runs": {name: len(run.time_s) for name, run in campaign.runs.items()}}


def tune(folder: Path, request: Request, tell: Tell) -> Request:
    """Tune tau and mu_cd; the table of `wsp tune`."""
    from wsp_env import recordings
    from wsp_env.recordings.validation_report import adhesion_table

    tell("reading the recordings", 0.1)
    campaign = read_campaign(Path(request["campaign"]))
    tell("tuning", 0.3)
    tuning = recordings.tune(campaign)
    table = adhesion_table(tuning)
    shown = {"header": list(table.header), "rows": [list(row) for row in table.rows], "caption": table.caption}
    return tuning.to_json() | {"sentence": tuning.sentence, "table": shown, "absurd": tuning.absurd}


def validate(folder: Path, request: Request, tell: Tell) -> Request:
    """Validate; the page of `wsp validate`."""
    from wsp_env.recordings.origin import origin
    from wsp_env.recordings.validation import validate as validated
    from wsp_env.recordings.validation_report import criteria_table, write

    place = Path(request["campaign"])
    tell("reading the recordings", 0.1)
    campaign = read_campaign(place)
    tell("tuning and simulating every stop", 0.3)
    found = validated(campaign)
    tell("writing the report", 0.9)
    write(folder / "report.html", found, None, origin("wsp validate", campaign, place), _page(request))
    table = criteria_table(found)
    shown = {"header": list(table.header), "rows": [list(row) for row in table.rows], "caption": table.caption}
    return {"verdict": found.verdict, "table": shown, "files": _left(folder)}


def diagnose(folder: Path, request: Request, tell: Tell) -> Request:
    """Diagnose; the page, diagnosis.json and model.json of `wsp diagnose`."""
    from wsp_env.diagnosis import diagnose as diagnosed
    from wsp_env.diagnosis.progress import Advance
    from wsp_env.diagnosis.report import write_report
    from wsp_env.diagnosis.sources import signed

    place = Path(request["campaign"])
    campaign = read_campaign(place)
    course = Advance()
    found = diagnosed(campaign, lambda step: tell(step, course.reach(step)), os.cpu_count() or 1)
    found = signed(found, place)
    tell("writing the report", 0.97)
    write_text(folder / "diagnosis.json", json.dumps(found.to_json(), indent=1, allow_nan=False) + "\n")
    write_text(folder / "model.json", json.dumps(found.model, indent=1) + "\n")
    write_report(folder / "report.html", found, _page(request))
    return {"verdict": found.verdict, "sentence": found.sentence, "next_test": found.next_test, "files": _left(folder)}


def brake(folder: Path, request: Request, tell: Tell) -> Request:
    """Brake the stops of the driving desk, one after the other."""
    from wsp_env.studio.stop import Choice, braked

    stops = []
    for number, chosen in enumerate(request["stops"]):
        tell(f"stop {'AB'[number]}", number / len(request["stops"]))
        stops.append(braked(Choice(**chosen)))
    return {"stops": stops}


def _page(request: Request) -> PageOptions:
    """Return how a report is written: alone on its page, as it may be read where there is no network; on paper where it can."""
    from wsp_env.report.paper import browser

    return PageOptions(standalone=True, excel=True, pdf=bool(request.get("pdf")) and browser() is not None)


def _left(folder: Path) -> list[str]:
    """Return what is there to take along."""
    names = ("report.html", "report.pdf", "report.xlsx", "diagnosis.json", "model.json")
    return [name for name in names if (folder / name).exists()]


#: Every task by name.
TASKS: dict[str, Callable[[Path, Request, Tell], Request]] = {
    "look": look,
    "check": check,
    "tune": tune,
    "validate": validate,
    "diagnose": diagnose,
    "brake": brake,
}

if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
