"""The cross-cut lattice: from a map of cut lengths to half-cuts, limits and a drawing.

With L the cell edge and s = L / 2, cuts are centred on the sites (p, q) s, p counted across
(column direction) and q along (row direction). Where p + q is even the cut lies across the
pull and has length a L, where it is odd along the pull and b L. Cell centres and corners are
even sites, the middles of cell edges odd ones; every facet between four sites is a square of
s x s that turns like a rotating square. Frame: x mm across from the lateral edge (column 0),
y mm along from the proximal edge (row 0), origin in the patch's proximal lateral corner.

A heterogeneous map is cut in half-cuts: each half has the mean length of the cells that it
touches, so that cuts on cell borders are averaged and cuts across them skewed (Bali et al.,
arXiv 2511.13941, "simple averaging and skewing"; the rule itself is our choice).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.errors import DataError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class HalfCuts:
    """Half-cuts, each from its site outwards; k half-cuts in patch coordinates.

    Attributes:
        position_mm: (k, 2) the site that the half-cut starts from, mm.
        direction: (k, 2) unit vector from the site to the tip.
        length_mm: (k,) length, mm.
        site: (k, 2) lattice coordinates (p, q) of the site, in units of half a cell.
    """

    position_mm: FloatArray
    direction: FloatArray
    length_mm: FloatArray
    site: IntArray

    def __len__(self) -> int:
        return len(self.length_mm)

    @property
    def tip_mm(self) -> FloatArray:
        """(k, 2) the tips, mm."""
        return self.position_mm + self.length_mm[:, None] * self.direction

    def cuts(self) -> Cuts:
        """The halves that leave one site in opposite directions, joined to one cut.

        Halves with an angle between them stay two pieces that meet in the site.
        """
        order = np.lexsort((self.direction[:, 1], self.direction[:, 0], self.site[:, 0]))
        order = order[np.argsort(self.site[order, 1], kind="stable")]
        start, end, site = [], [], []
        k = 0
        while k < len(order):
            i = order[k]
            j = order[k + 1] if k + 1 < len(order) else i
            paired = (
                j != i
                and bool(np.all(self.site[i] == self.site[j]))
                and float(self.direction[i] @ self.direction[j]) < -1 + 1e-12
            )
            start.append(self.tip_mm[i])
            end.append(self.tip_mm[j] if paired else self.position_mm[i])
            site.append(self.site[i])
            k += 2 if paired else 1
        return Cuts(
            np.array(start).reshape(-1, 2),
            np.array(end).reshape(-1, 2),
            np.array(site, dtype=np.int64).reshape(-1, 2),
        )


@dataclass(frozen=True, eq=False)
class Cuts:
    """Straight cuts as the laser sees them; k cuts in patch coordinates.

    Attributes:
        start_mm, end_mm: (k, 2) their two ends, mm.
        site: (k, 2) lattice coordinates (p, q) of the site that they belong to.
    """

    start_mm: FloatArray
    end_mm: FloatArray
    site: IntArray

    def __len__(self) -> int:
        return len(self.start_mm)

    @property
    def length_mm(self) -> FloatArray:
        """(k,) lengths, mm."""
        return np.asarray(np.linalg.norm(self.end_mm - self.start_mm, axis=1))


@dataclass(frozen=True, eq=False)
class CutMap:
    """Cut lengths cell by cell: the design of a kirigami patch.

    Attributes:
        a: (R, C) length of the cuts across the pull / cell edge, in [0, 1).
        b: (R, C) length of the cuts along the pull / cell edge, in [0, 1).
        cell_mm: cell edge, mm.

    Raises:
        DataError: lengths outside [0, 1), unequal shapes or an empty map; the message names
            the first cell.
    """

    a: FloatArray
    b: FloatArray
    cell_mm: float

    def __post_init__(self) -> None:
        a = np.array(self.a, dtype=np.float64)
        b = np.array(self.b, dtype=np.float64)
        if a.ndim != 2 or a.shape != b.shape or a.size == 0:
            raise DataError(
                "cut-map-shape",
                "The two maps of cut lengths are not tables of the same rows and columns.",
                remedy="Give one a and one b for every cell.",
                got=f"{a.shape} and {b.shape}",
            )
        if not (np.isfinite(self.cell_mm) and self.cell_mm > 0):
            raise DataError(
                "cell-size",
                "The cell edge is not a positive length.",
                remedy="Give the cell edge in mm.",
                got=self.cell_mm,
            )
        for name, lengths in (("a", a), ("b", b)):
            bad = ~((lengths >= 0) & (lengths < 1))
            if bad.any():
                row, column = np.argwhere(bad)[0]
                raise DataError(
                    "cut-length-range",
                    f"Cut length {name} of cell (row {row}, column {column}) is out of range.",
                    remedy="Cut lengths are fractions of the cell edge: neighbouring cuts meet "
                    "at 1. Divide percent by 100.",
                    got=lengths[row, column],
                    expected="0 <= length < 1",
                )
        a.setflags(write=False)
        b.setflags(write=False)
        object.__setattr__(self, "a", a)
        object.__setattr__(self, "b", b)

    @classmethod
    def uniform(cls, a: float, b: float, rows: int, columns: int, cell_mm: float) -> CutMap:
        """The map with the same fractions ``a``, ``b`` in each of ``rows`` x ``columns`` cells."""
        return cls(np.full((rows, columns), a), np.full((rows, columns), b), cell_mm)

    @property
    def rows(self) -> int:
        """Cells along the pull."""
        return int(self.a.shape[0])

    @property
    def columns(self) -> int:
        """Cells across the pull."""
        return int(self.a.shape[1])

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width (across) and length (along) of the patch, mm."""
        return self.columns * self.cell_mm, self.rows * self.cell_mm

    def half_fractions(self) -> FloatArray:
        """Half-cut lengths / half a cell at every site: (2R + 1, 2C + 1, 2), indexed (q, p, side).

        Side 0 points to smaller x (even sites) or y (odd sites), side 1 to larger. Zero where
        there is no half-cut: outside of the patch, and along its outline.
        """
        rows, columns = self.a.shape
        half = np.zeros((2 * rows + 1, 2 * columns + 1, 2))
        half[1::2, 1::2, :] = self.a[:, :, None]
        # Corners, not on the proximal and distal outline: each half averages its two cells.
        pair = 0.5 * (self.a[:-1] + self.a[1:])
        half[2:-1:2, 2::2, 0] = pair
        half[2:-1:2, :-1:2, 1] = pair
        # Upright cuts on upright cell edges: averaged. Across level edges: skewed.
        half[1::2, 2:-1:2, :] = 0.5 * (self.b[:, :-1] + self.b[:, 1:])[:, :, None]
        half[2::2, 1::2, 0] = self.b
        half[:-1:2, 1::2, 1] = self.b
        return half

    def half_cuts(self) -> HalfCuts:
        """Every half-cut of positive length, in patch coordinates, ordered by q, p, side."""
        half = self.half_fractions()
        q, p, side = np.nonzero(half > 0)
        sign = 2.0 * side - 1.0
        even = (p + q) % 2 == 0
        direction = np.column_stack([np.where(even, sign, 0.0), np.where(even, 0.0, sign)])
        facet_mm = self.cell_mm / 2
        return HalfCuts(
            position_mm=facet_mm * np.column_stack([p, q]).astype(np.float64),
            direction=direction,
            length_mm=facet_mm * half[q, p, side],
            site=np.column_stack([p, q]).astype(np.int64),
        )

    def facet_half_cuts(self) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """The four half-cuts on the edges of every facet, and which facets are mirror images.

        Facet (i, j) lies between the sites (j, i) and (j + 1, i + 1). Where i + j is even its
        edges are walked counter-clockwise in (x, y) from the site (j, i), where odd clockwise
        from (j + 1, i): so every edge starts in the site whose half-cut lies along it.

        Returns:
            (2R, 2C, 4) lengths / half a cell, in walking order, and (2R, 2C) mirrored.
        """
        half = self.half_fractions()
        plain = np.stack(
            [half[:-1, :-1, 1], half[:-1, 1:, 1], half[1:, 1:, 0], half[1:, :-1, 0]], axis=-1
        )
        mirror = np.stack(
            [half[:-1, 1:, 0], half[:-1, :-1, 1], half[1:, :-1, 1], half[1:, 1:, 0]], axis=-1
        )
        rows, columns = plain.shape[:2]
        mirrored = (np.arange(rows)[:, None] + np.arange(columns)[None, :]) % 2 == 1
        return np.where(mirrored[:, :, None], mirror, plain), mirrored

    @property
    def minimum_gap_mm(self) -> float:
        """Shortest distance from a cut tip to the next cut or to the outline, mm.

        Each half-cut points at the site half a cell away, whose cut runs across its way (or at
        the outline): the gap is half a cell less the longest half-cut. It is a lower bound
        where the cut at that site has length zero.
        """
        return float(self.cell_mm / 2 * (1.0 - self.half_fractions().max()))

    def feasible(self, ligament_mm: float, kerf_mm: float = 0.0) -> bool:
        """Whether every ligament is at least ``ligament_mm`` wide after a kerf of ``kerf_mm``.

        The kerf widens the cut that a tip points at by half of itself. A cut that is
        compensated for the kerf at its own tips loses no more than that.
        """
        return self.minimum_gap_mm - kerf_mm / 2 >= ligament_mm * (1 - 1e-12)


