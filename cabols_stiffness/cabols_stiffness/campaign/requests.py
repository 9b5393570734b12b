# SPDX-License-Identifier: Apache-2.0
"""Requests of the campaign's flow, and the rig's replies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from cabols_stiffness.campaign.plan import Point


class LoadKey(NamedTuple):
    """One load at one reflector."""

    configuration: int
    reflector: int
    load: int


@dataclass(frozen=True)
class Move:
    """Let the cables follow (free-moving) and move the robot."""

    configuration: int


@dataclass(frozen=True)
class Pretighten:
    """Let every limb find its zero."""

    configuration: int


@dataclass(frozen=True)
class BeginLoading:
    """Enter LOADING with the limbs at rest."""

    configuration: int


@dataclass(frozen=True, eq=False)
class Apply:
    """Bring the tensions to a stop of the trajectory and wait until the load has settled."""

    key: LoadKey
    point: Point


@dataclass(frozen=True, eq=False)
class Measure:
    """Measure the reflector under the settled load, and save it.

    Attributes:
        key: of the load.
        point: its tensions and branch.
        attempt: from 0.
    """

    key: LoadKey
    point: Point
    attempt: int


@dataclass(frozen=True)
class Tell:
    """Log retried or skipped loads with the reason.

    Attributes:
        what: "retried" or "skipped".
        keys: of the loads concerned.
        reason: why.
    """

    what: str
    keys: tuple[LoadKey, ...]
    reason: str


@dataclass(frozen=True)
class Rest:
    """Bring the tensions down and wait until the operator resumes the campaign."""


@dataclass(frozen=True)
class Finish:
    """Unload and stop."""


Request: TypeAlias = Move | Pretighten | BeginLoading | Apply | Measure | Tell | Rest | Finish


@dataclass(frozen=True)
class Reply:
    """Outcome of a request.

    Attributes:
        reason: why it failed; empty if it did not.
        pause: the operator has requested a pause.
        enough: the estimate has the requested accuracy.
        hopeless: a retry is useless, e.g. for a load beyond the limits.
    """

    reason: str = ""
    pause: bool = False
    enough: bool = False
    hopeless: bool = False

    @property
    def ok(self) -> bool:
        """Whether it succeeded."""
        return not self.reason
