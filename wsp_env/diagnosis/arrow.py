"""Gram matrices in which most columns belong to one run only (block-arrow matrices), solved run by run."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.side_by_side import side_by_side
from wsp_env.diagnosis.triangular import cholesky, inverse_of, solved


def rows_of(run: np.ndarray) -> list[slice | np.ndarray]:
    """Return the rows of each run, from the run (n,) of each row; consecutive rows as a slice, which needs no copy."""
    found: list[slice | np.ndarray] = []
    for one in np.unique(run):
        rows = np.flatnonzero(run == one)
        found.append(slice(rows[0], rows[-1] + 1) if rows[-1] - rows[0] + 1 == len(rows) else rows)
    return found


class ByRun(NamedTuple):
    """Columns (n, p) stored run by run, each without the columns that are zero in it: most columns belong to one run only."""

    width: int  # p
    rows: tuple[slice | np.ndarray, ...]  # (m,) of each run
    used: tuple[np.ndarray, ...]  # (u,) indices of the columns in each run
    blocks: tuple[np.ndarray, ...]  # (m, u) of each run

    @classmethod
    def of(cls, columns: np.ndarray, run: np.ndarray) -> "ByRun":
        """Store columns (n, p) whose rows belong to runs (n,)."""
        rows = tuple(rows_of(run))
        used = tuple(np.flatnonzero(columns[one].any(axis=0)) for one in rows)
        blocks = tuple(columns[one][:, mine] for one, mine in zip(rows, used, strict=True))
        return cls(columns.shape[1], rows, used, blocks)

    def beside(self, columns: np.ndarray) -> "ByRun":
        """Return these columns and further ones (n, k), which count as used in all runs."""
        further = np.arange(self.width, self.width + columns.shape[1])
        used = tuple(np.append(mine, further) for mine in self.used)
        blocks = tuple(side_by_side(lambda block, rows: np.column_stack([block, columns[rows]]), self.blocks, self.rows))
        return ByRun(self.width + columns.shape[1], self.rows, used, blocks)

    def kept(self, keep: np.ndarray) -> "ByRun":
        """Return the columns in the rows `keep` (n,) bool, numbered anew; runs of which none is kept have no rows."""
        number, every = np.cumsum(keep) - 1, np.arange(len(keep))
        rows = tuple(number[every[mine][keep[mine]]] for mine in self.rows)
        blocks = tuple(block[keep[mine]] for mine, block in zip(self.rows, self.blocks, strict=True))
        return self._replace(rows=rows, blocks=blocks)

    def squares(self) -> np.ndarray:
        """Return the sum of squares (p,) of each column."""
        total = np.zeros(self.width)
        for mine, block in zip(self.used, self.blocks, strict=True):
            total[mine] += np.einsum("mu,mu->u", block, block)
        return total

    def scaled(self, factors: np.ndarray) -> "ByRun":
        """Return the columns times factors (p,)."""
        return self._replace(blocks=tuple(side_by_side(lambda mine, block: block * factors[mine], self.used, self.blocks)))

    def order(self, whole: int) -> "Order":
        """Sort the columns by the runs of their rows; the last `whole` columns always count as common."""
        concerned = np.zeros((len(self.rows), self.width), dtype=bool)
        for i, mine in enumerate(self.used):
            concerned[i, mine] = True
        alone = (concerned.sum(axis=0) == 1) & (np.arange(self.width) < self.width - whole)
        return Order(tuple(np.flatnonzero(mine & alone) for mine in concerned), np.flatnonzero(~alone))

    def parts(self, order: "Order") -> list["Part"]:
        """Split the columns of each run into its own and the common ones."""
        place = np.full(self.width, -1)
        place[order.common] = np.arange(len(order.common))

        def part(rows: slice | np.ndarray, mine: np.ndarray, block: np.ndarray) -> Part:
            shared = place[mine] >= 0
            return Part(rows, block[:, ~shared], place[mine[shared]], block[:, shared])

        return side_by_side(part, *self[1:])


class Order(NamedTuple):
    """Order of the columns: those of one run only, and the common ones."""

    own: tuple[np.ndarray, ...]  # column indices of each run
    common: np.ndarray


class Part(NamedTuple):
    """The columns in the rows of one run."""

    rows: slice | np.ndarray  # (m,) indices
    own: np.ndarray  # (m, k) columns of this run only
    used: np.ndarray  # (u,) indices into the common columns that are not zero here
    shared: np.ndarray  # (m, u)


class Arrow(NamedTuple):
    """A symmetric matrix: one block per run, its products with the common columns, and the block of the common columns."""

    own: tuple[np.ndarray, ...]  # (k, k) of each run
    cross: tuple[np.ndarray, ...]  # (k, c) of each run
    common: np.ndarray  # (c, c)

    @classmethod
    def of(cls, parts: Sequence[Part], count: int, keep: np.ndarray | None = None) -> "Arrow":
        """Return the Gram matrix of columns of which `count` are common, over the rows `keep` (n,) bool."""

        def products(part: Part) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
            mine, used, shared = part.own, part.used, part.shared
            if keep is not None:
                inside = keep[part.rows]
                shared = shared[inside]
                touched = shared.any(axis=0)
                mine, used, shared = mine[inside], used[touched], shared[:, touched]
            cross = np.zeros((mine.shape[1], count))
            cross[:, used] = mine.T @ shared
            return mine.T @ mine, cross, used, shared.T @ shared

        own, cross, touched, shared = zip(*side_by_side(products, parts), strict=True)
        common = np.zeros((count, count))
        for used, one in zip(touched, shared, strict=True):
            if len(used) == count:
                common += one
            else:
                common[np.ix_(used, used)] += one
        return cls(own, cross, common)

    def first(self, columns: np.ndarray, own: Sequence[np.ndarray] | None = None) -> "Arrow":
        """Return the matrix with only the common columns of the given indices, and only the columns `own` (k,) of each run."""
        if own is None:
            return Arrow(self.own, tuple(one[:, columns] for one in self.cross), self.common[np.ix_(columns, columns)])
        blocks = tuple(one[np.ix_(mine, mine)] for one, mine in zip(self.own, own, strict=True))
        cross = tuple(one[np.ix_(mine, columns)] for one, mine in zip(self.cross, own, strict=True))
        return Arrow(blocks, cross, self.common[np.ix_(columns, columns)])

    def with_last(self, parts: Sequence[Part], keep: np.ndarray) -> "Arrow":
        """Return the matrix with another last common column, over the rows `keep` (n,) bool; each part uses it last."""
        common = self.common.copy()
        common[-1, :] = common[:, -1] = 0.0
        cross = []
        for part, before in zip(parts, self.cross, strict=True):
            last = part.shared[:, -1] * keep[part.rows]
            common[part.used[:-1], -1] += part.shared[:, :-1].T @ last
            common[-1, -1] += last @ last
            cross.append(np.column_stack([before[:, :-1], part.own.T @ last]))
        common[-1, :] = common[:, -1]
        return Arrow(self.own, tuple(cross), common)

    def widened(self) -> "Arrow":
        """Return the matrix with one more common column, which is zero."""
        return Arrow(self.own, tuple(np.pad(one, ((0, 0), (0, 1))) for one in self.cross), np.pad(self.common, (0, 1)))

    def square(self, own: Sequence[np.ndarray], common: np.ndarray) -> float:
        """Return the quadratic form of amplitudes (k,) of each run's own columns and (c,) of the common ones."""

        def of_run(block: np.ndarray, cross: np.ndarray, one: np.ndarray) -> float:
            return float(one @ (block @ one + 2.0 * (cross @ common)))

        return float(common @ self.common @ common) + sum(map(of_run, self.own, self.cross, own))

    def scaled(self, own: Sequence[np.ndarray], common: np.ndarray) -> "Arrow":
        """Return the matrix of scaled columns; factors (k,) for each run's own columns, (c,) for the common ones."""
        return Arrow(
            tuple(side_by_side(lambda one, d: one * np.outer(d, d), self.own, own)),
            tuple(side_by_side(lambda one, d: one * np.outer(d, common), self.cross, own)),
            self.common * np.outer(common, common),
        )

    def inner(self, other: "Arrow") -> float:
        """Return the Frobenius inner product: the sum of the products of all entries."""
        total = float(np.vdot(self.common, other.common)) + sum(side_by_side(_product, self.own, other.own))
        return total + 2.0 * sum(side_by_side(_product, self.cross, other.cross))


