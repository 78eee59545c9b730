"""Fuse organised clouds by projecting the map into the images: each voxel once, or whole bricks.

OctoMap's update rules; free space is sampled at voxel centres over the voxel's footprint, not ray
by ray.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise, repeat
from typing import Any

import numpy as np

from services.kernels import hits
from services.kernels.bricks import UNIFORM, Bricks
from services.mapper.answers import Fused
from services.mapper.box import Box
from services.mapper.brick_store import BrickStore
from services.mapper.look import Look, Span
from services.mapper.sensor_model import SensorModel
from services.mapper.view import INVALID, NO_RETURN, View

_SPANS_PER_THREAD = 4
"""Spans are taken as threads come free: bricks with much work lie together."""


class ProjectiveIntegrator:
    """Fuses depth images into a store.

    With several threads each takes an image, then bricks of its own: for every brick the images
    come in their order, so the map is that of one thread to the last bit.
    """

    def __init__(self, box: Box, store: BrickStore, sensor: SensorModel) -> None:
        self._box, self._store, self._sensor = box, store, sensor
        self._looks = [Look(store.bricks.slot.size)]

    def move_to(self, box: Box) -> None:
        """Go on in a box that has moved by whole bricks."""
        self._box = box

    @property
    def num_bytes(self) -> int:
        """Bytes of the lists of bricks."""
        return sum(look.num_bytes for look in self._looks)

    def fuse(self, views: Sequence[View], threads: int = 1) -> Fused:
        """Fuse checked images in order."""
        while len(self._looks) < threads:
            self._looks.append(Look(self._store.bricks.slot.size))
        try:
            if threads == 1:
                num_hits = sum(self._fuse([view], 1, map) for view in views)
            else:
                with ThreadPoolExecutor(threads) as pool:
                    starts = range(0, len(views), threads)
                    num_hits = sum(
                        self._fuse(views[n : n + threads], threads, pool.map) for n in starts
                    )
        except BaseException:
            # Interrupted: what was fused stays, nothing of the rest may.
            self._store.recount()
            for look in self._looks:
                look.forget()
            raise
        num_returns = sum(hits.count_returns(v.depth, INVALID, NO_RETURN) for v in views)
        return Fused(int(num_hits), int(num_returns), 0)

    def _fuse(self, views: Sequence[View], threads: int, each: Callable[..., Iterable[Any]]) -> int:
        """Fuse as many images as there are threads; return how many voxels were hit."""
        looks, store = self._looks[: len(views)], self._store
        update = self._sensor.fixed_point()
        list(each(Look.locate, looks, views, repeat(self._box)))
        for look in looks:
            for other in looks:
                if other is not look:
                    look.heed(other)
        list(each(Look.list_bricks, looks, repeat(store.bricks), repeat(update[2])))
        spans = self._spans(threads)

        def apply(bricks: Bricks, span: Span) -> int:
            return sum(look.apply(bricks, span, update) for look in looks)

        if len(spans) == 1:
            num_hits = apply(store.bricks, spans[0])
        else:
            shares = store.shares([self._slots_needed(looks, span) for span in spans])
            num_hits = sum(each(apply, shares, spans))
            store.rejoin(shares)
        for look in looks:
            look.forget()
        return num_hits

    def _slots_needed(self, looks: Sequence[Look], span: Span) -> int:
        """Return how many slots the images may ask for, never more than there are bricks."""
        closed = np.count_nonzero(self._store.bricks.slot[span.first : span.end] == UNIFORM)
        wanted = sum(look.slots_needed(self._store.bricks, span) for look in looks)
        return min(int(closed), wanted)

    def _spans(self, threads: int) -> list[Span]:
        """Cut the directory into spans of whole columns of bricks."""
        total = self._store.bricks.slot.size
        if threads == 1:
            return [Span(0, total)]
        cuts = np.linspace(0, total, _SPANS_PER_THREAD * threads + 1).astype(int)
        return [Span(int(a), int(b)) for a, b in pairwise(cuts)]
