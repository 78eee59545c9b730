"""The errors of the simulated world."""


class WorldError(ValueError):
    """The world cannot be built from what was asked."""


class MeshError(WorldError):
    """A mesh is unknown, missing, unreadable or not a solid."""


class PathError(WorldError):
    """A path is unknown or its measures are not."""


class DeformationError(WorldError):
    """A deformation is unknown or out of its limits."""
