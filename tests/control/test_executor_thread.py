# SPDX-License-Identifier: Apache-2.0
"""What control loops leave to the executor's thread: the lines of their log."""

from __future__ import annotations

import threading

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from cabols_control.bringup.free_domains import claim_domain
from cabols_control.ros.node import FAULT, RUNNING, Status
from cabols_control.ros.threads.executor_thread import hand_over
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.topics import NAMESPACE

pytestmark = [pytest.mark.ros]


@pytest.fixture
def node():
    context = Context()
    rclpy.init(context=context, domain_id=claim_domain())
    found = rclpy.create_node("loop", namespace=NAMESPACE, context=context)
    yield found
    found.destroy_node()
    context.shutdown()


@pytest.fixture
def executor(node):
    found = SingleThreadedExecutor(context=node.context)
    found.add_node(node)
    yield found
    found.remove_node(node)
    found.shutdown()


def test_a_call_waits_for_the_executors_thread(node, executor):
    done = hand_over(node, threading.get_ident)
    assert not done.done()
    thread = threading.Thread(target=executor.spin_once, args=(5.0,))
    thread.start()
    thread.join()
    assert done.result() == thread.ident


def test_without_an_executor_it_is_made_at_once(node):
    assert hand_over(node, threading.get_ident).result() == threading.get_ident()


def test_a_failure_is_the_executors(node, executor):
    done = hand_over(node, lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        executor.spin_once(5.0)
    assert isinstance(done.exception(), ZeroDivisionError)


def test_faults_come_and_go_in_the_log_without_keeping_the_loop(node, executor, capfd):
    status = Status(node, lockstep=True)
    for stamp_ns, state, fault in (
        (1, RUNNING, None),
        (2, FAULT, Fault(FaultName.WRENCH, "wrench: force x is 155.2 N")),
        (3, RUNNING, None),
        (4, FAULT, Fault(FaultName.TENSION, "tension: limb 3 pulls 145.1 N")),
    ):
        status.cycle(stamp_ns, state, fault)
    assert "force x" not in capfd.readouterr().err
    for _ in range(3):
        executor.spin_once(5.0)
    lines = capfd.readouterr().err.splitlines()
    assert ["force x" in lines[0], "cleared" in lines[1], "limb 3" in lines[2]] == [True] * 3
    assert "[ERROR]" in lines[0]
    assert "[INFO]" in lines[1]
