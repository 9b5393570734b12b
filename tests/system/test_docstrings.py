# SPDX-License-Identifier: Apache-2.0
"""Public functions of two or more arguments describe them; the list of the others shrinks."""

import ast

import docstrings
import structure

PLANTED = '''
def described(force, arm):
    """Turn.

    Args:
        force: (3,) [N].
        arm: (3,) [m].

    Returns:
        (3,) torque [N m].
    """

def half(force, arm):
    """Turn.

    Args:
        force: (3,), about the arm [N].

    Returns:
        (3,) torque by the arm [N m].
    """

def one(force):
    """One argument needs no section."""

class Public:
    def nothing(self, force, arm):
        """Turn a force about an arm."""

    def _private(self, force, arm):
        """Turn."""

class _Private:
    def method(self, force, arm):
        """Turn."""
'''


def test_arguments_are_described_and_the_skip_list_only_shrinks():
    found = set(docstrings.undescribed(structure.read_tree()))
    skipped = docstrings.skipped()
    assert sorted(found - skipped) == [], "describe the arguments, with shape and unit"
    assert sorted(skipped - found) == [], "run tools/docstrings.py --shrink"


def test_what_is_not_described_is_found(tmp_path):
    path = tmp_path / "cabols_hw" / "cabols_hw" / "planted.py"
    path.parent.mkdir(parents=True)
    path.write_text(PLANTED)
    found = docstrings.undescribed(structure.read_tree(tmp_path))
    assert found == {
        "cabols_hw.planted:half": ["arm"],
        "cabols_hw.planted:Public.nothing": ["force", "arm"],
    }


def test_a_method_counts_without_self():
    node = ast.parse("def f(self, force): ...").body[0]
    assert docstrings.missing_arguments(node) == []
