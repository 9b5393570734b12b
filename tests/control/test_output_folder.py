# SPDX-License-Identifier: Apache-2.0
"""Output folders: what a command did not write is neither deleted nor overwritten."""

from __future__ import annotations

import ast
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cabols_control.errors import UsageError
from cabols_control.files.output_folder import MARKER, OccupiedFolderError, claim, output_folder

ROOT = Path(__file__).resolve().parents[2]


def fill(folder, name="bag/run.mcap", text="old"):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def finished_run(folder, **options):
    with output_folder(folder, "demo", **options) as output:
        fill(folder)
        output.finish()


def test_a_finished_run_is_replaced(tmp_path):
    folder = tmp_path / "demo"
    finished_run(folder)
    with output_folder(folder, "demo") as output:
        assert sorted(path.name for path in folder.iterdir()) == [MARKER]
        assert not output.said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["demo"]


@pytest.mark.parametrize("keep", [False, True])
def test_a_folder_with_foreign_files_is_refused_and_left_as_it_is(tmp_path, keep):
    thesis = fill(tmp_path, "thesis.tex", "years of work")
    with pytest.raises(OccupiedFolderError, match=r"thesis\.tex; nothing was touched"):
        claim(tmp_path, "demo", keep=keep)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    assert thesis.read_text() == "years of work"


def test_a_foreign_file_in_a_folder_of_ours_is_refused_and_left(tmp_path):
    folder = tmp_path / "demo"
    finished_run(folder)
    notes = fill(folder, "bag/notes.txt", "mine")
    with pytest.raises(OccupiedFolderError, match=r"bag/notes\.txt"):
        claim(folder, "demo")
    assert notes.read_text() == "mine"
    assert (folder / "bag/run.mcap").exists()


@pytest.mark.parametrize("how", ["interrupted", "killed"])
def test_what_an_unfinished_run_left_is_kept_beside(tmp_path, how):
    folder = tmp_path / "demo"
    if how == "interrupted":
        with output_folder(folder, "demo"):
            fill(folder, text="precious")
    else:
        code = (
            "import os, signal, sys, pathlib\n"
            "from cabols_control.files.output_folder import claim\n"
            "kept = claim(sys.argv[1], 'demo')\n"
            "p = pathlib.Path(sys.argv[1]) / 'bag' / 'run.mcap'\n"
            "p.parent.mkdir(); p.write_text('precious')\n"
            "os.kill(os.getpid(), signal.SIGKILL)\n"
        )
        done = subprocess.run([sys.executable, "-c", code, str(folder)], check=False)
        assert done.returncode == -signal.SIGKILL
    said = []
    with output_folder(folder, "demo", say=said.append):
        assert not (folder / "bag").exists()
    (kept,) = tmp_path.glob("demo_unfinished_*")
    assert (kept / "bag/run.mcap").read_text() == "precious"
    assert kept.name in said[0]
    # A second one does not replace the first.
    with output_folder(folder, "demo", say=said.append):
        pass
    assert (kept / "bag/run.mcap").read_text() == "precious"


def test_keep_goes_on_with_what_is_there_and_lists_only_its_own(tmp_path):
    folder = tmp_path / "campaign"
    finished_run(folder)
    notes = fill(folder, "notes.txt", "mine")
    with output_folder(folder, "campaign_bench", keep=True) as output:
        fill(folder, "samples.csv")
        output.finish()
    listed = json.loads((folder / MARKER).read_text())["files"]
    assert listed == ["bag/run.mcap", "samples.csv"]
    with pytest.raises(OccupiedFolderError, match=r"notes\.txt"):
        claim(folder, "campaign_bench")
    assert notes.exists()


def test_after_a_crash_nothing_is_taken_for_ours(tmp_path):
    """What lies in the folder of a killed run may be anybody's: kept, also after a later end."""
    folder = tmp_path / "campaign"
    claim(folder, "campaign_bench")._lock.close()  # as a kill leaves it
    fill(folder, "notes.txt", "mine")
    with output_folder(folder, "campaign_bench", keep=True) as output:
        output.finish()
    with output_folder(folder, "campaign_bench"):
        pass
    (kept,) = tmp_path.glob("campaign_unfinished_*")
    assert (kept / "notes.txt").read_text() == "mine"


