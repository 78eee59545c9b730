"""One log format for all services: time, level, who, what."""

import logging
import sys
import time

import zenoh

_ZENOH = "error,zenoh_link_tls=warn"
"""Of zenoh's own log: whoever was turned away for its certificate is news. RUST_LOG overrides."""


def start_logging(address: str, level: str) -> None:
    """Send this process's log to stderr, one line per event, UTC.

    Args:
        address: `service[/instance]`, printed in every line.
        level: Least severe level, e.g. `info`.
    """
    zenoh.init_log_from_env_or(_ZENOH)
    line = f"%(asctime)s.%(msecs)03dZ %(levelname)-7s {address:<11} %(message)s"
    formatter = logging.Formatter(line, datefmt="%Y-%m-%dT%H:%M:%S")
    formatter.converter = time.gmtime
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter)
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
