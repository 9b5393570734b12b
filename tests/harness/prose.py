# SPDX-License-Identifier: Apache-2.0
"""Finds code that decides by prose: by a reason, a message, a text or a line of a log.

What reads a text for people is found by the names that such texts have here, in four forms:
methods that look into a text, comparisons, regular expressions, and match statements. A name that
was assigned such a text counts as one, within its function.
"""

import ast
import re
from dataclasses import dataclass

PROSE = re.compile(
    r"(?:^|_)(?:reason|message|msg|text|line|log|note|sentence|complaint|refusal|said|told)$"
)
"""Last word of a name whose value is for people."""
ERRORS = re.compile(r"(?:^|_)(?:error|exception|failure|exc)$")
"""`str(error)` is a text for people, too."""
LOOKS = {
    *("startswith", "endswith", "find", "rfind", "index", "rindex", "count"),
    *("partition", "rpartition", "split", "rsplit", "removeprefix", "removesuffix"),
    *("match", "fullmatch", "search", "findall", "finditer"),
}
UNCHANGED = {"lower", "upper", "strip", "lstrip", "rstrip", "casefold", "decode", "get"}
"""Methods whose result is as much prose as what they are called on."""
COMPARES = (ast.Eq, ast.NotEq, ast.In, ast.NotIn)


@dataclass(frozen=True)
class Finding:
    """One decision by prose.

    Attributes:
        line: of the source file, from 1.
        function: in which it stands; empty at the top level.
        source: the expression.
    """

    line: int
    function: str
    source: str


class _Scanner(ast.NodeVisitor):
    def __init__(self):
        self.found = []
        self._function = ""
        self._aliases = set()

    def visit_FunctionDef(self, node):
        outer = self._function, self._aliases
        self._function, self._aliases = node.name, set(self._aliases)
        self.generic_visit(node)
        self._function, self._aliases = outer

    def visit_AsyncFunctionDef(self, node):
        self.visit_FunctionDef(node)

    def visit_Assign(self, node):
        self.generic_visit(node)
        for target in node.targets:
            self._note(target, node.value)

    def visit_AnnAssign(self, node):
        self.generic_visit(node)
        if node.value is not None:
            self._note(node.target, node.value)

    def visit_NamedExpr(self, node):
        self.generic_visit(node)
        self._note(node.target, node.value)

    def _note(self, target, value):
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            for one, other in zip(target.elts, value.elts, strict=False):
                self._note(one, other)
        elif isinstance(target, ast.Name) and self.is_prose(value):
            self._aliases.add(target.id)

    def is_prose(self, node):
        """Whether an expression's value is a text for people, or holds one."""
        if isinstance(node, ast.Name):
            return node.id in self._aliases or bool(PROSE.search(node.id))
        if isinstance(node, ast.Attribute):
            return bool(PROSE.search(node.attr))
        if isinstance(node, ast.Subscript):
            key = node.slice
            if isinstance(key, ast.Constant) and isinstance(key.value, str):
                return bool(PROSE.search(key.value))
            return self.is_prose(node.value)
        if isinstance(node, ast.NamedExpr):
            return self.is_prose(node.target) or self.is_prose(node.value)
        if isinstance(node, ast.Tuple):
            return any(self.is_prose(part) for part in node.elts)
        if isinstance(node, ast.BoolOp):
            return any(self.is_prose(part) for part in node.values)
        if isinstance(node, ast.Call):
            return self._call_is_prose(node)
        return False

    def _call_is_prose(self, node):
        if isinstance(node.func, ast.Name) and node.func.id == "str" and node.args:
            given = node.args[0]
            last = getattr(given, "id", getattr(given, "attr", ""))
            return bool(ERRORS.search(last)) or self.is_prose(given)
        if isinstance(node.func, ast.Attribute):
            named = [a.value for a in node.args[:1] if isinstance(a, ast.Constant)]
            if node.func.attr == "get" and named and isinstance(named[0], str):
                return bool(PROSE.search(named[0]))
            return node.func.attr in UNCHANGED and self.is_prose(node.func.value)
        return False

    def visit_Call(self, node):
        self.generic_visit(node)
        if not isinstance(node.func, ast.Attribute) or node.func.attr not in LOOKS:
            return
        if all(_is_blank(part) for part in node.args) and not node.keywords:
            return  # lines and words are counted or taken apart, not read
        looked_into = [node.func.value]
        if node.func.attr in {"match", "fullmatch", "search", "findall", "finditer", "split"}:
            looked_into += node.args
        if any(self.is_prose(part) for part in looked_into):
            self._add(node)

    def visit_Compare(self, node):
        self.generic_visit(node)
        sides = [node.left, *node.comparators]
        for left, how, right in zip(sides, node.ops, sides[1:], strict=False):
            if _is_blank(left):
                continue
            if isinstance(how, COMPARES) and (self.is_prose(left) or self.is_prose(right)):
                self._add(node)
                return

    def visit_Match(self, node):
        self.generic_visit(node)
        if self.is_prose(node.subject):
            self._add(node)

    def _add(self, node):
        source = ast.unparse(node).partition("\n")[0]
        self.found.append(Finding(node.lineno, self._function, source))


def _is_blank(node):
    """Whether an expression is white space: `"\\n" in text` asks for lines, not for words."""
    value = node.value if isinstance(node, ast.Constant) else None
    return isinstance(value, str) and value != "" and value.isspace()


def decisions_by_prose(source):
    """Find decisions by prose in Python source.

    Args:
        source: text of a module.

    Returns:
        Findings, in order of the file.
    """
    scanner = _Scanner()
    scanner.visit(ast.parse(source))
    return sorted(scanner.found, key=lambda finding: finding.line)


WORD = r"(?:[\w.]*\.)?(?:\w*_)?(?:reason|message|text|line|log|note|textContent|why)"
SCRIPT_FORMS = (
    re.compile(
        rf"\b{WORD}\??\.(?:startsWith|endsWith|includes|indexOf|match|search|split|replace\w*)\("
    ),
    re.compile(rf"\b{WORD}\s*(?:===|!==|==|!=)|(?:===|!==|==|!=)\s*{WORD}\b(?!\.)"),
    re.compile(rf"\.(?:test|exec)\(\s*{WORD}\s*\)"),
    re.compile(rf"\bswitch\s*\(\s*{WORD}\s*\)"),
)
"""The same of the pages' scripts, by simpler means."""


def script_decisions(source):
    """Find decisions by prose in JavaScript source; a list of (line from 1, text of the line)."""
    return [
        (number, line.strip())
        for number, line in enumerate(source.splitlines(), start=1)
        if any(form.search(line) for form in SCRIPT_FORMS)
    ]
