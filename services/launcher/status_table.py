"""The board on the screen: a live table, or a line now and then."""

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from services.launcher.board import Board

MAX_ROWS = 16
"""More cameras than fit are shown as one row."""
_COLOURS = {"up": "green", "starting": "yellow", "silent": "yellow"}


def table(board: Board, now_s: float) -> RenderableType:
    """Draw the board."""
    processes = Table(box=None, header_style="dim", pad_edge=False, collapse_padding=True)
    processes.add_column("process")
    processes.add_column("state")
    for title in ("sent /s", "declared", "slowest stage", "cpu s", "MB", "lost", "bad", "restarts"):
        processes.add_column(title, justify="right")
    for name in _shown(board):
        processes.add_row(*_row(board, name, now_s))
    hidden = len(board.children) - len(_shown(board))
    if hidden:
        up = sum(board.health(name, now_s) == "up" for name in board.children)
        processes.add_row(Text(f"... {hidden} more", "dim"), Text(f"{up} of all up", "dim"))
    lines: list[RenderableType] = [processes, Text(), Text(headline(board))]
    if missing := board.missing(now_s):
        lines.append(Text(missing, "yellow"))
    return Group(*lines)


def headline(board: Board) -> str:
    """Return one line: how far, how fast, how good."""
    of = f" of {board.num_ticks}" if board.num_ticks else ""
    parts = [f"instant {board.ticks_done}{of}"]
    if (rate := board.record.perceptions_per_s) is not None:
        parts.append(f"{rate:.1f} perceptions/s")
    if board.summary is not None:
        parts.append(f"fuse {board.summary.fuse_ms:.1f} ms")
        parts.append(f"latency {board.summary.latency_ms:.0f} ms")
        if board.summary.cameras_missing:
            parts.append(f"cameras missing {len(board.summary.cameras_missing)}")
    if board.quality is not None:
        score = board.quality.stamp_true[1]
        parts.append(f"coverage {score.coverage:.1%}")
        parts.append(f"of visible {score.coverage_visible:.1%}")
        parts.append(f"precision {score.precision:.1%}")
        parts.append(f"F-score {score.f_score:.1%}")
    if restarts := sum(child.restarts for child in board.children.values()):
        parts.append(f"restarts {restarts}")
    return "  ".join(parts)


def _shown(board: Board) -> list[str]:
    return list(board.children)[:MAX_ROWS]


def _row(board: Board, name: str, now_s: float) -> list[RenderableType]:
    health = board.health(name, now_s)
    child = board.children[name]
    cells: list[RenderableType] = [name, Text(health, _COLOURS.get(health, "red"))]
    if name not in board.statuses:
        return [*cells, *[""] * 7, str(child.restarts)]
    status, stream = board.statuses[name][0], board.main_stream(name)
    stage = max(status.stages, key=lambda each: each.total_s, default=None)
    return [
        *cells,
        f"{stream.rate_hz:.1f}" if stream else "",
        f"{stream.declared_hz:.0f}" if stream else "",
        f"{stage.name} {stage.p50_ms:.1f} ms" if stage else "",
        f"{status.cpu_s:.1f}",
        f"{status.rss_bytes / 1e6:.0f}",
        str(sum(topic.lost for topic in status.topics)),
        str(status.bad_messages),
        str(child.restarts),
    ]
