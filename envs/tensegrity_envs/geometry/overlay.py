"""Images of regions under a map of the plane: the faces that their boundaries cut out, and preimages of each face.

A map without a fold inside a region sends as many points of it to P as the image of its boundary winds around P. So
the image of each sheet is known from its boundary alone, and all sheets together cut the plane into finitely many faces
with a constant number of preimages.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.geometry.regions import Map, Traced, signed_area

PRECISION = 1e-9  # coordinates are rounded to this, relative to the size of the picture, so that equal curves are equal


def cut(curves: Iterable[np.ndarray], precision: float = PRECISION) -> list[shapely.Polygon]:
    """The bounded faces of the plane cut along curves.

    Args:
        curves: polygonal chains, each of shape (n, 2); they may cross, touch, overlap and dangle.
        precision: coordinates are rounded to it, relative to the size of all curves; faces thinner than a few times
            that are rounding between two curves that should be one, and are left out.

    Returns:
        Polygons without common interior points.
    """
    chains = [np.asarray(curve, float) for curve in curves if len(curve) > 1]
    if not chains:
        return []
    points = np.concatenate(chains)
    grid = precision * max(float(np.ptp(points, axis=0).max()), 1e-300)
    lines = [shapely.linestrings(chain) for chain in chains]
    noded = shapely.unary_union(shapely.multilinestrings(lines), grid_size=grid)
    faces = shapely.get_parts(shapely.polygonize([noded]))
    thin = 2 * shapely.area(faces) < 8 * grid * shapely.length(faces)
    return list(faces[~thin])


def closed(points: np.ndarray) -> np.ndarray:
    """A ring with its first point once more at the end."""
    return np.concatenate([points, points[:1]])


def winding_numbers(rings: Sequence[np.ndarray], points: np.ndarray) -> np.ndarray:
    """How often closed curves, together, run around points, counter-clockwise positive.

    Args:
        rings: arrays of shape (n, 2), the last point joined to the first.
        points: shape (m, 2), none of them on a curve.

    Returns:
        shape (m,), integers.
    """
    total = np.zeros(len(points), int)
    for ring in rings:
        x, y = ring.T
        nx, ny = np.roll(x, -1), np.roll(y, -1)
        for block in np.array_split(np.arange(len(points)), max(1, len(points) * len(x) // 4_000_000)):
            px, py = points[block, 0, None], points[block, 1, None]
            left = (nx - x) * (py - y) - (px - x) * (ny - y)
            up, down = (y <= py) & (ny > py), (y > py) & (ny <= py)
            total[block] += (up & (left > 0)).sum(axis=1) - (down & (left < 0)).sum(axis=1)
    return total


def chord_area(points: np.ndarray) -> tuple[float, float]:
    """The area between a smooth curve and its chords, signed and without regard to sign, from the chords' bends.

    Args:
        points: of the curve, shape (n, 2).
    """
    u, v = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    triangles = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    # Leaving out every second point would lose every second triangle; parabolas lose a third of it at the chords. A
    # sharp bend is a corner of the curve, where there is nothing to add.
    smooth = (u * v).sum(axis=1) > 0.9 * np.hypot(*u.T) * np.hypot(*v.T)
    return float(triangles[smooth].sum()) / 6, float(np.abs(triangles[smooth]).sum()) / 6


@dataclass(frozen=True)
class Face:
    """A piece of the plane whose points have the same number of preimages on each sheet."""

    polygon: shapely.Polygon
    counts: tuple[int, ...]

    @property
    def count(self) -> int:
        """Preimages on all sheets."""
        return sum(self.counts)


@dataclass(frozen=True)
class SheetImage:
    """The image of one sheet.

    Attributes:
        name: of the sheet.
        source: the sheet.
        rings: images of its boundary curves, shape (n, 2) each.
        area: counted with multiplicity, between the curves, not their chords.
        area_error: estimate: for the polygons of the chords, or of what they have missed, if that is more.
    """

    name: str
    source: Traced
    rings: tuple[np.ndarray, ...]
    area: float
    area_error: float


@dataclass(frozen=True)
class Image:
    """The images of several sheets, and the faces they cut out.

    Attributes:
        sheets: each mapped without folds.
        faces: bounded faces, those with no preimage (holes) included.
        area_error: estimate for each of the areas, from the chords of all curves and what they miss.
    """

    sheets: tuple[SheetImage, ...]
    faces: tuple[Face, ...]
    area_error: float

    def area(self, wanted: Callable[[Face], bool] = lambda face: face.count > 0) -> float:
        """Total area of the faces that are wanted; by default of all that can be reached."""
        return float(sum(face.polygon.area for face in self.faces if wanted(face)))

    @property
    def overlap(self) -> float:
        """Area that is reached at least twice."""
        return self.area(lambda face: face.count > 1)

    @cached_property
    def most(self) -> tuple[int, ...]:
        """The largest number of preimages on each sheet, and on all together last."""
        found = [max((face.counts[k] for face in self.faces), default=0) for k in range(len(self.sheets))]
        return (*found, max((face.count for face in self.faces), default=0))

    @cached_property
    def regions(self) -> dict[int, shapely.Geometry]:
        """The plane by number of preimages: shapely polygons, each count's faces in one."""
        counts = sorted({face.count for face in self.faces} - {0})
        return {n: union([face.polygon for face in self.faces if face.count == n]) for n in counts}

    @cached_property
    def reachable(self) -> shapely.Geometry:
        """All points with a preimage, as one shapely geometry."""
        return union([face.polygon for face in self.faces if face.count > 0])

    @cached_property
    def holes(self) -> list[shapely.Polygon]:
        """What is enclosed by points with a preimage and has none, largest first."""
        polygons = shapely.get_parts(self.reachable)
        found = [shapely.Polygon(ring) for polygon in polygons for ring in polygon.interiors]
        return sorted(found, key=lambda hole: -hole.area)

    def count(self, x: Component, y: Component) -> np.ndarray:
        """Number of preimages of points, elementwise."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        found = np.zeros(x.shape, int)
        for face in self.faces:
            if face.count:
                found[shapely.contains_xy(face.polygon, x, y)] = face.count
        return found

    def along(self, start: tuple[float, float], end: tuple[float, float]) -> list[tuple[np.ndarray, np.ndarray, int]]:
        """Where a straight line runs through the image: from, to, and the number of preimages in between."""
        line = shapely.LineString([start, end])
        direction = np.subtract(end, start)
        pieces: list[tuple[float, np.ndarray, np.ndarray, int]] = []
        for n, region in self.regions.items():
            for part in shapely.get_parts(shapely.intersection(line, region)):
                ends = shapely.get_coordinates(part)
                if len(ends) > 1:
                    ends = ends[np.argsort(ends @ direction)]
                    pieces.append((float(ends[0] @ direction), ends[0], ends[-1], n))
        return [piece[1:] for piece in sorted(pieces, key=lambda piece: piece[0])]

    def to_features(self, **properties: Any) -> list[dict[str, Any]]:
        """GeoJSON features by number of preimages."""
        return [
            feature(region, {"configurations": n, "area": region.area} | properties)
            for n, region in self.regions.items()
        ]


def union(polygons: Sequence[shapely.Geometry]) -> shapely.Geometry:
    """Faces in one geometry; their common edges are equal point by point, so nothing is rounded."""
    return shapely.coverage_union_all(np.array(polygons, object)) if len(polygons) else shapely.Polygon()


def feature(geometry: shapely.Geometry, properties: Mapping[str, Any]) -> dict[str, Any]:
    """A GeoJSON feature of a shapely geometry."""
    return {"type": "Feature", "geometry": shapely.geometry.mapping(geometry), "properties": dict(properties)}


def feature_collection(features: Sequence[Mapping[str, Any]], **properties: Any) -> dict[str, Any]:
    """A GeoJSON document. Its coordinates are metres or radians, not longitude and latitude."""
    return {"type": "FeatureCollection", "properties": properties, "features": list(features)}


def image(sheets: Mapping[str, Traced], mapping: Map, precision: float = PRECISION) -> Image:
    """Images of sheets under a map that folds none of them.

    Args:
        sheets: traced regions, by name.
        mapping: (q1, q2) -> (x, y), elementwise, differentiable, with a determinant of one sign on each sheet.
        precision: see `cut`.
    """
    mapped: list[SheetImage] = []
    for name, traced in sheets.items():
        rings = tuple(
            np.stack([np.broadcast_to(v, len(r.points)) for v in mapping((r.points[:, 0], r.points[:, 1]))], axis=1)
            for r in traced.rings
        )
        area, error = 0.0, 0.0
        for ring in rings:
            bulge, part = chord_area(closed(ring))
            area += signed_area(ring) + bulge
            error += part
        mapped.append(SheetImage(name, traced, rings, abs(area), max(error, traced.missed_in_image)))
    everything = [closed(ring) for sheet in mapped for ring in sheet.rings]
    polygons = cut(everything, precision)
    inside = np.array([[*p.representative_point().coords[0]] for p in polygons]).reshape(-1, 2)
    counts = [np.abs(winding_numbers(sheet.rings, inside)) for sheet in mapped]
    faces = tuple(Face(p, tuple(int(n[k]) for n in counts)) for k, p in enumerate(polygons))
    return Image(tuple(mapped), faces, sum(sheet.area_error for sheet in mapped))
