"""Rows of words under titles, as columns; wide ones are not cut, so that they can be searched."""

from collections.abc import Sequence


def columns(titles: Sequence[str], rows: Sequence[Sequence[str]], right: str = "") -> list[str]:
    """Return a line of titles and one per row.

    Args:
        titles: Of the columns.
        rows: Each as long as `titles`.
        right: A letter per column, `r` for those whose cells end in line.
    """
    table = [titles, *rows]
    widths = [max(len(row[index]) for row in table) for index in range(len(titles))]
    sides = right.ljust(len(titles))
    return [
        "  ".join(
            cell.rjust(width) if side == "r" else cell.ljust(width)
            for cell, width, side in zip(row, widths, sides, strict=True)
        ).rstrip()
        for row in table
    ]
