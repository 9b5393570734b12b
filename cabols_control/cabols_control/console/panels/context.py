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

    async def cancel(self, action: str) -> Answer:
        """Cancel an action and show the answer."""
        return await self.do(self.dispatcher.cancel(self.page, action))
