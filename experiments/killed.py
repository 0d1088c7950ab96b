"""Every command killed (kill -9) and interrupted (Ctrl-C) at random moments: results whole or absent, and equal once resumed.

`python experiments/killed.py --each 50 --log out/killed.jsonl`; what the log holds is not done again. Commands run in forks of
a process that has everything imported, so that a moment falls into the work and not into the start of Python.
"""

import argparse
import hashlib
import importlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from wsp_env.cli import main as wsp
from wsp_env.recordings import demo_campaign

_SIGNALS = {"kill": signal.SIGKILL, "interrupt": signal.SIGINT}
_ORPHANS_END_S = 10.0  # so long may workers live on after their parent


def commands(campaign: Path) -> dict[str, list[str]]:
    """Return every command that writes a file, small; {out} is the folder that it writes into."""
    short = ["--cases", "low-120", "--draws", "1", "--controllers", "rule-based", "--jobs", "1"]
    return {
        "inspect": ["inspect", str(campaign / "A1.csv"), "--out", "{out}/campaign.toml"],
        "validate": ["validate", str(campaign), "--out", "{out}/validation.html", "--excel"],
        "replay": ["replay", str(campaign), "--controllers", "rule-based", "--out", "{out}"],
        "compare": ["compare", "--out", "{out}/c.html", "--mu-cd", "0.04", "--tau", "2e-4", "--speed", "15"],
        "evaluate": ["evaluate", "--vehicle", "wheelset", *short, "--out", "{out}"],
        "export": ["export", "c", "law", "--out", "{out}/law"],
        "compare-campaigns": ["compare-campaigns", str(campaign), str(campaign), "--tuned-only", "--out", "{out}"],
        "diagnose": ["diagnose", str(campaign), "--out", "{out}", "--workers", "1"],
        "demo": ["demo", "--out", "{out}/demo.html"],
    }


def start(arguments: Sequence[str], out: Path, said: Path) -> int:
    """Run a command in a fork with a session of its own; return its process."""
    pid = os.fork()
    if pid:
        return pid
    os.setsid()
    with said.open("wb") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    code = 70
    try:
        code = wsp([one.replace("{out}", str(out)) for one in arguments])
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def results(out: Path) -> dict[str, str]:
    """Return the files of a folder by name with their SHA-256; what is being written has a name that begins with a dot."""
    files = [file for file in sorted(out.rglob("*")) if file.is_file() and not file.name.startswith(".")]
    return {file.relative_to(out).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


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


def attempt(name: str, arguments: Sequence[str], kind: str, whole: dict[str, str], after_s: float) -> list[str]:
    """End a command after a time; return what is wrong with what it leaves, and with what it makes of it when run again."""
    place = Path(tempfile.mkdtemp())
    out, said = place / "out", place / "said"
    pid = start(arguments, out, said)
    time.sleep(after_s)
    if kind == "kill":
        os.kill(pid, signal.SIGKILL)
    elif alive(pid):
        os.killpg(pid, signal.SIGINT)
    _, status = os.waitpid(pid, 0)
    wrong = []
    until = time.monotonic() + _ORPHANS_END_S
    while alive(pid) and time.monotonic() < until:
        time.sleep(0.1)
    if left := alive(pid):
        wrong.append(f"{len(left)} workers outlive it")
    text = said.read_text(encoding="utf-8", errors="replace")
    if "Traceback" in text:
        wrong.append(f"traceback: {text[-300:]}")
    if kind == "interrupt" and os.waitstatus_to_exitcode(status) not in (0, 130):
        wrong.append(f"exit status {os.waitstatus_to_exitcode(status)}: {text[-200:]}")
    there = results(out)
    wrong += [f"{file} is neither whole nor absent" for file, digest in there.items() if whole.get(file) != digest]
    if name != "inspect" or "campaign.toml" not in there:  # it refuses to write over a campaign.toml
        os.waitpid(start(arguments, out, said), 0)
        if results(out) != whole:
            wrong.append("resumed, its results differ")
    shutil.rmtree(place, ignore_errors=True)
    return wrong


def main(arguments: Sequence[str] | None = None) -> int:
    """Kill and interrupt every command so many times; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=50)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, default=Path("out/killed.jsonl"))
    given = parser.parse_args(arguments)
    given.log.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in given.log.read_text().splitlines()] if given.log.exists() else []
    had = Counter((one["command"], one["kind"]) for one in done)
    bad = sum(bool(one["wrong"]) for one in done)
    generator = random.Random(given.seed + len(done))
    for name, own in commands(demo_campaign()).items():
        importlib.import_module(f"wsp_env.cli.{name.replace('-', '_')}")
        if given.only and name not in given.only:
            continue
        place = Path(tempfile.mkdtemp())
        for _ in range(2):  # the second time nothing is compiled any more
            shutil.rmtree(place / "out", ignore_errors=True)
            began = time.monotonic()
            os.waitpid(start(own, place / "out", place / "said"), 0)
            took = time.monotonic() - began
        whole = results(place / "out")
        if not whole:
            print(f"{name} writes nothing: {(place / 'said').read_text()[-500:]}")
            return 1
        for kind in _SIGNALS:
            for _ in range(had[name, kind], given.each):
                after = generator.uniform(0.0, 1.05 * took)
                wrong = attempt(name, own, kind, whole, after)
                bad += bool(wrong)
                with given.log.open("a") as stream:
                    stream.write(json.dumps({"command": name, "kind": kind, "after_s": after, "wrong": wrong}) + "\n")
                if wrong:
                    print(f"{name}, {kind} after {after:.2f} s: {'; '.join(wrong)}", flush=True)
        shutil.rmtree(place, ignore_errors=True)
        print(f"{name}: {took:.1f} s whole, {given.each} times each", flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
