# SPDX-License-Identifier: Apache-2.0
"""Robots from Denavit-Hartenberg tables, and files that are refused with the remedy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.errors import ConfigError
from cabols_stiffness import load_robot
from serial_robots import urdf

UR10 = [
    (0.0, 90.0, 127.3),
    (-612.0, 0.0, 0.0),
    (-572.3, 0.0, 0.0),
    (0.0, 90.0, 163.941),
    (0.0, -90.0, 115.7),
    (0.0, 0.0, 92.2),
]
"""a [mm], alpha [deg], d [mm] of the maker's data sheet, standard convention."""
PANDA = [
    (0.0, 0.0, 333.0),
    (0.0, -90.0, 0.0),
    (0.0, 90.0, 316.0),
    (82.5, 90.0, 0.0),
    (-82.5, -90.0, 384.0),
    (0.0, 90.0, 0.0),
    (88.0, 90.0, 0.0),
]
"""The same of the maker's page, modified convention."""


def turned(axis, angle):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(angle * np.array(axis)).as_matrix()
    return matrix


def moved(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def by_definition(rows, q, standard):
    """The textbook's product of four matrices for each joint."""
    pose = np.eye(4)
    for (a, alpha, d), angle in zip(rows, q, strict=True):
        about_z = turned([0, 0, 1], angle) @ moved(0, 0, 1e-3 * d)
        about_x = turned([1, 0, 0], np.radians(alpha)) @ moved(1e-3 * a, 0, 0)
        pose = pose @ (about_z @ about_x if standard else about_x @ about_z)
    return pose


def yaml_of(rows, convention):
    joints = [
        f"  - {{name: j{i}, a_mm: {a}, alpha_deg: {alpha}, d_mm: {d}, theta_deg: 0}}"
        for i, (a, alpha, d) in enumerate(rows, 1)
    ]
    return "\n".join(["name: arm", f"convention: {convention}", "joints:", *joints])


def csv_of(rows, convention):
    lines = ["joint,convention,a_m,alpha_rad,d_mm,theta_deg"]
    lines += [
        f"j{i},{convention},{1e-3 * a},{np.radians(alpha)},{d},0"
        for i, (a, alpha, d) in enumerate(rows, 1)
    ]
    return "\n".join(lines)


@pytest.mark.parametrize("form", [yaml_of, csv_of])
@pytest.mark.parametrize(("rows", "convention"), [(UR10, "standard"), (PANDA, "modified")])
def test_table_is_the_textbooks_product(tmp_path, form, rows, convention):
    path = tmp_path / f"arm.{'yaml' if form is yaml_of else 'csv'}"
    path.write_text(form(rows, convention), encoding="utf-8")
    robot, tool = load_robot(path, tool_position=[0.01, -0.02, 0.3]), moved(0.01, -0.02, 0.3)
    for seed in range(5):
        q = np.random.default_rng(seed).uniform(-2.0, 2.0, len(rows))
        pose = by_definition(rows, q, convention == "standard") @ tool
        position, rotation = robot.forward(q)
        np.testing.assert_allclose(position, pose[:3, 3], atol=1e-14)
        np.testing.assert_allclose(rotation, pose[:3, :3], atol=1e-14)


def test_offsets_signs_and_sliding_joints(tmp_path):
    text = yaml_of(UR10, "standard").replace("theta_deg: 0}", "theta_deg: 30, sign: -1}", 1)
    text = text.replace("{name: j2,", "{type: prismatic, name: j2, lower_mm: 0, upper_mm: 900,")
    path = tmp_path / "arm.yaml"
    path.write_text(text, encoding="utf-8")
    robot, q = load_robot(path), np.array([0.3, 0.4, -0.5, 0.2, 0.7, -0.1])
    rows = [list(row) for row in UR10]
    rows[1][2] = 1e3 * q[1]
    angles = q.copy()
    angles[0], angles[1] = np.radians(30.0) - q[0], 0.0
    np.testing.assert_allclose(
        robot.forward(q)[0], by_definition(rows, angles, True)[:3, 3], atol=1e-14
    )
    np.testing.assert_allclose(robot.limits[1], [0.0, 0.9])
    assert robot.slides.tolist() == [False, True, False, False, False, False]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("convention: standard", "convention: craig"), "another robot in the other one"),
        (("convention: standard", ""), "convention: expected one of"),
        (("a_mm: 0.0", "a: 0.0"), "expected one a with its unit, as in a_m"),
        (("d_mm: 127.3", "d_deg: 127.3"), "expected one d with its unit"),
        (("d_mm: 127.3", "d_mm: 1 m"), "d_mm: expected a number"),
        (("alpha_deg: 90.0", "alpha_deg: .nan"), "alpha_deg: expected"),
        (("name: j2", "name: j1"), "each name once"),
        (("theta_deg: 0}", "theta_deg: 0, mass_kg: 3}"), "got mass_kg"),
        (("joints:", "links:"), "expected name, convention and joints"),
        (("theta_deg: 0}", "theta_deg: 0, type: planar}"), "expected one of revolute"),
        (("theta_deg: 0}", "theta_deg: 0, sign: 2}"), "sign of 1 or -1"),
    ],
)
def test_wrong_tables_are_refused(tmp_path, change, said):
    path = tmp_path / "arm.yaml"
    path.write_text(yaml_of(UR10, "standard").replace(*change), encoding="utf-8")
    with pytest.raises(ConfigError, match=said):
        load_robot(path)


