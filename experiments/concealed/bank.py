"""Generates a bank: campaigns in DIR/campaigns, what is true of them in DIR/labels.json, its hash in DIR/labels.sha256."""

import dataclasses
import hashlib
import itertools
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from experiments.concealed.campaign import build, label, write
from experiments.concealed.concealment import passes, tuned, worst_error
from experiments.concealed.errors import BankError
from experiments.concealed.faults import inject
from experiments.concealed.interest import drive, sizes
from experiments.concealed.net import net
from experiments.concealed.plan import Case, plan
from experiments.concealed.workers import results
from wsp_env.executor import Executor, pack, unpack

#: An effect that the paper's validation would see is made smaller by this factor, at most so often; then all is drawn anew, and
#: when no draw helped, from the first draw on it is made smaller still.
SHRINK, SHRINKS = 0.75, 6
DRAWS, ROUNDS = 8, 2


@dataclasses.dataclass(frozen=True)
class Job:
    """One case to generate; picklable."""

    case: Case
    seed: int

    def __str__(self) -> str:
        """Return what a line may call it."""
        return self.case.name


def _label(out: Path, case: Case) -> Path:
    """Return the file of a case's label; when it is there, all of the case is."""
    return out / "labels" / f"{case.name}.json"


def generate(job: Job) -> bytes:
    """Generate one case until it is concealed; return its campaign and its label, packed, the label last."""
    case = job.case
    with tempfile.TemporaryDirectory(prefix="wsp-") as place:
        out = Path(place)
        truth = _concealed(job, out)
        if case.fault:  # after the paper's validation: it asks what is missing in the law, and not in a channel
            truth |= {"fault_axles": inject(out / "campaigns" / case.name, case.fault, case.repeat, job.seed + case.index)}
        _label(out, case).parent.mkdir()
        _label(out, case).write_text(json.dumps(truth), encoding="utf-8")
        return pack(out)


def _concealed(job: Job, out: Path) -> dict[str, Any]:
    table, case, first = sizes(), job.case, True
    for smaller, attempt in itertools.product(range(ROUNDS), range(DRAWS)):
        for turn in range(smaller * SHRINKS, (smaller + 1) * SHRINKS if case.effects else smaller * SHRINKS + 1):
            setup, concealed = build(case, job.seed, attempt, table, SHRINK**turn)
            distances = write(out / "campaigns" / case.name, case, setup, job.seed, attempt)
            error = worst_error(out / "campaigns" / case.name)
            if passes(error):
                plain, _ = build(case, job.seed, attempt, table, 0.0)
                without = {name: distance for name, (_, distance) in drive(plain, np.random.default_rng(0)).items()}
                truth = label(case, setup, concealed, distances, without if case.effects else distances)
                write(out / "plain", case, plain, job.seed, attempt)
                laws = (tuned(folder) for folder in (out / "campaigns" / case.name, out / "plain"))
                size = net(setup, plain, *laws) if case.effects else 0.0
                shutil.rmtree(out / "plain")
                return truth | {
                    "net": size,
                    "worst_relative_adhesion_error_percent": None if error is None else round(100 * error, 2),
                    "concealed_at_first": first,
                }
            first = False
    raise BankError(f"{case.name} ({', '.join(case.effects) or 'null'}): none of {DRAWS} draws passes the paper's validation")


def make(out: Path, cases: int, seed: int, executor: Executor) -> str:
    """Generate what is not there yet and publish the hash of the labels, which is returned.

    Raises
    ------
    BankError
        when the folder holds a bank of another size or seed

    """
    out.mkdir(parents=True, exist_ok=True)
    described = {"cases": cases, "seed": seed}
    head = out / "bank.json"
    if head.is_file() and (there := json.loads(head.read_text(encoding="utf-8"))) != described:
        raise BankError(f"{out} holds another bank, {there}, not {described}: choose another folder or the same numbers")
    head.write_text(json.dumps(described), encoding="utf-8")
    planned = plan(cases)
    todo = [Job(case, seed) for case in planned if not _label(out, case).is_file()]
    for _, content in results(generate, todo, executor, "bank"):
        unpack(content, out)
    ordered = sorted(planned, key=lambda case: case.name)
    labels = {case.name: json.loads(_label(out, case).read_text(encoding="utf-8")) for case in ordered}
    text = json.dumps(labels, indent=1) + "\n"
    (out / "labels.json").write_text(text, encoding="utf-8")
    digest = hashlib.sha256(text.encode()).hexdigest()
    (out / "labels.sha256").write_text(f"{digest}  labels.json\n", encoding="utf-8")
    return digest


def read_labels(out: Path, first: int | None = None) -> dict[str, dict[str, Any]]:
    """Read the labels of a bank, refusing them where they are not what was published.

    Parameters
    ----------
    first : how many of the cases, which are mixed: any first part holds all classes by their shares; None: all

    """
    file, published = out / "labels.json", out / "labels.sha256"
    if not file.is_file() or not published.is_file():
        raise BankError(f"{out} holds no finished bank (labels.json, labels.sha256): run `bank --out {out}` first")
    text = file.read_bytes()
    if hashlib.sha256(text).hexdigest() != published.read_text(encoding="utf-8").split()[0]:
        raise BankError(f"{file} has changed since its hash was published: generate the bank anew")
    labels: dict[str, dict[str, Any]] = json.loads(text)
    return dict(itertools.islice(labels.items(), first))
