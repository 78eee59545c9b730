"""Bricks of log-odds as lists of voxels."""

from collections.abc import Iterable

import numpy as np

from services.kernels.bricks import BRICK, UNKNOWN
from services.mapper.answers import Voxels
from services.mapper.archive import Block
from services.mapper.box import Box
from services.mapper.sensor_model import LOG_ODDS_SCALE


def voxels_of(blocks: Iterable[Block], box: Box, *, occupied: bool) -> Voxels:
    """Return the occupied, or else the free, voxels of bricks given relative to a box."""
    centres_m, probability = [np.empty((0, 3))], [np.empty(0)]
    for index, log_odds in blocks:
        chosen = (log_odds != UNKNOWN) & ((log_odds >= 0) == occupied)
        rows, local = np.nonzero(chosen)
        inside = np.stack([local >> 6, (local >> 3) & 7, local & 7], axis=1)
        centres_m.append(box.centres_m(index[rows].astype(np.int64) * BRICK + inside))
        probability.append(1.0 / (1.0 + np.exp(-log_odds[rows, local] / LOG_ODDS_SCALE)))
    return Voxels(np.concatenate(centres_m), np.concatenate(probability))
