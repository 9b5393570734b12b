# SPDX-License-Identifier: Apache-2.0
"""Operating the rig itself: modes, recording, robot and tracker, single limbs."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from nicegui import ui

from cabols_control.console.latest import WARNING
from cabols_control.naming import configuration_name, limb_name, reflector_name
from cabols_control.supervision.modes import OperatingMode

if TYPE_CHECKING:
    from cabols_control.console.panels.context import PageContext

ASKED = (
    (OperatingMode.FREE_MOVING, "Free-move"),
    (OperatingMode.PRETIGHTENING, "Pre-tighten"),
    (OperatingMode.LOADING, "Load"),
    (OperatingMode.STOPPED, "Stop (unload)"),
)
ROBOT_MODES = (OperatingMode.STOPPED, OperatingMode.FREE_MOVING)


def button(text: str, on_click: Any, name: str, colour: str = "blue-grey-8") -> ui.button:
    """Make a button in the page's style.

    Args:
        text: on it.
        on_click: NiceGUI's handler, plain or a coroutine, with or without the event.
        name: its attribute data-name, by which tests and scripts find it.
        colour: Quasar's name of it.
    """
    made = ui.button(text, on_click=on_click, color=colour)
    made.props(f"unelevated dense padding='8px 10px' data-name={name}")
    return made


def chooser(
    options: dict[int, str], label: str, text: str, on_click: Any, name: str
) -> tuple[ui.select, ui.button]:
    """Make a choice and, beside it, the button that acts on it.

    Args:
        options: what is shown, by value; 0 is chosen at first, so it must be one.
        label: of the choice.
        text: on the button.
        on_click: handler of the button.
        name: of the button, see `button`.
    """
    with ui.row().classes("items-center no-wrap full-width rowed").style("margin-top:6px"):
        choice = ui.select(options, value=0, label=label).style("flex:1")
        choice.props("dense outlined options-dense")
        return choice, button(text, on_click, name, "cyan-9")


COMMAND = "Take command first."
BUSY = "It is under way."
Condition = tuple[Any, str]
"""What must hold, and what is said where it does not."""


def enable(element: Any, *conditions: Condition) -> None:
    """Enable an element if all conditions hold; otherwise disable it and say which does not.

    Nothing is sent to the page if nothing changes.

    Args:
        element: a button, or another control.
        conditions: in the order in which they are looked at.
    """
    if getattr(element, "conditions", None) != conditions:
        element.conditions = conditions
        element._props["title"] = next((told for holds, told in conditions if not holds), "")
        element.update()
    enabled = all(holds for holds, _ in conditions)
    if element.enabled != enabled:
        element.set_enabled(enabled)


def mode_of(state: dict[str, Any]) -> dict[str, Any]:
    """Return the mode's part of the state."""
    found: dict[str, Any] = state.get("mode") or {"number": -1, "name": "", "next": []}
    return found


def activity(state: dict[str, Any], action: str) -> dict[str, Any]:
    """Return an action's part of the state.

    Args:
        state: of the rig, as LatestValues.state returns it.
        action: its name.

    Returns:
        busy, progress (0 to 1) and text; empty if this console has not started it yet.
    """
    found: dict[str, Any] = (state.get("activities") or {}).get(action) or {}
    return found


class ModePanel:
    """Modes, reset, tare, recording."""

    def __init__(self, own: PageContext) -> None:
        """Build."""
        self._own = own
        ui.html("<h2>Rig</h2>", sanitize=False)
        self._modes = {}
        with ui.element("div").classes("modes"):
            for mode, text in ASKED:
                colour = "cyan-9" if mode != OperatingMode.STOPPED else "blue-grey-7"
                self._modes[mode] = button(
                    text,
                    lambda m=mode: self._ask_mode(m),
                    f"mode-{mode.name}",
                    colour,
                )
            self._tare = button("Tare sensor", self._ask_tare, "tare")
            self._reset = button("Reset fault", lambda: own.call("reset"), "reset", "deep-orange-9")
            self._record = button("Start recording", self._toggle_recording, "record")
            self._record.style("grid-column: 1 / -1")
        ui.html(
            '<div id="recording-text" class="hint" style="margin-top:6px"></div>', sanitize=False
        )
        self._recording = False

    async def _ask_mode(self, mode: OperatingMode) -> None:
        # A stop is not held up by a question.
        if mode == OperatingMode.STOPPED or await self._own.agreed(f"Mode {mode.name}"):
            await self._own.call("set_mode", mode=int(mode))

    async def _ask_tare(self) -> None:
        if await self._own.agreed("A tare of the sensor"):
            await self._own.call("tare")

    async def _toggle_recording(self) -> None:
        await self._own.call("record", data=not self._recording)

    def refresh(self, state: dict[str, Any], commanding: bool) -> None:
        """Show a new state, and enable what may be done in it.

        Args:
            state: of the rig, as LatestValues.state returns it.
            commanding: whether this page is in command.
        """
        mode, command = mode_of(state), (commanding, COMMAND)
        for wanted, made in self._modes.items():
            told = f"Not after {mode['name']}." if mode["name"] else "No mode arrives."
            enable(made, command, (int(wanted) in mode["next"], told))
        enable(self._tare, command, (mode["name"] == "STOPPED", "Only in Stopped."))
        enable(self._reset, command, (mode["name"] == "FAULT", "There is no fault to reset."))
        self._recording = bool(state.get("recording"))
        self._record.text = "Stop recording" if self._recording else "Start recording"
        enable(self._record, command, (state.get("recording") is not None, "No recorder runs."))


