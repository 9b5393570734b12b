# SPDX-License-Identifier: Apache-2.0
"""The packages' rooms: no import in a circle or upward, no long file, tables that are up to date.

Each rule is also held against a small tree that breaks it.
"""

import re

import pytest

import structure


@pytest.fixture(scope="module")
def modules():
    return structure.read_tree()


@pytest.fixture
def planted(tmp_path):
    """Return a function that writes a tree of packages, from paths to texts, and reads it."""

    def plant(texts):
        for name, text in texts.items():
            path = tmp_path / name.partition("/")[0] / f"{name}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return structure.read_tree(tmp_path)

    return plant


def test_no_circle_between_files(modules):
    assert structure.file_circles(modules) == []


def test_no_circle_between_rooms_on_any_level(modules):
    assert structure.room_circles(modules) == []


def test_no_import_upward(modules):
    assert structure.upward(modules) == []


def test_no_file_over_400_lines(modules):
    assert structure.too_long(modules) == []


def test_every_package_is_read(modules):
    """A reader that finds nothing would find no fault either."""
    packages = {path.parent.name for path in structure.ROOT.glob("cabols_*/setup.cfg")}
    assert packages == set(structure.MAY_IMPORT)
    assert {module.package for module in modules.values()} == packages
    kinematics = modules["cabols_control.kinematics"]
    assert "cabols_control.geometry" in kinematics.imports
    assert "cabols_control.tension.__init__" in modules["cabols_control.rig"].imports


def test_tables_in_the_architecture_page_are_up_to_date(modules):
    page = structure.PAGE.read_text()
    assert structure.with_tables(page, structure.tables(modules)) == page, "run `make structure`"


def test_a_changed_table_is_noticed(modules):
    page = structure.PAGE.read_text()
    wrong = re.sub(r"\| `cabols_hw` \| (\d+)", "| `cabols_hw` | 99", page)
    assert wrong != page
    assert structure.with_tables(wrong, structure.tables(modules)) != wrong


def test_a_page_without_markers_is_refused():
    with pytest.raises(ValueError, match="expected <!-- structure: begin -->"):
        structure.with_tables("no markers", "tables")


@pytest.mark.parametrize(
    "statement",
    [
        "from cabols_control.b import x",
        "from cabols_control import b",
        "import cabols_control.b",
        "from .b import x",
        "from . import b",
        "def late():\n    from cabols_control import b",
    ],
)
def test_a_circle_between_files_is_found(planted, statement):
    found = planted({"cabols_control/a": statement, "cabols_control/b": "import cabols_control.a"})
    assert structure.file_circles(found) == [("cabols_control.a", "cabols_control.b")]
    assert any(line.startswith("circle between files") for line in structure.violations(found))


def test_a_circle_between_rooms_is_found_where_no_file_is_in_a_circle(planted):
    found = planted(
        {
            "cabols_hw/left/one": "import cabols_hw.right.one",
            "cabols_hw/left/two": "",
            "cabols_hw/right/one": "",
            "cabols_hw/right/two": "from cabols_hw.left import two",
        }
    )
    assert structure.file_circles(found) == []
    assert structure.room_circles(found) == [("cabols_hw.left", "cabols_hw.right")]


def test_a_circle_between_a_folder_and_its_neighbour_inside_a_room_is_found(planted):
    found = planted(
        {
            "cabols_sim/room/top": "from cabols_sim.room.inner import one",
            "cabols_sim/room/inner/one": "",
            "cabols_sim/room/inner/two": "from cabols_sim.room import top",
        }
    )
    assert structure.room_circles(found) == [("cabols_sim.room.inner", "cabols_sim.room.top")]


@pytest.mark.parametrize(
    ("package", "other"),
    [
        ("cabols_control", "cabols_hw"),
        ("cabols_hw", "cabols_sim"),
        ("cabols_hw", "cabols_stiffness"),
        ("cabols_stiffness", "cabols_hw"),
        ("cabols_control", "cabols_sim"),
    ],
)
def test_an_import_upward_is_found(planted, package, other):
    found = planted({f"{package}/a": f"import {other}.b", f"{other}/b": "", f"{package}/c": ""})
    assert structure.upward(found) == [f"{package}.a imports {other}.b"]


def test_a_long_file_is_found(planted):
    found = planted({"cabols_hw/long": "x = 1\n" * 401, "cabols_hw/not_long": "x = 1\n" * 400})
    assert structure.too_long(found) == ["cabols_hw.long: 401 lines, at most 400"]


def test_a_crowded_folder_is_reported(planted):
    found = planted({f"cabols_hw/room/m{i}": "" for i in range(13)})
    assert structure.crowded(found) == ["cabols_hw.room: 13 files, about 12 are enough"]


def test_layers_follow_the_arrows():
    assert structure.layers({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == {"a": 2, "b": 1, "c": 0}
