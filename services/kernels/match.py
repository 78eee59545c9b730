"""The cheapest way to give each row a column of its own."""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy", nogil=True)
def match(costs, columns):  # type: ignore[no-untyped-def]
    """Write the column of each row so that the sum of costs is least.

    Args:
        costs: (N, N), finite.
        columns: (N,) int64; written.

    Source: Kuhn, "The Hungarian method", 1955; shortest augmenting paths with potentials,
    O(N^3), as in Jonker and Volgenant, 1987.
    """
    num = costs.shape[0]
    row_price, column_price = np.zeros(num + 1), np.zeros(num + 1)
    row_of = np.zeros(num + 1, np.int64)  # Row 0: free. Column 0: where each path begins.
    came_from = np.zeros(num + 1, np.int64)
    slack, used = np.empty(num + 1), np.empty(num + 1, np.bool_)
    for row in range(1, num + 1):
        row_of[0], column = row, 0
        slack[:], used[:] = np.inf, False
        while row_of[column] != 0:
            used[column] = True
            here, step, following = row_of[column], np.inf, 0
            for j in range(1, num + 1):
                if used[j]:
                    continue
                reduced = costs[here - 1, j - 1] - row_price[here] - column_price[j]
                if reduced < slack[j]:
                    slack[j], came_from[j] = reduced, column
                if slack[j] < step:
                    step, following = slack[j], j
            for j in range(num + 1):
                if used[j]:
                    row_price[row_of[j]] += step
                    column_price[j] -= step
                else:
                    slack[j] -= step
            column = following
        while column != 0:
            row_of[column] = row_of[came_from[column]]
            column = came_from[column]
    for j in range(1, num + 1):
        columns[row_of[j] - 1] = j - 1
