"""The colours of a plan's picture."""

# Colours of Okabe & Ito, 2008, and two of Tol, 2021: told apart by the colour-blind as well.
_ROBOTS = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"),
    *("#882255", "#999933"),
)
INK, GRID, TARGET = "#333333", "#DDDDDD", "#000000"


def colour(index: int) -> str:
    """Return a robot's colour, the same in every part of the picture."""
    return _ROBOTS[index % len(_ROBOTS)]
