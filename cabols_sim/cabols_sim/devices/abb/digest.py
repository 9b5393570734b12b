# SPDX-License-Identifier: Apache-2.0
"""HTTP digest authentication, server side (RFC 7616 with MD5 and qop=auth, as in the IRC5)."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import threading
from collections import OrderedDict

NONCES = 256


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


class DigestGuard:
    """Checks Authorization headers for one user."""

    def __init__(self, user: str, password: str, realm: str = "validusers@robapi.abb") -> None:
        """Accept this user only."""
        self._user = user
        self._realm = realm
        self._secret = _md5(f"{user}:{realm}:{password}")
        self._nonces: OrderedDict[str, int] = OrderedDict()
        self._lock = threading.Lock()

    def challenge(self) -> str:
        """Value of WWW-Authenticate, with a new nonce."""
        nonce = secrets.token_hex(16)
        with self._lock:
            self._nonces[nonce] = 0
            while len(self._nonces) > NONCES:
                self._nonces.popitem(last=False)
        return f'Digest realm="{self._realm}", qop="auth", nonce="{nonce}", algorithm=MD5'

    def allows(self, method: str, path: str, header: str) -> bool:
        """Whether an Authorization header proves the password for this request.

        A nonce must be one of ours, and its count must rise: a header cannot be sent twice.

        Args:
            method: of the request.
            path: of the request.
            header: Authorization header, empty where there is none.
        """
        scheme, _, rest = header.partition(" ")
        if scheme.lower() != "digest":
            return False
        fields = {
            name.lower(): quoted or bare
            for name, quoted, bare in re.findall(r'(\w+)=(?:"([^"]*)"|([^\s,]+))', rest)
        }
        try:
            count = int(fields["nc"], 16)
            wanted = _md5(
                f"{self._secret}:{fields['nonce']}:{fields['nc']}:{fields['cnonce']}:auth:"
                + _md5(f"{method}:{path}")
            )
            given = (fields["username"], fields["uri"], fields["qop"], fields["realm"])
            proof, nonce = fields["response"], fields["nonce"]
        except (KeyError, ValueError):
            return False
        if given != (self._user, path, "auth", self._realm):
            return False
        if not hmac.compare_digest(wanted.encode(), proof.encode()):
            return False
        with self._lock:
            if not self._nonces.get(nonce, count) < count:
                return False
            self._nonces[nonce] = count
        return True
