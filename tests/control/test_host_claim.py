# SPDX-License-Identifier: Apache-2.0
"""Names of a host: one process has each, and a killed one has none."""

import os
import signal
import subprocess
import sys
import uuid

import pytest

from cabols_control.ros.lifetime.host_claim import HostClaim


@pytest.fixture
def name():
    return f"{'a name of any length ' * 20}{uuid.uuid4()}"


def test_a_name_is_had_once_and_given_back(name):
    first, second = HostClaim(), HostClaim()
    assert first.take(name)
    assert not second.take(name)
    assert second.take(name + "2")
    first.release()
    assert second.take(name)
    second.release()


def test_what_a_killed_process_had_is_free_at_once(name):
    code = (
        "import sys, time\n"
        "from cabols_control.ros.lifetime.host_claim import HostClaim\n"
        "claim = HostClaim()\n"
        "print(claim.take(sys.argv[1]), flush=True)\n"
        "time.sleep(60)\n"
    )
    path = os.pathsep.join(p for p in sys.path if p)
    child = subprocess.Popen(
        [sys.executable, "-c", code, name],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    try:
        assert child.stdout.readline() == "True\n"
        claim = HostClaim()
        assert not claim.take(name)
        child.send_signal(signal.SIGKILL)
        child.wait()
        assert claim.take(name)
        claim.release()
    finally:
        child.kill()
        child.communicate()
