# SPDX-License-Identifier: Apache-2.0
"""D- and A-optimal choice of loads: greedy, then exchanges (Fedorov 1972) until none helps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.errors import CabolsError
from cabols_stiffness.design.information import Information

RIDGE = 1e-3
"""Prior information, a deviation of thirty times the parameter: the greedy start has no zeros."""

SWEEPS = 5
"""Of exchanges over all chosen loads, at most."""


def d_criterion(information: FloatArray) -> FloatArray:
    """(...,) minus log determinant of information (..., p, p): the volume of the ellipsoid."""
    return np.asarray(-np.linalg.slogdet(information)[1])


def a_criterion(information: FloatArray) -> FloatArray:
    """(...,) trace of the covariance of information (..., p, p): the sum of scaled variances."""
    return np.asarray(np.trace(np.linalg.inv(information), axis1=-2, axis2=-1))


CRITERIA: dict[str, Callable[[FloatArray], FloatArray]] = {"D": d_criterion, "A": a_criterion}


@dataclass(frozen=True, eq=False)
class Design:
    """Chosen loads.

    Attributes:
        chosen: (m,) indices of the candidates, in the order of choice; one may come twice.
        information: (p, p) of all of them.
        exchanges: that improved the greedy choice.
    """

    chosen: IntArray
    information: FloatArray
    exchanges: int

    @property
    def deviation(self) -> FloatArray:
        """(p,) standard deviations of the scaled parameters."""
        return np.asarray(np.sqrt(np.diagonal(np.linalg.inv(self.information))))


def choose(
    information: Information,
    loads: int,
    configurations: int,
    criterion: str = "D",
    most: int | None = None,
) -> Design:
    """Choose the loads that make the parameters' covariance small.

    Args:
        information: of all candidates.
        loads: how many, over all configurations.
        configurations: how many different ones may be used: each costs a motion of the robot.
        criterion: "D" or "A", in scaled units.
        most: loads at one configuration, so that all are used: two or three would tell most about
            six constants, but more of them show a stiffness that is none; None: any.

    Raises:
        CabolsError: if the criterion is unknown, a number is below 1, or the candidates do not
            determine the parameters.
    """
    if criterion not in CRITERIA:
        raise CabolsError(f"criterion: expected one of {', '.join(CRITERIA)}, got {criterion!r}")
    if not (loads >= 1 and configurations >= 1):
        raise CabolsError(
            f"loads, configurations: expected 1 or more, got {loads} and {configurations}"
        )
    if most is not None and most * configurations < loads:
        raise CabolsError(
            f"most: expected {configurations} configurations to hold {loads} loads, got {most} each"
        )
    search = _Search(information, configurations, CRITERIA[criterion], most or loads)
    for _ in range(loads):
        search.add(search.best()[0])
    exchanges = search.exchange()
    found = search.total()
    if not np.linalg.cond(found) < 1e14:
        raise CabolsError(
            f"candidates: expected ones that determine all {information.parameters} parameters, "
            "got a singular information; allow more loads or configurations"
        )
    return Design(np.array(search.order), found, exchanges)


class _Search:
    def __init__(
        self,
        information: Information,
        configurations: int,
        criterion: Callable[[FloatArray], FloatArray],
        most: int,
    ) -> None:
        self._information, self._limit, self._criterion = information, configurations, criterion
        self._most = most
        self._counts = np.zeros(information.configuration.size)
        self._ridge = RIDGE * np.eye(information.parameters)
        self._stays: dict[int, FloatArray] = {}
        self.order: list[int] = []

    def total(self) -> FloatArray:
        """Return the (p, p) information of the chosen loads."""
        return np.asarray(np.sum([np.zeros_like(self._ridge), *self._stays.values()], axis=0))

    def add(self, index: int, times: float = 1.0) -> None:
        """Choose a candidate once more, or once less."""
        self._counts[index] += times
        if times > 0.0:
            self.order.append(index)
        else:
            self.order.remove(index)
        where = int(self._information.configuration[index])
        members = self._counts * (self._information.configuration == where)
        if members.any():
            self._stays[where] = self._information.of_stay(members)
        else:
            self._stays.pop(where, None)

    def best(self) -> tuple[int, float]:
        """Return the candidate that improves the criterion most, and the criterion with it."""
        total = self.total() + self._ridge
        best, least = -1, np.inf
        for where in np.unique(self._information.configuration):
            if where not in self._stays and len(self._stays) >= self._limit:
                continue
            here: BoolArray = self._information.configuration == where
            members = np.flatnonzero(here)
            if self._counts[members].sum() >= self._most:
                continue
            base = total - self._stays.get(int(where), np.zeros_like(total))
            added = self._information.with_each(self._counts * here, members)
            value = self._criterion(base + added)
            index = int(np.argmin(value))
            if value[index] < least:
                best, least = int(members[index]), float(value[index])
        return best, least

    def exchange(self) -> int:
        """Replace chosen loads by better ones until no replacement helps."""
        count = 0
        for _ in range(SWEEPS):
            improved = False
            for old in list(self.order):
                before = float(self._criterion(self.total() + self._ridge))
                self.add(old, -1.0)
                new, value = self.best()
                better = new != old and value < before - 1e-9 * abs(before)
                self.add(new if better else old)
                count += better
                improved = improved or better
            if not improved:
                break
        return count
