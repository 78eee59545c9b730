"""The folder "Replay": there while a recording is played."""

import time
from typing import TYPE_CHECKING, Any

from services.viewer.controls import Reports, number
from services.viewer.web_panel import Ask, notify

if TYPE_CHECKING:
    import viser

_SERVICE = "replay"
_HOLD_S = 1.5


class WebReplay:
    """Pause, resume, seek and rate of a recording; shows what the replay reports."""

    def __init__(self, server: "viser.ViserServer", ask: Ask) -> None:
        self._ask = ask
        self._touched_s = -_HOLD_S
        self._folder = server.gui.add_folder("Replay", order=15, visible=False)
        with self._folder:
            self._said: Any = server.gui.add_markdown("")
            pause = server.gui.add_button("Pause replay")
            resume = server.gui.add_button("Resume replay")
            self._position: Any = server.gui.add_slider(
                "Position (s)", min=0.0, max=1.0, step=0.1, initial_value=0.0
            )
            self._rate: Any = server.gui.add_number(
                "Replay rate", 1.0, min=0.05, max=100.0, step=0.05, hint="1 is as it was recorded."
            )

        async def on_pause(event: Any) -> None:  # In turn: viser's threads overtake one another.
            self._send("pause", {}, event)

        async def on_resume(event: Any) -> None:
            self._send("resume", {}, event)

        pause.on_click(on_pause)
        resume.on_click(on_resume)
        self._position.on_update(lambda event: self._changed("seek", "t_s", event))
        self._rate.on_update(lambda event: self._changed("set", "rate", event))

    def draw(self, reports: Reports) -> None:
        """Show the folder while a replay answers."""
        report = reports.get(_SERVICE)
        self._folder.visible = report is not None
        if report is None:
            return
        duration_s = max(0.1, round(number(report.get("duration_s")) or 0.0, 1))
        t_s = number(report.get("position_s")) or 0.0
        self._said.content = f"{report.get('state', '')}, {t_s:.1f} of {duration_s:.1f} s"
        if self._position.max != duration_s:
            self._position.max = duration_s
        if time.monotonic() - self._touched_s >= _HOLD_S:
            self._position.value = min(max(0.0, t_s), duration_s)
            self._rate.value = number(report.get("rate")) or 1.0

    def _changed(self, verb: str, parameter: str, event: Any) -> None:
        if event.client is not None:
            self._touched_s = time.monotonic()
            self._send(verb, {parameter: float(event.target.value)}, event)

    def _send(self, verb: str, params: dict[str, Any], event: Any) -> None:
        self._ask(_SERVICE, verb, params, lambda *said: notify(event.client, *said))
