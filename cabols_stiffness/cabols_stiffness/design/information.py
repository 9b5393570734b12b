# SPDX-License-Identifier: Apache-2.0
"""Information of a load about the joints, in scaled units, before any measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_stiffness.design.candidates import Candidates
from cabols_stiffness.measurements.samples import covariances
from cabols_stiffness.model.balance import Law, balance
from cabols_stiffness.model.robot import JOINTS, RobotModel
from cabols_stiffness.model.screws import point_motion


@dataclass(frozen=True, eq=False)
class Setup:
    """Prior knowledge before the campaign.

    Attributes:
        robot: with the platform as its tool.
        stiffness: (6,) guess, such as a data sheet's or an earlier result's [N m/rad].
        reflectors: (r, 3) in tool axes [m].
        noise: (r, 3, 3) covariance of a measured reflector, base axes [m^2].
        cubic: whether cubic terms are to be found, too.
        reference_every: loads between two measurements of the unloaded reference.
    """

    robot: RobotModel
    stiffness: FloatArray
    reflectors: FloatArray
    noise: FloatArray
    cubic: bool = False
    reference_every: int = 4

    def __post_init__(self) -> None:
        """Check the covariances."""
        covariances("noise", self.noise, self.reflectors.shape[0], 3, True)


class Information:
    """Whitened derivatives of every candidate, by the scaled parameters.

    Attributes:
        rows: (n, r, 3, p) for n candidates, r reflectors and p parameters: relative stiffness, then
            cubic torque at the joint's largest deflection, relative to the linear one.
        configuration: (n,) of the candidates.
    """

    def __init__(self, setup: Setup, candidates: Candidates) -> None:
        """Load the guessed robot with every candidate."""
        robot = setup.robot
        law = Law(np.asarray(setup.stiffness, dtype=np.float64), np.zeros(JOINTS))
        joints = candidates.configurations[candidates.configuration]
        rest = balance(robot, joints, candidates.wrench, law, follows=False)
        columns = rest.by_stiffness * law.stiffness
        if setup.cubic:
            reach = np.abs(rest.deflection).max(axis=0)
            columns = np.concatenate([columns, rest.by_cubic * law.stiffness / reach**2], axis=2)
        arms = np.einsum("nij,rj->nri", rest.posture.rotation, setup.reflectors)
        motion = point_motion(arms) @ rest.posture.jacobian[:, None]
        white = np.linalg.inv(np.linalg.cholesky(setup.noise))
        self.rows = white @ motion @ columns[:, None]
        self.configuration = candidates.configuration
        self._every = setup.reference_every
        self._squares = np.einsum("nrip,nriq->npq", self.rows, self.rows)

    @property
    def parameters(self) -> int:
        """Number p of parameters."""
        return int(self.rows.shape[-1])

    def of(self, chosen: FloatArray) -> FloatArray:
        """(p, p) information of a multiset of candidates, offsets of the passes estimated.

        A pass over one reflector shares an offset: what the loads' mean tells is lost, the less so
        the more unloaded references it has and the better loads of opposite sense balance.

        Args:
            chosen: (n,) how often each candidate is measured.
        """
        total = np.zeros((self.parameters, self.parameters))
        for index in np.unique(self.configuration[chosen > 0.0]):
            total += self.of_stay(chosen * (self.configuration == index))
        return total

    def of_stay(self, chosen: FloatArray) -> FloatArray:
        """(p, p) as `of`, of candidates that all belong to one configuration."""
        used = np.flatnonzero(chosen)
        count = chosen[used].sum()
        squares = np.einsum("n,npq->pq", chosen[used], self._squares[used])
        mean = np.einsum("n,nrip->rip", chosen[used], self.rows[used])
        samples = count + 1.0 + count / self._every
        return np.asarray(squares - np.einsum("rip,riq->pq", mean, mean) / samples)

    def with_each(self, chosen: FloatArray, members: IntArray) -> FloatArray:
        """(m, p, p) as of_stay of the same configuration, with each of m members added once.

        Args:
            chosen: (n,) how often each candidate is measured, all of one configuration.
            members: (m,) indices of the candidates.
        """
        used = np.flatnonzero(chosen)
        count = chosen[used].sum() + 1.0
        squares = np.einsum("n,npq->pq", chosen[used], self._squares[used])
        mean = np.einsum("n,nrip->rip", chosen[used], self.rows[used])
        each = mean + self.rows[members]
        samples = count + 1.0 + count / self._every
        lost = np.einsum("nrip,nriq->npq", each, each) / samples
        return np.asarray(squares + self._squares[members] - lost)
