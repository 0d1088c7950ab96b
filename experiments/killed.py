"""Every command killed (kill -9) and interrupted (Ctrl-C) at random moments: results whole or absent, and equal once resumed.

`python experiments/killed.py --each 50 --log out/killed.jsonl`; what the log holds is not done again. Commands run on small
campaigns, in forks of a process that has everything imported, so that a moment falls into the work and not into the start of
Python. The moment is drawn evenly over the processor time of an undisturbed run: a busy machine does not move it.
"""

import argparse
import hashlib
import importlib
import json
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from wsp_env.child import CLOCK_PER_CPU
from wsp_env.cli import INTERRUPTED, demo
from wsp_env.cli import main as wsp

_SIGNALS = {"kill": signal.SIGKILL, "interrupt": signal.SIGINT}
_ORPHANS_END_S = 10.0  # so long may workers live on after their parent: one that is just being started ends once it is
_ENDS_S = 600.0  # by the clock, after Ctrl-C: longer counts as a hang, on a busy machine too
_LOOKS_EVERY_S = 0.005
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


class Command(NamedTuple):
    """What is run; {out} is the folder that it writes into."""

    arguments: Sequence[str]
    files: Path | None = None  # that lie in that folder before
    once: str = ""  # a result over which the command refuses to write


class Ended(NamedTuple):
    """How a command ended."""

    status: int  # exit status; the signal's number below zero
    took_s: float  # of the processor, with its workers
    late_s: float  # by the clock, from the signal on
    lived_s: float  # by the clock, workers after it
    left: int  # processes that outlive it


def commands(place: Path) -> dict[str, Command]:
    """Return every command that writes a file, on campaigns that are written to a folder."""
    one, other, files = place / "one", place / "other", place / "files"
    writer = multiprocessing.get_context("spawn").Process(target=campaigns, args=(one, other))
    writer.start()  # polars may not be used here: its threads do not come along into forks
    writer.join()
    shutil.copytree(one, files, ignore=shutil.ignore_patterns("*.toml"))
    short = ["--cases", "low-120", "--draws", "1", "--controllers", "rule-based", "--jobs", "1"]
    return {
        "inspect": Command(["inspect", f"{one}/A1.csv", "--out", "{out}/campaign.toml"], once="campaign.toml"),
        "inspect FOLDER": Command(["inspect", "{out}", "--vehicle", "coach"], files),
        "validate": Command(["validate", str(one), "--out", "{out}/validation.html", "--excel"]),
        "replay": Command(["replay", str(one), "--controllers", "rule-based", "--out", "{out}"]),
        "compare": Command(["compare", "--out", "{out}/c.html", "--mu-cd", "0.04", "--tau", "2e-4", "--speed", "15"]),
        "evaluate": Command(["evaluate", "--vehicle", "wheelset", *short, "--out", "{out}"]),
        "export": Command(["export", "c", "law", "--out", "{out}/law"]),
        "compare-campaigns": Command(["compare-campaigns", str(one), str(other), "--out", "{out}"]),
        "diagnose": Command(["diagnose", str(one), "--out", "{out}", "--workers", "1", "--excel"]),
        "demo": Command(["demo", "--out", "{out}/demo.html"]),
    }


