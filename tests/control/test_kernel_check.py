# SPDX-License-Identifier: Apache-2.0
"""What is said of a kernel: of a rig's computer nothing is wanting, of others what to set."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cabols_control.realtime.check_command import main
from cabols_control.realtime.kernel_check import (
    Facts,
    TimerRun,
    judge,
    read_facts,
    run_timer,
    stolen_share,
)

GOOD = Facts(
    release="6.8.1-rt",
    preempt_rt=True,
    cores=8,
    isolated="2-3",
    fifo=True,
    locked_bytes=-1,
    wake_up=True,
    throttle_us=950_000,
    governors=("performance",),
    clock="tsc",
    virtual=False,
)
RUN = TimerRun(fifo=True, cycles=5000, median_us=5.0, p99_us=20.0, worst_us=60.0, lost=0)


def wanting(facts=GOOD, run=RUN, stolen=0.0):
    return [finding.subject for finding in judge(facts, [run], stolen) if not finding.good]


def test_a_rigs_computer_lacks_nothing():
    assert wanting() == []


@pytest.mark.parametrize(
    ("change", "subject"),
    [
        ({"preempt_rt": False}, "kernel"),
        ({"fifo": False}, "SCHED_FIFO"),
        ({"locked_bytes": 8 << 20}, "memory to lock"),
        ({"wake_up": False}, "limit on wake-up times"),
        ({"throttle_us": 500_000}, "real-time share"),
        ({"cores": 1}, "cores"),
        ({"cores": 2, "isolated": ""}, "cores"),
        ({"governors": ("performance", "powersave")}, "frequency"),
        ({"clock": "hpet"}, "clock"),
        ({"virtual": True}, "machine"),
    ],
)
def test_what_is_wanting_is_named_with_what_to_set(change, subject):
    facts = replace(GOOD, **change)
    assert wanting(facts) == [subject]
    assert all(f.advice for f in judge(facts, [RUN], 0.0))


def test_a_late_timer_is_named_and_so_is_one_that_is_not_a_number():
    assert wanting(run=replace(RUN, p99_us=900.0)) == ["bare timer, SCHED_FIFO"]
    assert wanting(run=replace(RUN, lost=5)) == ["bare timer, SCHED_FIFO"]
    assert wanting(run=replace(RUN, p99_us=float("nan"))) == ["bare timer, SCHED_FIFO"]
    assert wanting(stolen=0.01) == ["machine"]


def test_facts_are_read_from_proc_and_sys(tmp_path):
    texts = {
        "proc/version": "Linux version 6.1 SMP PREEMPT_RT",
        "proc/sys/kernel/sched_rt_runtime_us": "-1\n",
        "sys/devices/system/cpu/isolated": "2-3\n",
        "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "powersave\n",
        "sys/devices/system/clocksource/clocksource0/current_clocksource": "hpet\n",
        "proc/cpuinfo": "flags : fpu hypervisor sse\n",
    }
    for name, text in texts.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    facts = read_facts(tmp_path)
    assert (facts.preempt_rt, facts.isolated, facts.clock) == (True, "2-3", "hpet")
    assert (facts.throttle_us, facts.governors, facts.virtual) == (-1, ("powersave",), True)
    empty = read_facts(tmp_path / "none")
    assert (empty.preempt_rt, empty.governors, empty.virtual) == (False, (), False)


def test_stolen_time_is_a_share_of_all():
    before = "cpu  100 0 100 800 0 0 0 0 0 0"
    after = "cpu  150 0 150 870 0 0 0 30 0 0"
    assert stolen_share(before, after) == pytest.approx(30 / 200)
    assert stolen_share(before, before) == 0.0


def test_a_timer_runs_and_the_command_says_what_it_found(capsys, tmp_path):
    run = run_timer(0.1, fifo=False)
    assert run.cycles == 100
    assert 0.0 <= run.median_us <= run.p99_us <= run.worst_us
    code = main(["--seconds", "0.1", "--output", str(tmp_path / "rt.json")])
    out = capsys.readouterr().out
    assert code == (1 if "To set:" in out else 0)
    assert "bare timer, ordinary" in out
    assert (tmp_path / "rt.json").exists()
