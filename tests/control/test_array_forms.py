# SPDX-License-Identifier: Apache-2.0
"""Arrays in the forms in which others hold them, at the public entries: one table.

Read-only (a view of a message, a memory map), strided, Fortran-ordered, single precision, a list:
each gives what a plain float64 array gives, and starts no compiler. Empty ones give nothing, or a
ShapeError.
"""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.calibration.model import Readings
from cabols_control.errors import ShapeError
from cabols_control.forward_kinematics import PoseFinder, PoseRegion
from cabols_control.forward_kinematics.pose import stretched_lengths
from cabols_control.gains import wrench_gains
from cabols_control.geometry import RigGeometry, load_geometry
from cabols_control.kinematics import cable_lengths, direction_gradients, structure_matrix
from cabols_control.limb import LimbModel, identify_limb
from cabols_control.limb_springs import limb_springs
from cabols_control.realtime.kernel_signatures import compiled_since, specialisations
from cabols_control.registration.reflectors import RegistrationError, register_pose
from cabols_control.tension import METHODS, RigTensionResolver, TensionResolver, distribute
from cabols_control.workspace.bodies import load_bodies
from cabols_control.workspace.capacity import (
    available_wrenches,
    capacity_along,
    capacity_of_matrices,
)
from cabols_control.workspace.elastic import (
    limb_stiffness,
    platform_stiffness,
    tension_stiffness,
    yield_under,
)
from cabols_control.workspace.grid import box_grid
from cabols_control.workspace.interference import clearance_along
from cabols_control.workspace.surface import level_surface
from cabols_control.workspace.wrench_set import wrench_box, wrench_polytope, wrench_zonotope
from cases import outcome

BENCH = load_geometry()
POSITION = np.array(BENCH.reference_position) + np.array([0.02, -0.03, 0.05])
EYE = np.eye(3)
A = structure_matrix(BENCH, POSITION, EYE)
WRENCH = np.array([20.0, -10.0, 15.0, 1.0, -2.0, 0.5])
BOX = np.array([20.0, 20.0, 20.0, 2.0, 2.0, 2.0])
LOW, HIGH = np.full(8, 1.0), np.full(8, 150.0)
AXIS = np.linspace(-1.0, 1.0, 5)
LEVEL = 1.0 - np.abs(AXIS)[:, None, None] - np.abs(AXIS)[None, :, None] * np.ones(5)


def rig(base, platform, position, rotation):
    made = RigGeometry(base, platform, position, rotation)
    return cable_lengths(made, POSITION, EYE)


def into(resolver, *arguments):
    tension = np.empty(8)
    resolver.solve_into(*arguments, tension)
    return tension


def fixed(A, low, high):
    return TensionResolver(A, low, high)


def moving(base, platform, low, high):
    return RigTensionResolver(base, platform, low, high)


FIXED, MOVING = fixed(A, LOW, HIGH), moving(BENCH.base_points, BENCH.platform_points, LOW, HIGH)
MANY = (np.tile(POSITION, (3, 1)), np.tile(EYE, (3, 1, 1)), np.tile(WRENCH, (3, 1)))
POINTS = (np.array(BENCH.base_points), np.array(BENCH.platform_points))

REFLECTORS = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
SECONDS = np.linspace(0.0, 1.0, 101)
WOUND = 0.02 * (SECONDS - 0.05 * (1.0 - np.exp(-SECONDS / 0.05)))

PULLS, SPRINGS = np.full(8, 30.0), np.full(8, 2200.0)
RADIUS, SWIVELS = np.full(8, 0.04), np.repeat([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], 4, axis=0)


def over(radius, axes):
    points = (BENCH.base_points, BENCH.platform_points, BENCH.reference_position, EYE)
    return RigGeometry(*points, pulley_radius=radius, pulley_axes=axes)


