"""What the user wants to see; all browsers share it."""

from dataclasses import dataclass

from services.viewer.voxels import MAX_DRAWN, ColourBy


@dataclass(frozen=True)
class Options:
    """Switches of the view."""

    colour_by: ColourBy = ColourBy.HEIGHT
    follow: bool = True
    """The target stays in the middle, and the ground passes below it."""
    voxels: bool = True
    cameras: bool = True
    wedges: bool = True
    formation: bool = True
    trail: bool = True
    cloud: bool = False
    truth: bool = False
    coverage: bool = False
    dark: bool = False
    max_points: int = MAX_DRAWN
