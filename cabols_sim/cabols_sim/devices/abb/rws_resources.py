# SPDX-License-Identifier: Apache-2.0
"""Resources of Robot Web Services: path and query to answer; no sockets, no authentication."""

from __future__ import annotations

from cabols_sim.devices.abb.rapid import RapidError, RapidProgram

TASK = "T_ROB1"
MODULE = "cabols"
SYMBOLS = "/rw/rapid/symbol/data/RAPID/"
SYMBOL_NOT_FOUND = -1073442809
REJECTED = -1073445865
NO_RESOURCE = -1073445881


class Refusal(Exception):  # noqa: N818
    """An answer other than success: HTTP status, RWS code and message."""

    def __init__(self, status: int, code: int, message: str) -> None:
        super().__init__(message)
        self.status, self.code = status, code


class RwsResources:
    """Path and query to answer; no sockets, no authentication."""

    def __init__(self, program: RapidProgram) -> None:
        """Serve one program on one task."""
        self._program = program

    def get(self, path: str) -> list[dict[str, str]]:
        """Return the state entries of a resource; Refusal if there is none."""
        program = self._program
        if path.startswith(SYMBOLS):
            name = self._symbol(path)
            return [{"_type": "rap-data", "_title": path[1:], "value": program.get(name)}]
        running = "running" if program.running else "stopped"
        known = {
            "/rw/rapid/execution": {
                "_type": "rap-execution",
                "_title": "execution",
                "ctrlexecstate": running,
                "cycle": "forever",
            },
            "/rw/panel/ctrlstate": {
                "_type": "pnl-ctrlstate",
                "_title": "ctrlstate",
                "ctrlstate": program.controller_state,
            },
            "/rw/panel/opmode": {
                "_type": "pnl-opmode",
                "_title": "opmode",
                "opmode": program.operation_mode,
            },
            "/rw/rapid/tasks": {
                "_type": "rap-task-li",
                "_title": TASK,
                "name": TASK,
                "type": "normal",
                "taskstate": "linked",
                "excstate": "started" if program.running else "stopped",
                "active": "On",
                "motiontask": "TRUE",
            },
            "/logout": {"_type": "user-logout", "_title": "logout"},
        }
        if path not in known:
            raise Refusal(404, NO_RESOURCE, f"no such resource: {path}")
        return [known[path]]

    def post(self, path: str, action: str, form: dict[str, str]) -> None:
        """Act; Refusal if that is not possible now, or ever.

        Args:
            path: of the request.
            action: what to do with it.
            form: content of the request.
        """
        program = self._program
        if program.operation_mode != "AUTO":
            raise Refusal(403, REJECTED, "operation not allowed in manual mode")
        try:
            if path.startswith(SYMBOLS) and action == "set":
                program.set(self._symbol(path), form.get("value", ""))
            elif (path, action) == ("/rw/rapid/execution", "start"):
                program.start()
            elif (path, action) == ("/rw/rapid/execution", "stop"):
                program.stop()
            elif (path, action) == ("/rw/rapid/execution", "resetpp"):
                program.reset_pointer()
            elif (path, action) == ("/rw/panel/ctrlstate", "setctrlstate"):
                self._switch(form.get("ctrl-state", ""))
            elif path.startswith("/rw/mastership"):
                # Implicit mastership suffices for one client; requesting it is no error.
                return
            else:
                raise Refusal(404, NO_RESOURCE, f"no such resource: {path}?action={action}")
        except RapidError as error:
            raise Refusal(400, REJECTED, str(error)) from error

    def _switch(self, wanted: str) -> None:
        if wanted not in ("motoron", "motoroff"):
            raise Refusal(400, REJECTED, f"ctrl-state: expected motoron or motoroff, got {wanted}")
        self._program.set_motors(wanted == "motoron")

    def _symbol(self, path: str) -> str:
        """Name of the variable of .../T_ROB1/name or .../T_ROB1/module/name."""
        task, *rest = path[len(SYMBOLS) :].split("/")
        modules, name = rest[:-1], rest[-1] if rest else ""
        if task != TASK or modules not in ([], [MODULE]) or name not in self._program.names:
            raise Refusal(400, SYMBOL_NOT_FOUND, f"RAPID symbol was not found: {path}")
        return name
