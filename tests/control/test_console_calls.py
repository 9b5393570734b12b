# SPDX-License-Identifier: Apache-2.0
"""The console's calls: a service that is not matched yet, and requests that are lost."""

from __future__ import annotations

import asyncio

import pytest
from rclpy.task import Future
from std_srvs.srv import Trigger

from cabols_control.console.latest import LatestValues
from cabols_control.ros.console import calls as console_calls
from cabols_control.ros.console.calls import Calls
from cabols_control.ros.rig_client import calls as rig_calls


class FakeClient:
    """A client of a service that is matched at the k-th look and loses the first requests."""

    def __init__(self, matched_after=0, lost=0):
        self.looks, self.matched_after = 0, matched_after
        self.lost, self.asked, self.removed = lost, 0, 0

    def service_is_ready(self):
        self.looks += 1
        return self.looks > self.matched_after

    def call_async(self, request):
        self.asked += 1
        future = Future()
        if self.asked > self.lost:
            future.set_result(Trigger.Response(success=True, message="stopped"))
        return future

    def remove_pending_request(self, future):
        self.removed += 1


@pytest.fixture
def call(monkeypatch):
    """Calls a service through a fake client; quick ones, so that nothing takes its full time."""
    monkeypatch.setattr(console_calls, "REPEAT_S", 0.01)
    monkeypatch.setattr(console_calls, "LOOK_AGAIN_S", 0.001)
    monkeypatch.setattr(rig_calls, "ActionClient", lambda *_: None)

    def ask(client, service="emergency_stop"):
        class Node:
            def create_client(self, kind, name):
                return client

        calls = Calls(Node(), LatestValues())
        return asyncio.run(calls.call(service, {}))

    return ask


def test_service_that_is_not_matched_yet_is_waited_for(call):
    """A permitted emergency stop was refused, as its service was looked for once."""
    client = FakeClient(matched_after=20)
    assert call(client).success
    assert client.asked == 1


def test_service_that_never_comes_is_said(call, monkeypatch):
    monkeypatch.setattr(console_calls, "MATCH_S", 0.05)
    answer = call(FakeClient(matched_after=10**9))
    assert not answer.success
    assert "its node is not running" in answer.message


def test_emergency_stop_is_repeated_until_it_is_answered(call):
    client = FakeClient(lost=5)
    assert call(client).success
    assert client.asked == 6
    assert client.removed == 5


def test_other_requests_are_sent_once(call, monkeypatch):
    """A tare that was done and whose answer was lost is not to be done twice."""
    monkeypatch.setattr(console_calls, "ANSWER_S", 0.1)
    client = FakeClient(lost=1)
    answer = call(client, "tare")
    assert not answer.success
    assert "no answer" in answer.message
    assert client.asked == 1
