# SPDX-License-Identifier: Apache-2.0
"""Answers of Robot Web Services: the wanted field, or why there is none and what to do.

A controller answers in JSON or XHTML, with or without a character set, whatever was asked for.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from cabols_hw.abb.errors import RwsError, RwsFailure
from cabols_hw.abb.rws.dialects import MODULE, RwsCall
from cabols_hw.abb.rws.http_exchange import HttpAnswer

SYMBOL_CODES = frozenset({-1073442809, -1073442804})
"""Codes of a RAPID symbol that is not found."""

SUCCESS = (200, 201, 202, 204)
GIVEN = 120
"""Characters of an odd answer that are shown."""


@dataclass(frozen=True)
class Content:
    """What an answer holds.

    Attributes:
        states: fields of each entry.
        code: of an error; 0 for none.
        message: of an error.
    """

    states: tuple[dict[str, str], ...] = ()
    code: int = 0
    message: str = ""


def content_of(answer: HttpAnswer) -> Content:
    """Read JSON or XHTML of either version; nothing where it is neither."""
    content = _text(answer)
    try:
        if content.startswith("{"):
            return _from_json(json.loads(content, object_pairs_hook=_each_once))
        if content.startswith("<"):
            return _from_xml(content)
    except (ValueError, ElementTree.ParseError, RecursionError):
        pass
    return Content()


def value_of(call: RwsCall, answer: HttpAnswer, url: str) -> list[dict[str, str]]:
    """Return the entries of a good answer.

    Args:
        call: that was made.
        answer: to it.
        url: of the controller, for the text.

    Raises:
        RwsError: if it is no good answer; the message says what to do.
    """
    content = content_of(answer)
    if answer.status not in SUCCESS:
        raise failure_of(call, answer, content, url)
    if call.key and not any(call.key in state for state in content.states):
        shown = _text(answer)[:GIVEN] or "nothing"
        raise RwsError(
            RwsFailure.ODD_ANSWER,
            f"robot: {call.what}: expected an answer with {call.key} from {url}, got {shown!r}",
        )
    return list(content.states)


def failure_of(call: RwsCall, answer: HttpAnswer, content: Content, url: str) -> RwsError:
    """Return the error of an answer that is no success.

    Args:
        call: that was made.
        answer: to it.
        content: of the answer.
        url: of the controller, for the text.
    """
    failure, advice = _judge(answer.status, content)
    said = f": {content.message}" if content.message else ""
    code = f", code {content.code}" if content.code else ""
    text = f"robot: {call.what} refused by {url} (HTTP {answer.status}{code}){said}"
    return RwsError(failure, f"{text}; {advice}" if advice else text)


def _judge(status: int, content: Content) -> tuple[RwsFailure, str]:
    if content.code in SYMBOL_CODES:
        return (
            RwsFailure.NO_SYMBOL,
            f"load the module {MODULE} ({MODULE}.mod) into the robot's task, of the same version "
            "as this program",
        )
    known = _BY_STATUS.get(status)
    if known is not None:
        return known
    if 300 <= status < 400:
        return RwsFailure.WRONG_VERSION, "give the address that it refers to as rws_url"
    if status >= 500:
        return RwsFailure.BUSY, "is the controller starting, or overloaded? try again"
    return RwsFailure.REJECTED, ""


_VERSION = (
    "the controller does not know this resource: does it speak another version of Robot Web "
    "Services (1.0: RobotWare 6, http; 2.0: RobotWare 7, https)? check rws_url"
)
_BY_STATUS = {
    401: (
        RwsFailure.CREDENTIALS,
        "it does not accept this user and password: check them",
    ),
    403: (
        RwsFailure.FORBIDDEN,
        "does the FlexPendant or another client hold the mastership, or may this user not write? "
        "release it there, turn the key to AUTO, check the user's grants",
    ),
    404: (RwsFailure.WRONG_VERSION, _VERSION),
    405: (RwsFailure.WRONG_VERSION, _VERSION),
    406: (RwsFailure.WRONG_VERSION, _VERSION),
    410: (RwsFailure.WRONG_VERSION, _VERSION),
    415: (RwsFailure.WRONG_VERSION, _VERSION),
    429: (RwsFailure.BUSY, "too many requests: is another client polling?"),
    500: (
        RwsFailure.WHITE_LIST,
        "is this computer's address on the controller's white list (connected services, "
        "firewall)? else restart the controller's web service",
    ),
    503: (
        RwsFailure.BUSY,
        "too many sessions are open on the controller, or it is starting: close other clients, or "
        "wait some minutes until their sessions expire",
    ),
}


def _text(answer: HttpAnswer) -> str:
    found = re.search(r"(?i)charset\s*=\s*\"?([\w-]+)", answer.headers.get("content-type", ""))
    for name in (found[1] if found else "", "utf-8-sig"):
        if name:
            try:
                return answer.body.decode(name).lstrip("\ufeff \t\r\n")
            except (LookupError, UnicodeDecodeError):
                continue
    return answer.body.decode("latin-1").lstrip()


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse a name that stands twice in an object: which holds?"""
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name twice")
    return found


def _from_json(data: Any) -> Content:
    if not isinstance(data, dict):
        return Content()
    inside = data.get("_embedded")
    holder = inside if isinstance(inside, dict) else data
    status = holder.get("status", data.get("status"))
    states: list[dict[str, str]] = []
    for place in (data.get("state"), holder.get("_state"), holder.get("resources")):
        entries = place if isinstance(place, list) else []
        states += [_fields(entry) for entry in entries if isinstance(entry, dict)]
    if not isinstance(status, dict):
        return Content(tuple(states))
    return Content(tuple(states), _number(status.get("code")), str(status.get("msg", "")))


def _fields(entry: dict[str, Any]) -> dict[str, str]:
    return {str(k): str(v) for k, v in entry.items() if isinstance(v, str | int | float)}


def _from_xml(content: str) -> Content:
    # Entities are never declared by a controller, but by whoever wants them to explode.
    if "<!ENTITY" in content:
        return Content()
    states: list[dict[str, str]] = []
    error: dict[str, str] = {}
    for element in ElementTree.fromstring(content).iter():
        spans = {
            str(span.get("class")): (span.text or "").strip()
            for span in element
            if span.tag.rpartition("}")[2] == "span" and span.get("class")
        }
        if spans and "code" in spans and element.get("class") == "status":
            error = spans
        elif spans:
            states.append(spans)
    return Content(tuple(states), _number(error.get("code")), error.get("msg", ""))


def _number(value: Any) -> int:
    try:
        return int(value)
    except (TypeError, ValueError, OverflowError):
        return 0
