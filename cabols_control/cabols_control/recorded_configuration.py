# SPDX-License-Identifier: Apache-2.0
"""What a bag says of how its run was configured: the nodes' parameters and the files in force."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import yaml

from cabols_control.rig_folder import FILES, RigFolder

PARAMETERS = "parameters_"
"""Before a node's name: the key of its parameters, as YAML."""
UNREADABLE = "not readable on the recorder's computer"
LARGEST = 1 << 20
"""Longest file that is copied into a bag [bytes]."""
SECRET = ("password_file", "token_file", "tls_key")
"""Parameters whose files no bag carries."""
STEMS = {"robot_configurations": "robot", "robot": "robot_truth", "bias": "bias"}
"""Where a parameter's file is not named as the rig's file in whose place it stands."""


def configuration_texts(
    folder: RigFolder, parameters: Mapping[str, Mapping[str, Any]]
) -> dict[str, str]:
    """Return what goes into a bag's metadata.

    Args:
        folder: of the rig.
        parameters: values by name, by node, as the running nodes answered.

    Returns:
        Texts by key: `rig`; `configuration`, the fingerprint that /diagnostics has; of every file
        of the rig, or of the file that a node's parameter puts in its place, `NAME_file`,
        `NAME_yaml` (or urdf, cal) and `NAME_sha256`; each node's parameters; the method of tension
        distribution where a parameter names one.
    """
    found = {"rig": folder.name, "configuration": folder.fingerprint}
    for file in FILES:
        if folder.has(file.name):
            found |= _file_texts(Path(file.name).stem, folder.path / file.name)
    for node, values in sorted(parameters.items()):
        found[PARAMETERS + node] = yaml.safe_dump(dict(values), sort_keys=True)
        for name, value in values.items():
            if not (name.endswith("_file") and value and isinstance(value, str)):
                continue
            if name not in SECRET:
                stem = name.removesuffix("_file")
                found |= _file_texts(STEMS.get(stem, stem), Path(value))
        if values.get("tension_method"):
            found["tension_method"] = str(values["tension_method"])
    return found


def _file_texts(name: str, path: Path) -> dict[str, str]:
    kind = path.suffix.removeprefix(".") or "text"
    key = name if kind in ("yaml", "yml") else f"{name}_{kind}"
    text = f"{name}_yaml" if kind in ("yaml", "yml") else f"{name}_{kind}"
    try:
        content = path.read_bytes()
    except OSError:
        return {f"{key}_file": f"{path}: {UNREADABLE}"}
    found = {f"{key}_file": path.name, f"{key}_sha256": sha256(content).hexdigest()}
    if len(content) <= LARGEST:
        found[text] = content.decode(errors="replace")
    return found
