# SPDX-License-Identifier: Apache-2.0
"""Runs beside each other never share a domain that was drawn; one in a hundred did."""

from __future__ import annotations

import subprocess
import sys

import pytest

from cabols_control.bringup import free_domains

CLAIMS = (
    "import sys; from cabols_control.bringup.free_domains import claim_domain; "
    "print(*(claim_domain() for _ in range(15)), flush=True); sys.stdin.read()"
)


def test_processes_beside_each_other_get_other_domains():
    command = [sys.executable, "-c", CLAIMS]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen(command, **pipes) for _ in range(3)]
    try:
        claimed = [int(d) for process in processes for d in process.stdout.readline().split()]
    finally:
        for process in processes:
            process.communicate()
    assert len(set(claimed)) == 45
    assert set(claimed) <= set(free_domains.SAFE_DOMAINS)


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(free_domains, "FOLDER", tmp_path / "domains")
    monkeypatch.setattr(free_domains, "_claims", type(free_domains._claims)(maxlen=3))
    return tmp_path / "domains"


def test_a_domain_is_not_used_again_at_once_but_later(own_folder, monkeypatch):
    monkeypatch.setattr(free_domains, "SAFE_DOMAINS", range(1, 5))
    drawn = [free_domains.claim_domain() for _ in range(40)]
    assert all(len(set(drawn[k : k + 4])) == 4 for k in range(36))


def test_where_nothing_can_be_claimed_any_domain_is_drawn(own_folder):
    own_folder.write_text("no folder")
    assert free_domains.claim_domain() in free_domains.SAFE_DOMAINS
