"""Follows the voxels of one map, and says which of them stand where nothing is any more."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from moving_maps import Contender
from moving_scene import Instant, MovingScene, distance_m, looked_through, points_of
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from services.kernels.rigid import FloatArray
from services.mapper.box import Box

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Truth:
    """What one instant says of (V,) voxels."""

    instant: Instant
    distance_m: FloatArray
    """To the nearest surface, negative in the body."""
    hit: BoolArray
    """A return ends in it."""
    looks: BoolArray
    """A camera looked through it, and nothing returned from it."""


@dataclass
class Record:
    """What a map did, frame by frame."""

    ghosts: list[int] = field(default_factory=list)
    inside: list[int] = field(default_factory=list)
    to_clear: list[int] = field(default_factory=list)
    num_late: int = 0
    num_hidden: int = 0
    num_never: int = 0
    missing: list[float] = field(default_factory=list)
    missing_ground: list[float] = field(default_factory=list)


class Judge:
    """Follows one map's voxels, (V, 3) centres."""

    def __init__(self, contender: Contender, centres_m: FloatArray, voxel_m: float) -> None:
        self.contender, self.record = contender, Record()
        self._edge_m, self._centres_m = voxel_m, centres_m
        none = np.zeros(len(centres_m), np.int64)
        self._waits, self._age, self._looks = none.copy(), none.copy(), none.copy()
        self._stood = np.zeros(len(centres_m), np.bool_)

    def take(self, truth: Truth) -> None:
        """Fuse an instant and judge the map after it."""
        self.contender.fuse(truth.instant)
        now, record = self.contender.occupied(self._centres_m), self.record
        away = truth.distance_m > self._edge_m
        # Frames that a voxel which its surface has left goes on being occupied.
        left = (self._stood & away) | (self._waits > 0)
        record.to_clear += (self._waits[left & ~now] + 1).tolist()
        self._waits = np.where(left & now & away, self._waits + 1, 0)
        self._stood = now & ~away
        ghost = now & (truth.distance_m > 2 * self._edge_m)
        self._age = np.where(ghost, self._age + 1, 0)
        self._looks = np.where(truth.hit, 0, self._looks + truth.looks)
        k = self.contender.frames_to_clear
        late = ghost & (self._looks >= k)
        record.ghosts.append(int(ghost.sum()))
        record.inside.append(int((now & (truth.distance_m < -2 * self._edge_m)).sum()))
        record.num_late += int(late.sum())
        record.num_hidden += int((ghost & (self._age >= k) & ~late).sum())
        self._look_for_surface(truth, now)

    def _look_for_surface(self, truth: Truth, now: BoolArray) -> None:
        near_m = 2 * self._edge_m
        tree = cKDTree(self._centres_m[now])
        if len(truth.instant.seen_m):
            nearest = tree.query(truth.instant.seen_m, distance_upper_bound=near_m)[0]
            self.record.missing.append(float((nearest > near_m).mean()))
        ground = truth.hit & (np.abs(self._centres_m[:, 2] - self._edge_m / 2) < 1e-6)
        foot_m = self._centres_m[ground] * (1, 1, 0)
        nearest = tree.query(foot_m, distance_upper_bound=near_m)[0]
        self.record.missing_ground.append(float((nearest > near_m).mean()))

    def end(self) -> Record:
        """Count what still stands."""
        self.record.num_never = int((self._waits > 0).sum())
        return self.record


def voxels_hit(instant: Instant, box: Box) -> BoolArray:
    """Return (nx, ny, nz) whether a return ends in a voxel."""
    hit = np.zeros(box.shape, np.bool_)
    for view in instant.views:
        keys = box.keys(points_of(view))
        hit[tuple(keys[((keys >= 0) & (keys < box.shape)).all(axis=1)].T)] = True
    return hit


def truths_of(scene: MovingScene, box: Box) -> tuple[FloatArray, Iterator[Truth]]:
    """Film a scene; return the centres (V, 3) of the voxels that are asked about, and the truth.

    Asked about are those that something returned from, for no other can be occupied, and their
    neighbours, for rounding.
    """
    film = [scene.instant(n) for n in range(scene.num_instants)]
    hits = [voxels_hit(instant, box) for instant in film]
    asked = binary_dilation(np.any(hits, axis=0), np.ones((3, 3, 3)))
    centres_m = box.centres_m(np.argwhere(asked))

    def truths() -> Iterator[Truth]:
        for instant, dense in zip(film, hits, strict=True):
            hit = dense[asked]
            seen = np.any([looked_through(v, box, centres_m) for v in instant.views], axis=0)
            yield Truth(instant, distance_m(instant.body, centres_m), hit, seen & ~hit)

    return centres_m, truths()


def judged(scene: MovingScene, maps: list[Contender], box: Box) -> list[Record]:
    """Let every map fuse what happens in a scene."""
    centres_m, truths = truths_of(scene, box)
    judges = [Judge(contender, centres_m, box.resolution_m) for contender in maps]
    for truth in truths:
        for judge in judges:
            judge.take(truth)
    return [judge.end() for judge in judges]
