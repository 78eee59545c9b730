"""The questions of planners to a map: what a ray meets, how far obstacles are, what is unknown."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.mapper import distance, questions
from services.mapper.answers import RayHits
from services.mapper.box import Box
from services.mapper.distance import UnknownIs
from services.mapper.fading import Fading
from services.mapper.questions import Bounds


class MapQuestions:
    """Base of a map that answers them, all in the map's frame, of what lies in its box."""

    box: Box
    _fading: Fading

    def cast_rays(
        self,
        origins_m: ArrayLike,
        directions: ArrayLike,
        max_range_m: float = math.inf,
        unknown_stops: bool = False,
    ) -> RayHits:
        """Return the first occupied voxel of each ray: OctoMap's `castRay`, voxel for voxel.

        A ray from outside enters the box; beyond it there is nothing. Origins and directions are
        taken in single precision as OctoMap does; what is no ray is answered so and counted.

        Args:
            origins_m: (N, 3), map frame. directions: (N, 3), any length.
            max_range_m: a voxel farther away, by its centre, is not met.
            unknown_stops: unknown voxels of the box end a ray, too.

        Raises:
            BadPoints: If the shapes do not fit or the range is not positive.
        """
        bricks = self._fading.settled()
        return questions.cast_rays(
            bricks, self.box, origins_m, directions, max_range_m, unknown_stops
        )

    def distance(
        self, points_m: ArrayLike, reach_m: float = math.inf, unknown_is: UnknownIs = "free"
    ) -> NDArray[np.float64]:
        """Return the (N,) distances, m, of points to the nearest occupied voxel's centre.

        Args:
            points_m: (N, 3), map frame, in the box or out of it; one that is not finite gets NaN.
            reach_m: what is farther, or nowhere, is told as this; smaller is faster.
            unknown_is: what unknown voxels of the box count as, free or occupied.

        Raises:
            BadPoints, TooMuchAsked, MissingScipy: See `distance` and `questions`.
        """
        return distance.to_points(self._fading.settled(), self.box, points_m, reach_m, unknown_is)

    def distance_field(
        self,
        bounds_m: Bounds | None = None,
        reach_m: float = 1.0,
        unknown_is: UnknownIs = "free",
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return the distance, m, of every voxel centre to the nearest occupied one.

        Args:
            bounds_m: least and greatest corner, map frame; None is the whole box. Occupied voxels
                of the box beyond them count as far as `reach_m`.
            reach_m: what is farther is told as this. unknown_is: as for `distance`.

        Returns:
            The distances (nx, ny, nz) and the centre of voxel (0, 0, 0), map frame, m.

        Raises:
            BadBox: If the bounds have no volume or lie outside the box.
            BadPoints, TooMuchAsked, MissingScipy: See `distance` and `questions`.
        """
        return distance.field(self._fading.settled(), self.box, bounds_m, reach_m, unknown_is)

    def unknown(self, bounds_m: Bounds | None = None) -> NDArray[np.float64]:
        """Return the (N, 3) centres, map frame, m, of the unknown voxels that bounds touch.

        Raises:
            BadBox: If the bounds have no volume or lie outside the box.
            TooMuchAsked: If they hold more than `questions.MAX_VOXELS` voxels.
        """
        bricks = self._fading.settled()
        part = questions.part_of(self.box, bounds_m)
        return questions.unknown_centres_m(bricks, self.box, part)
