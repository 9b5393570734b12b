# SPDX-License-Identifier: Apache-2.0
"""Load programmes: choose or upload, look at, check at this pose, run."""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import events, ui

from cabols_control.console.latest import NOTICE, WARNING
from cabols_control.console.panels.rig import BUSY, COMMAND, activity, button, enable, mode_of
from cabols_control.console.preview import preview_svg
from cabols_control.console.uploads import UPLOAD_BYTES, keep_upload, program_choices
from cabols_control.errors import CabolsError

if TYPE_CHECKING:
    from cabols_control.console.panels.context import PageContext


class LoadPanel:
    """Starts a programme only after its check has found it feasible; the node checks again."""

    def __init__(self, own: PageContext) -> None:
        """Build."""
        self._own = own
        self._feasible = False
        choices = program_choices(own.dispatcher.settings.uploads)
        with ui.row().classes("items-center no-wrap full-width"):
            self._program = (
                ui.select(choices, value="ramps", label="Load programme", on_change=self._changed)
                .props("dense outlined options-dense data-name=program")
                .style("flex:1; min-width:0")
            )
            self._scale = (
                ui.number("Scale", value=1.0, min=-10, max=10, step=0.1, on_change=self._changed)
                .props("dense outlined data-name=scale")
                .style("width:74px")
            )
        self._picture = ui.html("", sanitize=False).classes("preview full-width")
        self._verdict = (
            ui.html("", sanitize=True).classes("verdict").props("role=status data-name=verdict")
        )
        with ui.row().classes("full-width rowed"):
            self._check = button("Check", self._do_check, "check")
            self._run = button("Run", self._do_run, "run", "cyan-9")
            self._abort = button("Abort", lambda: own.cancel("run_program"), "abort")
        self._progress = ui.linear_progress(0.0, show_value=False).props("aria-label='Progress'")
        self._running = (
            ui.html("", sanitize=True).classes("hint").props("role=status data-name=running")
        )
        self._upload = ui.upload(
            label="Upload a programme (.csv)",
            auto_upload=True,
            max_file_size=UPLOAD_BYTES,
            on_upload=self._uploaded,
            on_rejected=self._rejected,
        ).props("accept=.csv flat dense data-name=upload")
        ui.html(
            "CSV columns time_s, fx_n, fy_n, fz_n, mx_nm, my_nm, mz_nm; straight lines between "
            "rows. Runs in Loading only.",
            sanitize=True,
        ).classes("hint")
        ui.timer(0.3, self._do_check, once=True)

    async def _changed(self) -> None:
        self._judge(False, "", "")
        await self._do_check()

    def _scale_value(self) -> float:
        value = self._scale.value
        return float(value) if value is not None and math.isfinite(value) and value != 0.0 else 1.0

    async def _do_check(self) -> None:
        program, scale = str(self._program.value), self._scale_value()
        answer = await self._own.dispatcher.look("check_program", program=program, scale=scale)
        if (program, scale) != (str(self._program.value), self._scale_value()):
            return  # another programme was chosen meanwhile
        if not answer.success:
            self._picture.content = ""
            self._judge(False, "fault", answer.message)
            return
        found = answer.response
        self._picture.content = preview_svg(found.time, found.wrench, found.worst_time, found.name)
        self._judge(bool(found.feasible), "ok" if found.feasible else "fault", answer.message)

    def _judge(self, feasible: bool, level: str, text: str) -> None:
        self._feasible = feasible
        self._verdict.content = escape(text)
        self._verdict.props(f"data-level={level or 'none'}")
        version, state = self._own.dispatcher.latest.state()
        del version
        self.refresh(state, self._own.in_command)

    async def _do_run(self) -> None:
        if not await self._own.agreed("A load programme"):
            return
        await self._own.start(
            "run_program",
            program=str(self._program.value),
            scale=self._scale_value(),
            checked=True,
        )

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        dispatcher = self._own.dispatcher
        refusal = dispatcher.lease.refusal(self._own.page)
        try:
            if refusal:
                raise CabolsError(refusal)
            content = await event.file.read()
            kept = keep_upload(dispatcher.settings.uploads, event.file.name, content)
        except CabolsError as error:
            self._refused(str(error))
            return
        finally:
            self._upload.reset()
        dispatcher.latest.tell(
            NOTICE, "console", f"uploaded {kept.path.name}: {kept.program.duration:g} s"
        )
        choices = program_choices(dispatcher.settings.uploads)
        self._program.set_options(choices, value=str(kept.path))

    def _rejected(self) -> None:
        self._upload.reset()
        self._refused(f"expected one .csv file of at most {UPLOAD_BYTES} bytes")

    def _refused(self, reason: str) -> None:
        self._own.dispatcher.latest.tell(WARNING, "console", f"upload refused: {reason}")
        self._judge(self._feasible, "fault", f"Upload refused: {reason}")

    def refresh(self, state: dict[str, Any], commanding: bool) -> None:
        """Show a new state, and enable what may be done in it.

        Args:
            state: of the rig, as LatestValues.state returns it.
            commanding: whether this page is in command.
        """
        doing = activity(state, "run_program")
        busy = bool(doing.get("busy"))
        loading = mode_of(state)["name"] == "LOADING"
        command = (commanding, COMMAND)
        feasible = (self._feasible, "The check has not found it feasible.")
        enable(self._run, command, (loading, "Only in Loading."), feasible, (not busy, BUSY))
        enable(self._abort, command, (busy, "No programme was started here."))
        enable(self._upload, command)
        self._progress.value = doing.get("progress", 0.0)
        self._running.content = escape(doing.get("text", ""))
