# SPDX-License-Identifier: Apache-2.0
"""Robot files of CASPR and cdpyr: read as others write them, round trips, mistakes named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from cabols_control.errors import CabolsError, DataFileError
from cabols_control.kinematics import cable_lengths
from cabols_control.motion import Motion
from cabols_control.workspace.formats.caspr import read_caspr, write_caspr
from cabols_control.workspace.formats.cdpyr import read_cdpyr, write_cdpyr
from cabols_control.workspace.robot import load_robot
from cabols_control.workspace.tool.command import main as workspace
from cabols_control.workspace.tool.exchange_command import exchanged_of

ROBOTS = sorted((Path(__file__).parents[2] / "examples" / "robots").glob("*.yaml"))
BODIES = """<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE bodies_system SYSTEM "../../templates/bodies.dtd">
<bodies_system><links display_range="-1 1 -1 1 -1 1">
 <link_rigid num="1" name="Plate">
  <joint type="{joint}" q_initial="{at}"/>
  <physical><mass>2.5</mass><com_location>0.01 0.02 0.03</com_location>
   <end_location>0 0 0</end_location></physical>
  <parent><num>0</num><location>0.0 0.0 0.5</location></parent>
 </link_rigid></links></bodies_system>
"""


def cables_text(ends, reference="joint"):
    rows = "".join(
        f'<cable_linear_spring name="c{k}" attachment_reference="{reference}">'
        "<properties><K_cable>100</K_cable><force_min>1.0</force_min>"
        f"<force_max>{50 + k}</force_max></properties><attachments>"
        f"<attachment><link>1</link><location>{b}</location></attachment>"
        f"<attachment><link>0</link><location>{a}</location></attachment>"
        "</attachments></cable_linear_spring>"
        for k, (a, b) in enumerate(ends)
    )
    return f'<cables default_cable_set="one"><cable_set id="one">{rows}</cable_set></cables>'


PLANE = [
    ("0 0 0", "-.1 .05 0"),
    ("1 0 0", ".1 .05 0"),
    ("1 1 0", ".1, -.05, 0"),
    ("0 1 0", "-.1 -.05 0"),
]


def caspr_files(tmp_path, joint="PLANAR_XY", at="0.5 0.4 0.1", ends=PLANE, reference="joint"):
    bodies, cables = tmp_path / "plate_bodies.xml", tmp_path / "plate_cables.xml"
    bodies.write_text(BODIES.format(joint=joint, at=at), encoding="utf-8")
    cables.write_text(cables_text(ends, reference), encoding="utf-8")
    return bodies, cables


def test_a_model_as_others_write_it(tmp_path):
    found = read_caspr(*caspr_files(tmp_path))
    assert found.motion is Motion.PLANAR_XY
    np.testing.assert_allclose(found.position, [0.5, 0.4, 0.5])
    np.testing.assert_allclose(found.rotation[:2, 0], [np.cos(0.1), np.sin(0.1)])
    np.testing.assert_allclose(found.base_points[2], [1.0, 1.0, 0.0])
    np.testing.assert_allclose(found.platform_points[2], [0.1, -0.05, 0.0])
    np.testing.assert_allclose(found.tension_max, [50, 51, 52, 53])
    assert found.mass == 2.5
    moved = read_caspr(*caspr_files(tmp_path, reference="com"))
    np.testing.assert_allclose(moved.platform_points[2], [0.11, -0.03, 0.03])
    turned = read_caspr(*caspr_files(tmp_path, "SPATIAL_QUATERNION", "1 2 3 0 0 0 1"))
    np.testing.assert_allclose(turned.rotation, np.diag([-1.0, -1.0, 1.0]), atol=1e-15)
    turned = read_caspr(*caspr_files(tmp_path, "SPATIAL_EULER_XYZ", f"1 2 3 {np.pi / 2} 0 0"))
    np.testing.assert_allclose(turned.rotation[:, 1], [0.0, 0.0, 1.0], atol=1e-15)


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda b, c: b.write_text("<a>"), "expected XML"),
        (lambda b, c: b.write_text(b.read_text().replace("PLANAR_XY", "R_Z")), "joint"),
        (
            lambda b, c: b.write_text(b.read_text().replace("0.5 0.4 0.1", "0.5 nan 0.1")),
            "q_initial",
        ),
        (lambda b, c: b.write_text(b.read_text().replace("0.5 0.4 0.1", "0.5 0.4")), "q_initial"),
        (lambda b, c: b.write_text('<!DOCTYPE a [<!ENTITY x "y">]><a>&x;</a>'), "entities"),
        (lambda b, c: b.write_text(b.read_text().replace("link_rigid", "joint_only")), "one link"),
        (
            lambda b, c: c.write_text(c.read_text().replace('default_cable_set="one"', "")),
            "cable set",
        ),
        (lambda b, c: c.write_text(c.read_text().replace("1 1 0", "1 1")), "cable 3: location"),
        (lambda b, c: c.write_text(c.read_text().replace("<link>1", "<link>2", 1)), "cable 1"),
        (lambda b, c: c.write_text(c.read_text().replace("force_max", "most")), "force_max"),
        (lambda b, c: c.unlink(), "cannot be read"),
    ],
)
def test_mistakes_in_a_model_are_named(tmp_path, spoil, named):
    files = caspr_files(tmp_path)
    spoil(*files)
    with pytest.raises(CabolsError, match=named):
        read_caspr(*files)


@pytest.mark.parametrize("reference", ["COM", "centre", "end", ""])
def test_points_about_something_unknown_are_refused(tmp_path, reference):
    """They were taken from the joint."""
    with pytest.raises(DataFileError, match="cable 1: attachment_reference: expected joint or com"):
        read_caspr(*caspr_files(tmp_path, reference=reference))


@pytest.mark.filterwarnings("ignore::cabols_control.rig_folder.RigWarning")
@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_round_trips(tmp_path, path):
    given = exchanged_of(load_robot(geometry=path))
    for read, write in ((read_caspr, write_caspr), (read_cdpyr, write_cdpyr)):
        again = read(*write(given, tmp_path, "robot"))
        for name in ("position", "rotation", "base_points", "platform_points", "tension_max"):
            np.testing.assert_allclose(getattr(again, name), getattr(given, name), atol=1e-12)
        assert again.mass == pytest.approx(given.mass)
        np.testing.assert_allclose(again.centre_of_mass, given.centre_of_mass)
        if read is read_caspr:
            assert again.motion is given.motion
            np.testing.assert_allclose(again.tension_min, given.tension_min)


@pytest.mark.parametrize("form", ["caspr", "cdpyr"])
def test_through_the_command(tmp_path, capsys, form):
    given = next(path for path in ROBOTS if path.stem == "planar")
    words = ["--geometry", str(given), "--format", form, "--output", str(tmp_path / "out")]
    assert workspace(["export", *words]) == 0
    assert "no place for" in capsys.readouterr().out
    files = sorted(str(path) for path in (tmp_path / "out").glob("robot*.[xj]*"))
    robot = tmp_path / "again" / "robot.yaml"
    assert workspace(["import", *files, "--output", str(robot)]) == 0
    old, new = load_robot(geometry=given), load_robot(geometry=robot)
    assert new.geometry.motion is Motion.PLANAR_XY
    np.testing.assert_allclose(new.geometry.base_points, old.geometry.base_points)
    np.testing.assert_allclose(new.tension_max, old.tension_max)
    if form == "caspr":
        np.testing.assert_allclose(new.tension_min, old.tension_min)


@pytest.mark.parametrize(("form", "keeps"), [("caspr", True), ("cdpyr", False), ("wirex", False)])
def test_an_export_says_which_pulleys_the_format_turns_round(tmp_path, capsys, form, keeps):
    """An axis towards the platform came back turned: lengths were off by 37 mm, without a word."""
    corners = [[x, y, z] for z in (0.0, 2.0) for y in (-1.5, 1.5) for x in (-2.0, 2.0)]
    content = {
        "reference_pose": {"position": [0.0, 0.0, 1.0], "rotation_xyz_deg": [0.0, 0.0, 0.0]},
        "base_points": corners,
        "platform_points": [[0.1 * x, y / 7.5, 0.1 - 0.1 * z] for x, y, z in corners],
        "pulley_radius": [0.0, 0.04] * 4,
        "pulley_axes": [[0.0, 0.0, 1.0]] * 8,
        "tension_min": 5.0,
        "tension_max": 500.0,
    }
    path = tmp_path / "given.yaml"

    def exported():
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        words = ["--geometry", str(path), "--format", form, "--output", str(tmp_path / "out")]
        assert workspace(["export", *words]) == 0
        return capsys.readouterr().out

    # Of the lower cables 1 to 4 two have wheels; away from the platform is down.
    told = "cables 2 and 4 would have other lengths" in exported()
    assert told is not keeps
    content["pulley_axes"] = [[0.0, 0.0, -1.0]] * 4 + [[0.0, 0.0, 1.0]] * 4
    assert "warning" not in exported()


def cdpyr_content():
    pulley = {"radius": 0.03}
    anchors = [
        {"position": [x, y, z], "pulley": pulley} for x in (-1, 1) for y in (-1, 1) for z in (0, 2)
    ]
    own = [
        {"position": [0.1 * y, -0.1 * x, 0.05 - 0.1 * (z > 0)]}
        for x, y, z in (a["position"] for a in anchors)
    ]
    return {
        "name": "box",
        "frame": {"anchors": anchors},
        "platforms": [{"anchors": own[::-1]}],
        "cables": [{"diameter": 0.002, "breaking_load": 400.0}],
        "kinematic_chains": [
            {"frame_anchor": k, "platform": 0, "platform_anchor": 7 - k, "cable": 0}
            for k in range(8)
        ],
        "home_pose": {"position": [0, 0, 1.0], "dcm": np.eye(3).tolist()},
    }


def test_chains_join_anchors_and_pulleys_are_kept(tmp_path):
    path = tmp_path / "box.yaml"
    path.write_text(yaml.safe_dump(cdpyr_content()), encoding="utf-8")
    found = read_cdpyr(path)
    np.testing.assert_allclose(found.platform_points[0], [-0.1, 0.1, 0.05])
    np.testing.assert_allclose(found.pulley_radius, 0.03)
    # The platform is at z = 1: cables of the lower pulleys come from below.
    np.testing.assert_allclose(found.pulley_axes[:, 2], [-1, 1] * 4)
    np.testing.assert_allclose(found.tension_max, 400.0)
    again = read_cdpyr(*write_cdpyr(found, tmp_path, "again"))
    np.testing.assert_allclose(again.pulley_axes, found.pulley_axes, atol=1e-12)
    robot = tmp_path / "robot.yaml"
    assert workspace(["import", str(path), "--output", str(robot)]) == 0
    np.testing.assert_allclose(load_robot(geometry=robot).geometry.pulley_radius, 0.03)


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda c: c.pop("frame"), "frame"),
        (lambda c: c["kinematic_chains"][2].update(frame_anchor=9), r"chains\[2\]: frame_anchor"),
        (lambda c: c["kinematic_chains"][1].update(platform_anchor=True), "platform_anchor"),
        (lambda c: c["platforms"].append({}), "one platform"),
        (lambda c: c["frame"]["anchors"][3].update(position=[1, 2]), "3 numbers"),
        (lambda c: c["frame"]["anchors"][3].update(dcm=[[2, 0, 0]] * 3), "rotation"),
        (lambda c: c["home_pose"].update(position=[0, 0, float("inf")]), "finite"),
    ],
)
def test_mistakes_in_a_robot_are_named(tmp_path, spoil, named):
    content = cdpyr_content()
    spoil(content)
    path = tmp_path / "box.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(DataFileError, match=named):
        read_cdpyr(path)


@pytest.mark.parametrize("files", [["a.xml"], ["a.json", "b.json"], ["missing.json"]])
def test_wrong_files_are_refused(tmp_path, files):
    words = [str(tmp_path / name) for name in files]
    assert workspace(["import", *words, "--output", str(tmp_path / "robot.yaml")]) != 0


def leaving_point(foot, along, far, radius):
    """Where a cable leaves a swivelling wheel, and its arc: CASPR's model in its own steps."""
    plane = np.cross(along, far - foot)
    inwards = np.cross(plane, along)
    centre = foot + radius * inwards / np.linalg.norm(inwards)
    share = radius / np.linalg.norm(far - centre)
    turned = np.cross(plane / np.linalg.norm(plane), far - centre)
    leaves = centre + share**2 * (far - centre) - share * np.sqrt(1.0 - share**2) * turned
    angle = np.arccos((foot - centre) @ (leaves - centre) / radius**2)
    return leaves, radius * angle


