# SPDX-License-Identifier: Apache-2.0
"""Which limbs of which configuration have passed the check at first power-on; on disk."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from cabols_control.errors import CabolsError
from cabols_control.files.durable_file import write_durably
from cabols_control.files.state_folder import state_folder
from cabols_control.rig_folder import RigFolder

FORM = 1
WIRED = ("geometry.yaml", "limbs.yaml", "card.yaml", "frames.yaml", "sensor.cal")
"""Files whose change may mean another wiring: the check is to be made again."""


def configuration_hash(folder: RigFolder) -> str:
    """Hash of the files that describe a rig's wiring.

    Args:
        folder: of the rig.
    """
    digest = hashlib.sha256()
    for name in WIRED:
        if folder.has(name):
            digest.update(name.encode() + b"\0")
            digest.update((folder.path / name).read_bytes() + b"\0")
    return digest.hexdigest()


def record_path(folder: RigFolder) -> Path:
    """File of a rig's result in the state folder.

    Args:
        folder: of the rig.
    """
    return state_folder() / f"first_power_on_{re.sub(r'[^A-Za-z0-9_.-]', '_', folder.name)}.json"


def passed_limbs(path: Path, configuration: str) -> frozenset[int]:
    """Limbs that have passed, from 0; none for another configuration, or without a usable file.

    Args:
        path: of the file.
        configuration: hash of the files.
    """
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
        fits = content["form"] == FORM and content["configuration"] == configuration
        limbs = frozenset(limb for limb in content["limbs"] if type(limb) is int)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return frozenset()
    return limbs if fits else frozenset()


def save_passed(path: Path, configuration: str, limbs: Iterable[int]) -> None:
    """Write which limbs have passed; the file is complete or as before.

    Args:
        path: of the file; its folder is made.
        configuration: hash of the files.
        limbs: from 0.

    Raises:
        CabolsError: if it cannot be written.
    """
    content = {"form": FORM, "configuration": configuration, "limbs": sorted(limbs)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, json.dumps(content))
    except OSError as error:
        raise CabolsError(f"{path}: the check's result cannot be written ({error})") from error


def has_passed(folder: RigFolder, cables: int, path: Path | None = None) -> bool:
    """Whether all limbs of a rig have passed as it is configured now.

    Args:
        folder: of the rig.
        cables: number of its limbs.
        path: of the file; None: the state folder's.
    """
    found = passed_limbs(path or record_path(folder), configuration_hash(folder))
    return found >= frozenset(range(cables))
