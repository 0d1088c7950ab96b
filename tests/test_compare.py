"""The comparison of the classic and the recovering law."""

import json
import math

import pytest

from wsp_env import cli
from wsp_env.evaluation.compare import StopOptions, compare
from wsp_env.parameters.uic_z1 import BOGIE


def test_recovery_shortens_a_sliding_stop_and_leaves_a_rolling_one():
    result = compare("none", BOGIE, (0.03, 0.2), (1e-5, 4e-4), StopOptions(30.0, draws=1))
    pairs = {(pair.mu_cd, pair.tau): pair for pair in result.pairs}
    assert pairs[0.03, 4e-4].gained_m > pairs[0.03, 1e-5].gained_m > 0.0
    assert pairs[0.03, 4e-4].parted_mps > pairs[0.03, 1e-5].parted_mps  # the stronger recovery shows earlier
    assert pairs[0.03, 4e-4].largest_gap_mps > 0.5
    assert pairs[0.03, 1e-5].classic_m == pairs[0.03, 4e-4].classic_m
    rolling = pairs[0.2, 4e-4]  # more adhesion than the brake asks for
    assert rolling.gained_m == pytest.approx(0.0, abs=0.1)
    assert math.isnan(rolling.parted_mps)


def test_the_command_compares(tmp_path, capsys):
    page = tmp_path / "compare.html"
    arguments = ["--controller", "none", "--vehicle", "wheelset", "--speed", "15", "--mu-cd", "0.03", "--tau", "2e-4"]
    assert cli.main(["compare", *arguments, "--out", str(page), "--json"]) == 0
    pairs = json.loads(capsys.readouterr().out)["pairs"]
    assert len(pairs) == 1
    assert pairs[0]["gained_m"] == pytest.approx(pairs[0]["classic_m"] - pairs[0]["recovering_m"])
    assert "mu_cd 0.03" in page.read_text()
    assert cli.main(["compare", *arguments, "--out", str(page)]) == 0
    printed = capsys.readouterr().out
    assert "parted" in printed
    assert "\\" not in printed
    assert cli.main(["compare", "--tau", "0"]) == 2


DIES = """\
import os


class Dies:
    def reset(self, n, vehicle):
        os._exit(3)

    def act(self, seen):
        pass
"""


@pytest.mark.parametrize("code", ["import os\n\nos._exit(3)\n", DIES], ids=["loaded", "begun"])
def test_a_controller_that_ends_its_process_is_named(code, tmp_path, capsys):
    file = tmp_path / "[" / "bold].py"  # no markup
    file.parent.mkdir()
    file.write_text(code)
    page = tmp_path / "compare.html"
    assert cli.main(["compare", "--controller", f"{file}:Dies", "--vehicle", "wheelset", "--out", str(page)]) == 2
    why = "ended the process it ran in, twice" if code == DIES else "it calls os._exit(3)"
    assert f"{file}:Dies" in (said := capsys.readouterr().err)
    assert why in said
    assert not page.exists()
