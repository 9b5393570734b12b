# SPDX-License-Identifier: Apache-2.0
"""People count from 1: no text for people shows an index from 0.

Only the functions of cabols_control/naming.py cross over. A text that names a limb, cable, joint,
reflector, configuration or load by a placeholder must take the number from there.
"""

import ast
import re
import string
from pathlib import Path

import pytest

from cabols_control import naming
from cabols_control.errors import CabolsError

ROOT = Path(__file__).resolve().parents[2]
NAMING = ROOT / "cabols_control" / "cabols_control" / "naming.py"
NOUN = r"(?:limb|cable|joint|reflector|configuration|conf\.|load|robot to|motion to|move to)"
BEFORE = re.compile(rf"(?<![a-z_]){NOUN}(?:[ #_=(\[-]*|s[ #_=(\[-]+|: ?)$", re.IGNORECASE)
"""Text that ends with one of the nouns: what follows is its number."""
NUMBER_ZERO = re.compile(rf"(?<![a-z_]){NOUN}s?[ #]0\b(?![.,]\d)", re.IGNORECASE)
"""Nothing that people read has the number 0."""
WRAPPED = {"number", *(name for name in dir(naming) if name.endswith(("_name", "_names")))}
INDEX = {"i", "j", "index", "limb", "cable", "joint", "reflector", "configuration"}
ATTRIBUTES = {"index", "limb", "joint", "reflector", "configuration"}
NO_NUMBER = {"axis"}
SAYS_SO = re.compile(r"\bfrom 0\b|\[\{\}\]")
"""A text about a ROS field or an array may count from 0 if it says so, or is written as one."""
PERCENT = re.compile(r"%(?:\((\w+)\))?[-+ #0]*\d*(?:\.\d+)?[diouxXeEfFgGcrsa]")
NOT_FOR_PEOPLE = ("id=", "<i id", "tb-", "tm-", "encoder ")
"""Before a bare index: names of HTML elements, and of what a simulated fault has frozen."""


def is_wrapped(node, named=()):
    """Whether an expression is a number that naming.py made, or no number but a name."""
    if isinstance(node, ast.Name) and node.id in NO_NUMBER.union(named):
        return True
    for part in ast.walk(node):
        if isinstance(part, ast.Call):
            name = part.func.attr if isinstance(part.func, ast.Attribute) else part.func
            name = name.id if isinstance(name, ast.Name) else name
            if name in WRAPPED:
                return True
    return "names[" in ast.unparse(node)


def is_bare_index(node):
    """Whether an expression is an index and nothing else: `i`, `self.limb`, `row["limb"]`."""
    if isinstance(node, ast.Name):
        return node.id in INDEX
    if isinstance(node, ast.Attribute):
        return node.attr in ATTRIBUTES
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        return node.slice.value in INDEX
    return False


def pieces(node):
    """(text before, expression) of every placeholder of a formatted text, in any of the forms."""
    if isinstance(node, ast.JoinedStr):
        before = ""
        for part in node.values:
            if isinstance(part, ast.Constant):
                before = part.value
            else:
                shape = ast.unparse(part.format_spec) if part.format_spec else ""
                # No index is a number with decimals.
                if not re.search(r"\.\d+[efg]", shape):
                    yield before, part.value
                before = ""
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mod) and is_text(node.left):
        given = node.right.elts if isinstance(node.right, ast.Tuple) else [node.right]
        yield from percent(node.left.value, given)
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        if text := last_text(node.left):
            yield text, node.right
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        if node.func.attr == "format" and is_text(node.func.value):
            yield from formatted(node.func.value.value, node)
        elif node.args[1:] and is_text(node.args[0]):
            yield from percent(node.args[0].value, node.args[1:])