def campaigns(*folders: Path) -> None:
    """Write campaigns: two stops of 8 s to tune on, one to validate; friction differs from folder to folder."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    made = importlib.import_module("synthetic_stops")
    for number, folder in enumerate(folders):
        frictions = [0.055 - 0.005 * number + more for more in (0.0, 0.01, 0.005)]
        stops = made.stops(2e-4, frictions, 25.0, 8.0, 0.25, 1.0, [1, 2, 3])
        made.write_campaign(folder, dict(zip(("A1", "A2", "B1"), stops, strict=True)), ["A1", "A2"], ["B1"])


def start(command: Command, out: Path, said: Path) -> int:
    """Run a command in a fork with a session of its own; return its process once it is at work."""
    if command.files:
        shutil.copytree(command.files, out)
    ready, tell = os.pipe()
    if pid := os.fork():
        os.close(tell)
        os.read(ready, 1)
        os.close(ready)
        return pid
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # where this runs in the background it is ignored
    with said.open("wb") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    code = 70
    try:
        os.write(tell, b".")
        code = wsp([one.replace("{out}", str(out)) for one in command.arguments])
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def wait(pid: int, until_s: float = float("inf"), kind: str = "") -> Ended:
    """Wait for a command's end; send it the signal once it has taken so much of the processor [s]."""
    sent = 0.0
    while not (ended := os.wait4(pid, os.WNOHANG))[0]:
        if not sent and until_s < float("inf") and spent(pid) >= until_s:
            sent = time.monotonic()
            os.kill(pid, signal.SIGKILL) if kind == "kill" else os.killpg(pid, signal.SIGINT)
        if sent and time.monotonic() - sent > _ENDS_S:
            os.killpg(pid, signal.SIGKILL)
        time.sleep(_LOOKS_EVERY_S)
    late = time.monotonic() - sent if sent else 0.0
    began = time.monotonic()
    while (left := alive(pid)) and time.monotonic() < began + _ORPHANS_END_S * CLOCK_PER_CPU:
        time.sleep(0.1)
    lived = time.monotonic() - began
    for one in left:
        os.kill(one, signal.SIGKILL)
    used = ended[2]
    return Ended(os.waitstatus_to_exitcode(ended[1]), used.ru_utime + used.ru_stime, late, lived, len(left))


def spent(pid: int) -> float:
    """Return what a process and its children have taken of the processor [s]."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return 0.0
    return _TICK_S * sum(map(int, fields[11:15])) + sum(map(spent, map(int, children)))


def alive(session: int) -> list[int]:
    """Return the processes of a session that run."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == session and fields[0] != "Z":
                found.append(int(entry.name))
    return found


