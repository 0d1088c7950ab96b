"""Results are written whole or not at all, where they cannot be it is said before the work, and they are never lost."""

import os
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from wsp_env.cli import main
from wsp_env.evaluation import results
from wsp_env.output import OutputError, all_of, ready, write_text, write_whole

#: Paths that nothing can be written to.
NOWHERE = [Path("/proc/nothing/x.html"), Path("a\0b"), Path("/dev/null/x")] if sys.platform == "linux" else [Path("a\0b")]


@pytest.mark.parametrize("path", NOWHERE)
def test_what_cannot_be_written_is_said_before_the_work(path):
    with pytest.raises(OutputError, match="cannot be written"):
        ready(path)


def test_a_folder_or_a_file_in_the_way_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "page.html").mkdir()
    for path in (tmp_path / "file" / "page.html", tmp_path / "page.html"):
        with pytest.raises(OutputError, match="cannot be written"):
            ready(path)
    ready(tmp_path / "new" / "page.html")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("path", NOWHERE[:1])
def test_a_result_is_not_lost(path, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(OutputError, match="it lies in"):
        write_text(path, "the answer")
    assert [file.read_text() for file in tmp_path.glob("wsp-*/*")] == ["the answer"]


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    file = tmp_path / "page.html"
    write_text(file, "first")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))

    def fails(stream):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="no space left on device; nor is there room elsewhere"):
        write_whole(file, fails)
    assert file.read_text() == "first"
    assert os.listdir(tmp_path) == ["page.html"]


def _fails(error, cause=None):
    def fail(*_):
        raise error from cause

    return fail


def test_ctrl_c_in_the_instant_after_a_file_is_made_leaves_nothing(tmp_path, monkeypatch):
    made = Path.open

    def interrupted(self, *mode):
        made(self, *mode).close()
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "open", interrupted)
    for write in (lambda: write_text(tmp_path / "a.txt", "b"), lambda: ready(tmp_path / "a.txt")):
        with pytest.raises(KeyboardInterrupt):
            write()
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "fail", [_fails(KeyboardInterrupt()), _fails(RuntimeError("Error calling __set_name__"), KeyboardInterrupt())]
)
def test_ctrl_c_while_a_command_is_imported_is_answered_in_a_word(fail, monkeypatch, capsys):
    monkeypatch.setattr("importlib.import_module", fail)
    assert main(["tune", "x"]) == 130
    assert capsys.readouterr().err == "wsp: interrupted\n"


def test_an_error_that_is_no_interrupt_is_not_hidden(monkeypatch):
    monkeypatch.setattr("importlib.import_module", _fails(RuntimeError("a defect")))
    with pytest.raises(RuntimeError, match="a defect"):
        main(["tune", "x"])


def test_one_result_that_fails_leaves_the_others():
    done = []

    def fails():
        raise OutputError("full")

    with pytest.raises(OutputError, match="full"):
        all_of(lambda: done.append(1), fails, lambda: done.append(2))
    assert done == [1, 2]


@pytest.mark.parametrize(
    "command",
    [
        ["diagnose", "DEMO", "--out", "FILE"],
        ["validate", "DEMO", "--out", "FILE/page.html"],
        ["replay", "DEMO", "--out", "FILE"],
        ["evaluate", "--out", "FILE"],
        ["demo", "--out", "FILE/page.html"],
        ["compare", "--out", "FILE/page.html"],
        ["compare-campaigns", "DEMO", "DEMO", "--out", "FILE"],
        ["inspect", "DEMO/A1.csv", "--out", "FILE/campaign.toml"],
        ["inspect", "FOLDER", "--out", "FILE/campaign.toml"],
        ["export", "c", "law", "--out", "FILE"],
        ["export", "fmu", "law", "--out", "FILE/law.fmu"],
        ["export", "template", "--out", "FILE"],
    ],
)
def test_every_command_tries_its_output_first(command, tmp_path, capsys, monkeypatch):
    from wsp_env.recordings import campaign, demo_campaign

    (tmp_path / "file").write_text("")
    run = next(demo_campaign().glob("*.csv")).name
    names = {"DEMO/A1.csv": str(demo_campaign() / run), "DEMO": str(demo_campaign()), "FOLDER": str(tmp_path)}
    arguments = [names.get(one, one.replace("FILE", str(tmp_path / "file"))) for one in command]
    monkeypatch.setattr(campaign, "read_recording", lambda *_: pytest.fail("work has begun"))
    assert main(arguments) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert "cannot be written" in said[0]


@pytest.mark.parametrize("command", [["validate", "x"], ["demo"], ["compare"], ["inspect", "x"], ["export", "fmu", "law"]])
def test_a_folder_is_refused_where_a_file_is_written(command, capsys):
    assert main([*command, "--out", "new/"]) == 2
    said = capsys.readouterr().err
    assert said == "wsp: --out new/ names a folder, but this command writes a file; name a file in it with --out\n"


@pytest.mark.parametrize("option", [["--output", "x"], ["--output=x"]])
def test_who_writes_output_is_told_the_name_of_the_option(option, capsys):
    with pytest.raises(SystemExit):
        main(["diagnose", "x", *option])
    assert "commands that write files take --out, not --output" in capsys.readouterr().err


def kept(stops=2):
    values = {name: np.zeros(stops) for name in results._EACH_STOP}
    return values | {name: np.zeros((5, stops)) for name in results._KEYS if name not in values}


def test_a_result_of_the_cache_is_what_was_written(tmp_path):
    file = tmp_path / "case.npz"
    results.write(file, kept())
    found = results.read(file)
    assert set(found) == set(kept())
    assert results.read(tmp_path / "nowhere.npz") is None
    changed = {name: np.array(values) for name, values in found.items()}
    with np.load(file) as archive:
        digest = archive["digest"]
    changed["energy"] = changed["energy"] + 1.0
    np.savez(file, digest=digest, **changed)
    with pytest.warns(UserWarning, match="its digest is another"):
        assert results.read(file) is None


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"law": None}, "lacks law"), ({"law": np.zeros(3)}, "differ in length"), ({"draw": np.zeros(9)}, "differ")],
)
def test_a_result_of_another_form_is_computed_again(tmp_path, wrong, said):
    values = {name: array for name, array in (kept() | wrong).items() if array is not None}
    results.write(tmp_path / "case.npz", values)
    with pytest.warns(UserWarning, match=said):
        assert results.read(tmp_path / "case.npz") is None


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY\x01\x00v\x00{}", b"\x80\x04."])
def test_a_damaged_result_is_computed_again(tmp_path, content):
    (tmp_path / "case.npz").write_bytes(content)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert results.read(tmp_path / "case.npz") is None
    assert len(said) == 1