class RobotPanel:
    """Moving the robot to a stored configuration, measuring a reflector."""

    def __init__(self, own: PageContext) -> None:
        """Build."""
        self._own = own
        count = own.dispatcher.settings.configurations
        reflectors = len(own.dispatcher.settings.scene["reflectors"])
        places = {i: configuration_name(i).capitalize() for i in range(count)}
        self._index, self._move = chooser(
            places, "Stored configuration", "Move", self._do_move, "move"
        )
        self._cancel = button(
            "Stop the robot", lambda: own.cancel("move_to_configuration"), "move-cancel"
        )
        self._moved = ui.html("", sanitize=True).classes("verdict")
        targets = {i: reflector_name(i).capitalize() for i in range(reflectors)}
        self._reflector, self._measure = chooser(
            targets, "Laser tracker", "Measure", self._do_measure, "measure"
        )
        self._measured = ui.html("", sanitize=True).classes("verdict")
        ui.html(
            "The robot moves in Free-moving, and in Stopped while no cable pulls.", sanitize=True
        ).classes("hint")

    async def _do_move(self) -> None:
        if not await self._own.agreed("A motion of the robot"):
            return
        await self._own.start("move_to_configuration", index=int(self._index.value))

    async def _do_measure(self) -> None:
        if not await self._own.agreed("A measurement"):
            return
        await self._own.start(
            "measure_reflector", reflector=int(self._reflector.value), search=True
        )

    def refresh(self, state: dict[str, Any], commanding: bool) -> None:
        """Show a new state, and enable what may be done in it.

        Args:
            state: of the rig, as LatestValues.state returns it.
            commanding: whether this page is in command.
        """
        moving = activity(state, "move_to_configuration")
        allowed = mode_of(state)["number"] in [int(mode) for mode in ROBOT_MODES]
        command, busy = (commanding, COMMAND), bool(moving.get("busy"))
        where = (allowed, "Only in Stopped and Free-moving.")
        enable(self._move, command, where, (not busy, BUSY))
        enable(self._cancel, command, (busy, "No motion was started here."))
        self._moved.content = escape(moving.get("text", ""))
        measuring = activity(state, "measure_reflector")
        enable(self._measure, command, (not measuring.get("busy"), BUSY))
        self._measured.content = escape(measuring.get("text", ""))


class LimbPanel:
    """Commissioning of one limb."""

    def __init__(self, own: PageContext) -> None:
        """Build."""
        self._own = own
        cables = own.dispatcher.settings.cables
        self._limb = (
            ui.select({i: limb_name(i).capitalize() for i in range(cables)}, value=0, label="Limb")
            .props("dense outlined options-dense")
            .classes("full-width")
        )
        with ui.row().classes("full-width"):
            self._step = ui.checkbox("Step: gain, time constant", value=True).props("dense")
            self._ramp = ui.checkbox("Ramp: stiffness", value=True).props("dense")
        with ui.row().classes("full-width rowed"):
            self._start = button("Commission", self._do_start, "commission", "cyan-9")
            self._cancel = button(
                "Abort", lambda: own.cancel("commission_limb"), "commission-cancel"
            )
        self._progress = ui.linear_progress(0.0, show_value=False).props("aria-label='Progress'")
        self._text = ui.html("", sanitize=True).classes("verdict")
        ui.html(
            "Starts in Stopped. The step pays cable out and in; the ramp pre-tightens all limbs "
            "and pulls one to 150 N.",
            sanitize=True,
        ).classes("hint")

    async def _do_start(self) -> None:
        if not (self._step.value or self._ramp.value):
            refusal = "commissioning: choose step or ramp"
            self._own.dispatcher.latest.tell(WARNING, "console", refusal)
        if not await self._own.agreed("Commissioning"):
            return
        await self._own.start(
            "commission_limb",
            limb=int(self._limb.value),
            step=bool(self._step.value),
            ramp=bool(self._ramp.value),
        )

    def refresh(self, state: dict[str, Any], commanding: bool) -> None:
        """Show a new state, and enable what may be done in it.

        Args:
            state: of the rig, as LatestValues.state returns it.
            commanding: whether this page is in command.
        """
        doing = activity(state, "commission_limb")
        busy = bool(doing.get("busy"))
        command = (commanding, COMMAND)
        rests = (mode_of(state)["name"] == "STOPPED", "Only in Stopped.")
        enable(self._start, command, (not busy, BUSY), rests)
        enable(self._cancel, command, (busy, "Nothing is under way."))
        self._progress.value = doing.get("progress", 0.0)
        self._text.content = escape(doing.get("text", ""))
