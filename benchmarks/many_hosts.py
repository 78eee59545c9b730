"""A ring of cameras on several computers: what it makes of a bad link, and of one that is cut.

Router, simulator and planner on one host, three cameras on two others, mapper and evaluator on a
fourth: network namespaces, between which a wire delays, loses and limits what each host sends. The
first ring, of small images, has certificates (mTLS on every link); the second, of large ones, asks
for twice what the link carries. Beside it: what one TCP stream alone makes of the same link.
Ages are from the first shutter of an instant to its map; the hosts have one clock. Linux, root.

    python benchmarks/many_hosts.py [--seconds 10] [--tcp reno] [--json FILE]
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from hosts_ring import CAMERAS, HOSTS, RATE_HZ, HostsRing, certify, hosts_ring
from machine import describe
from wire import DESK, PERFECT, Quality, Wire, lacking

LINK = Quality(delay_s=0.02, loss=0.01, rate_bit_s=50e6)
CUT_S = 10.0
SETTLE_S = 3.0
RELEARN_S = 12.0
"""After a link has changed: BBR holds on to the round trip that it knew for ten seconds."""
PATIENCE_S = 120.0
SMALL, LARGE = "320x240", "640x480"
_CONTROL = Path("/proc/sys/net/ipv4/tcp_congestion_control")
_OTHERS = tuple(name for name in HOSTS if name != DESK)


@dataclass(frozen=True)
class Flow:
    """A time in which nothing was changed."""

    what: str
    instants_hz: float
    cameras_hz: tuple[float, ...]
    """Clouds of each camera that are in the map."""
    age_p50_ms: float
    age_p95_ms: float
    later_p50_ms: float
    """Of the second half: what queues grows older."""
    left_mbit_s: float
    """What the host with two cameras sent."""


@dataclass(frozen=True)
class Cut:
    """A host that was cut off for a while."""

    host: str
    meanwhile_hz: float
    """Instants of the map, heard at the desk, while it was."""
    again_s: float
    """From when the link was back to the first instant with all cameras."""


def flow(ring: HostsRing, what: str, seconds: float) -> Flow:
    """Listen for a while."""
    begun_s, sent = time.monotonic(), ring.wire.counts["left"].octets
    time.sleep(seconds)
    told = ring.desk.since(begun_s)
    ages_ms = np.array([each.latency_ms for each in told]) if told else np.array([np.inf])
    p50, p95 = np.percentile(ages_ms, (50, 95))
    found = Flow(
        what=what,
        instants_hz=len(told) / seconds,
        cameras_hz=tuple(sum(c in each.used for each in told) / seconds for c in CAMERAS),
        age_p50_ms=float(p50),
        age_p95_ms=float(p95),
        later_p50_ms=float(np.median(ages_ms[len(ages_ms) // 2 :])),
        left_mbit_s=8e-6 * (ring.wire.counts["left"].octets - sent) / seconds,
    )
    rates = " ".join(f"{rate:5.1f}" for rate in found.cameras_hz)
    print(
        f"{what:44}{found.instants_hz:6.1f}  {rates}{p50:8.0f}{p95:7.0f}{found.left_mbit_s:8.1f}",
        flush=True,
    )
    return found


def cut(ring: HostsRing, host: str) -> Cut:
    """Cut a host off, and let it back."""
    ring.wire.cut(host)
    begun_s = time.monotonic()
    time.sleep(CUT_S)
    meanwhile_hz = len(ring.desk.since(begun_s)) / CUT_S
    ring.wire.cut()
    back_s = time.monotonic()
    again = ring.desk.wait(lambda: ring.desk.first_whole(back_s), PATIENCE_S, f"{host} is back")
    found = Cut(host, meanwhile_hz, again.heard_s - back_s)
    print(
        f"{host} cut off for {CUT_S:g} s: {meanwhile_hz:.1f} instants/s meanwhile, all cameras "
        f"again {found.again_s:.1f} s after",
        flush=True,
    )
    return found


def set_link(ring: HostsRing, quality: Quality) -> None:
    """Give every host but ours the same link, and let what is under way arrive."""
    ring.wire.set(dict.fromkeys(_OTHERS, quality))
    time.sleep(RELEARN_S)


def begun(ring: HostsRing) -> None:
    """Wait for the first whole instant.

    Raises:
        TimeoutError: If there is none; what the services said stands in it.
    """
    try:
        ring.desk.wait(lambda: ring.desk.first_whole(0.0), PATIENCE_S, "the first instant")
    except TimeoutError as error:
        raise TimeoutError(f"{error}\n{ring.said()}") from error
    time.sleep(SETTLE_S)


def trials(seconds: float, tcp: str) -> Iterator[Flow | Cut]:
    """Run both rings."""
    print(f"{'':44}{'maps/s':>6}  {'cameras, clouds/s':17}{'age p50':>8}{'p95':>7}{'Mbit/s':>8}")
    with tempfile.TemporaryDirectory() as folder:
        certs = certify(Path(folder))
        with hosts_ring(SMALL, certs=certs, tcp=tcp) as ring:
            begun(ring)
            yield flow(ring, f"{SMALL}, mTLS, a perfect link", seconds)
            set_link(ring, LINK)
            yield flow(ring, f"{SMALL}, mTLS, {_words(LINK)}", seconds)
            for host in ("left", "maps", "base"):
                yield cut(ring, host)
            time.sleep(SETTLE_S)
            yield flow(ring, f"{SMALL}, mTLS, after the cuts", seconds)
    with hosts_ring(LARGE, tcp=tcp) as ring:
        begun(ring)
        yield flow(ring, f"{LARGE}, a perfect link", seconds)
        set_link(ring, LINK)
        yield flow(ring, f"{LARGE}, {_words(LINK)}", 2 * seconds)
        set_link(ring, PERFECT)
        yield flow(ring, f"{LARGE}, perfect again", seconds)


def one_stream_mbit_s(tcp: str, seconds: float = 5.0) -> float:
    """Return what a single TCP stream makes of the link, nothing else running."""
    receive = (
        "import socket; s, _ = socket.create_server(('0.0.0.0', 5000)).accept(); n = 0\n"
        "while d := s.recv(1 << 20): n += len(d)\nprint(n)"
    )
    send = (
        "import socket, sys, time; end = time.time() + float(sys.argv[2])\n"
        "while True:\n"
        "    try: s = socket.create_connection((sys.argv[1], 5000)); break\n"
        "    except OSError: time.sleep(0.05)\n"
        "while time.time() < end: s.send(bytes(65536))"
    )
    with tempfile.TemporaryDirectory() as folder, Wire(HOSTS, Path(folder), tcp=tcp) as wire:
        wire.set(dict.fromkeys(_OTHERS, LINK))
        receiver = subprocess.Popen(
            wire.hosts["maps"].command(sys.executable, "-c", receive), stdout=subprocess.PIPE
        )
        words = (sys.executable, "-c", send, wire.hosts["maps"].address, str(seconds))
        subprocess.run(wire.hosts["left"].command(*words), check=True)
        arrived, _ = receiver.communicate(timeout=60)
    return 8e-6 * int(arrived) / seconds


def _words(link: Quality) -> str:
    return f"{link.delay_s * 1e3:g} ms, {link.loss:.0%} loss, {link.rate_bit_s / 1e6:g} Mbit/s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument(
        "--tcp", default="", help="congestion control, e.g. reno; the kernel's own if not"
    )
    parser.add_argument("--json", type=Path, help="also write the figures here")
    asked = parser.parse_args()
    if reason := lacking():
        sys.exit(reason)
    print(describe("eclipse-zenoh"))
    alone = one_stream_mbit_s(asked.tcp)
    control = asked.tcp or _CONTROL.read_text().strip()
    print(f"TCP {control}; one stream alone on {_words(LINK)}: {alone:.1f} Mbit/s")
    print(f"{RATE_HZ:g} instants/s are asked for")
    done = list(trials(asked.seconds, asked.tcp))
    if asked.json:
        told = {
            "alone_mbit_s": alone,
            "flows": [asdict(each) for each in done if isinstance(each, Flow)],
            "cuts": [asdict(each) for each in done if isinstance(each, Cut)],
        }
        asked.json.write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
