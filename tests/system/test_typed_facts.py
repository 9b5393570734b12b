# SPDX-License-Identifier: Apache-2.0
"""Text is for people: no code of the packages decides by a reason, a message or a line of a log.

What a program needs is a number or a name in a field of its own: Mode.cause, LoopStatus.fault, the
codes of services and actions. What may look into a text is listed here, each with its reason.
"""

from functools import cache
from pathlib import Path

import pytest

from prose import decisions_by_prose, script_decisions

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("cabols_control", "cabols_hw", "cabols_sim", "cabols_stiffness")
GENERATED = ("tracker_pb2.py", "tracker_pb2_grpc.py")
ALLOWED = {
    # Formats of files and protocols: their texts are for programs.
    "cabols_control/bags/recorded_types.py has_header": "fields of a message definition",
    "cabols_control/bags/writer.py add_channel": "equal message definitions are written once",
    "cabols_control/rig_tools/new_rig.py _campaign": "lines of a rig's YAML file, comments kept",
    "cabols_control/rig_tools/new_rig.py _geometry": "lines of a rig's YAML file, comments kept",
    "cabols_control/rig_tools/migrate.py without_keys": "keys of a YAML file, by line",
    "cabols_sim/bench/busiest.py processor_seconds": "a line of /proc, in the kernel's format",
    "cabols_hw/force_torque/ati.py _unit": "a unit in ATI's calibration file",
    "cabols_hw/force_torque/ati.py _torque_unit": "a unit in ATI's calibration file",
    "cabols_hw/tracker/client.py aim": "an enumeration of the tracker's protocol",
    "cabols_hw/tracker/client.py _why": "an enumeration of the tracker's protocol",
    "cabols_sim/devices/abb/rapid.py set": "a RAPID variable's value, TRUE or FALSE",
    # Headers and cells of a laboratory's table.
    "cabols_stiffness/data_files/cells.py _from_headers": "a comment line of a table",
    "cabols_control/serial_arms/arm.py parse_urdf": "names and prefixes of an XML file",
    "cabols_stiffness/table/reading.py _number": "an empty cell of a table",
    "cabols_stiffness/table/units.py meaning": "a column's header: name and unit",
    "cabols_stiffness/table/units.py _split": "a column's header: name and unit",
    # Words of a command line.
    "cabols_control/bringup/argument_text.py read_argument": "value of a launch argument",
    "cabols_control/bringup/argument_text.py _expanded": "a path of a launch argument",
    "cabols_control/bringup/argument_text.py _find_program": "name of a programme",
    "cabols_control/bringup/argument_text.py listed": "names of topics or nodes, by commas",
    "cabols_control/bringup/launching.py argument_values": "value of a launch argument",
    "cabols_control/rig_tools/rig_urdf.py _three": "numbers of an option",
    "cabols_control/topics.py foreign_row": "name and type of a topic",
    "cabols_control/ros/messages/transport.py init": "rcl's sentence without places in its code",
    "cabols_control/command_line.py _rig": "value of the option --rig",
    "cabols_control/rig_folder.py find_rig": "name or folder of a rig",
    # A text is shown again only if it has changed; what it says is not looked at.
    "cabols_control/console/latest.py tell": "the same line within a second is shown once",
    "cabols_control/ros/limb_actions/commissioning.py commission_limb": "a refusal is shown once",
    "cabols_control/console/static/panels.js": "an element is written only if its text changes",
    "cabols_stiffness/nodes/run_campaign.py _show": "a note is shown once",
    "cabols_stiffness/nodes/stiffness_campaign.py _judge": "a refusal is logged once",
}
"""Where a text may be looked into, as file and function, and why."""


def sources(ending):
    """(place in the list above, path) of every source file of the packages."""
    for package in PACKAGES:
        root = ROOT / package
        for path in sorted((root / package).rglob(f"*{ending}")):
            if path.name not in GENERATED:
                yield path.relative_to(root).as_posix(), path


@cache
def python_findings():
    return list(_python_findings())


