"""Derivatives of predictions by many parameters, of which those of single runs share columns.

The start of each run changes its own rows only. With a column each, hundreds of runs would need a matrix of
their number squared; side by side in one column they need memory in proportion to the data.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_backends.models.interface import Array

Indices: TypeAlias = NDArray[np.intp]
Mask: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Derivatives:
    """Rows x parameters, packed.

    Attributes:
        values: Rows x packed columns.
        site: Run of each row.
        places: Parameter in each packed column, by run: runs x packed columns; -1 for none.
        count: Number of parameters.
    """

    values: Array
    site: Indices
    places: Indices
    count: int

    def mapped(self, change: Callable[[Array], Array], site: Indices | None = None) -> "Derivatives":
        """Return them with rows changed by a function that mixes no runs.

        Args:
            change: Of the packed rows.
            site: Run of each row afterwards, where the function leaves rows out.
        """
        return replace(self, values=change(self.values), site=self.site if site is None else site)

    def scaled(self, factors: Array) -> "Derivatives":
        """Return them with each parameter in another unit."""
        by_site = np.where(self.places >= 0, factors[self.places], 0.0)
        return replace(self, values=self.values * by_site[self.site])

    def dense(self) -> Array:
        """Return rows x parameters in full."""
        found = np.zeros((self.values.shape[0], self.count))
        for rows, columns, here in self._blocks():
            found[np.ix_(rows, columns)] = self.values[np.ix_(rows, here)]
        return found

    def gram(self) -> Array:
        """Return the products of all pairs of columns: parameters x parameters."""
        found = np.zeros((self.count, self.count))
        for rows, columns, here in self._blocks():
            part = self.values[rows][:, here]
            found[np.ix_(columns, columns)] += part.T @ part
        return found

    def along(self, rows: Array) -> Array:
        """Return the products of all columns with a vector of rows."""
        found = np.zeros(self.count)
        for own, columns, here in self._blocks():
            found[columns] += self.values[own][:, here].T @ rows[own]
        return found

    def times(self, parameters: Array) -> Array:
        """Return the change of all rows by a change of the parameters."""
        by_site = np.where(self.places >= 0, parameters[self.places], 0.0)
        changes: Array = np.einsum("ij,ij->i", self.values, by_site[self.site])
        return changes

    def columns(self, places: Sequence[int]) -> Array:
        """Return the full columns of some parameters: rows x their number."""
        found = np.zeros((self.values.shape[0], len(places)))
        for index, place in enumerate(places):
            runs, packed = np.nonzero(self.places == place)
            for one in np.unique(packed):
                rows = np.isin(self.site, runs[packed == one])
                found[rows, index] = self.values[rows, one]
        return found

    def squares(self) -> Array:
        """Return the sum of squares of each column."""
        found = np.zeros(self.count)
        for rows, columns, here in self._blocks():
            found[columns] += np.sum(self.values[rows][:, here] ** 2, axis=0)
        return found

    def spread(self, covariance: Array) -> Array:
        """Return the variance of each row by a covariance of the parameters."""
        found = np.zeros(self.values.shape[0])
        for rows, columns, here in self._blocks():
            part = self.values[rows][:, here]
            found[rows] = np.sum((part @ covariance[np.ix_(columns, columns)]) * part, axis=1)
        return found

    def rows(self, here: Mask) -> tuple[Array, list[int]]:
        """Return some rows in full, of the parameters that change them, and these parameters."""
        part = replace(self, values=self.values[here], site=self.site[here])
        runs = np.unique(part.site)
        used = np.unique(part.places[runs])
        used = used[used >= 0]
        return part.columns(used.tolist()), used.tolist()

    def _blocks(self) -> list[tuple[Indices, Indices, Indices]]:
        """Return of each run its rows, its parameters, and their packed columns.

        Runs with the same parameters are one block: without unknowns of single runs there is one.
        """
        kinds, kind = np.unique(self.places, axis=0, return_inverse=True)
        by_row = kind.reshape(-1)[self.site]
        order = np.argsort(by_row, kind="stable").astype(np.intp)
        ends = np.cumsum(np.bincount(by_row, minlength=len(kinds)))
        found = []
        for places, first, end in zip(kinds, [0, *ends[:-1]], ends, strict=True):
            here = np.flatnonzero(places >= 0).astype(np.intp)
            found.append((order[first:end], places[here], here))
        return found


def in_full(matrix: Array) -> Derivatives:
    """Return a matrix whose columns all belong to all runs."""
    count = matrix.shape[1]
    return Derivatives(
        values=matrix,
        site=np.zeros(matrix.shape[0], dtype=np.intp),
        places=np.arange(count, dtype=np.intp)[None, :],
        count=count,
    )
