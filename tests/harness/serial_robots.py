# SPDX-License-Identifier: Apache-2.0
"""Serial robots from their makers' data sheets, with a plausible stiffness, as URDFs."""

from __future__ import annotations

import numpy as np

HALF = np.pi / 2.0
IIWA = [
    ("revolute", (0, 0, 0.1475), (0, 0, 0), (0, 0, 1)),
    ("revolute", (0, 0, 0.1925), (0, 0, 0), (0, 1, 0)),
    ("revolute", (0, 0, 0.2), (0, 0, 0), (0, 0, 1)),
    ("revolute", (0, 0, 0.2), (0, 0, 0), (0, -1, 0)),
    ("revolute", (0, 0, 0.2), (0, 0, 0), (0, 0, 1)),
    ("revolute", (0, 0, 0.2), (0, 0, 0), (0, 1, 0)),
    ("revolute", (0, 0, 0.081), (0, 0, 0), (0, 0, 1)),
]
"""LBR iiwa 7 R800: 340, 400, 400, 126 mm (flange 45 mm behind the last joint)."""
KR210 = [
    ("prismatic", (0, 0, 0.3), (0, 0, 0), (1, 0, 0)),
    ("revolute", (0, 0, 0.675), (0, 0, 0), (0, 0, -1)),
    ("revolute", (0.35, 0, 0), (0, 0, 0), (0, 1, 0)),
    ("revolute", (1.15, 0, 0), (0, 0, 0), (0, 1, 0)),
    ("revolute", (1.0, 0, 0.041), (0, 0, 0), (-1, 0, 0)),
    ("revolute", (0.2, 0, 0), (0, 0, 0), (0, 1, 0)),
    ("continuous", (0.1, 0, 0), (0, 0, 0), (-1, 0, 0)),
]
"""KR 210 R2700 on a linear axis: 675, 350, 1150, 41, 1200, 215 mm."""
UR10 = [
    ("revolute", (0, 0, 0.1273), (0, 0, 0), (0, 0, 1)),
    ("revolute", (0, 0.220941, 0), (0, HALF, 0), (0, 1, 0)),
    ("revolute", (0, -0.1719, 0.612), (0, 0, 0), (0, 1, 0)),
    ("revolute", (0, 0, 0.5723), (0, HALF, 0), (0, 1, 0)),
    ("revolute", (0, 0.1149, 0), (0, 0, 0), (0, 0, 1)),
    ("revolute", (0, 0, 0.1157), (0, 0, 0), (0, 1, 0)),
]
IRB6640 = [
    ("revolute", (0, 0, 0.78), (0, 0, 0), (0, 0, 1)),
    ("revolute", (0.32, 0, 0), (0, 0, 0), (0, 1, 0)),
    ("revolute", (0, 0, 1.28), (0, 0, 0), (0, 1, 0)),
    ("revolute", (0, 0, 0.2), (0, 0, 0), (1, 0, 0)),
    ("revolute", (1.1425, 0, 0), (0, 0, 0), (0, 1, 0)),
    ("revolute", (0.2, 0, 0), (0, 0, 0), (1, 0, 0)),
]
REFLECTOR = (0.08, 0.05, 0.02)
"""Off the last joint's axis: a point on it does not see that joint turn."""
STIFFNESS = {
    "iiwa": np.array([2.1e4, 2.0e4, 1.4e4, 1.3e4, 8e3, 5e3, 4e3]),
    "kr210": np.array([2.2e7, 3.5e6, 3.0e6, 2.4e6, 4.5e5, 4.0e5, 3.0e5]),
    "ur10": np.array([3.2e4, 3.2e4, 2.3e4, 1.3e4, 1.2e4, 1.1e4]),
    "irb6640": np.array([3.3e6, 3.1e6, 2.6e6, 5.0e5, 4.2e5, 3.1e5]),
}
CHAINS = {
    "iiwa": (IIWA, (0, 0, 0.045)),
    "kr210": (KR210, (0.115, 0, 0)),
    "ur10": (UR10, (0, 0.0922, 0)),
    "irb6640": (IRB6640, (0, 0, 0)),
}


def urdf(folder, name):
    """Write the robot's URDF, with a gripper's finger behind its flange."""
    joints, flange = CHAINS[name]
    text, parent = [f'<robot name="{name}"><link name="base_link"/>'], "base_link"
    for i, (kind, xyz, rpy, axis) in enumerate(joints, 1):
        words = [" ".join(map(str, values)) for values in (xyz, rpy, axis)]
        text.append(
            f'<link name="link_{i}"/><joint name="axis_{i}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="link_{i}"/><origin xyz="{words[0]}" rpy="{words[1]}"/>'
            f'<axis xyz="{words[2]}"/><limit lower="-5" upper="5" effort="1" velocity="1"/></joint>'
        )
        parent = f"link_{i}"
    place = " ".join(map(str, flange))
    text.append(
        f'<link name="tool0"/><joint name="flange" type="fixed"><parent link="{parent}"/>'
        f'<child link="tool0"/><origin xyz="{place}"/></joint><link name="finger"/>'
        '<joint name="jaw" type="prismatic"><parent link="tool0"/><child link="finger"/>'
        '<axis xyz="1 0 0"/><limit lower="0" upper="0.1" effort="1" velocity="1"/></joint></robot>'
    )
    path = folder / f"{name}.urdf"
    path.write_text("".join(text), encoding="utf-8")
    return path
