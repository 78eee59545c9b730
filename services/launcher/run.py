"""`encircle run`: start everything, watch it, sum it up, leave nothing behind."""

import shutil
import signal
import time

from rich.console import Console
from rich.live import Live

from services.launcher.board import Board
from services.launcher.errors import ChildFailedError
from services.launcher.extras import check_extras, lacking_for_viewer
from services.launcher.page import Page
from services.launcher.plan_command import refuse_infeasible
from services.launcher.ports import router_endpoint
from services.launcher.processes import WATCHERS, ProcessSpec, process_table
from services.launcher.record import record_line
from services.launcher.report import Record, Run, report
from services.launcher.results import Results
from services.launcher.settings import RunSettings
from services.launcher.status_table import headline, table
from services.launcher.steering import Steering
from services.launcher.supervisor import Crash, Supervisor
from services.launcher.warm_up import warm_up
from services.launcher.watch import Watch
from services.launcher.watchdog import FROZEN_AFTER_S, Watchdog
from services.runtime.bus import Bus
from services.runtime.errors import RuntimeFault
from services.runtime.settings import BusSettings

_POLL_S = 0.1
_SCREEN_PERIOD_S = 0.25
_LINE_PERIOD_S = 2.0
_SAVE_TIMEOUT_S = 20.0
_VITAL = ("router", "simulator", "planner", "mapper")
"""Without these nothing flows; once it has begun, a run goes on without a camera or evaluator."""
EXIT_INTERRUPTED = 130


class Interrupt:
    """Set by Ctrl-C or SIGTERM; a second one stops at once."""

    def __init__(self) -> None:
        self.is_set = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._handle())

    def _handle(self) -> None:
        if self.is_set:
            raise KeyboardInterrupt
        self.is_set = True


def run(settings: RunSettings, console: Console) -> int:
    """Run the whole chain.

    Returns:
        The exit code: 0, or 130 when it was interrupted before its end.

    Raises:
        SettingsError: If the formation is infeasible.
        LauncherError: If something is missing or a vital process cannot be kept alive.
    """
    check_extras(settings)
    if settings.viewer and (lacking := lacking_for_viewer()):
        console.print(
            f"no viewer: {', '.join(lacking)} not installed; pip install 'encircle[viewer]'",
            markup=False,
        )
        settings = settings.model_copy(update={"viewer": False})
    refuse_infeasible(settings)
    results = Results.create(settings)
    warm_up(console.print)
    interrupt = Interrupt()
    endpoint = router_endpoint(settings.port)

    def table_of(cameras: int) -> dict[str, ProcessSpec]:
        changed = settings.model_copy(update={"cameras": cameras})
        table = process_table(changed, endpoint, results.folder.resolve())
        return {spec.name: spec for spec in table}

    specs = tuple(table_of(settings.cameras).values())
    record = Record(settings.cameras)
    console.print(f"{len(specs)} processes, router at {endpoint}, logs in {results.logs}")
    with Supervisor(specs, results.logs) as supervisor:
        began_ns = time.time_ns()
        supervisor.start()
        board = Board(supervisor.children, settings.num_ticks, record)
        bus_settings = BusSettings(connect=endpoint, shm_pool_mib=0)
        with (
            Bus(bus_settings, "launcher") as bus,
            Watch(bus, board) as watch,
            Steering(table_of, supervisor, board, bus) as steering,
        ):
            _follow(settings, console, supervisor, board, bus, watch, steering, interrupt)
            _save_map(bus, results, console)
            if settings.record is not None:
                console.print(record_line(bus), markup=False)
        restarts = supervisor.restarts
    span_ns = record.span_ns
    known = Run(
        mode=settings.mode,
        seed=settings.seed,
        dt_s=settings.dt_s,
        voxel_size_m=settings.voxel_size,
        wall_s=(span_ns[1] - span_ns[0]) * 1e-9 if span_ns else 0.0,
        startup_s=(span_ns[0] - began_ns) * 1e-9 if span_ns else None,
        restarts=restarts,
    )
    results.write(record, report(record, known), console)
    return EXIT_INTERRUPTED if interrupt.is_set and not settings.forever else 0


def _follow(
    settings: RunSettings,
    console: Console,
    supervisor: Supervisor,
    board: Board,
    bus: Bus,
    watch: Watch,
    steering: Steering,
    interrupt: Interrupt,
) -> None:
    """Watch until the run is over, and do what is asked."""
    live = not settings.headless and console.is_terminal
    period_s = _SCREEN_PERIOD_S if live else _LINE_PERIOD_S
    page, watchdog = Page(bus, board, console.print), Watchdog(board)
    due_s = time.monotonic()
    with Live(console=console, auto_refresh=False, transient=False) as screen:
        while not board.finished and not interrupt.is_set:
            for crash in supervisor.poll():
                _tell(crash, console, starting=board.summary is None)
            for name in watchdog.frozen(time.monotonic()):
                console.print(
                    f"{name} has said nothing for {FROZEN_AFTER_S:g} s; ending it",
                    style="red",
                    markup=False,
                )
                supervisor.kill(name)
            watch.update(_POLL_S)
            steering.tend()
            page.tell()
            if board.all_heard:
                bus.presence.announce()  # Tick 0 waits for us: no instant passes unseen.
            now_s = time.monotonic()
            if now_s < due_s:
                continue
            due_s = now_s + period_s
            if live:
                screen.update(table(board, now_s), refresh=True)
            else:
                missing = board.missing(now_s)
                console.print(f"{headline(board)}{f'  ({missing})' if missing else ''}")


def _tell(crash: Crash, console: Console, *, starting: bool) -> None:
    console.print(f"{crash}; its last lines:\n{crash.log_tail}", style="red", markup=False)
    # The start waits for all who do not only watch: without one it would wait for ever.
    service = crash.name.partition("/")[0]
    if crash.given_up and service not in WATCHERS and (starting or service in _VITAL):
        raise ChildFailedError(f"{crash.name} cannot be kept alive; the run needs it")


def _save_map(bus: Bus, results: "Results", console: Console) -> None:
    for name, wanted in results.maps.items():
        try:
            bus.request("mapper", "save", {"path": name}, timeout_s=_SAVE_TIMEOUT_S)
            if wanted is not None:
                shutil.move(results.folder / name, wanted)
        except (RuntimeFault, OSError) as error:
            console.print(f"the map was not saved: {error}", style="red", markup=False)