PULLEYS = over(RADIUS, SWIVELS)
LENGTHS = cable_lengths(PULLEYS, POSITION, EYE)
REGION = PoseRegion(BENCH.reference_position, BENCH.reference_rotation, np.full(3, 0.3), 0.3)
FINDER = PoseFinder(PULLEYS, 1e-4, REGION)

TEN = np.hstack([A, np.roll(A[:, :2], 1, axis=1) * [[1.0, -1.0]] + 0.1])

ENTRIES = {
    **{
        f"distribute {method}, ten cables": (
            lambda *words, method=method: distribute(*words, method).tension,
            (TEN, TEN @ np.full(10, 40.0), np.full(10, 1.0), np.full(10, 150.0)),
        )
        for method in ("p_norm", "barycentre", "analytic_centre")
    },
    "wrench_gains": (
        lambda *words: np.array(
            [each.tension for each in wrench_gains([LimbModel(1.5, 0.3)] * 8, *words, 40.0).limbs]
        ),
        (SPRINGS, np.array([-10.0, -90.0, -40.0, -40.0])),
    ),
    "limb_springs": (
        lambda *words: limb_springs(*words).stiffness(LENGTHS),
        (SPRINGS, np.full(8, 15e3), LENGTHS),
    ),
    "box_grid": (
        lambda *words: box_grid(*words[:2], (3, 2, 2), *words[2:]).positions,
        (POSITION, np.full(3, 0.2), np.zeros((1, 3)), EYE),
    ),
    "register_pose": (
        lambda *words: register_pose(*words).position,
        (REFLECTORS, REFLECTORS + POSITION, np.tile(1e-10 * EYE, (4, 1, 1))),
    ),
    "identify_limb": (
        lambda *words: np.array(identify_limb(*words).gain),
        (SECONDS, np.ones(101), WOUND),
    ),
    "RigGeometry": (rig, (*POINTS, np.array(BENCH.reference_position), EYE)),
    "cable_lengths": (lambda p, r: cable_lengths(BENCH, p, r), (POSITION, EYE)),
    "structure_matrix": (lambda p, r: structure_matrix(BENCH, p, r), (POSITION, EYE)),
    **{
        f"distribute {method}": (
            lambda *words, method=method: distribute(*words, method).tension,
            (A, WRENCH, LOW, HIGH),
        )
        for method in METHODS
    },
    "TensionResolver": (lambda *words: fixed(*words).solve(WRENCH).tension, (A, LOW, HIGH)),
    "TensionResolver.solve": (lambda w: FIXED.solve(w).tension, (WRENCH,)),
    "TensionResolver.solve_into": (lambda w: into(FIXED, w), (WRENCH,)),
    "TensionResolver.feasible": (FIXED.feasible, (WRENCH,)),
    "TensionResolver.solve_batch": (lambda w: FIXED.solve_batch(w)[0], MANY[2:]),
    "RigTensionResolver": (
        lambda *words: moving(*words).solve(POSITION, EYE, WRENCH).tension,
        (*POINTS, LOW, HIGH),
    ),
    "RigTensionResolver.solve": (
        lambda *words: MOVING.solve(*words).tension,
        (POSITION, EYE, WRENCH),
    ),
    "RigTensionResolver.solve_into": (
        lambda *words: into(MOVING, *words),
        (POSITION, EYE, WRENCH),
    ),
    "RigTensionResolver.solve_batch": (lambda *words: MOVING.solve_batch(*words)[0], MANY),
    "capacity_along": (
        lambda *words: capacity_along(BENCH, *words, wrench_box(BOX)).margin,
        (*MANY[:2], LOW, HIGH),
    ),
    "capacity_of_matrices": (
        lambda *words: capacity_of_matrices(*words, wrench_box(BOX)).margin,
        (A[None], LOW, HIGH),
    ),
    "available_wrenches": (lambda *words: available_wrenches(*words)[1], (A, LOW, HIGH)),
    "clearance_along": (
        lambda *words: clearance_along(BENCH, load_bodies(), *words).cables,
        MANY[:2],
    ),
    "wrench_box": (lambda *words: wrench_box(*words).vertices(), (BOX, WRENCH, WRENCH)),
    "wrench_polytope": (lambda p: wrench_polytope(p).vertices(), (MANY[2],)),
    "wrench_zonotope": (lambda *words: wrench_zonotope(*words).vertices(), (MANY[2], WRENCH)),
    "pulleys": (
        lambda radius, axes: cable_lengths(over(radius, axes), POSITION, EYE),
        (RADIUS, SWIVELS),
    ),
    "direction_gradients": (
        lambda *words: direction_gradients(PULLEYS, *words),
        (POSITION, EYE),
    ),
    "PoseFinder.find": (lambda lengths: FINDER.find(lengths).position, (LENGTHS,)),
    "PoseFinder": (
        lambda std: PoseFinder(PULLEYS, std, REGION).find(LENGTHS).position,
        (np.full(8, 1e-4),),
    ),
    "PoseRegion": (
        lambda *words: PoseFinder(PULLEYS, 1e-4, PoseRegion(*words, 0.3)).find(LENGTHS).position,
        (np.array(BENCH.reference_position), EYE, np.full(3, 0.3)),
    ),
    "stretched_lengths": (
        lambda *words: np.concatenate(stretched_lengths(*words)),
        (LENGTHS, PULLS, SPRINGS, np.full(8, 1e-4), np.full(8, 0.1)),
    ),
    "tension_stiffness": (
        lambda *words: tension_stiffness(PULLEYS, *words),
        (POSITION, EYE, PULLS),
    ),
    "platform_stiffness": (
        lambda p, r, pulls, springs, target: platform_stiffness(
            PULLEYS, p, r, pulls, springs, 1e4, target
        ),
        (POSITION, EYE, PULLS, SPRINGS, 1e3 * np.eye(6)),
    ),
    "limb_stiffness": (lambda *words: limb_stiffness(words[0], 1e4, words[1]), (SPRINGS, LENGTHS)),
    "yield_under": (
        lambda stiffness, loads: np.array(yield_under(stiffness, loads, range(6), 0.15).moved),
        (1e3 * np.eye(6), MANY[2]),
    ),
    "Readings": (
        lambda *words: Readings(*words, 7.0).wrench,
        (*MANY[:2], np.tile(LENGTHS, (3, 1)), MANY[2]),
    ),
    "level_surface": (
        lambda *words: np.array(level_surface(*words).volume),
        (AXIS, AXIS, AXIS, LEVEL),
    ),
}


