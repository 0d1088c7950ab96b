"""The tutorial does what it says: its blocks are run from top to bottom, as a reader would."""

import re
import shlex
import tomllib
import warnings
from pathlib import Path

import pytest

from wsp_env.cli import main

PAGE = Path(__file__).parents[1] / "docs" / "tutorial.md"
TRUE_TAU = 2.338e-4  # [m/J] of the demo campaign, wsp_env/data/README.md


@pytest.mark.slow
def test_tutorial_from_top_to_bottom(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")  # tables in full width
    printed = {}
    for language, block in re.findall(r"^```(python|console|toml)\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S):
        if language == "python":
            exec(compile(block, str(PAGE), "exec"), {})
        elif language == "toml":
            draft = tomllib.loads(Path("trial/campaign.toml").read_text(encoding="utf-8"))
            assert tomllib.loads(block)["channels"] == draft["channels"], "the draft's guesses are what the tutorial shows"
            Path("trial/campaign.toml").write_text(block, encoding="utf-8")
        else:
            program, *arguments = shlex.split(block.removeprefix("$ "))
            assert program == "wsp"
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                assert main(arguments) == 0, capsys.readouterr().err
            printed[arguments[0]] = capsys.readouterr().out
    assert list(printed) == ["inspect", "tune", "validate", "replay"]
    low, high = map(float, re.search(r"interval (\S+) to (\S+) m/J", printed["tune"]).groups())
    assert low < TRUE_TAU < high
    assert "meets all the seed paper's own figures" in " ".join(printed["validate"].split())
    for name in ("validation.html", "replay/replay.html"):
        assert (tmp_path / "trial" / name).stat().st_size > 10_000
    for shown in ("test_07", "test_09", "test_12", "rule-based", "none", "recorded"):
        assert shown in printed["replay"]