def is_text(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def last_text(node):
    """Text with which the left side of a sum of texts ends; empty if it does not."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return last_text(node.right)
    if isinstance(node, ast.JoinedStr):
        node = node.values[-1]
    return node.value if is_text(node) else ""


def percent(template, given):
    """Placeholders of `template % given`, and of a log call with the same arguments."""
    begin = 0
    for k, match in enumerate(PERCENT.finditer(template.replace("%%", "  "))):
        if given and isinstance(given[0], ast.Dict):
            keys = [key.value for key in given[0].keys]
            value = given[0].values[keys.index(match[1])]
        else:
            value = given[min(k, len(given) - 1)]
        yield template[begin : match.start()], value
        begin = match.end()


def formatted(template, call):
    """Placeholders of `template.format(...)`."""
    named = {word.arg: word.value for word in call.keywords}
    count = 0
    for before, field, _, _ in string.Formatter().parse(template):
        if field is None:
            continue
        name = re.split(r"[.\[]", field)[0]
        if name in named:
            yield before, named[name]
        elif call.args:
            place = int(name) if name else count
            # With a starred argument every placeholder may be an index.
            yield before, call.args[min(place, len(call.args) - 1)]
            count += 1


def violations(source, name="<source>"):
    """Placeholders of a Python source at which people would read an index from 0."""
    tree = ast.parse(source)
    docs = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and is_text(node.value)
    }
    found, made = [], names_made(tree)
    for node in ast.walk(tree):
        if is_text(node) and id(node) not in docs and NUMBER_ZERO.search(node.value):
            found.append(f"{name}:{node.lineno}: {node.value!r}")
        shape = ast.unparse(node) if isinstance(node, ast.JoinedStr) else ""
        if SAYS_SO.search(re.sub(r"\{[^{}]*\}", "{}", shape)):
            continue
        for before, value in pieces(node):
            named = BEFORE.search(before) and not is_text(value)
            shown = isinstance(node, ast.JoinedStr) and is_bare_index(value)
            internal = any(word in before for word in NOT_FOR_PEOPLE)
            if (named and not is_wrapped(value, made)) or (shown and not internal):
                found.append(f"{name}:{node.lineno}: {before}{{{ast.unparse(value)}}}")
    return found


def page_violations(source, name="<source>"):
    """The same of a script or a template: the server sends names, no page makes them."""
    holes = r"(?:\$\{|\{\{|[\"'`] ?\+)"
    wrong = re.compile(rf"(?<![a-z]){NOUN}s?[ #]*{holes}", re.IGNORECASE)
    found = []
    for number, line in enumerate(source.splitlines(), start=1):
        if wrong.search(line) or NUMBER_ZERO.search(line):
            found.append(f"{name}:{number}: {line.strip()}")
    return found


def names_made(tree):
    """Variables to which a source assigns names that naming.py made, and nothing else."""
    made, other = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            (made if is_wrapped(node.value) else other).add(node.targets[0].id)
    return made - other


def tree_files(*suffixes):
    folders = (*sorted(ROOT.glob("cabols_*")), ROOT / "tools", ROOT / "docs")
    found = [path for folder in folders for path in folder.rglob("*") if path.suffix in suffixes]
    return [path for path in found if not {"build", "install"} & set(path.parts)]


def test_no_message_shows_an_index_from_zero():
    files = tree_files(".py")
    assert len(files) > 200
    wrong = []
    for path in files:
        if path != NAMING and not path.name.endswith(("_pb2.py", "_pb2_grpc.py")):
            wrong += violations(path.read_text("utf-8"), str(path.relative_to(ROOT)))
    assert not wrong, "\n".join(wrong)


def test_no_page_layout_or_document_shows_an_index_from_zero():
    files = [*tree_files(".js", ".j2", ".html", ".json", ".md", ".yaml"), ROOT / "README.md"]
    assert len(files) > 20
    wrong = []
    for path in files:
        wrong += page_violations(path.read_text("utf-8"), str(path.relative_to(ROOT)))
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "planted",
    [
        'f"limb {i} is slack"',
        'f"limbs {np.flatnonzero(slack).tolist()} are slack"',
        'f"limb {limb + 1} is slack"',
        'f"cable {int(lengths.argmin())}: too short"',
        'f"joint {j}: beyond its limit"',
        'f"reflector {request.reflector}: not seen"',
        'f"robot to configuration {feedback.configuration}"',
        'f"motion to {index} not begun"',
        'f"limb_{result.limb}.png"',
        'f"configuration_{n}_nm_per_rad"',
        'f"{limb:4d} {gain:8.3f}"',
        "f'<th scope=\"row\">{i}</th>'",
        'where = limb\nf"limb {where} is slack"',
        '"limb %d is slack" % i',
        '"%s: reflector %d, load %d" % (what, key.reflector, number(key.load))',
        '"joint %(joint)d" % {"joint": j}',
        '"limb {} is slack".format(i)',
        '"limb {which} is slack".format(which=limb)',
        '"{}, reflector {}, load {}".format(*whole)',
        '"limb " + str(i) + " is slack"',
        'logger.warning("limb %d is slack", i)',
        'raise CabolsError("limb 0 is slack")',
    ],
)
def test_a_planted_index_is_found(planted):
    assert violations(planted)


@pytest.mark.parametrize(
    "planted",
    [
        "put(title, `limb ${i} is slack`);",
        'put(title, "limb " + i);',
        "<p>reflector {{ row.reflector }}</p>",
        '"label": "cable 0"',
        "Limb 0 pulls at the upper corner.",
    ],
)
def test_an_index_planted_in_a_page_is_found(planted):
    assert page_violations(planted)


@pytest.mark.parametrize(
    "right",
    [
        'f"{limb_name(i)} is slack"',
        'f"not pre-tightened: {limb_names(np.flatnonzero(slack))}"',
        'f"limb_{number(result.limb)}.png"',
        'f"{place_name(*key)}: {reason}"',
        'where = configuration_name(i)\nf"robot to {where}: {reason}"',
        'f"limb: expected one of the indices {limbs} (from 0), got {request.limb}"',
        'f"expected joint {model.names[joint]!r} to be revolute"',
        '"loads {}".format(number(k))',
        'f"loads: expected {most} at most"',
        'f"the eight cables{devices}"',
        'f"four cores, load {average:.1f}"',
    ],
)
def test_right_texts_pass(right):
    assert not violations(right)


def test_names_count_from_one():
    assert naming.limb_name(3) == "limb 4"
    assert naming.limb_names([0]) == "limb 1"
    assert naming.limb_names([0, 1, 3]) == "limbs 1, 2 and 4"
    assert naming.limb_names([]) == "no limb"
    assert naming.place_name(0, 2, 9) == "configuration 1, reflector 3, load 10"


@pytest.mark.parametrize("typed", ["0", "9", "-1", "four", "1.5", ""])
def test_only_numbers_of_limbs_come_back(typed):
    with pytest.raises(CabolsError, match="limb: expected a number from 1 to 8"):
        naming.limb_index(typed, 8)


def test_what_people_type_comes_back_as_an_index():
    assert [naming.limb_index(str(naming.number(i)), 8) for i in range(8)] == list(range(8))
    assert naming.configuration_index("10", 13) == 9
