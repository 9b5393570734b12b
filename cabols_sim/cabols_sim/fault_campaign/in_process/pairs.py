# SPDX-License-Identifier: Apache-2.0
"""Any two disturbances of the generated campaign at once, or one soon after the other; pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cabols_sim.fault_campaign.in_process.disturbances import PATIENCE_S, Disturbance
from cabols_sim.fault_campaign.in_process.rig import LockstepRig

GAPS_S = (0.0, 0.005, 0.05, 0.3)
"""Times from the first to the second, of which one is drawn [s]."""
ALONE = ("amplifier delivers all", "amplifier offset, larger")
"""What has a bound of its own already, and goes beyond it with a second fault of its limb."""


def two_of(singles: Sequence[Disturbance], wrong: Sequence[Disturbance]) -> Disturbance:
    """Return the disturbance that draws two others.

    An amplifier that drives by itself is not drawn with a wrong controller: all are switched off
    for its sake, and the motors that the controller has wound in coast. Where it gives no current
    against its motor, nothing but a hardware stop holds the cable (887 N).

    Args:
        singles: of which two are drawn.
        wrong: controllers among them that go wrong.
    """
    drawn = [way for way in singles if way.name not in ALONE]
    controllers = {way.name for way in wrong}

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        while True:
            first, second = (drawn[k] for k in random.choice(len(drawn), 2, replace=False))
            drives, is_wrong = first.amplifier, first.name in controllers
            if not ((drives and second.name in controllers) or (is_wrong and second.amplifier)):
                break
        first.strike(rig, random)
        rig.run(float(random.choice(GAPS_S)))
        second.strike(rig, random)

    return Disturbance("any two", strike, PATIENCE_S, pair=True)
