"""A network of a few hosts on one machine: a wire of known delay, loss and rate between them.

Each host is a network namespace with one interface, a TUN device; what is sent there comes to us as
packets, and we hand each to the host it is for, when and if the wire would have. That is what tc's
netem does in the kernel, where the kernel has it; ours can be cut, and needs no module. Linux and
root only.
"""

import contextlib
import fcntl
import heapq
import os
import random
import select
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_MTU = 1500
_DESTINATION = slice(16, 20)  # Of an IPv4 header.
_IDLE_S = 0.2
_MOST_AT_ONCE = 64
SUBNET = "10.77.0"
DESK = "desk"


def lacking() -> str:
    """Return what hosts of our own cannot be made without, in words; empty if nothing lacks."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if not Path("/dev/net/tun").exists():
        return "no /dev/net/tun on this machine"
    for command in (("ip", "-V"), ("unshare", "--version")):
        try:
            subprocess.run(command, capture_output=True, check=True)
        except (OSError, subprocess.CalledProcessError):
            return f"no {command[0]} on this machine"
    return ""


@dataclass(frozen=True)
class Quality:
    """What becomes of the packets that a host sends."""

    delay_s: float = 0.0
    loss: float = 0.0
    """Share of the packets that never come."""
    rate_bit_s: float = 1e9
    queue_s: float = 0.1
    """How far a host may send ahead of the rate; what comes then is dropped (drop tail)."""


PERFECT = Quality()


@dataclass
class Count:
    """What a host has sent."""

    packets: int = 0
    octets: int = 0
    lost: int = 0
    """By the wire's loss."""
    dropped: int = 0
    """Because its queue was full, or the wire cut."""


class Host:
    """A namespace: a network, name and shared memory of its own; the desk is where we are."""

    def __init__(
        self, name: str, number: int, folder: Path, tcp: str, *, is_desk: bool = False
    ) -> None:
        self.name, self.address = name, f"{SUBNET}.{number}"
        self._namespace = None if is_desk else f"encircle-{os.getpid()}-{number}"
        self._shared = folder / f"shm-{name}"
        self._shared.mkdir()
        device = f"enc{os.getpid() % 100000}-{number}"
        self.tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(
            self.tun, _TUNSETIFF, struct.pack("16sH", device.encode(), _IFF_TUN | _IFF_NO_PI)
        )
        there: tuple[str, ...] = ()
        if self._namespace is not None:
            _ip("netns", "add", self._namespace)
            _ip("link", "set", device, "netns", self._namespace)
            there = ("-netns", self._namespace)
            _ip(*there, "link", "set", "lo", "up")
            if tcp:
                script = f"echo {tcp} > /proc/sys/net/ipv4/tcp_congestion_control"
                _ip("netns", "exec", self._namespace, "sh", "-c", script)
        _ip(*there, "address", "add", f"{self.address}/24", "dev", device)
        _ip(*there, "link", "set", device, "mtu", str(_MTU), "up")

    def command(self, *argv: str) -> list[str]:
        """Return the command that runs another here."""
        if self._namespace is None:
            return list(argv)
        # On two machines nothing lies in a memory that both see; neither does it here.
        script = f'hostname {self.name}; mount --bind {self._shared} /dev/shm; exec "$@"'
        inside = ("unshare", "--uts", "sh", "-c", script, "sh", *argv)
        return ["ip", "netns", "exec", self._namespace, *inside]

    def close(self) -> None:
        """Leave nothing behind."""
        os.close(self.tun)
        if self._namespace is not None:
            _ip("netns", "delete", self._namespace)


class Wire:
    """Hosts and what is between them, on a thread of its own; `with` makes and removes them.

    Args:
        names: of the hosts; `desk` is where the caller itself is.
        folder: where their shared memories lie. seed: of the loss.
        tcp: the congestion control of all but the desk; this machine's own if empty.
    """

    def __init__(self, names: tuple[str, ...], folder: Path, seed: int = 0, tcp: str = "") -> None:
        self._names, self._folder, self._tcp = names, folder, tcp
        self._qualities = dict.fromkeys(names, PERFECT)
        self._cut: set[str] = set()
        self._rng = random.Random(seed)
        self._thread = threading.Thread(target=self._run, name="wire", daemon=True)
        self._stopped = threading.Event()
        self.hosts: dict[str, Host] = {}
        self.counts = {name: Count() for name in names}

    def __enter__(self) -> Self:
        try:
            for number, name in enumerate(self._names, 1):
                self.hosts[name] = Host(name, number, self._folder, self._tcp, is_desk=name == DESK)
        except BaseException:
            self._remove()
            raise
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()
        self._remove()

    def set(self, qualities: Mapping[str, Quality]) -> None:
        """Change what becomes of what the named hosts send."""
        self._qualities = self._qualities | dict(qualities)

    def cut(self, *names: str) -> None:
        """Let nothing pass to or from these hosts, and everything to and from all others."""
        self._cut = set(names)

    def _remove(self) -> None:
        for host in self.hosts.values():
            with contextlib.suppress(subprocess.CalledProcessError):
                host.close()
        self.hosts.clear()

    def _run(self) -> None:
        owners = {host.tun: host for host in self.hosts.values()}
        ways = {socket.inet_aton(host.address): host for host in self.hosts.values()}
        free_s = dict.fromkeys(self._names, 0.0)  # When a host's sender is done with its queue.
        due: list[tuple[float, int, Host, bytes]] = []
        poller = select.epoll()
        for tun in owners:
            poller.register(tun, select.EPOLLIN)
        number = 0
        while not self._stopped.is_set():
            wait_s = min(_IDLE_S, max(0.0, due[0][0] - time.monotonic())) if due else _IDLE_S
            for tun, _ in poller.poll(wait_s):
                sender = owners[tun]
                for packet in _packets(tun):
                    if (receiver := ways.get(packet[_DESTINATION])) is None:
                        continue  # IPv6's and multicast's greetings.
                    arrives_s = self._passes(sender.name, receiver.name, len(packet), free_s)
                    if arrives_s is not None:
                        heapq.heappush(due, (arrives_s, number, receiver, packet))
                        number += 1
            now_s = time.monotonic()
            while due and due[0][0] <= now_s:
                _, _, receiver, packet = heapq.heappop(due)
                try:
                    os.write(receiver.tun, packet)
                except OSError:
                    self.counts[receiver.name].dropped += 1
        poller.close()

    def _passes(
        self, sender: str, receiver: str, num_octets: int, free_s: dict[str, float]
    ) -> float | None:
        """Return when a packet arrives; None if it does not."""
        quality, count, now_s = self._qualities[sender], self.counts[sender], time.monotonic()
        count.packets, count.octets = count.packets + 1, count.octets + num_octets
        begins_s = max(now_s, free_s[sender])
        if {sender, receiver} & self._cut or begins_s > now_s + quality.queue_s:
            count.dropped += 1
            return None
        free_s[sender] = begins_s + 8 * num_octets / quality.rate_bit_s
        if self._rng.random() < quality.loss:
            count.lost += 1
            return None
        return free_s[sender] + quality.delay_s


def _packets(tun: int) -> list[bytes]:
    """Return what waits on a device, a bounded number at a time so that nobody starves."""
    found: list[bytes] = []
    with contextlib.suppress(OSError):
        while len(found) < _MOST_AT_ONCE:
            found.append(os.read(tun, _MTU))
    return found


def _ip(*words: str) -> None:
    subprocess.run(("ip", *words), check=True, capture_output=True)
