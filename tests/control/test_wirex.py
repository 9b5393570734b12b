# SPDX-License-Identifier: Apache-2.0
"""WireX's files: read as others write them, written and read again; mistakes are named."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.errors import DataFileError
from cabols_control.kinematics import cable_lengths
from cabols_control.motion import Motion
from cabols_control.workspace.formats.wirex import read_wirex, write_wirex
from cabols_control.workspace.robot import load_robot
from cabols_control.workspace.tool.command import main as workspace
from cabols_control.workspace.tool.exchange_command import exchanged_of
from case_robots import FOLDER

CORNERS = [(x, y, z) for z in (2.0, 0.0) for x, y in ((-2, 1.5), (2, 1.5), (2, -1.5), (-2, -1.5))]
HELD = [(0.2 * np.sign(x), 0.1 * np.sign(y), 0.1 - 0.1 * z) for x, y, z in CORNERS]


def text_form(base=CORNERS, held=HELD, **values):
    """A robot as text, with comments, blanks and a point that is commented out."""
    values = {"dof": 6, "now": len(base), "lmin": 0, "lmax": 0, "fmin": 1, "fmax": 10, **values}
    lines = ["// Parameter of Wire Robot", ""]
    lines += [f"{key} {value}" for key, value in values.items() if value is not None]
    for key, rows in (("base", base), ("platform", held)):
        lines += [f"{key} {k}  {x} {y}\t{z}" for k, (x, y, z) in enumerate(rows, 1)]
    return "\n".join([*lines, "// base 9 0 0 3", "", "// End of File"])


def chain(start, end, radius=0.1, turn=""):
    x, y, z = start
    u, v, w = end
    return (
        f'<chain id="1" winchtype="a"><base x="{x}" y="{y}" z="{z}" {turn} radius="{radius}" />'
        f'<platform x="{u}" y="{v}" z="{w}" a11="1" /></chain>'
    )


def xml_form(chains, pattern="3R3T"):
    return (
        f'<models><robot name="r" motionpattern="{pattern}"><geometry>{"".join(chains)}</geometry>'
        '<platform mass="25" swing_angle="50"><centerofgravity x="0" y="0.1" z="0.2" /></platform>'
        "</robot></models>"
    )


def written(tmp_path, text, name="robot.txt"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_text_form(tmp_path):
    robot = read_wirex(written(tmp_path, text_form(lmin=0.5, lmax=4.0)))
    np.testing.assert_array_equal(robot.base_points, CORNERS)
    np.testing.assert_allclose(robot.platform_points, HELD)
    np.testing.assert_array_equal(robot.tension_max, np.full(8, 10.0))
    assert (robot.length_min, robot.length_max) == (0.5, 4.0)
    np.testing.assert_allclose(robot.position, [0.0, 0.0, 1.0])
    assert any("no pose" in note for note in robot.notes)
    # 0 stands for no limit.
    assert read_wirex(written(tmp_path, text_form())).length_max == np.inf


def test_a_crane_hangs_below_its_frame_and_a_plane_stays_one(tmp_path):
    top = [(x, y, 3.0) for x, y, _ in CORNERS[:4]]
    crane = read_wirex(written(tmp_path, text_form(top, np.zeros((4, 3)), dof=3)))
    assert crane.position[2] == pytest.approx(1.0)
    plane = [(x, y, 0.0) for x, y, _ in CORNERS[:4]]
    held = [(0.1 * np.sign(x), 0.1 * np.sign(y), 0.0) for x, y, _ in plane]
    assert read_wirex(written(tmp_path, text_form(plane, held, dof=3))).position[2] == 0.0


def test_pulleys_of_the_xml_have_the_lengths_of_a_tangent(tmp_path):
    """Cables run over wheels that swivel about z: arc and tangent by plane geometry."""
    chains = [chain(start, end, 0.05) for start, end in zip(CORNERS, HELD, strict=True)]
    path = tmp_path / "again" / "robot.yaml"
    xml = written(tmp_path, xml_form(chains), "robot.xml")
    words = ["import", str(xml), "--output", str(path), "--position", "0.1", "0.2", "0.9"]
    assert workspace(words) == 0
    robot = load_robot(geometry=path)
    rig = robot.geometry
    assert robot.platform.weight == pytest.approx(25 * 9.80665)
    np.testing.assert_allclose(rig.reference_position, [0.1, 0.2, 0.9])
    lengths = cable_lengths(rig, rig.reference_position, rig.reference_rotation)
    for start, end, length in zip(CORNERS, HELD, lengths, strict=True):
        away = np.array(end) + rig.reference_position - start
        side, down = np.hypot(away[0], away[1]) - 0.05, abs(away[2])
        far = np.hypot(side, down)
        tangent = np.sqrt(far**2 - 0.05**2)
        # From where the cable meets the groove to where it leaves, as angles about the centre.
        wrapped = np.pi + np.arctan2(down, side) - np.arccos(0.05 / far)
        assert length == pytest.approx(tangent + 0.05 * wrapped, abs=1e-9)


@pytest.mark.filterwarnings("ignore::cabols_control.rig_folder.RigWarning")
@pytest.mark.parametrize("name", ["cogiro", "ipanema1", "robocrane", "segesta10", "planar_kntu"])
def test_round_trip(tmp_path, name):
    given = exchanged_of(load_robot(geometry=FOLDER / f"{name}.yaml"))
    given.mass, given.centre_of_mass = 3.5, np.array([0.1, -0.2, 0.3])
    again = read_wirex(*write_wirex(given, tmp_path, "robot"))
    np.testing.assert_array_equal(again.base_points, given.base_points)
    np.testing.assert_array_equal(again.platform_points, given.platform_points)
    np.testing.assert_array_equal(again.centre_of_mass, given.centre_of_mass)
    np.testing.assert_array_equal(again.tension_max, given.tension_max.min())
    assert again.mass == 3.5


def test_through_the_command(tmp_path, capsys):
    given = FOLDER / "cogiro.yaml"
    out = tmp_path / "out"
    words = ["--geometry", str(given), "--format", "wirex", "--output", str(out)]
    assert workspace(["export", *words]) == 0
    assert "reference pose" in capsys.readouterr().out
    old = load_robot(geometry=given).geometry
    files = [str(out / "robot.txt"), str(out / "robot.xml")]
    path = tmp_path / "robot.yaml"
    place = [str(value) for value in old.reference_position]
    assert workspace(["import", *files, "--output", str(path), "--position", *place]) == 0
    new = load_robot(geometry=path).geometry
    assert new.motion is Motion.SPATIAL
    np.testing.assert_allclose(
        cable_lengths(new, new.reference_position, new.reference_rotation),
        cable_lengths(old, old.reference_position, old.reference_rotation),
    )


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (text_form().replace("now 8", "now 9"), r"cables 1 to 9"),
        (text_form(now=None), r"now"),
        (text_form().replace("base 2 ", "base 1 "), r"each cable's number once"),
        (text_form(dof=5), r"dof: expected 6 or 3, got 5"),
        (text_form(dof="six"), r"dof"),
        (text_form(fmax="nan"), r"finite"),
        (text_form() + "\nfmin 2", r"once each"),
        (text_form() + "\nbase 1,5 0 0 0", r"base"),
        ("PK\x00", r"expected dof"),
    ],
)
def test_mistakes_in_the_text_are_named(tmp_path, text, named):
    with pytest.raises(DataFileError, match=named):
        read_wirex(written(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("<models></models>", r"one robot with geometry"),
        (xml_form([chain((0, 0, 1), (0, 0, 0))], "2R3T"), r"motionpattern"),
        (xml_form([chain((0, 0, 1), (0, 0, 0), -1)]), r"radius"),
        (xml_form([chain((0, 0, "x"), (0, 0, 0))]), r"cable 1: base: z"),
        (xml_form([chain((0, 0, 1), (0, 0, 0), 0, 'a11="1"')]), r"a12"),
        (xml_form([chain((0, 0, 1), (0, 0, 0)).replace("<base", "<bse")]), r"base and platform"),
    ],
)
def test_mistakes_in_the_xml_are_named(tmp_path, text, named):
    with pytest.raises(DataFileError, match=named):
        read_wirex(written(tmp_path, text, "robot.xml"))


def test_a_robot_of_cdpyr_in_xml_is_named(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text("<robot><frame><anchors><anchor/></anchors></frame></robot>", "utf-8")
    with pytest.raises(DataFileError, match="one of cdpyr in XML, of which JSON and YAML"):
        read_wirex(path)