WHEELS = [
    ((x, y, z), (0.0, 0.0, 1.0 if z else -1.0)) for x in (-1, 1) for y in (-1, 1) for z in (0, 2)
]


def pulley_model(tmp_path, radius="0.045", tag="base_rotating_pulley"):
    """A spatial model of eight cables over wheels, as CASPR writes one."""
    rows = "".join(
        f'<cable_ideal name="c{k}" attachment_reference="joint"><properties>'
        "<force_min>1</force_min>"
        f"<force_max>9999999999</force_max></properties><attachments><{tag}>"
        f"<fixed_location>{x} {y} {z}</fixed_location><pulley_radius>{radius}</pulley_radius>"
        f"<cable_entry_vector>{along[0]} {along[1]} {2 * along[2]}</cable_entry_vector></{tag}>"
        f"<attachment><link>1</link><location>{0.1 * y} {-0.1 * x} {0.1 - 0.1 * z}</location>"
        "</attachment></attachments></cable_ideal>"
        for k, ((x, y, z), along) in enumerate(WHEELS)
    )
    bodies, cables = tmp_path / "wheels_bodies.xml", tmp_path / "wheels_cables.xml"
    given = {"joint": "SPATIAL_EULER_XYZ", "at": "0.1 -0.1 0.4 0.1 0.2 -0.1"}
    bodies.write_text(BODIES.format(**given), encoding="utf-8")
    text = f'<cables default_cable_set="one"><cable_set id="one">{rows}</cable_set></cables>'
    cables.write_text(text, encoding="utf-8")
    return bodies, cables


