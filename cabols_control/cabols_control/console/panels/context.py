# SPDX-License-Identifier: Apache-2.0
"""One open page of the console: its identity, and how its handlers reach the dispatcher."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import Any

from nicegui import ui

from cabols_control.console.dispatcher import Answer, Dispatcher


class PageContext:
    """One open page: its id, and how its handlers reach the dispatcher."""

    def __init__(self, dispatcher: Dispatcher, page: str) -> None:
        """Bind a page to the dispatcher."""
        self.dispatcher = dispatcher
        self.page = page

    @property
    def in_command(self) -> bool:
        """Whether this page may command."""
        return not self.dispatcher.lease.refusal(self.page)

    async def do(self, asked: Awaitable[Answer]) -> Answer:
        """Await an answer and show it."""
        answer = await asked
        self.show(answer)
        return answer

    def show(self, answer: Answer) -> None:
        """Show a refusal; a granted request shows by its effect, and both are in the log."""
        if not answer.success:
            ui.notify(
                answer.message[:300],
                type="negative",
                position="bottom",
                timeout=6000,
                close_button="close",
            )

    async def call(self, service: str, **fields: Any) -> Answer:
        """Call a service and show the answer."""
        return await self.do(self.dispatcher.call(self.page, service, **fields))

    async def start(self, action: str, **fields: Any) -> Answer:
        """Start an action and show the answer."""
        return await self.do(self.dispatcher.start(self.page, action, **fields))

    async def agreed(self, what: str) -> bool:
        """Ask before something is done inside a stiffness campaign; true at once outside of one.

        Args:
            what: that would be done, as a sentence's subject.
        """
        _, state = self.dispatcher.latest.state()
        if not (state.get("campaign") or {}).get("active"):
            return True
        with ui.dialog() as dialog, ui.card().props("role=alertdialog data-name=question"):
            ui.label(f"A stiffness campaign is under way. {what} disturbs or ends it. Do it?")
            with ui.row():
                yes = ui.button(
                    "Do it", on_click=lambda: dialog.submit(True), color="deep-orange-9"
                )
                yes.props("unelevated data-name=question-yes")
                no = ui.button("Leave it", on_click=lambda: dialog.submit(False))
                no.props("unelevated autofocus data-name=question-no")
        try:
            return await dialog is True
        finally:
            dialog.delete()

    async def cancel(self, action: str) -> Answer:
        """Cancel an action and show the answer."""
        return await self.do(self.dispatcher.cancel(self.page, action))
