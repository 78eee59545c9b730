"""What the mapper refuses, and why. Whatever is refused leaves the map as it was."""


class MapperError(ValueError):
    """Base of all that the mapper's core raises on bad input."""


class BadBox(MapperError):
    """The box or the voxel size describes no usable grid."""


class MapTooLarge(MapperError):
    """The box would need more memory than is allowed."""


class BadSensorModel(MapperError):
    """The probabilities are no sensor model."""


class BadPose(MapperError):
    """A transform is not a finite rigid motion."""


class BadDepth(MapperError):
    """A depth image, its scale or its range is not usable."""


class BadColor(MapperError):
    """A picture is not usable, or not that of the depth image."""


class BadIntrinsics(MapperError):
    """The pinhole parameters are not usable."""


class BadPoints(MapperError):
    """Points, or the origin of their rays, are not usable."""


class BadThreads(MapperError):
    """A number of threads is not usable."""


class BadDecay(MapperError):
    """A time or half-life is not usable."""


class BadMapFile(MapperError):
    """A file holds no map of ours, or its name ends in an unknown format."""


class BadRows(MapperError):
    """A number of rows to be told at once is too small."""


class TooMuchAsked(MapperError):
    """An answer would be larger than is allowed."""


class MissingScipy(MapperError):
    """A question needs a package that is not installed; the text names the extra."""


class BadMemory(MapperError):
    """A request does not go with what is remembered."""