def read_only(array):
    copy = array.copy()
    copy.setflags(write=False)
    return copy


def strided(array):
    wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]))
    wide[..., ::2] = array
    return wide[..., ::2]


def unaligned(array):
    raw = np.zeros(array.nbytes + 1, dtype=np.uint8)
    view = raw[1:].view(np.float64).reshape(array.shape)
    view[...] = array
    return view


FORMS = {
    "read-only": (read_only, 1e-12),
    "strided": (strided, 1e-12),
    "reversed": (lambda array: array[..., ::-1].copy()[..., ::-1], 1e-12),
    "Fortran": (np.asfortranarray, 1e-12),
    "unaligned": (unaligned, 1e-12),
    "big-endian": (lambda array: array.astype(">f8"), 1e-12),
    "list": (lambda array: array.tolist(), 1e-12),
    "float32": (lambda array: array.astype(np.float32), 1e-4),
    "big-endian float32": (lambda array: array.astype(">f4"), 1e-4),
    "long double": (lambda array: array.astype(np.longdouble), 1e-12),
    "objects": (lambda array: array.astype(object), 1e-12),
    "subclass": (lambda array: array.view(np.ma.MaskedArray), 1e-12),
}


@pytest.mark.parametrize("entry", ENTRIES)
def test_every_form_gives_what_plain_arrays_give(entry):
    call, arguments = ENTRIES[entry]
    if entry == "distribute daqp":
        pytest.importorskip("daqp")
    plain = call(*arguments)
    # Plain arrays may have a shorter way of their own; both ways are compiled once.
    call(*[np.asarray(argument, order="F").astype(np.float32) for argument in arguments])
    before = specialisations()
    for name, (form, tolerance) in FORMS.items():
        found = call(*[form(argument) for argument in arguments])
        scale = max(1.0, float(np.abs(plain).max()))
        np.testing.assert_allclose(found, plain, rtol=0, atol=tolerance * scale, err_msg=name)
        for k in range(len(arguments)):
            call(*[form(each) if i == k else each for i, each in enumerate(arguments)])
    assert compiled_since(before) == []