def test_a_folder_in_use_is_refused_but_shared_with_a_tool_inside(tmp_path):
    folder = tmp_path / "commission"
    with output_folder(folder, "commission_bench") as outer:
        with pytest.raises(OccupiedFolderError, match="in use"):
            claim(folder, "demo")
        with output_folder(folder, "commission", keep=True, shared=True) as inner:
            fill(folder, "limbs.yaml")
            inner.finish()
        outer.finish()
    content = json.loads((folder / MARKER).read_text())
    assert content["command"] == "commission_bench"
    assert content["files"] == ["limbs.yaml"]


def test_a_file_or_a_place_that_cannot_be_written_is_refused(tmp_path):
    path = fill(tmp_path, "file")
    with pytest.raises(UsageError, match="got a file; name another folder"):
        claim(path, "demo")
    with pytest.raises(UsageError, match="name another folder"):
        claim(path / "below", "demo")
    with pytest.raises(UsageError, match="name another folder"):
        claim("/proc/nowhere", "demo")


def test_a_link_out_of_the_folder_is_removed_and_not_followed(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    treasure = fill(elsewhere, "treasure")
    folder = tmp_path / "demo"
    with output_folder(folder, "demo") as output:
        (folder / "link").symlink_to(elsewhere)
        output.finish()
    with output_folder(folder, "demo"):
        assert not os.path.lexists(folder / "link")
    assert treasure.exists()


def test_the_folder_behind_a_link_is_judged(tmp_path):
    behind = tmp_path / "home"
    thesis = fill(behind, "thesis.tex")
    link = tmp_path / "link"
    link.symlink_to(behind)
    with pytest.raises(OccupiedFolderError):
        claim(link, "demo")
    assert thesis.exists()


def test_a_torn_marker_counts_as_none(tmp_path):
    folder = tmp_path / "demo"
    finished_run(folder)
    (folder / MARKER).write_text("{")
    with pytest.raises(OccupiedFolderError):
        claim(folder, "demo")
    assert (folder / "bag/run.mcap").exists()


REMOVING = {"rmtree", "unlink", "rmdir", "remove", "removedirs"}
MAY_REMOVE = {
    "cabols_control/cabols_control/files/output_folder.py": "files that the marker lists",
    "cabols_control/cabols_control/calibration/recording.py": "a copy that it has just made",
    "cabols_control/cabols_control/bags/recover.py": "its own temporary file and old metadata",
    "cabols_control/cabols_control/bringup/processes.py": "logs of the same nodes before",
    "tests/bench/life_cycle.py": "bags and logs of its own starts that ended well",
    "tests/bench/bench_calibration.py": "its own rows, when asked to begin anew",
    "tests/bench/bench_pose_faults.py": "its own rows, when asked to begin anew",
    "tests/bench/bench_one_process.py": "the run before, in its own folder",
    "tests/bench/two_hosts.py": "an unfinished run of the same case, in its own folder",
    "tests/bench/bench_analysis.py": "bags that it has just written into its own folder",
}


def removals(text: str) -> list[str]:
    """Return the calls in a program that remove files or folders."""
    called = [node.func for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    found = [func for func in called if isinstance(func, ast.Attribute) and func.attr in REMOVING]
    of_lists = {"remove"}
    return [
        ast.unparse(func)
        for func in found
        if func.attr not in of_lists or ast.unparse(func.value) in ("os", "shutil")
    ]


def test_only_the_output_folder_removes_what_is_on_the_disk():
    sources = [*ROOT.glob("cabols_*/cabols_*/**/*.py"), *ROOT.glob("tests/bench/*.py")]
    found = {str(path.relative_to(ROOT)): removals(path.read_text()) for path in sources}
    assert {name for name, calls in found.items() if calls} <= set(MAY_REMOVE)
    assert len(sources) > 200


@pytest.mark.parametrize(
    "text", ["import shutil\nshutil.rmtree(options.output)", "path.unlink()", "os.remove(name)"]
)
def test_a_planted_removal_is_found(text):
    assert removals(text)
    assert not removals("items.remove(3)")
