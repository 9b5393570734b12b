# SPDX-License-Identifier: Apache-2.0
"""The two forms of Robot Web Services: 1.0 (RobotWare 6, IRC5) and 2.0 (RobotWare 7, OmniCore).

Resources and forms after ABB's reference of each. 2.0 has other paths, wants its version in the
types of content, and a client has to hold the mastership "edit" before it writes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from urllib.parse import urlencode

TASK = "T_ROB1"
MODULE = "cabols"
START = {
    "regain": "continue",
    "execmode": "continue",
    "cycle": "forever",
    "condition": "none",
    "stopatbp": "disabled",
    "alltaskbytsp": "true",
}


@dataclass(frozen=True)
class RwsCall:
    """A request.

    Attributes:
        what: it does, for people: "reading cabols_done".
        method: of HTTP.
        path: with its query.
        form: content of a POST.
        key: field of the answer that is wanted; empty for none.
    """

    what: str
    method: str
    path: str
    form: dict[str, str] = field(default_factory=dict)
    key: str = ""

    @property
    def body(self) -> bytes:
        """Content as it is sent."""
        return urlencode(self.form).encode()


@dataclass(frozen=True)
class Dialect:
    """How one version names what the rig needs.

    Attributes:
        version: of Robot Web Services.
        accept: type of content that is asked for.
        content_type: of a form.
        mastership: whether writing needs it.
    """

    version: str
    accept: str
    content_type: str
    mastership: bool

    def headers(self, call: RwsCall) -> dict[str, str]:
        """Return the headers that the version wants."""
        headers = {"Accept": self.accept}
        if call.method == "POST":
            headers["Content-Type"] = self.content_type
        return headers

    def operation_mode(self) -> RwsCall:
        """AUTO, MANR or MANF."""
        return self._get("reading the operation mode", "/rw/panel/opmode", "opmode")

    def controller_state(self) -> RwsCall:
        """Motors and emergency stop."""
        path = self._of("/rw/panel/ctrlstate", "/rw/panel/ctrl-state")
        return self._get("reading the controller's state", path, "ctrlstate")

    def execution(self) -> RwsCall:
        """Whether RAPID runs."""
        return self._get("reading the execution state", "/rw/rapid/execution", "ctrlexecstate")

    def tasks(self) -> RwsCall:
        """All RAPID tasks."""
        return self._get("reading the tasks", "/rw/rapid/tasks", "name")

    def read(self, name: str) -> RwsCall:
        """Read a RAPID variable."""
        return self._get(f"reading {name}", self._symbol(name), "value")

    def write(self, name: str, value: str) -> RwsCall:
        """Write a RAPID variable.

        Args:
            name: of the variable.
            value: as RAPID writes it.
        """
        path = self._symbol(name) + self._of("?action=set", "")
        return self._post(f"writing {name}", path, {"value": value})

    def start(self) -> RwsCall:
        """Start RAPID."""
        return self._execute("starting RAPID", "start", START)

    def stop(self) -> RwsCall:
        """Stop RAPID and the motion."""
        form = {"stopmode": "stop"} if self.version == "1.0" else STOP_2
        return self._execute("stopping RAPID", "stop", form)

    def pointer_to_main(self) -> RwsCall:
        """Program pointer to main."""
        return self._execute("program pointer to main", "resetpp", {})

    def take_mastership(self) -> RwsCall:
        """Ask for the right to write."""
        return self._post("requesting the mastership", "/rw/mastership/edit/request", {})

    def release_mastership(self) -> RwsCall:
        """Give the right to write back."""
        return self._post("releasing the mastership", "/rw/mastership/edit/release", {})

    def log_out(self) -> RwsCall:
        """End the session."""
        return self._get("logging out", "/logout", "")

    def _of(self, first: str, second: str) -> str:
        return first if self.version == "1.0" else second

    def _symbol(self, name: str) -> str:
        return self._of(
            f"/rw/rapid/symbol/data/RAPID/{TASK}/{name}",
            f"/rw/rapid/symbol/RAPID/{TASK}/{MODULE}/{name}/data",
        )

    def _execute(self, what: str, action: str, form: dict[str, str]) -> RwsCall:
        path = "/rw/rapid/execution" + self._of(f"?action={action}", f"/{action}")
        return self._post(what, path, form)

    def _get(self, what: str, path: str, key: str) -> RwsCall:
        return RwsCall(what, "GET", path + self._of("?json=1", ""), {}, key)

    def _post(self, what: str, path: str, form: dict[str, str]) -> RwsCall:
        json = "&json=1" if "?" in path else "?json=1"
        return RwsCall(what, "POST", path + self._of(json, ""), form)


STOP_2 = {"stopmode": "stop", "usetsp": "normal"}
RWS_1 = Dialect("1.0", "application/json", "application/x-www-form-urlencoded", mastership=False)
RWS_2 = Dialect(
    "2.0",
    "application/hal+json;v=2.0",
    "application/x-www-form-urlencoded;v=2.0",
    mastership=True,
)
