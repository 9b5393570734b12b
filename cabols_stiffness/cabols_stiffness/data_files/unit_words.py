# SPDX-License-Identifier: Apache-2.0
"""Words of units, and their factors to SI."""

from __future__ import annotations

import re

import numpy as np

LENGTH = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "micron": 1e-6,
    "microns": 1e-6,
    "in": 0.0254,
    "inch": 0.0254,
    "mil": 2.54e-5,
    "thou": 2.54e-5,
}
ANGLE = {
    "rad": 1.0,
    "degree": np.pi / 180.0,
    "degrees": np.pi / 180.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "deg": np.pi / 180.0,
    "°": np.pi / 180.0,
    "mdeg": 1e-3 * np.pi / 180.0,
    "arcmin": np.pi / 10800.0,
    "arcsec": np.pi / 648000.0,
    "gon": np.pi / 200.0,
}
FORCE = {"n": 1.0, "newton": 1.0, "kn": 1e3, "dan": 10.0, "kgf": 9.80665, "lbf": 4.4482216152605}
TORQUE = {
    "nm": 1.0,
    "nmm": 1e-3,
    "ncm": 1e-2,
    "knm": 1e3,
    "kgfm": 9.80665,
    "kgfcm": 9.80665e-2,
    "lbfin": 4.4482216152605 * 0.0254,
    "lbfft": 4.4482216152605 * 0.3048,
}
MASS = {"kg": 1.0, "g": 1e-3, "lb": 0.45359237, "lbs": 0.45359237}
KIND = {"length": LENGTH, "angle": ANGLE, "force": FORCE, "torque": TORQUE, "mass": MASS}


def is_unit(word: str) -> bool:
    """Whether a word is a unit that some column may have.

    Args:
        word: as written, such as "N m".
    """
    return any(plain_unit(word) in table for table in KIND.values())


def plain_unit(word: str) -> str:
    """Return a unit's word without blanks, dots and capitals.

    Args:
        word: as written.
    """
    text = re.sub(r"[-\s*·⋅._]", "", word).lower()
    # Of "micro" there are two characters, of which a keyboard has one and a font's table the other.
    return text.replace("\u00b5", "u").replace("\u03bc", "u")
