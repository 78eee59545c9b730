"""What was heard of each key: counts, and the newest payload."""

from dataclasses import dataclass, field

from schemas.message import MessageError
from services.inspector.header import read_header
from services.inspector.rates import KeyRate

MAX_KEYS = 4096
"""More keys than these are not told apart."""


@dataclass
class Hearing:
    """Counts by key from headers alone; keeps one payload of each."""

    rates: dict[str, KeyRate] = field(default_factory=dict)
    newest: dict[str, bytes] = field(default_factory=dict)

    def add(self, key: str, payload: bytes, received_ns: int) -> None:
        """Take in a sample."""
        if key not in self.rates and len(self.rates) >= MAX_KEYS:
            return
        try:
            header = read_header(payload)
        except MessageError:
            header = None
        self.rates.setdefault(key, KeyRate()).add(header, len(payload), received_ns)
        self.newest[key] = payload