def _product(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.vdot(a, b))


def combined(arrows: Sequence[Arrow], weights: np.ndarray) -> Arrow:
    """Return the weighted sum of arrows."""

    def total(parts: Sequence[np.ndarray]) -> np.ndarray:
        result = weights[0] * parts[0]
        for weight, part in zip(weights[1:], parts[1:], strict=True):
            result += weight * part
        return result

    own = side_by_side(total, list(zip(*(one.own for one in arrows), strict=True)))
    cross = side_by_side(total, list(zip(*(one.cross for one in arrows), strict=True)))
    return Arrow(tuple(own), tuple(cross), total([one.common for one in arrows]))


class Eliminated:
    """An arrow matrix plus 1 on the diagonal of its nuisance columns, with the runs' own columns eliminated.

    Parameters
    ----------
    arrow : all columns. The first `nuisances` common columns get the 1, the other common columns are right-hand sides

    """

    def __init__(self, arrow: Arrow, nuisances: int) -> None:

        def eliminated(own: np.ndarray, cross: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            root = cholesky(own + np.eye(len(own)))
            half = solved(root, cross)
            return root, half, half.T @ half

        self.nuisances = nuisances
        self._roots, self._half, squares = zip(*side_by_side(eliminated, arrow.own, arrow.cross), strict=True)
        self.rest = arrow.common - sum(squares)  # (c, c) Schur complement
        diagonal = np.arange(nuisances)
        self.rest[diagonal, diagonal] += 1.0
        self.factor = cholesky(self.rest[:nuisances, :nuisances])  # lower, of the common nuisances

    @property
    def logdet(self) -> float:
        """Log determinant of the matrix of all nuisance columns."""
        diagonals = [np.diag(root) for root in (*self._roots, self.factor)]
        return 2.0 * float(sum(np.log(one).sum() for one in diagonals))

    def of_common(self, y: np.ndarray) -> np.ndarray:
        """Return the inverse Schur complement of the common nuisances times Y (c, ...)."""
        return solved(self.factor, solved(self.factor, y), True)

    def solution(self, column: int) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the amplitudes of the runs' own columns and of the common nuisances; right-hand side: a common column."""
        common = self.of_common(self.rest[: self.nuisances, column])
        sides = [half[:, column] - half[:, : self.nuisances] @ common for half in self._half]
        return [solved(root, side, True) for root, side in zip(self._roots, sides, strict=True)], common

    def spread(self, run: int, own: np.ndarray, common: np.ndarray) -> np.ndarray:
        """Return the root (m, k) of X A^-1 X' for the matrix A and rows X of one run, in its own and the common columns."""
        mine = solved(self._roots[run], own.T)
        rest = common.T - self._half[run][:, : self.nuisances].T @ mine
        return np.vstack([mine, solved(self.factor, rest)]).T

    def half(self, own: Sequence[np.ndarray], common: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Return L^-1 Y for the root L of the matrix; Y and the result: rows (k, m) of each run's columns, and common rows."""
        mine = [solved(root, one) for root, one in zip(self._roots, own, strict=True)]
        rest = common - sum(half[:, : self.nuisances].T @ one for half, one in zip(self._half, mine, strict=True))
        return mine, solved(self.factor, rest)

    def back(self, own: Sequence[np.ndarray], common: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Return L^-T Y; applied after `half`, this gives the inverse of the matrix times the columns."""
        last = solved(self.factor, common, True)
        sides = [one - half[:, : self.nuisances] @ last for half, one in zip(self._half, own, strict=True)]
        return [solved(root, side, True) for root, side in zip(self._roots, sides, strict=True)], last

    def inverse(self) -> Arrow:
        """Return those blocks of the inverse matrix that an arrow stores."""
        common = inverse_of(self.factor)

        def blocks(root: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            back = solved(root, half[:, : self.nuisances], True)
            cross = -back @ common
            return inverse_of(root) - cross @ back.T, cross

        own, cross = zip(*side_by_side(blocks, self._roots, self._half), strict=True)
        return Arrow(own, cross, common)
