# SPDX-License-Identifier: Apache-2.0
"""docs/interface.md: made from the code, complete, up to date."""

import pytest

import interface
from cabols_control.ros.messages import topics
from cabols_control.ros.rig_client import calls as rig_calls

NODE = """
from cabols_msgs.srv import SetMode
from std_srvs.srv import Trigger


class Node:
    def __init__(self):
        self.create_client(SetMode, "asked_not_served")
        self.create_service(SetMode, "served", self.answer)
        for name, callback in (("one", self.one), ("two", self.two)):
            self.create_service(Trigger, name, callback)
        declare(self, "rate", 250.0, "Hz, of what it sends", (1.0, 1000.0))
"""


@pytest.fixture
def planted(tmp_path):
    """A tree with one node and one service type."""
    folder = tmp_path / "cabols_control" / "cabols_control" / "nodes"
    folder.mkdir(parents=True)
    (folder / "example.py").write_text(NODE)
    (tmp_path / "cabols_msgs" / "srv").mkdir(parents=True)
    (tmp_path / "cabols_msgs" / "srv" / "SetMode.srv").write_text("uint8 mode\n---\nbool success\n")
    return tmp_path


def test_page_and_picture_are_up_to_date():
    assert interface.PAGE.read_text() == interface.page(), "run `make interface`"
    text = interface.ARCHITECTURE.read_text()
    assert interface.with_picture(text) == text, "run `make interface`"


def test_page_names_every_topic_and_every_type():
    text = interface.page()
    assert not [name for name in topics.TYPES if f"| `{name}` |" not in text]
    for kind, paths in interface.definitions(interface.ROOT).items():
        assert paths, kind
        assert not [path.stem for path in paths if f"### {path.stem}\n" not in text]


def test_everything_that_the_console_calls_is_served():
    found = {item.name: item for item in interface.served(interface.ROOT)}
    for name in rig_calls.SERVICES:
        assert found[name].kind == "service"
    for name, kind in rig_calls.ACTIONS.items():
        assert found[name].type == f"cabols_msgs/{kind.__name__}"


def test_a_service_is_found_and_a_client_is_not(planted):
    found = [(item.name, item.type, item.where) for item in interface.served(planted)]
    assert found == [
        ("one", "std_srvs/Trigger", "`example`"),
        ("served", "cabols_msgs/SetMode", "`example`"),
        ("two", "std_srvs/Trigger", "`example`"),
    ]


def test_a_parameter_is_found_with_its_bounds(planted):
    expected = interface.Parameter(
        "`example`", "rate", "250.0", "Hz, of what it sends", "(1.0, 1000.0)"
    )
    assert interface.parameters(planted) == [expected]
