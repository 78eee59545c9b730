"""What `hz`, `bw` and `delay` print of each key."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from schemas.topics import find
from services.inspector.arrays import size
from services.inspector.delays import Delays
from services.inspector.rates import KeyRate, Span
from services.inspector.tables import columns


class KeyFigures(NamedTuple):
    """All that is counted of a key."""

    key: str
    rate: KeyRate
    delays: Delays
    here: int
    """Samples that the listener itself let go."""

    @property
    def declared_hz(self) -> float:
        """Of its row; 0: none, or no row."""
        topic = find(self.key)
        return 0.0 if topic is None else topic.rate_hz


def hz_lines(figures: list[KeyFigures], now_ns: int) -> list[str]:
    """Rates: as sent, by the senders' numbers and stamps."""
    titles = ("key", "sent /s", "declared", "gap ms min", "max", "std", *_LOSS)
    return _table(titles, figures, now_ns, _hz_cells)


def bw_lines(figures: list[KeyFigures], now_ns: int) -> list[str]:
    """Bandwidths: as sent, had all messages the mean size of those that came."""
    titles = ("key", "bandwidth", "mean", "min", "max", "sent /s", *_LOSS)
    return _table(titles, figures, now_ns, _bw_cells)


def delay_lines(figures: list[KeyFigures], now_ns: int) -> list[str]:
    """Delays: from the sender's stamp to our reception, and of clouds from the shutter."""
    titles = ("key", "delay ms min", "mean", "p95", "max", "since shutter ms", *_LOSS)
    return _table(titles, figures, now_ns, _delay_cells)


_LOSS = ("lost", "dropped here", "")
Cells = Callable[[KeyFigures, Span], tuple[str, ...]]


def _table(
    titles: tuple[str, ...], figures: list[KeyFigures], now_ns: int, cells: Cells
) -> list[str]:
    rows = []
    for each in figures:
        span = each.rate.span(now_ns)
        loss = (str(max(0, each.rate.lost - each.here)), str(each.here), _remark(each, span))
        rows.append((each.key, *cells(each, span), *loss))
    return columns(titles, rows, " " + "r" * (len(titles) - 2))


def _hz_cells(each: KeyFigures, span: Span) -> tuple[str, ...]:
    declared = f"{each.declared_hz:g}" if each.declared_hz else "-"
    gaps = (span.min_gap_s, span.max_gap_s, span.std_gap_s)
    return _rate(span), declared, *(_ms(gap_s) for gap_s in gaps)


def _bw_cells(_: KeyFigures, span: Span) -> tuple[str, ...]:
    bandwidth = "-" if span.bandwidth is None else f"{size(span.bandwidth)}/s"
    sizes = (span.mean_bytes, span.min_bytes, span.max_bytes)
    return bandwidth, *(size(num) for num in sizes), _rate(span)


def _delay_cells(each: KeyFigures, _: Span) -> tuple[str, ...]:
    told = each.delays.told()
    if told is None:
        return "-", "-", "-", "-", "-"
    return (*(_ms(value) for value in told[:4]), _ms(told.shutter_s))


def _remark(each: KeyFigures, span: Span) -> str:
    remarks: Mapping[str, object] = {
        f"silent for {span.silent_s or 0:.1f} s": span.silent_s,
        f"restarted {each.rate.restarts}x": each.rate.restarts,
        f"{each.rate.unnumbered} without envelope": each.rate.unnumbered,
        "not in the topic table": find(each.key) is None,
        "several senders at once, rates are of each": each.rate.several_senders,
        "clocks differ": each.delays.clocks_differ,
    }
    return ", ".join(words for words, applies in remarks.items() if applies)


def _rate(span: Span) -> str:
    return "-" if span.rate_hz is None else f"{span.rate_hz:.2f}"


def _ms(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds * 1e3:.1f}"
