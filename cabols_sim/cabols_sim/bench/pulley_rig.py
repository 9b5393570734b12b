# SPDX-License-Identifier: Apache-2.0
"""A rig's folder whose cables leave pulleys: known to control, or in the simulated rig alone."""

from __future__ import annotations

import shutil
from pathlib import Path

from cabols_control.configuration import read_yaml
from cabols_control.errors import UsageError
from cabols_control.geometry import load_geometry
from cabols_control.rig_folder import RigFolder

TRUTH = "geometry_truth.yaml"


def make_pulley_rig(source: RigFolder, target: Path, radius: float, neglected: bool) -> Path:
    """Copy a rig's folder and put pulleys with vertical axes at its base points.

    Args:
        source: of the rig without pulleys.
        target: folder to make.
        radius: of all pulleys [m].
        neglected: whether control goes on believing in points.

    Returns:
        The folder.

    Raises:
        UsageError: if the rig has pulleys of its own.
        ConfigError: if these pulleys cannot be.
    """
    geometry, plant = source.file("geometry.yaml"), source.file("plant.yaml")
    if "pulley_radius" in read_yaml(geometry) or "geometry_file" in read_yaml(plant):
        raise UsageError(
            f"--pulleys: expected a rig between points, got {source.path}, which has pulleys or a "
            "true geometry of its own; leave the option out"
        )
    shutil.copytree(source.path, target)
    file = target / ("geometry.yaml" if not neglected else TRUTH)
    text = geometry.read_text(encoding="utf-8").rstrip("\n")
    file.write_text(f"{text}\npulley_radius: {radius!r}   # m\n", encoding="utf-8")
    if neglected:
        own = plant.read_text(encoding="utf-8").rstrip("\n")
        line = f"geometry_file: {TRUTH}   # control neglects the pulleys"
        (target / "plant.yaml").write_text(f"{own}\n{line}\n", encoding="utf-8")
    load_geometry(file)
    return target