def masked(array):
    return np.ma.masked_array(array, np.arange(array.size).reshape(array.shape) == 0)


QUICK = [
    "RigTensionResolver.solve",
    "RigTensionResolver.solve_into",
    *(f"TensionResolver.{call}" for call in ("solve", "solve_into", "feasible")),
]
"""Calls of half a microsecond: they look at the kind of numbers, not for a mask."""
NO_NUMBERS = {
    "complex": lambda array: array + 1j,
    "structured": lambda array: array.view([("value", np.float64)]),
    "times": lambda array: array.astype("m8[s]"),
    "masked": masked,
}


@pytest.mark.parametrize("form", NO_NUMBERS)
@pytest.mark.parametrize("entry", ENTRIES)
def test_what_is_no_number_is_refused(entry, form):
    if form == "masked" and entry in QUICK:
        return
    call, arguments = ENTRIES[entry]
    with pytest.raises(ShapeError, match="expected"):
        call(*[NO_NUMBERS[form](argument) for argument in arguments])


@pytest.mark.parametrize("entry", [name for name in ENTRIES if name not in QUICK])
def test_a_mask_in_one_argument_alone_is_refused(entry):
    call, arguments = ENTRIES[entry]
    for k in range(len(arguments)):
        with pytest.raises(ShapeError, match="expected"):
            call(*[masked(each) if i == k else each for i, each in enumerate(arguments)])


@pytest.mark.parametrize("entry", ENTRIES)
def test_empty_arrays_give_nothing_or_are_refused(entry):
    call, arguments = ENTRIES[entry]
    found = outcome(lambda: call(*[argument[:0] for argument in arguments]))
    if isinstance(found, Exception):
        assert isinstance(found, (ShapeError, RegistrationError))
        assert "expected" in str(found)
    else:
        assert np.size(found) == 0


@pytest.mark.parametrize(
    "tension",
    [
        read_only(np.zeros(8)),
        strided(np.zeros(8)),
        np.zeros(8, dtype=np.float32),
        np.zeros(8, dtype=">f8"),
        np.zeros(7),
        [0.0] * 8,
    ],
    ids=["read-only", "strided", "float32", "big-endian", "short", "list"],
)
def test_an_output_that_cannot_be_filled_is_refused(tension):
    with pytest.raises(ShapeError, match="tension: expected"):
        FIXED.solve_into(WRENCH, tension)
    with pytest.raises(ShapeError, match="tension: expected"):
        MOVING.solve_into(POSITION, EYE, WRENCH, tension)


@pytest.mark.parametrize("wrong", [read_only(np.zeros((3, 8))), strided(np.zeros((3, 8)))])
def test_a_batch_that_cannot_be_filled_is_refused(wrong):
    with pytest.raises(ShapeError, match="out: expected"):
        FIXED.solve_batch(MANY[2], (wrong, np.empty(3, dtype=np.int64)))


def test_a_geometry_leaves_the_callers_arrays_writable():
    arrays = [array.copy() for array in (*POINTS, POSITION, EYE)]
    RigGeometry(*arrays)
    assert all(array.flags.writeable for array in arrays)
