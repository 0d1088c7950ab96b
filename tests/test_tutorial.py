"""The tutorial does what it says: its blocks are run from top to bottom, as a reader would."""

import json
import re
import shlex
import tomllib
import warnings
from pathlib import Path

import pytest

from wsp_env.cli import main

PAGE = Path(__file__).parents[1] / "docs" / "tutorial.md"
TRUE_TAU = 2.536e-4  # [m/J] of the concealed campaign, wsp_env/data/README.md


@pytest.mark.slow
@pytest.mark.long
def test_tutorial_from_top_to_bottom(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")  # tables in full width
    printed, names = {}, {}
    for language, block in re.findall(r"^```(python|console|toml)\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S):
        if language == "python":
            exec(compile(block, str(PAGE), "exec"), names)
        elif language == "toml":
            draft = tomllib.loads(Path("trial/campaign.toml").read_text(encoding="utf-8"))
            assert tomllib.loads(block)["channels"] == draft["channels"], "the draft's guesses are what the tutorial shows"
            assert draft["vehicle"]["axle_positions_m"] == [0.0, 2.56, 19.0, 21.56]
        else:
            words = shlex.split(block.partition("\n")[0].removeprefix("$ "))
            program, *arguments = words[: words.index(">")] if ">" in words else words
            assert program == "wsp"
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                assert main(arguments) == 0, capsys.readouterr().err
            printed[arguments[0]] = capsys.readouterr().out
            if ">" in words:
                Path(words[-1]).write_text(printed[arguments[0]])
    assert list(printed) == ["vehicle", "inspect", "tune", "validate", "diagnose", "replay"]
    tau = float(re.search(r"tau = (\S+) m/J", printed["tune"])[1])
    assert tau == pytest.approx(TRUE_TAU, rel=0.1)  # off by more than its interval: the law lacks physics
    model = json.loads(Path("trial/diagnosis/model.json").read_text())
    assert abs(model["tau_m_per_J"] - TRUE_TAU) < abs(tau - TRUE_TAU)
    assert "meets all the seed paper's own figures" in " ".join(printed["validate"].split())
    assert "named: What the simulation lacks: the pads' friction falls" in " ".join(printed["diagnose"].split())
    for name in ("signals.html", "validation.html", "diagnosis/report.html", "replay/replay.html"):
        assert (tmp_path / "trial" / name).stat().st_size > 10_000
    for shown in ("test_07", "test_09", "test_12", "test_13", "rule-based", "none", "recorded"):
        assert shown in printed["replay"]