def test_wheels_of_caspr_have_caspr_s_lengths(tmp_path):
    robot = tmp_path / "robot.yaml"
    assert workspace(["import", *map(str, pulley_model(tmp_path)), "--output", str(robot)]) == 0
    geometry = load_robot(geometry=robot).geometry
    pose = (geometry.reference_position, geometry.reference_rotation)
    for k, length in enumerate(cable_lengths(geometry, *pose)):
        far = pose[0] + pose[1] @ geometry.platform_points[k]
        foot, along = np.array(WHEELS[k][0], dtype=float), np.array(WHEELS[k][1])
        leaves, arc = leaving_point(foot, along, far, 0.045)
        assert length == pytest.approx(np.linalg.norm(far - leaves) + arc, abs=1e-12)
    out = tmp_path / "out"
    words = ["export", "--geometry", str(robot), "--format", "caspr", "--output", str(out)]
    assert workspace([*words, "--name", "again"]) == 0
    again = read_caspr(out / "again_bodies.xml", out / "again_cables.xml")
    np.testing.assert_allclose(again.pulley_radius, 0.045)
    np.testing.assert_allclose(again.pulley_axes, geometry.pulley_axes)
    np.testing.assert_allclose(again.base_points, geometry.base_points)


def test_limits_that_stand_for_none_are_said(tmp_path):
    found = read_caspr(*pulley_model(tmp_path))
    assert found.tension_max.max() == 1e8
    assert any("stand for none" in note for note in found.notes)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"radius": "-0.1"}, "cable 1: expected a radius from 0"),
        ({"radius": "nan"}, "cable 1: pulley_radius"),
        ({"radius": ""}, "cable 1: pulley_radius"),
        ({"tag": "screw_base_rotating_pulley"}, "got screw_base_rotating_pulley"),
    ],
)
def test_wheels_that_are_none_are_named(tmp_path, given, named):
    with pytest.raises(DataFileError, match=named):
        read_caspr(*pulley_model(tmp_path, **given))


def test_a_spring_without_a_motor_is_no_cable(tmp_path):
    bodies, cables = caspr_files(tmp_path)
    text = cables.read_text().replace("cable_linear_spring", "cable_passive_linear_spring", 1)
    text = text.replace("</cable_linear_spring>", "</cable_passive_linear_spring>", 1)
    cables.write_text(text)
    with pytest.raises(DataFileError, match=r"cable 1.*which pulls by itself"):
        read_caspr(bodies, cables)


def test_a_point_mass_with_a_joint_in_space_is_a_point(tmp_path, capsys):
    ends = [(f"{x} {y} {z}", "0 0 0") for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]
    files = caspr_files(tmp_path, "SPATIAL_EULER_XYZ", "0 0 0.5 0 0 0", ends)
    robot = tmp_path / "robot.yaml"
    assert workspace(["import", *map(str, files), "--output", str(robot)]) == 0
    assert "read as a point" in capsys.readouterr().out
    assert load_robot(geometry=robot).geometry.motion is Motion.POINT
