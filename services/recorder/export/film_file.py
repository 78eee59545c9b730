"""Films as files: `.mp4` for players and browsers, `.gif` and `.webp` for pages, `.png` stills."""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from services.recorder.export.errors import ExportError

ENDINGS = (".mp4", ".gif", ".webp", ".png")
_CODECS = ("libx264", "libvpx-vp9", "mpeg4")
"""The best that PyAV's FFmpeg was built with; every browser plays H.264."""
_CRF = {"libx264": "20", "libvpx-vp9": "32"}
_GIF_COLORS = 128
_WEBP_QUALITY = 72
_MOST_BYTES = 2 << 30
"""Of a loop's pictures, which are all held until the end: its writer takes them at once."""

Picture = NDArray[np.uint8]


class FilmFile(Protocol):
    """Takes pictures (H, W, 3), all of one size."""

    def add(self, picture: Picture) -> None:
        """Append a picture; it may be overwritten afterwards."""


def check_ending(path: Path) -> None:
    """See to it, before anything is drawn, that a name tells a format.

    Raises:
        ExportError: Naming the choices.
    """
    if path.suffix not in ENDINGS:
        raise ExportError(f"unknown format {path.suffix!r} of {path}; known: {', '.join(ENDINGS)}")


def check_room(path: Path, num_pictures: int, width: int, height: int) -> None:
    """See to it, before anything is drawn, that a loop's pictures have room in memory.

    Raises:
        ExportError: Naming how many have, and what to do.
    """
    channels = {".gif": 1, ".webp": 3}.get(path.suffix)
    if channels is None:
        return  # Written as it is drawn, or one picture.
    most = _MOST_BYTES // (channels * width * height)
    if num_pictures > most:
        raise ExportError(
            f"{num_pictures} pictures of {width}x{height} are too many for a {path.suffix}, which "
            f"is held in memory until it is whole (at most {most}): write .mp4, or give --start, "
            "--end, --speed, --fps or --size"
        )


@contextmanager
def film_file(path: Path, fps: float) -> Iterator[FilmFile]:
    """Open a film to be written; the name's ending tells the format.

    It is written beside its place and put there when it is whole.

    Raises:
        ExportError: If the name ends otherwise, or it cannot be written.
    """
    check_ending(path)
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        with _open(partial, fps) as film:
            yield film
        partial.replace(path)
    except OSError as error:
        raise ExportError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)


def _open(path: Path, fps: float) -> "_Video | _Pictures":
    match path.suffix:
        case ".mp4":
            return _Video(path, fps)
        case ".gif" | ".webp" | ".png":
            return _Pictures(path, fps)
        case _:
            raise AssertionError(path.suffix)


class _Video:
    """H.264 in an .mp4; rows and columns are made even, as its colours need."""

    def __init__(self, path: Path, fps: float) -> None:
        self._path, self._fps = path, fps
        self._container: Any = None
        self._stream: Any = None

    def __enter__(self) -> Self:
        import av

        # Its index first: a browser plays it before it has all of it.
        options = {"movflags": "faststart"}
        self._container = av.open(str(self._path), "w", format="mp4", options=options)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if self._stream is not None and kind is None:
                for packet in self._stream.encode():
                    self._container.mux(packet)
        finally:
            self._container.close()

    def add(self, picture: Picture) -> None:
        import av

        height, width = (side // 2 * 2 for side in picture.shape[:2])
        if self._stream is None:
            self._stream = self._open_stream(width, height)
        frame = av.VideoFrame.from_ndarray(
            np.ascontiguousarray(picture[:height, :width]), format="rgb24"
        )
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def _open_stream(self, width: int, height: int) -> Any:
        import av

        rate = Fraction(self._fps).limit_denominator(1001)
        for codec in _CODECS:
            try:
                stream = self._container.add_stream(codec, rate=rate)
            except (av.codec.codec.UnknownCodecError, ValueError):
                continue
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            if codec in _CRF:
                stream.options = {"crf": _CRF[codec]}
            return stream
        raise ExportError(f"PyAV's FFmpeg has none of {', '.join(_CODECS)}; write .gif or .webp")


class _Pictures:
    """A still, or a loop of pictures that plays for ever."""

    def __init__(self, path: Path, fps: float) -> None:
        self._path = path
        self._frame_ms = 1000.0 / fps
        self._pictures: list[Any] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None or not self._pictures:
            return
        first, *others = self._pictures
        # Durations are whole milliseconds (hundredths of a second in a GIF): their sum is kept.
        step_ms = 10 if self._path.suffix == ".gif" else 1
        ends = np.rint(np.arange(len(self._pictures) + 1) * self._frame_ms / step_ms) * step_ms
        loop = {"save_all": True, "append_images": others, "loop": 0}
        loop["duration"] = np.diff(ends).astype(int).tolist()
        match self._path.suffix:
            case ".gif":
                first.save(self._path, **loop, optimize=False, disposal=1)
            case ".webp":
                first.save(self._path, **loop, quality=_WEBP_QUALITY, method=4)
            case _:
                first.save(self._path, optimize=True)

    def add(self, picture: Picture) -> None:
        from PIL import Image

        image = Image.fromarray(picture.copy())
        if self._path.suffix == ".png":
            self._pictures = [image]
            return
        if self._path.suffix == ".gif":
            # One palette for all: single colours would flicker from picture to picture.
            if not self._pictures:
                self._pictures.append(image.quantize(_GIF_COLORS, dither=Image.Dither.NONE))
                return
            image = image.quantize(palette=self._pictures[0], dither=Image.Dither.NONE)
        self._pictures.append(image)
