"""A picture that is being drawn: light, depth, and what has been put in."""

import numpy as np
from numpy.typing import NDArray

from services.kernels import screen
from services.kernels.light import Floor, Lamp, Mood, Squares, paint
from services.kernels.lines import draw_lines
from services.kernels.rasterise import rasterise, to_camera
from services.kernels.rigid import FloatArray, apply, inverse
from services.recorder.export.stage import lens, sun

_NEAR_M = 0.02
_NOTHING = -1
_LAMP_PX = 1024
_SHADOW_PX = 3
_HIDDEN = 0.25
"""Share of its opacity that a line behind something keeps."""
_EDGE_KEEPS = 0.62


class Drawing:
    """Drawn larger than the picture will be, `times` in each direction, for soft edges."""

    def __init__(self, width: int, height: int, times: int, foot: int) -> None:
        """Allocate; the scene is in the middle of what lies above the lowest `foot` rows."""
        self._times = times
        shape = (height * times, width * times)
        self.intrinsics = lens(shape[1], shape[0] - foot * times)
        """(4,) of the large picture."""
        self.rgb = np.empty((*shape, 3), np.float32)
        self.depth_m = np.empty(shape, np.float32)
        self._triangle = np.empty(shape, np.int32)
        self._lamp_depth_m = np.empty((_LAMP_PX, _LAMP_PX), np.float32)
        self._lamp_triangle = np.empty((_LAMP_PX, _LAMP_PX), np.int32)
        self._picture = np.empty((height, width, 3), np.uint8)
        self._gamma = screen.gamma_table()
        self.T_world_eye: FloatArray = np.eye(4)

    def begin(
        self,
        T_world_eye: FloatArray,
        squares: Squares,
        size_m: float,
        floor: Floor,
        mood: Mood,
        centre_m: FloatArray,
        radius_m: float,
    ) -> None:
        """Draw the squares, edges of `size_m`, on the floor; the sun sees `radius_m` around."""
        self.T_world_eye = T_world_eye
        vertices = squares.corners_m.reshape(-1, 3)
        faces = _two_triangles(len(squares.corners_m))
        self.depth_m.fill(np.inf)
        self._rasterise(vertices, faces)
        T_lamp_world, lamp_intrinsics = sun(centre_m, radius_m, _LAMP_PX)
        self._lamp_depth_m.fill(np.inf)
        seen = np.empty((len(vertices), 3))
        to_camera(vertices, inverse(T_lamp_world), seen)
        rasterise(seen, faces, lamp_intrinsics, _NEAR_M, self._lamp_depth_m, self._lamp_triangle)
        lamp = Lamp(T_lamp_world, lamp_intrinsics, self._lamp_depth_m, 1.6 * size_m, _SHADOW_PX)
        paint(
            self.rgb, self.depth_m, self._triangle, squares, lamp, floor, mood, T_world_eye,
            self.intrinsics,
        )  # fmt: skip
        screen.outline(self.rgb, self.depth_m, self._triangle, 4 * size_m, self._times, _EDGE_KEEPS)

    def lines(
        self, ends_m: FloatArray, rgba: FloatArray, width_px: FloatArray, slack_m: float
    ) -> None:
        """Draw (N, 2, 3) lines of the world, the farthest first, widths in the picture's pixels."""
        ends = apply(inverse(self.T_world_eye), ends_m)
        order = np.argsort(-ends[:, :, 2].mean(axis=1), kind="stable")
        draw_lines(
            self.rgb, self.depth_m, ends[order], rgba[order], self._times * width_px[order],
            self.intrinsics, _NEAR_M, slack_m, _HIDDEN,
        )  # fmt: skip

    def veil(
        self, corners_m: FloatArray, faces: NDArray[np.int32], rgb: FloatArray, opacity: float
    ) -> None:
        """Lay a colour over what is behind the front faces (F, 3) of (V, 3) corners, world."""
        depth_m = self.depth_m.copy()
        self._rasterise(corners_m, faces, depth_m)
        screen.veil(self.rgb, self._triangle, rgb, opacity)

    def hang(
        self,
        corners_m: FloatArray,
        image: NDArray[np.float32],
        T_image_world: FloatArray,
        image_intrinsics: FloatArray,
        opacity: float,
    ) -> None:
        """Put a picture (h, w, 3) of light on the (4, 3) corners of a view's image plane, world."""
        faces = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]], np.int32)
        self._rasterise(corners_m, faces)
        screen.hang(
            self.rgb, self.depth_m, self._triangle, image, self.T_world_eye, self.intrinsics,
            T_image_world, image_intrinsics, opacity,
        )  # fmt: skip

    def developed(self) -> NDArray[np.uint8]:
        """Return the (H, W, 3) picture, sRGB; overwritten by the next."""
        screen.develop(self.rgb, self._times, self._gamma, self._picture)
        return self._picture

    def _rasterise(
        self,
        vertices_m: NDArray[np.floating],
        faces: NDArray[np.int32],
        depth_m: NDArray[np.float32] | None = None,
    ) -> None:
        seen = np.empty((len(vertices_m), 3))
        to_camera(vertices_m, self.T_world_eye, seen)
        self._triangle.fill(_NOTHING)
        depth_m = self.depth_m if depth_m is None else depth_m
        rasterise(seen, faces, self.intrinsics, _NEAR_M, depth_m, self._triangle)


def _two_triangles(num_squares: int) -> NDArray[np.int32]:
    """Return (2 F, 3) triangles of F squares whose corners follow one another."""
    first = 4 * np.arange(num_squares, dtype=np.int32)[:, None, None]
    two = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    faces: NDArray[np.int32] = (first + two).reshape(-1, 3)
    return faces
