"""Damaged files for every door: what may become of them, and how they are damaged. Used by the tests and by `make fuzz`."""

import contextlib
import json
import random
import time
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
from synthetic_stops import stop, write_campaign
from test_policy import write as write_policy

from wsp_env.envs.model import read_model
from wsp_env.evaluation.network import check_network
from wsp_env.evaluation.policy import CONTRACT, NETWORK, load_policy
from wsp_env.evaluation.programme import STANDARD, read_programme
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle_file import read_vehicle, write_vehicle
from wsp_env.recordings import CampaignError, CampaignWarning, read_campaign
from wsp_env.recordings.creep_curves import eurosprinter_curve, read_creep_curves
from wsp_env.recordings.inspection import draft, inspect

#: Files that once went wrong; each is tried again in every run. Its name says at which door: `csv--what.csv`.
CORPUS = Path(__file__).parent / "crashes"

#: The doors: recordings in every format, and every JSON and TOML file.
NAMES = (
    "csv", "german.csv", "wide.csv", "parquet", "mat", "v73.mat", "mf4", "packed.mf4",
    "campaign", "curves", "vehicle", "programme", "model", "contract", "network",
)  # fmt: skip

#: A damaged file may take so long [s] of the processor.
LONGEST_S = 20.0

#: What damage puts into text: numbers beyond all bounds, depths, other types, signs that mean something elsewhere.
TOKENS = [
    b"1e400", b"-1", b"0", b"nan", b"inf", b"1" + b"0" * 400, b"1" + b"0" * 5000, b"[" * 2000, b"{" * 2000, b'"', b"'", b"\n",
    b"\r", b"\0", b",", b";", b"\t", b"true", b"null", b"{}", b"[]", b"=", b"\xff\xfe", b"\xef\xbb\xbf", b"\\ud800",
    b"12:00:00", b"</script><script>", b"[/bold]", b"../../../etc/passwd", b"a.b.c.d", b"#", b"1e-300",
    b"9999999999999", b"\x1b[31m",
]  # fmt: skip

#: Errors that a door may answer with.
REFUSALS = (ParameterError, CampaignError)


class Door:
    """One way in: a sound file, and what reads it."""

    def __init__(self, name: str, content: bytes, read: Callable[[Path], object], suffix: str):
        self.name, self.content, self.read, self.suffix = name, content, read, suffix

    def try_out(self, content: bytes, folder: Path) -> str:
        """Give a content to the door; return what it said, "" for one that it took. Any other error is raised."""
        file = folder / f"x{self.suffix}"
        file.write_bytes(content)
        began = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CampaignWarning)
            try:
                self.read(file)
                said = ""
            except REFUSALS as error:
                said = str(error)
        assert time.process_time() - began < LONGEST_S, "too slow"
        assert all(len(line) < 1100 and line.isprintable() for line in said.split("\n  ")), "its message is no line"
        return said


def damaged(content: bytes, seed: int) -> bytes:
    """Return a content with one to four damages: bits, bytes, cuts, doubled stretches, tokens, numbers of its binary fields."""
    rng = random.Random(seed)
    data = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        if not data:
            break
        at, to = sorted((rng.randrange(len(data)), rng.randrange(len(data))))
        kind = rng.randrange(8)
        if kind == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[at] = rng.randrange(256)
        elif kind == 2:
            del data[at:]
        elif kind == 3:
            del data[at : min(to, at + 200)]
        elif kind == 4:
            data[at:at] = data[at : min(to, at + 500)]
        elif kind == 5:
            data[at:at] = rng.choice(TOKENS)
        elif kind == 6:
            data[at : at + 8] = rng.choice((2**64 - 1, 2**63, 2**32, 0, at, len(data))).to_bytes(8, "little")
        else:
            data[at : at + rng.randint(1, 12)] = rng.choice(TOKENS)
    return bytes(data)


