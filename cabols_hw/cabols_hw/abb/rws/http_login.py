# SPDX-License-Identifier: Apache-2.0
"""HTTP authentication of a client: digest (RFC 7616), as IRC5 asks, or basic, as OmniCore does."""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
import threading
from enum import Enum

ALGORITHMS = {"MD5": hashlib.md5, "SHA-256": hashlib.sha256}


class Scheme(Enum):
    """Ways to prove a password."""

    DIGEST = "digest"
    BASIC = "basic"


class Login:
    """Answers the challenges of one server; may be used by several threads.

    Attributes:
        scheme: that the server asked for last; None before.
    """

    def __init__(self, user: str, password: str) -> None:
        """Keep user and password."""
        self._user, self._password = user, password
        self._lock = threading.Lock()
        self._fields: dict[str, str] = {}
        self._count = 0
        self.scheme: Scheme | None = None

    def challenge(self, header: str) -> bool:
        """Take a WWW-Authenticate header; return whether it can be answered.

        Args:
            header: its value; several challenges may stand behind each other.
        """
        found = re.search(r"(?i)\bdigest\s", header)
        if found is None:
            if not re.search(r"(?i)\bbasic\b", header):
                return False
            self.scheme = Scheme.BASIC
            return True
        fields = {
            name.lower(): (quoted or bare)
            for name, quoted, bare in re.findall(
                r'(\w+)\s*=\s*(?:"([^"]*)"|([^\s,]+))', header[found.end() :]
            )
        }
        algorithm = fields.get("algorithm", "MD5").upper()
        if not fields.get("nonce") or algorithm not in ALGORITHMS:
            return False
        with self._lock:
            self._fields, self._count = {**fields, "algorithm": algorithm}, 0
            self.scheme = Scheme.DIGEST
        return True

    def header(self, method: str, path: str) -> str:
        """Return the value of Authorization for a request; empty before a challenge.

        Args:
            method: of the request.
            path: of the request, with its query.
        """
        if self.scheme is Scheme.BASIC:
            proof = f"{self._user}:{self._password}".encode()
            return "Basic " + base64.b64encode(proof).decode()
        if self.scheme is None:
            return ""
        with self._lock:
            self._count += 1
            fields, count = self._fields, f"{self._count:08x}"
        return self._digest(fields, count, method, path)

    def _digest(self, fields: dict[str, str], count: str, method: str, path: str) -> str:
        def digest(text: str) -> str:
            return ALGORITHMS[fields["algorithm"]](text.encode()).hexdigest()

        realm, nonce = fields.get("realm", ""), fields["nonce"]
        secret = digest(f"{self._user}:{realm}:{self._password}")
        asked = digest(f"{method}:{path}")
        said = {"username": self._user, "realm": realm, "nonce": nonce, "uri": path}
        plain = {"algorithm": fields["algorithm"]}
        if "auth" in re.split(r"[\s,]+", fields.get("qop", "")):
            mine = secrets.token_hex(8)
            said["cnonce"] = mine
            said["response"] = digest(f"{secret}:{nonce}:{count}:{mine}:auth:{asked}")
            plain.update(qop="auth", nc=count)
        else:
            said["response"] = digest(f"{secret}:{nonce}:{asked}")
        if "opaque" in fields:
            said["opaque"] = fields["opaque"]
        parts = [f'{name}="{value}"' for name, value in said.items()]
        return "Digest " + ", ".join(parts + [f"{name}={value}" for name, value in plain.items()])
