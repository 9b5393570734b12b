# SPDX-License-Identifier: Apache-2.0
"""Stiffness campaigns: start, watch, pause, resume, abort; the running estimate; the reports."""

from __future__ import annotations

import re
from datetime import datetime
from html import escape
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from nicegui import ui

from cabols_control.console.dispatcher import Answer
from cabols_control.console.panels.rig import COMMAND, activity, button, enable, mode_of
from cabols_control.console.reports import REPORT, finished

if TYPE_CHECKING:
    from cabols_control.console.panels.context import PageContext

ACTION = "run_stiffness_test"
LOOK_S = 2.0


class CampaignPanel:
    """Shows and commands the campaigns; the stiffness node runs them."""

    def __init__(self, own: PageContext) -> None:
        """Build."""
        self._own = own
        self._file = (
            ui.input("campaign.yaml on the rig's computer; empty: default")
            .props("dense outlined data-name=campaign-file")
            .classes("full-width")
        )
        with ui.row().classes("no-wrap full-width"):
            self._folder = (
                ui.input("Folder", value=f"campaign_{datetime.now():%Y-%m-%d}")  # noqa: DTZ005
                .props("dense outlined data-name=campaign-folder")
                .style("flex:1; min-width:0")
            )
            self._accuracy = (
                ui.number("Stop at, %", value=0.0, min=0, max=100, step=0.5)
                .props("dense outlined")
                .style("width:92px")
            )
        with ui.row().classes("full-width rowed"):
            self._start = button("Start", self._do_start, "campaign-start", "cyan-9")
            self._pause = button("Pause", lambda: own.call("pause"), "campaign-pause")
            self._resume = button("Resume", lambda: own.call("resume"), "campaign-resume")
            self._abort = button("Abort", lambda: own.call("abort"), "campaign-abort")
        self._progress = ui.linear_progress(0.0, show_value=False).props("aria-label='Progress'")
        self._text = (
            ui.html("", sanitize=True)
            .classes("verdict")
            .props("role=status data-name=campaign-text")
        )
        self._estimate = ui.html("", sanitize=False).classes("full-width")
        with ui.row().classes("full-width items-center rowed").style("margin-top:8px"):
            ui.html("<h2 style='margin:0'>Finished reports</h2>", sanitize=False)
            self._report = button("Write report", lambda: own.call("report"), "campaign-report")
        self._reports = ui.html("", sanitize=False).classes("reports full-width")
        self._shown = ""
        self._look()
        ui.timer(LOOK_S, self._look)

    async def _do_start(self) -> None:
        name = str(self._folder.value or "")
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}", name):
            self._own.show(Answer(False, "folder: expected letters, digits, . _ and -"))
            return
        await self._own.start(
            ACTION,
            campaign=str(self._file.value or ""),
            folder=str((self._own.dispatcher.settings.campaigns / name).resolve()),
            accuracy=float(self._accuracy.value or 0.0) / 100.0,
        )

    def _look(self) -> None:
        """Look for finished reports."""
        rows = []
        for report in finished(self._own.dispatcher.settings.campaigns):
            when = datetime.fromtimestamp(report.changed_s)  # noqa: DTZ006
            address = f"/reports/{quote(report.name)}/{REPORT}"
            rows.append(
                f'<div><a href="{address}" target="_blank" rel="noopener">{escape(report.name)}</a>'
                f' <span class="hint">{when:%Y-%m-%d %H:%M}</span></div>'
            )
        content = "".join(rows) or '<span class="hint">none yet</span>'
        if content != self._shown:
            self._shown = self._reports.content = content

    def refresh(self, state: dict[str, Any], commanding: bool) -> None:
        """Show a new state, and enable what may be done in it.

        Args:
            state: of the rig, as LatestValues.state returns it.
            commanding: whether this page is in command.
        """
        run = activity(state, ACTION)
        campaign = state.get("campaign") or {}
        active = bool(campaign.get("active"))
        command, under_way = (commanding, COMMAND), (active, "No campaign is under way.")
        free = (not active and not run.get("busy"), "A campaign is under way.")
        rests = (mode_of(state)["name"] == "STOPPED", "Only in Stopped.")
        paused = bool(campaign.get("paused"))
        enable(self._start, command, free, rests)
        enable(self._pause, command, under_way, (not paused, "It is paused."))
        enable(self._resume, command, under_way, (paused, "It is not paused."))
        enable(self._abort, command, under_way)
        enable(self._report, command, (bool(campaign), "No campaign has run."), free)
        self._progress.value = campaign.get("progress", 0.0)
        ended = "" if active else run.get("text", "")
        told = campaign.get("text", "") if active or not ended else ended
        self._text.content = escape(told)
        estimate = state.get("estimate")
        self._estimate.content = estimate_html(estimate) if estimate else ""


def estimate_html(estimate: dict[str, Any]) -> str:
    """Running estimate with its intervals as a table."""
    rows = []
    for joint in estimate["joints"]:
        if joint["stiffness"] is None:
            cells = '<td class="n" colspan="3">not identified yet</td>'
        else:
            cells = (
                f'<td class="n">{joint["stiffness"]:,.0f}</td>'
                f'<td class="n">{joint["low"]:,.0f} to {joint["high"]:,.0f}</td>'
                f'<td class="n">&plusmn;{joint["percent"]:.1f} %</td>'
            )
        rows.append(f'<tr><th scope="row">{joint["number"]}</th>{cells}</tr>')
    return (
        f"<h2 style='margin-top:8px'>Running estimate, {estimate['loads']} loads</h2>"
        '<table class="data" aria-label="Joint stiffness"><thead><tr><th scope="col">Joint</th>'
        '<th scope="col">N m/rad</th><th scope="col">95 % interval</th><th scope="col"></th></tr>'
        f"</thead><tbody>{''.join(rows)}</tbody></table>"
    )
