"""Shared memory for large payloads; when there is none, the network carries them."""

import logging

import zenoh

from schemas.codec import Encoded
from services.runtime.estate import Will

logger = logging.getLogger(__name__)

MIN_BYTES = 16 << 10  # Below this a copy through the socket costs no more than the segment.
_MIB = 1 << 20
_POLICY = zenoh.shm.GarbageCollect()  # Free what readers have let go; never wait for a slow one.


class SharedPool:
    """A pool of shared memory that `Bus` writes payloads into.

    zenoh locks its segments in memory, so a pool above the process's memlock limit cannot be
    had; we take the largest that fits and say which. Opened at the first large payload: most
    services never send one.
    """

    def __init__(self, size_mib: int) -> None:
        self._wanted_mib = size_mib
        self._provider: zenoh.shm.ShmProvider | None = None
        self._will: Will | None = None
        self._opened = False
        self.used = 0
        self.missed = 0

    @property
    def in_use(self) -> bool | None:
        """Whether payloads went by shared memory; None before the first large one."""
        return None if not self.used + self.missed else self.used > 0

    def wrap(self, encoded: Encoded) -> zenoh.shm.ZShmMut | None:
        """Copy a payload into shared memory; None when it is small or no room is to be had."""
        if len(encoded) < MIN_BYTES or not self._wanted_mib:
            return None
        if not self._opened:
            self._open()
        if self._provider is None:
            self.missed += 1
            return None
        header, body = encoded.header, encoded.body
        chunk = _alloc(self._provider, len(encoded))
        if chunk is None:
            self.missed += 1
            return None
        chunk[: len(header)] = header
        # zenoh takes bytes and bytearray here, and nothing else with a buffer.
        chunk[len(header) : len(encoded)] = bytes(body) if isinstance(body, memoryview) else body
        self.used += 1
        return chunk

    def _open(self) -> None:
        self._opened = True
        will = Will()
        size_mib = self._wanted_mib
        while size_mib:
            try:
                self._provider = zenoh.shm.ShmProvider.default_backend(size_mib * _MIB)
            except zenoh.ZError as error:
                logger.info("no shared pool of %d MiB: %s", size_mib, error)
                size_mib //= 2
                continue
            asked = self._wanted_mib
            logger.info("shared memory pool of %d MiB (asked %d MiB)", size_mib, asked)
            if will.enter(size_mib * _MIB):
                self._will = will
            return
        logger.warning("no shared memory: large payloads go over the network; check `ulimit -l`")


def _alloc(provider: zenoh.shm.ShmProvider, size: int) -> zenoh.shm.ZShmMut | None:
    try:
        return provider.alloc(size, _POLICY)
    except zenoh.ZError:
        pass
    # The holes that readers left are too small one by one: a header grows by a byte now and then.
    provider.garbage_collect()
    provider.defragment()  # type: ignore[no-untyped-call]
    try:
        return provider.alloc(size, _POLICY)
    except zenoh.ZError:
        return None