def doors(folder: Path) -> dict[str, Door]:
    """Return every door, with small sound files made in a folder."""
    columns = stop(2e-4, 0.06, duration_s=2.0)  # a second of coasting, then the brakes
    campaign = write_campaign(folder / "campaign", {"A1": columns})
    toml = (campaign / "campaign.toml").read_bytes()
    found = {}

    def add(name: str, content: bytes, read: Callable[[Path], object], suffix: str) -> None:
        found[name] = Door(name, content, read, suffix)

    def recording(file: Path) -> None:
        """Read a damaged file as the run of a campaign, and inspect it."""
        (file.parent / "campaign.toml").write_bytes(toml.replace(b"A1.csv", file.name.encode()))
        try:
            read_campaign(file.parent)
        finally:
            tomllib.loads(draft(file, inspect(file)))

    for suffix, content in _recordings(folder, columns).items():
        add(suffix.strip("."), content, recording, f".{suffix.split('.')[-1]}")

    def described(file: Path) -> None:
        (file.parent / "A1.csv").write_bytes((campaign / "A1.csv").read_bytes())
        read_campaign(file.parent)

    def curves(file: Path) -> None:
        for table in eurosprinter_curve().glob("*.csv"):
            (file.parent / table.name).write_bytes(table.read_bytes())
        read_creep_curves(file.parent)

    def contract(file: Path) -> None:
        policy = folder / "policy"
        (policy / CONTRACT).write_bytes(file.read_bytes())
        load_policy(policy)

    def network(file: Path) -> None:
        policy = folder / "network"
        policy.mkdir(exist_ok=True)
        write_policy(policy, content=file.read_bytes())
        try:
            load_policy(policy)
        finally:
            with contextlib.suppress(ValueError):
                check_network(file.read_bytes())

    (folder / "policy").mkdir()
    write_policy(folder / "policy")
    model = {"tau_m_per_J": 2e-4, "mu_cd": {"A1": 0.05}, "contact": {"kinetic_friction_d": 0.05}, "mechanisms": {}}
    model |= {"vehicle": {"axles": 4, "mass_kg": 43e3, "wheelset_inertia_kgm2": 160.0, "wheel_radius_m": 0.445}}
    add("campaign", toml, lambda file: described(file.rename(file.parent / "campaign.toml")), ".toml")
    text = (eurosprinter_curve() / "campaign.toml").read_bytes()
    add("curves", text, lambda file: curves(file.rename(file.parent / "campaign.toml")), ".toml")
    add("vehicle", write_vehicle(COACH).encode(), read_vehicle, ".toml")
    add("programme", STANDARD.read_bytes(), read_programme, ".toml")
    add("model", json.dumps(model).encode(), lambda file: read_model(str(file)), ".json")
    add("contract", (folder / "policy" / CONTRACT).read_bytes(), contract, ".json")
    add("network", (folder / "policy" / NETWORK).read_bytes(), network, ".onnx")
    return found


def _recordings(folder: Path, columns: dict[str, np.ndarray]) -> dict[str, bytes]:
    """Return the same short stop in every format."""
    import asammdf
    import h5py
    import scipy.io

    rounded = {name: np.round(values, 4) for name, values in columns.items()}
    frame = pl.DataFrame(rounded)
    frame.write_parquet(folder / "a.parquet")
    scipy.io.savemat(folder / "a.mat", rounded, do_compression=True)
    with h5py.File(folder / "b.mat", "w", userblock_size=512) as content:
        for name, values in rounded.items():
            content[name] = values
    for name, compression in (("a", 0), ("b", 2)):
        with asammdf.MDF(version="4.10") as mdf:
            time = rounded["time_s"]
            mdf.append([asammdf.Signal(values, time, name=own) for own, values in rounded.items() if own != "time_s"])
            mdf.save(folder / f"{name}.mf4", compression=compression)
    text = frame.write_csv()
    return {
        "csv": text.encode(),
        "german.csv": text.replace(",", ";").replace(".", ",").encode("cp850"),
        "wide.csv": text.encode("utf-16"),
        "parquet": (folder / "a.parquet").read_bytes(),
        "mat": (folder / "a.mat").read_bytes(),
        "v73.mat": (folder / "b.mat").read_bytes(),
        "mf4": (folder / "a.mf4").read_bytes(),
        "packed.mf4": (folder / "b.mf4").read_bytes(),
    }
