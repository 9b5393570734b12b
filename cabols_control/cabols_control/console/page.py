# SPDX-License-Identifier: Apache-2.0
"""The only page: header, state of the rig, controls of the operator."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from fastapi import Request
from nicegui import app, context, ui

from cabols_control.console.dispatcher import Dispatcher, mark_of
from cabols_control.console.panels.campaign import CampaignPanel
from cabols_control.console.panels.context import PageContext
from cabols_control.console.panels.live_view import (
    health_html,
    limbs_html,
    log_html,
    view_html,
    wrench_html,
)
from cabols_control.console.panels.load import LoadPanel
from cabols_control.console.panels.rig import LimbPanel, ModePanel, RobotPanel

REFRESH_S = 0.4


def build_page(dispatcher: Dispatcher) -> None:
    """Register the page; every visitor gets a page of their own."""
    # The scene's bundle of three.js is on the page's import map once its package is imported.
    import nicegui.elements.scene  # noqa: F401

    @ui.page("/")
    def index(request: Request) -> None:
        address = request.client.host if request.client else "?"
        viewer = dispatcher.open(context.client.id, str(app.storage.browser["id"]), address)
        _Page(dispatcher, PageContext(dispatcher, viewer.page)).build()


class _Page:
    """Builds one page and keeps it fresh."""

    def __init__(self, dispatcher: Dispatcher, own: PageContext) -> None:
        self._dispatcher = dispatcher
        self._own = own
        self._version = -1
        self._commanding: bool | None = None
        self._panels: list[Callable[[dict[str, Any], bool], None]] = []

    def build(self) -> None:
        """Lay the page out."""
        settings = {
            "page": self._own.page,
            "mark": mark_of(self._own.page),
            "scene": self._dispatcher.settings.scene,
        }
        # "<" would end the script early if a string held "</script>".
        text = json.dumps(settings).replace("<", "\\u003c")
        ui.add_head_html('<link rel="stylesheet" href="/console/console.css">')
        ui.add_head_html(f'<script type="application/json" id="console-settings">{text}</script>')
        ui.add_body_html('<script type="module" src="/console/live.js"></script>')
        self._header()
        ui.html('<div id="alarm" class="alarm" role="alert"></div>', sanitize=False)
        with ui.element("main").classes("deck"):
            with ui.element("div").classes("column").props('role="region" aria-label="Operate"'):
                self._operate()
            with ui.element("div").classes("column middle"):
                ui.html(view_html(), sanitize=False).classes("card")
                limbs = limbs_html(self._dispatcher.settings.cables)
                ui.html(limbs, sanitize=False).classes("card")
                ui.html(log_html(), sanitize=False).classes("card")
            with ui.element("div").classes("column"):
                ui.html(wrench_html(), sanitize=False).classes("card")
                health = health_html(self._dispatcher.settings.rig)
                ui.html(health, sanitize=False).classes("card")
        ui.timer(REFRESH_S, self._refresh)

    def _header(self) -> None:
        with ui.element("header").classes("bar"):
            # First in the order of the Tab key, last to the eye.
            ui.html(
                '<button id="estop" type="button" aria-label="Emergency stop: cut all currents '
                'now">EMERGENCY<br>STOP</button>',
                sanitize=False,
            ).classes("estop")
            title = f"<span>{self._dispatcher.settings.title}</span>"
            ui.html(title, sanitize=False).classes("brand")
            ui.html(
                '<div class="mode" role="status" aria-live="polite"><span id="mode-chip" '
                'class="mode-chip" data-mode="">&hellip; No mode</span>'
                '<span id="mode-reason" class="mode-reason"></span></div>',
                sanitize=False,
            ).classes("mode")
            ui.html(
                '<span id="link" class="link" role="status">&hellip; Connecting</span>',
                sanitize=False,
            ).style("order:3")
            with ui.element("div").classes("operator"):
                ui.html('<span id="operator-text" class="operator-text"></span>', sanitize=False)
                self._take = ui.button("Take command", on_click=self._toggle_command)
                self._take.props("unelevated dense padding='6px 14px'").mark("take")

    def _operate(self) -> None:
        own = self._own
        with ui.element("section").classes("card"):
            self._panels.append(ModePanel(own).refresh)
        with ui.element("section").classes("card"):
            with ui.tabs().props("dense inline-label align=left no-caps mobile-arrows") as tabs:
                names = ("Load", "Robot", "Limbs", "Campaign")
                made = [ui.tab(name) for name in names]
            with ui.tab_panels(tabs, value=made[0]).props("animated=false keep-alive"):
                kinds: tuple[type[Any], ...] = (LoadPanel, RobotPanel, LimbPanel, CampaignPanel)
                for tab, kind in zip(made, kinds, strict=True):
                    with ui.tab_panel(tab):
                        self._panels.append(kind(own).refresh)

    def _toggle_command(self) -> None:
        dispatcher, page = self._dispatcher, self._own.page
        answer = dispatcher.release(page) if self._own.in_command else dispatcher.take(page)
        self._own.show(answer)
        self._refresh()

    def _refresh(self) -> None:
        version, state = self._dispatcher.latest.state()
        commanding = self._own.in_command
        if (version, commanding) == (self._version, self._commanding):
            return
        self._version, self._commanding = version, commanding
        self._take.text = "Release command" if commanding else "Take command"
        for refresh in self._panels:
            refresh(state, commanding)
