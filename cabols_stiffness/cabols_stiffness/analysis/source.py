# SPDX-License-Identifier: Apache-2.0
"""Where an analysis finds its data: a campaign's folder, or any bag."""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory

from cabols_control.bags.metadata import FILE_NAME
from cabols_control.bags.recover import recover
from cabols_stiffness.analysis.bag import (
    BagLoads,
    campaign_text,
    loads_announced,
    read_loads,
)
from cabols_stiffness.campaign.journal import PLAN, bags_of
from cabols_stiffness.campaign.plan import CampaignPlan, load_plan
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.measurements.measured_load import MeasuredLoad

VERSIONS_OF = ("cabols_stiffness", "cabols_control", "cabols_msgs", "numpy", "scipy", "pin",
               "rosbags", "mcap", "bokeh")  # fmt: skip
BLOCK = 1 << 20


@dataclass(frozen=True)
class Source:
    """What was read.

    Attributes:
        plan: of the campaign.
        loads: finished, in the order of recording.
        failures: (configuration, reflector, load, reason) of what failed.
        bags: SHA-256 of every file of every bag, by path.
        parameters: of this analysis, and versions, text by key.
        wrenches: samples read.
        rig_s: of the rig's time [s].
    """

    plan: CampaignPlan
    loads: list[MeasuredLoad] = field(default_factory=list)
    failures: list[tuple[int, int, int, str]] = field(default_factory=list)
    bags: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)
    wrenches: int = 0
    rig_s: float = 0.0


def is_campaign(path: Path) -> bool:
    """Whether a folder is a campaign's."""
    return (path / PLAN).is_file() and bool(bags_of(path))


def read_source(
    path: str | Path,
    campaign: str | Path = "",
    geometry: str | Path | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Source:
    """Read a campaign's bags, or one bag; nothing else of the folder but campaign.yaml.

    Args:
        path: of the campaign's folder or of the bag.
        campaign: campaign.yaml to use; empty: the folder's, or the one that the bag carries.
        geometry: YAML of the rig's geometry; None: the bench's.
        say: gets a line for each bag.

    Raises:
        CampaignError, BagError, ConfigError: saying what was expected, what came, what helps.
    """
    place = Path(path)
    if not place.exists():
        raise CampaignError(f"{place}: expected a campaign's folder or a bag, got nothing there")
    folders = bags_of(place) if is_campaign(place) else [place]
    plan = _plan(place, folders[0], campaign)
    parameters = {
        "source": str(place),
        "campaign": str(campaign) or ("the folder's" if is_campaign(place) else "the bag's"),
        "python": platform.python_version(),
        "command": " ".join(sys.argv),
        **_versions(),
    }
    source = Source(plan, parameters=parameters)
    rig_s, wrenches = 0.0, 0
    for number, folder in enumerate(folders, start=1):
        say(f"reading bag {number} of {len(folders)}: {folder}")
        found = _read(folder, plan, geometry)
        if found is None:
            continue
        source.loads.extend(found.loads)
        source.failures.extend(found.failures)
        wrenches, rig_s = wrenches + found.wrenches, rig_s + found.rig_s
        for file in sorted(folder.glob("*.mcap")):
            source.bags[str(file)] = _hash(file)
    if not source.loads:
        raise CampaignError(f"{place}: stiffness_load: expected loads that succeeded, got none")
    return Source(plan, source.loads, source.failures, source.bags, parameters, wrenches, rig_s)


def _read(folder: Path, plan: CampaignPlan, geometry: str | Path | None) -> BagLoads | None:
    """Read one bag, or the readable part of an interrupted run's; None for a run without loads."""
    if not is_campaign(folder.parent.parent):
        return read_loads(folder, plan, geometry)
    if not any(folder.glob("*.mcap")):
        return None
    if (folder / FILE_NAME).exists():
        return _read_run(folder, plan, geometry)
    with TemporaryDirectory() as scratch:
        # The folder may belong to others, or still be written to: it is left as it is.
        whole = Path(scratch) / folder.name
        recover(folder, whole)
        return _read_run(whole, plan, geometry)


def _read_run(bag: Path, plan: CampaignPlan, geometry: str | Path | None) -> BagLoads | None:
    return read_loads(bag, plan, geometry, some=False) if loads_announced(bag) else None


def _plan(place: Path, bag: Path, campaign: str | Path) -> CampaignPlan:
    if campaign:
        return load_plan(campaign)
    if is_campaign(place):
        return load_plan(place / PLAN)
    text = campaign_text(bag)
    if not text:
        raise CampaignError(
            f"{place}: expected a bag that carries its campaign.yaml, got one without; name the "
            "campaign: --campaign FILE"
        )
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / PLAN
        file.write_text(text, encoding="utf-8")
        plan = load_plan(file)
    if plan.rig.urdf:
        raise CampaignError(
            f"{place}: expected the bench's robot, got a campaign for "
            f"{Path(plan.rig.urdf).name}; name the campaign, its URDF beside it: --campaign FILE"
        )
    return plan


def _hash(file: Path) -> str:
    digest = sha256()
    with file.open("rb") as stream:
        while block := stream.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _versions() -> dict[str, str]:
    return {f"version of {name}": _version(name) for name in VERSIONS_OF}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