def test_link_or_locked_joint_of_a_table_is_refused(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(yaml_of(UR10, "standard"), encoding="utf-8")
    with pytest.raises(ConfigError, match="expected no name of a link"):
        load_robot(path, "tool0")
    with pytest.raises(ConfigError, match="leave the joint out"):
        load_robot(path, locked={"j1": 0.2})


@pytest.mark.parametrize(
    "more",
    [
        '<gazebo><sensor:camera name="eye"/></gazebo>',
        '<link name="looks"><visual><xacro:grey xmlns:xacro="x"/></visual></link>'
        '<joint name="l" type="fixed"><parent link="base"/><child link="looks"/></joint>',
        '<gazebo><mesh filename="$(find arm)/a.stl"/></gazebo>',
        '<transmission><type name="${kind}"/></transmission>',
    ],
)
def test_what_has_no_joints_may_be_of_other_programs(tmp_path, more):
    """As public URDFs have it: prefixes that nobody declared, macros left in a link's looks."""
    path = tmp_path / "arm.urdf"
    joint = (
        '<joint name="j" type="revolute"><parent link="base"/><child link="tool0"/>'
        '<axis xyz="0 0 1"/><limit xmlns:more="m" lower="-1" upper="1" more:acceleration="3"/>'
        "</joint>"
    )
    links = '<link name="base"/><link name="tool0"/>'
    path.write_text(f'<robot name="a">{links}{joint}{more}</robot>', encoding="utf-8")
    assert load_robot(path, least=1).joint_names == ("j",)


def test_candidates_for_the_flange_are_told_with_their_joints(tmp_path):
    path = tmp_path / "arm.urdf"
    links = "".join(f'<link name="{name}"/>' for name in ("base", "arm", "finger", "ee", "cover"))
    joints = "".join(
        f'<joint name="{child}_j" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint>'
        for parent, child, kind in (
            ("base", "arm", "revolute"),
            ("arm", "finger", "fixed"),
            ("arm", "ee", "fixed"),
            ("base", "cover", "fixed"),
        )
    )
    path.write_text(f'<robot name="a">{links}{joints}</robot>', encoding="utf-8")
    said = r"got ee \(behind 1 joints\), finger \(behind 1 joints\), cover \(behind 0"
    with pytest.raises(ConfigError, match=said):
        load_robot(path, least=1)
    assert load_robot(path, "ee", least=1).n == 1


@pytest.mark.parametrize(
    "text",
    [
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"><xacro:arm/></robot>',
        '<robot name="a"><xacro:arm prefix="x"/></robot>',
        '<robot name="a"><link name="${prefix}base"/></robot>',
        '<robot name="a"><link name="$(arg prefix)base"/></robot>',
    ],
)
def test_xacro_is_refused_with_the_command_that_expands_it(tmp_path, text):
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"`xacro arm.urdf.xacro > arm_expanded.urdf`"):
        load_robot(path)


@pytest.mark.parametrize("text", ['<sdf version="1.6"><model name="x"/></sdf>', "<mujoco/>"])
def test_files_of_simulators_are_refused_by_name(tmp_path, text):
    path = tmp_path / "arm.xml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"whose root is <robot>, got <(sdf|mujoco)>"):
        load_robot(path)


def test_mimic_on_the_way_can_be_held(tmp_path):
    path = urdf(tmp_path, "kr210")
    text = path.read_text(encoding="utf-8")
    mimic = '<limit lower="-5" upper="5" effort="1" velocity="1"/></joint>'
    path.write_text(
        text.replace(mimic, mimic.replace("</joint>", '<mimic joint="axis_2"/></joint>'), 1),
        encoding="utf-8",
    )
    with pytest.raises(ConfigError, match="hold it where it is"):
        load_robot(path)
    assert load_robot(path, locked={"axis_1": 0.5}).n == 6
