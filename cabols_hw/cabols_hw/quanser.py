"""The Quanser Q8 card: the seam where its back end plugs in.

The back end itself (Daq over `quanser.hardware.HIL`) is not built yet; opening it says so.
"""

from __future__ import annotations

from typing import NoReturn

from cabols_control.errors import CabolsError


class CardError(CabolsError):
    """The card, or its driver, is not there or has failed."""


def open_q8(board: str, limbs: int) -> NoReturn:
    """Open a Q8 card.

    Raises:
        CardError: always, in this version: with the driver missing, or with the back end missing.
    """
    try:
        import quanser.hardware  # noqa: F401
    except ImportError as error:
        raise CardError(
            "quanser.hardware: expected Quanser's Python API (part of the Quanser SDK, from its "
            f"vendor), got {error}; without a card run the simulated bench: "
            "ros2 launch cabols_sim bench.launch.py"
        ) from error
    raise CardError(
        f"Q8 board {board}, {limbs} limbs: the hardware back end is not part of this version; "
        "implement cabols_hw.daq.Daq for it, or run the simulated bench"
    )