def longest_cut(cell_mm: float, ligament_mm: float, kerf_mm: float = 0.0) -> float:
    """Longest feasible cut / cell edge: 1 - (2 ligament + kerf) / L, at least 0."""
    return max(0.0, 1.0 - (2.0 * ligament_mm + kerf_mm) / cell_mm)


def draw_svg(cut_map: CutMap, *, stroke_mm: float = 0.15, margin_mm: float = 2.0) -> str:
    """The outline and the cuts as an SVG text in millimetres (a 1:1 viewBox)."""
    width, length = cut_map.size_mm
    cuts = cut_map.half_cuts().cuts()
    lines = "".join(
        f"M{x0:.4g} {y0:.4g}L{x1:.4g} {y1:.4g}"
        for (x0, y0), (x1, y1) in zip(cuts.start_mm, cuts.end_mm, strict=True)
    )
    across = width + 2 * margin_mm
    along = length + 2 * margin_mm
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{across:g}mm" height="{along:g}mm" '
        f'viewBox="{-margin_mm:g} {-margin_mm:g} {across:g} {along:g}">\n'
        f"<title>{len(cuts)} cuts on {width:g} x {length:g} mm</title>\n"
        f'<rect width="{width:g}" height="{length:g}" fill="#f4efe6" stroke="#444" '
        f'stroke-width="{stroke_mm:g}"/>\n'
        f'<path d="{lines}" fill="none" stroke="#c00" stroke-width="{stroke_mm:g}"/>\n</svg>\n'
    )