def _python_findings():
    for place, path in sources(".py"):
        for found in decisions_by_prose(path.read_text(encoding="utf-8")):
            yield f"{place} {found.function}", f"{place}:{found.line}: {found.source}"


def script_findings():
    for place, path in sources(".js"):
        for line, text in script_decisions(path.read_text(encoding="utf-8")):
            yield place, f"{place}:{line}: {text}"


def test_no_code_decides_by_prose():
    found = [*python_findings(), *script_findings()]
    bad = [told for place, told in found if place not in ALLOWED]
    assert not bad, "decides by a text for people; give the fact a field:\n" + "\n".join(bad)


def test_the_list_of_what_may_has_no_stale_entry():
    places = {place for place, _ in (*python_findings(), *script_findings())}
    assert sorted(ALLOWED.keys() - places) == []


def test_the_scan_reads_every_package_and_the_pages_scripts():
    places = [place for place, _ in (*sources(".py"), *sources(".js"))]
    for package in PACKAGES:
        assert sum(place.startswith(f"{package}/") for place in places) > 20
    assert sum(place.endswith(".js") for place in places) >= 4


PLANTED = [
    'if message.reason.startswith("emergency stop"): cut()',
    'if reason.endswith("stop"): cut()',
    'if "stale" in status.reason: cut()',
    'if "refuses" not in result.message: retry()',
    'if mode_reason == "unloaded": go()',
    'if "unloaded" != self.reason: go()',
    'if reason in ("start", "reset"): go()',
    'if (mode, reason) == (4, "emergency stop"): cut()',
    'if re.match(r"sensor_.*", complaint): cut()',
    "if PATTERN.search(line): cut()",
    'name = reason.partition(":")[0]',
    'at = float(answer.message.rpartition(" at ")[2])',
    'code = message.text.split(":")[0]',
    'if answer["reason"] == "done": go()',
    'if answer.get("message") == "done": go()',
    'if reason.lower().strip() == "done": go()',
    'if "401" in str(error): go()',
    'if any(word in line for word in ("error", "WARN")): show(line)',
    'while (told := ask().message) != "done": wait()',
    'def f(m):\n    heard = m.reason\n    return heard.startswith("unattended")',
    'def f(m):\n    mode, heard = m.mode, m.reason\n    return heard == "start"',
    'def f(m):\n    heard = (m.mode, str(m.reason))\n    return heard[1].startswith("unattended")',
    'async def f(m):\n    return m.reason.find("fault") >= 0',
    'match status.reason:\n    case "start": go()',
]


@pytest.mark.parametrize("source", PLANTED)
def test_a_planted_decision_is_found(source):
    assert decisions_by_prose(source)


@pytest.mark.parametrize(
    "source",
    [
        "if message.cause == Cause.EMERGENCY_STOP: cut()",
        'if status.fault in SENSOR_FAULTS: show("sensor")',
        "if code in NOT_YET: retry()",
        'raise ConfigError(f"{path}: {error}") from error',
        "if reason: tell(reason)",
        "lines = text.split()",
        'whole = text[: text.rfind("\\n") + 1]',
        'style = "|" if "\\n" in text else ""',
        'if record["mode"] == FAULT: cut()',
        'if message.node == "plant": watch()',
    ],
)
def test_a_decision_by_facts_is_not(source):
    assert not decisions_by_prose(source)


@pytest.mark.parametrize(
    "source",
    [
        'if (state.mode.reason.startsWith("emergency")) cut();',
        'if (row.why.includes("FAULT")) paint();',
        'if (state.mode.reason === "start") hide();',
        'if ("start" == reason) hide();',
        "if (/fault/.test(message.text)) paint();",
        "switch (state.reason) { }",
        'const name = event.message.split(":")[0];',
    ],
)
def test_a_planted_decision_in_a_script_is_found(source):
    assert script_decisions(source)


@pytest.mark.parametrize(
    "source",
    [
        'if (state.mode.name === "FAULT") paint();',
        "put(byId('mode-reason'), state.mode.reason);",
        'if (level === "fault") line.append(text);',
    ],
)
def test_a_decision_by_facts_in_a_script_is_not(source):
    assert not script_decisions(source)
