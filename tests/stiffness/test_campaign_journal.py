# SPDX-License-Identifier: Apache-2.0
"""A campaign's folder survives what can happen to it; windows and their averages."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_stiffness.campaign.journal import Journal, bags_of, read_log, read_samples
from cabols_stiffness.campaign.requests import LoadKey
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.measurements.measured_load import MeasuredLoad, to_cells
from cabols_stiffness.measurements.window import Rolling, WindowAverage, average, stands


def make_load(random, load=0, group=0):
    root = random.normal(size=(6, 6))
    spread = random.normal(size=(3, 3))
    return MeasuredLoad(
        3,
        1,
        load,
        group,
        1,
        10**9,
        2 * 10**9,
        random.normal(size=8),
        WindowAverage(
            random.normal(size=6),
            root @ root.T,
            np.abs(random.normal(size=6)),
            random.normal(size=6),
            101,
        ),
        random.normal(size=3),
        spread @ spread.T,
    )


def test_loads_come_back_with_every_digit(tmp_path, random):
    loads = [make_load(random, number) for number in range(3)]
    journal = Journal(tmp_path / "campaign")
    for load in loads:
        journal.add(load)
    journal.close()
    again = Journal(tmp_path / "campaign")
    assert [to_cells(load) for load in again.loads] == [to_cells(load) for load in loads]
    assert again.finished == {LoadKey(3, 1, number) for number in range(3)}
    assert again.next_group == 1
    found = read_samples(tmp_path / "campaign", 2)
    np.testing.assert_array_equal(found[0].average.covariance, loads[2].average.covariance)
    again.close()


def test_line_that_was_cut_is_dropped(tmp_path, random):
    folder = tmp_path / "campaign"
    journal = Journal(folder)
    journal.add(make_load(random))
    journal.close()
    file = folder / "samples.csv"
    whole = file.read_bytes()
    file.write_bytes(whole + b"3,1,1,0,1,10000")
    assert len(read_samples(folder)) == 1, "who only reads leaves it out, too"
    journal = Journal(folder)
    assert len(journal.loads) == 1
    journal.add(make_load(random, 1))
    journal.close()
    assert [load.load for load in read_samples(folder)] == [0, 1]
    assert file.read_bytes().startswith(whole)


def test_damaged_line_is_named(tmp_path, random):
    folder = tmp_path / "campaign"
    journal = Journal(folder)
    journal.add(make_load(random))
    journal.close()
    file = folder / "samples.csv"
    file.write_bytes(file.read_bytes() + b"3,1,nonsense\n")
    with pytest.raises(CampaignError, match=r"samples.csv, line 3: expected \d+ cells, got 3"):
        Journal(folder)


def test_folder_belongs_to_one_campaign_and_one_process(tmp_path):
    folder = tmp_path / "campaign"
    journal = Journal(folder)
    with pytest.raises(CampaignError, match="is another campaign running"):
        Journal(folder)
    journal.close()
    other = tmp_path / "other.yaml"
    text = (folder / "campaign.yaml").read_text(encoding="utf-8")
    other.write_text(text.replace("retries: 2", "retries: 3"), encoding="utf-8")
    with pytest.raises(CampaignError, match="expected an empty folder or the same campaign"):
        Journal(folder, other)
    Journal(folder).close()


def test_bag_of_a_cut_run_gives_back_what_the_table_lacks(tmp_path, random):
    journal = Journal(tmp_path / "campaign")
    first, second = make_load(random, 0, 4), make_load(random, 1, 4)
    journal.add(first)
    assert journal.adopt([first, second]) == 1
    assert journal.adopt([first, second]) == 0
    assert journal.next_group == 5
    journal.close()


def test_log_and_bags(tmp_path):
    journal = Journal(tmp_path / "campaign")
    journal.tell(7, "skipped", [LoadKey(1, 2, 3), LoadKey(1, 2, 4)], "the beam, again, is blocked")
    bag = journal.new_bag()
    assert bag.name == "0001"
    bag.mkdir(parents=True)
    assert journal.new_bag().name == "0002"
    assert bags_of(tmp_path / "campaign") == [bag]
    journal.close()
    rows = read_log(tmp_path / "campaign")
    assert [row["load_index"] for row in rows] == ["3", "4"]
    assert rows[0]["reason"] == "the beam, again, is blocked"


def test_a_folder_of_0_1_goes_on(tmp_path, random):
    """Version 0.1 called the indices by their nouns alone; they counted from 0 then, too."""
    folder = tmp_path / "campaign"
    first, second = make_load(random, 0), make_load(random, 1)
    journal = Journal(folder)
    journal.add(first)
    journal.tell(7, "skipped", [LoadKey(1, 2, 3)], "the beam is blocked")
    journal.close()
    for name in ("samples.csv", "log.csv"):
        file = folder / name
        header, rest = file.read_text("utf-8").split("\n", 1)
        assert "configuration_index,reflector_index,load_index" in header
        file.write_text(header.replace("_index", "") + "\n" + rest, encoding="utf-8")
    journal = Journal(folder)
    journal.add(second)
    assert [load.load for load in journal.loads] == [first.load, second.load]
    journal.close()
    assert [load.load for load in read_samples(folder)] == [first.load, second.load]
    assert read_log(folder)[0]["configuration_index"] == "1"


def test_rolling_keeps_order_and_forgets_the_oldest(random):
    rolling = Rolling(2, 100)
    rows = random.normal(size=(730, 2))
    stamps = np.arange(730, dtype=np.int64) * 1000
    for begin in range(0, 730, 37):
        rolling.add(stamps[begin : begin + 37], rows[begin : begin + 37])
    rolling.add(stamps[-3:], rows[-3:] + 1.0)
    np.testing.assert_array_equal(rolling.between(650_000, 729_000), rows[650:730])
    with pytest.raises(CampaignError, match="window: expected it within the newest"):
        rolling.between(0, 729_000)
    rolling.add(np.array([10**9, 10**9, 2 * 10**9]), rows[:3])
    assert rolling.newest_ns == 2 * 10**9
    assert len(rolling.between(10**9, 2 * 10**9)) == 2


def test_average_of_a_window(random):
    wrenches, joints = Rolling(6, 1000), Rolling(6, 1000)
    stamps = np.arange(400, dtype=np.int64) * 1_000_000
    loads = 3.0 + random.normal(size=(400, 6))
    wrenches.add(stamps, loads)
    joints.add(stamps[::4], np.tile(np.arange(6.0), (100, 1)))
    found = average(wrenches, joints, 100_000_000, 200_000_000)
    np.testing.assert_allclose(found.wrench, loads[100:201].mean(axis=0))
    np.testing.assert_allclose(found.covariance, np.cov(loads[100:201], rowvar=False) / 101)
    np.testing.assert_allclose(found.joints, np.arange(6.0))
    assert found.samples == 101
    with pytest.raises(CampaignError, match="at least 5 samples"):
        average(wrenches, joints, 398_000_000, 500_000_000)
    bad = Rolling(6, 1000)
    bad.add(stamps, np.where(stamps[:, None] == 150_000_000, np.nan, loads))
    with pytest.raises(CampaignError, match="finite"):
        average(bad, joints, 100_000_000, 200_000_000)


def test_load_stands_when_it_has_stopped_to_change():
    stamps = np.arange(300, dtype=np.int64) * 1_000_000
    ramp = np.outer(np.minimum(np.arange(300) / 150.0, 1.0), np.full(6, 50.0))
    wrenches = Rolling(6, 1000)
    wrenches.add(stamps[:150], ramp[:150])
    assert not stands(wrenches, 40_000_000, 0.2, 0.03)
    wrenches.add(stamps[150:220], ramp[150:220])
    assert not stands(wrenches, 40_000_000, 0.2, 0.03), "the earlier window is not over yet"
    wrenches.add(stamps[220:], ramp[220:])
    assert stands(wrenches, 40_000_000, 0.2, 0.03)


def test_no_campaign_begins_among_foreign_files(tmp_path):
    """A home folder named by mistake stays as it is."""
    thesis = tmp_path / "thesis.tex"
    thesis.write_text("years of work")
    with pytest.raises(CampaignError, match=r"got one with thesis\.tex; name another folder"):
        Journal(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