def results(out: Path, hidden: bool = False) -> dict[str, str]:
    """Return the files of a folder by name with their SHA-256; what is being written (`hidden`) begins with a dot."""
    files = [file for file in sorted(out.rglob("*")) if file.is_file() and file.name.startswith(".") == hidden]
    return {file.relative_to(out).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


class Trials:
    """A command with what an undisturbed run leaves, and what was seen of broken ones."""

    def __init__(self, command: Command) -> None:
        """Run it undisturbed; once more where that compiled kernels."""
        self.command = command
        self._resumed: dict[tuple[tuple[str, str], ...], str] = {}  # what was left -> what is wrong once it is run again
        compiled = _compiled()
        self.whole, self.took_s = self._undisturbed()
        if _compiled() != compiled:
            self.whole, self.took_s = self._undisturbed()

    def _undisturbed(self) -> tuple[dict[str, str], float]:
        """Return the results, and what they take of the processor [s]."""
        with tempfile.TemporaryDirectory() as place:
            out, said = Path(place, "out"), Path(place, "said")
            ended = wait(start(self.command, out, said))
            whole, text = results(out), said.read_text(encoding="utf-8", errors="replace")
        if ended.status or not whole:
            raise SystemExit(f"{' '.join(self.command.arguments)} ends with {ended.status}: {text[-500:]}")
        return whole, ended.took_s

    def attempt(self, kind: str, share: float) -> dict[str, Any]:
        """End the command after that share of its work; return how it ended and what is wrong, also when it is run again."""
        place = Path(tempfile.mkdtemp())
        out, said = place / "out", place / "said"
        ended = wait(start(self.command, out, said), share * self.took_s, kind)
        text = said.read_text(encoding="utf-8", errors="replace")
        wrong = []
        if ended.left:
            wrong.append(f"{ended.left} workers outlive it")
        if "Traceback" in text:
            wrong.append(f"traceback: {text[-300:]}")
        if kind == "interrupt" and ended.status not in (0, INTERRUPTED):
            wrong.append(f"exit status {ended.status}: {text[-200:]}")
        if kind == "interrupt" and (half := results(out, hidden=True)):
            wrong.append(f"left half-written: {', '.join(half)}")
        there = results(out)
        wrong += [f"{file} is neither whole nor absent" for file, digest in there.items() if self.whole.get(file) != digest]
        wrong += filter(None, [self._resume(out, said)])
        shutil.rmtree(place, ignore_errors=True)
        own = set(there) - set(results(self.command.files) if self.command.files else ())
        late, lived = round(ended.late_s, 2), round(ended.lived_s, 1)
        return {"status": ended.status, "late_s": late, "workers_lived_s": lived, "files": len(own), "wrong": wrong}

    def _resume(self, out: Path, said: Path) -> str:
        """Run a broken command again; say what is wrong with its results. The same files left are tried once."""
        left = results(out) | {f".{number}": digest for number, digest in enumerate(results(out, hidden=True).values())}
        # In an empty folder, or one as it was before, the command would be an undisturbed one, which has been tried.
        if set(left) == set(results(self.command.files) if self.command.files else ()) or self.command.once in left:
            return ""
        key = tuple(sorted(left.items()))
        if key not in self._resumed:
            ended = wait(start(self.command._replace(files=None), out, said))
            text = said.read_text(encoding="utf-8", errors="replace")
            same = results(out) == self.whole and not ended.status
            self._resumed[key] = "" if same else f"resumed, it ends otherwise: {ended.status}, {text[-300:]}"
        return self._resumed[key]


def _compiled() -> set[Path]:
    """Return the compiled kernels."""
    return set(Path(importlib.import_module("wsp_env.compiled").__file__ or "").parent.glob("__pycache__/kernels-*/*/*"))


def main(arguments: Sequence[str] | None = None) -> int:
    """Kill and interrupt every command so many times, all of them in turn; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=50)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, default=Path("out/killed.jsonl"))
    given = parser.parse_args(arguments)
    given.log.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in given.log.read_text().splitlines()] if given.log.exists() else []
    had = Counter((one["command"], one["kind"]) for one in done)
    generator = random.Random(given.seed + len(done))
    place = Path(tempfile.mkdtemp())
    known = commands(place)
    for name in known:
        importlib.import_module(f"wsp_env.cli.{name.partition(' ')[0].replace('-', '_')}")
    vars(demo)["concealed_campaign"] = lambda: place / "one"  # `wsp demo` on a small campaign
    trials: dict[str, Trials] = {}
    turns = [(turn, name, kind) for turn in range(given.each) for name in given.only or known for kind in _SIGNALS]
    for turn, name, kind in turns:
        if turn < had[name, kind]:
            continue
        if name not in trials:
            trials[name] = Trials(known[name])
            print(f"{name}: {trials[name].took_s:.2f} s of the processor, {len(trials[name].whole)} files", flush=True)
        share = generator.uniform(0.0, 1.0)
        one = {"command": name, "kind": kind, "share": round(share, 4), **trials[name].attempt(kind, share)}
        done.append(one)
        with given.log.open("a") as stream:
            stream.write(json.dumps(one) + "\n")
        if one["wrong"]:
            print(f"{name}, {kind} at {share:.0%}: {one['wrong']}", flush=True)
    shutil.rmtree(place)
    table(done)
    return any(one["wrong"] for one in done)


def table(done: Sequence[dict[str, Any]]) -> None:
    """Print what the log holds, a row for each command."""
    of: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
    for one in done:
        of[one["command"]].append(one)
    print("| command | killed | interrupted | ended at work | with results | longest end after Ctrl-C [s] | wrong |")
    for name, tried in of.items():
        at_work = sum(one["status"] != 0 for one in tried)
        count = Counter(one["kind"] for one in tried)
        longest = max((one["late_s"] for one in tried if one["kind"] == "interrupt"), default=0.0)
        cells = (name, count["kill"], count["interrupt"], at_work, sum(one["files"] > 0 for one in tried), longest)
        print(f"| {' | '.join(map(str, cells))} | {sum(bool(one['wrong']) for one in tried)} |")


if __name__ == "__main__":
    sys.exit(main())
