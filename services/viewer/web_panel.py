"""The panel's controls: they show what services report, and pass on what the user wants."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from services.viewer.controls import CLOCK_VERBS, CONTROLS, Choice, Control, Number, Reports

if TYPE_CHECKING:
    import viser

Ask = Callable[[str, str, dict[str, Any], Callable[[str, str], None]], None]
"""Service, verb, parameters, and who is told of a refusal: service and text."""

_HOLD_S = 1.5
"""So long after the user's touch a control keeps his value: the report may still be the old one."""
_NOTICE_S = 12.0


class WebPanel:
    """Status and the folder "Control"."""

    def __init__(self, server: "viser.ViserServer", ask: Ask) -> None:
        self._gui, self._ask = server.gui, ask
        self._reports: Reports = {}
        self._touched_s: dict[str, float] = {}
        self._status = server.gui.add_markdown("Waiting for the first message.", order=0)
        with server.gui.add_folder("Control", order=10):
            clock = server.gui.add_button_group("Clock", CLOCK_VERBS)
            clock.on_click(self._on_clock)
            self._inputs = {control.label: self._input(control) for control in CONTROLS}

    def draw(self, reports: Reports, line: str, notices: list[str]) -> None:
        """Show what is reported and what is missing."""
        self._reports = reports
        told = "\n".join(f"- {notice}" for notice in notices) or "Everything flows."
        self._status.content = f"**{line}**\n\n{told}" if line else told
        for control in CONTROLS:
            self._show(control)

    def _show(self, control: Control) -> None:
        handle = self._inputs[control.label]
        value = control.shown(self._reports)
        handle.disabled, handle.visible = value is None, value is not None
        if value is None or self._held(control.label):
            return
        if isinstance(control.kind, Choice):
            options = control.kind.choices
            if value not in options:
                options = (*options, str(value))
            if handle.options != options:
                handle.options = options
        handle.value = value

    def _held(self, label: str) -> bool:
        return time.monotonic() - self._touched_s.get(label, -_HOLD_S) < _HOLD_S

    def _input(self, control: Control) -> Any:
        match control.kind:
            case Number(minimum, maximum, step):
                whole = step >= 1
                handle: Any = self._gui.add_number(
                    control.label,
                    int(minimum) if whole else minimum,
                    min=int(minimum) if whole else minimum,
                    max=int(maximum) if whole else maximum,
                    step=int(step) if whole else step,
                    disabled=True,
                    hint=control.hint,
                )
            case Choice(choices):
                handle = self._gui.add_dropdown(
                    control.label, choices, disabled=True, hint=control.hint
                )

        async def on_update(event: Any) -> None:
            self._on_update(control, event)

        handle.on_update(on_update)
        return handle

    def _on_update(self, control: Control, event: Any) -> None:
        if event.client is None:
            return  # It was us who showed a report.
        try:
            request = control.request(event.target.value, self._reports)
        except ValueError as error:
            notify(event.client, control.label, str(error))
            return
        self._touched_s[control.label] = time.monotonic()
        if request is not None:
            self._ask(request[0], "set", request[1], lambda *said: notify(event.client, *said))

    async def _on_clock(self, event: Any) -> None:
        # Not on viser's pool of threads: there, clicks would overtake one another.
        verb = str(event.target.value).lower()
        self._ask("simulator", verb, {}, lambda *said: notify(event.client, *said))


def notify(client: Any, service: str, text: str) -> None:
    """Show a refusal to the one who asked."""
    if client is not None:
        client.add_notification(
            f"{service} refused", text, color="red", auto_close_seconds=_NOTICE_S
        )
