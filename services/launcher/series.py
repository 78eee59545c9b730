"""Figures of a run's instants, in memory that does not grow with the run."""

import numpy as np
from numpy.typing import NDArray


class Series:
    """Rows of named numbers: what sums them up is of all, the rows kept are an even choice.

    Number, mean, least, greatest and last value are exact however many rows came. The rows
    themselves, which curves and percentiles are made of, are all kept while they are few; when
    they are twice `kept`, every second one is let go, and from then on every second comes in.
    """

    def __init__(self, *names: str, kept: int = 4096) -> None:
        self._columns = {name: column for column, name in enumerate(names)}
        self._rows = np.empty((2 * kept, len(names)))
        self._num_rows, self._stride = 0, 1
        self._num_settled = 0
        self._sums = np.zeros(len(names))
        self._least = np.full(len(names), np.inf)
        self._greatest = np.full(len(names), -np.inf)
        self._newest: NDArray[np.float64] | None = None
        """May still be corrected; not in any of the above."""

    def __len__(self) -> int:
        return self._num_settled + (self._newest is not None)

    def add(self, *values: float) -> None:
        """Append a row: one value per name, in the names' order."""
        if self._newest is not None:
            self._settle(self._newest)
        self._newest = np.array(values, np.float64)

    def correct(self, *values: float) -> None:
        """Put another row in the place of the newest."""
        self._newest = np.array(values, np.float64)

    def values(self, name: str) -> NDArray[np.float64]:
        """Return a column of the rows that are kept, the newest included."""
        settled = self._rows[: self._num_rows, self._columns[name]]
        newest = [] if self._newest is None else [self._newest[self._columns[name]]]
        return np.append(settled, newest)

    def figures(self, name: str) -> dict[str, float]:
        """Return `mean`, `min`, `max` and `final` of a column, over all rows; at least one."""
        assert self._newest is not None
        column = self._columns[name]
        newest = float(self._newest[column])
        return {
            "mean": (float(self._sums[column]) + newest) / len(self),
            "min": min(float(self._least[column]), newest),
            "max": max(float(self._greatest[column]), newest),
            "final": newest,
        }

    def percentile(self, name: str, q: float) -> float:
        """Return a percentile of a column, over the rows that are kept; at least one."""
        return float(np.percentile(self.values(name), q))

    def _settle(self, row: NDArray[np.float64]) -> None:
        if self._num_settled % self._stride == 0:
            if self._num_rows == len(self._rows):
                self._num_rows //= 2
                self._rows[: self._num_rows] = self._rows[::2]
                self._stride *= 2
            self._rows[self._num_rows] = row
            self._num_rows += 1
        self._num_settled += 1
        self._sums += row
        np.minimum(self._least, row, out=self._least)
        np.maximum(self._greatest, row, out=self._greatest)
