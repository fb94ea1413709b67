"""Random bodies: blobs, snakes, boxes, islands, folded sheets and closed skins, of random materials."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from taichi_sim.lattice import LatticeBody, Material
from taichi_sim.lattice.laws.enclosure import closed_surface
from taichi_sim.lattice.topology import SIDES

EDGE = 0.01  # m
FLOATING = ("fluid", "water", "wet sand")  # where pressure acts on closed surfaces only


def draw_shape(rng: np.random.Generator, around: str) -> tuple[str, np.ndarray, np.ndarray | None, np.ndarray | None]:
    """A kind of shape, its voxels, the chambers of closed skins, and links to be cut as pairs of places."""
    kinds = ("blob", "snake", "box", "islands", "folded sheet", "skin", "two skins", "pouch")
    shares = (0.25, 0.2, 0.1, 0.1, 0.15, 0.1, 0.05, 0.05)
    kind = str(rng.choice(kinds, p=shares))
    if kind == "skin":
        return kind, hollow(rng.integers(3, 5, 3)), None, None
    if kind == "two skins":
        one, two = hollow(np.array([3, 3, 3])), hollow(np.array([3, 3, rng.integers(3, 4)]))
        voxels = np.concatenate([one, two + np.array([3, 0, 0])])
        return kind, voxels, np.repeat([0, 1], [len(one), len(two)]), None
    if kind == "pouch":
        size = rng.integers(3, 6, 2)
        sheet = np.argwhere(np.ones((*size, 1), bool))
        inner = ((sheet[:, :2] > 0) & (sheet[:, :2] < size - 1)).all(axis=1)
        low = np.flatnonzero(inner)
        return (
            kind,
            np.concatenate([sheet, sheet + np.array([0, 0, 1])]),
            None,
            np.stack([low, low + len(sheet)], axis=1),
        )
    if kind == "box":
        return kind, np.argwhere(np.ones(rng.integers(1, 5, 3), bool)), None, None
    if kind == "snake":
        return kind, snake(rng, int(rng.integers(3, 40))), None, None
    if kind == "islands":
        parts = [blob(rng, int(rng.integers(1, 12))) for _ in range(int(rng.integers(2, 5)))]
        tops = np.cumsum([0, *(np.ptp(p[:, 2]) + 2 for p in parts[:-1])])
        moved = [p - [0, 0, p[:, 2].min()] + [0, 0, top] for p, top in zip(parts, tops, strict=True)]
        return kind, np.concatenate(moved), None, None
    if kind == "folded sheet":
        length, width = rng.integers(4, 9), rng.integers(1, 4)
        places = [(x, y, z) for z in (0, 2) for x in range(length) for y in range(width)]
        return kind, np.array(places + [(0, y, 1) for y in range(width)]), None, None
    return kind, blob(rng, int(rng.integers(3, 60))), None, None


def hollow(size: np.ndarray) -> np.ndarray:
    """Voxels of a box of walls one voxel thick."""
    filled = np.ones(size, bool)
    filled[1:-1, 1:-1, 1:-1] = False
    return np.argwhere(filled)


def blob(rng: np.random.Generator, count: int) -> np.ndarray:
    """So many connected voxels, grown at random sides, in a random order."""
    places = [(0, 0, 0)]
    known = set(places)
    while len(places) < count:
        place = tuple((np.array(places[rng.integers(len(places))]) + SIDES[rng.integers(6)]).tolist())
        if place not in known:
            known.add(place)
            places.append(place)
    found = rng.permutation(np.array(places))
    return found - [0, 0, found[:, 2].min()]


def snake(rng: np.random.Generator, count: int) -> np.ndarray:
    """A random walk that seldom turns and never crosses itself."""
    places, way = [(0, 0, 0)], SIDES[rng.integers(6)]
    known = set(places)
    for _ in range(10 * count):
        if len(places) == count:
            break
        way = SIDES[rng.integers(6)] if rng.random() < 0.3 else way
        place = tuple((np.array(places[-1]) + way).tolist())
        if place in known:
            way = SIDES[rng.integers(6)]
            continue
        known.add(place)
        places.append(place)
    found = np.array(places)
    return found - [0, 0, found[:, 2].min()]


def draw_body(
    rng: np.random.Generator,
    around: str,
    shape: str,
    voxels: np.ndarray,
    chambers: np.ndarray | None,
    cuts: np.ndarray | None,
) -> tuple[LatticeBody, list[str]]:
    """A body of a shape, and words for what it has."""
    count, features = len(voxels), []
    poisson = rng.random() < 0.3
    materials = tuple(draw_material(rng, poisson) for _ in range(int(rng.integers(1, 4))))
    regions = rng.integers(0, min(count, int(rng.integers(1, 6))), count)
    if rng.random() < 0.05:
        regions = np.arange(count)
        features.append("a region per voxel")
    fixed = np.zeros((count, 6), bool)
    if rng.random() < 0.25:
        held = rng.choice(count, int(rng.integers(1, 1 + max(1, count // 4))), replace=False)
        fixed[held] = rng.random((len(held), 6)) < rng.choice([0.4, 1.0])
        features.append("held")
    body = LatticeBody(
        voxels=voxels,
        materials=materials,
        material_index=rng.integers(0, len(materials), count),
        voxel_size=EDGE,
        regions=regions,
        fixed=fixed,
        pressure_normals=None,
        chambers=chambers,
        cut_links=np.zeros((0, 2), int) if cuts is None else cuts,
    )
    closed = shape in ("skin", "two skins", "pouch")
    if not closed and len(body.topology.links) and rng.random() < 0.3:
        links = body.topology.links
        chosen = rng.choice(len(links), int(rng.integers(1, 1 + max(1, len(links) // 5))), replace=False)
        body = replace(body, cut_links=links[chosen])
        features.append("cut links")
    if closed:
        body = replace(body, pressure_normals=out_of_boxes(body))
        closed_surface(body)  # refuses a skin that is open
        features.append("chambers" if body.has_chambers else "closed skin")
    elif around not in FLOATING and rng.random() < 0.4:
        body = replace(body, pressure_normals=outward(body) * (rng.random((count, 1)) < 0.5))
        features.append("pressed faces")
    features += ["Poisson"] * poisson + ["materials"] * (len(materials) > 1)
    return body, features


def outward(body: LatticeBody) -> np.ndarray:
    """Sum of the normals of the exposed faces of every voxel, -1 to 1 along each axis."""
    normals = np.zeros((body.voxel_count, 3), int)
    voxel, side = body.topology.faces.T
    np.add.at(normals, voxel, SIDES[side])
    return np.clip(normals, -1, 1)


def out_of_boxes(body: LatticeBody) -> np.ndarray:
    """The outward normals of the walls of boxes, one per chamber."""
    normals = np.zeros((body.voxel_count, 3), int)
    for chamber in np.unique(np.asarray(body.chambers)):
        rows = np.asarray(body.chambers) == chamber
        inside = body.voxels[rows]
        normals[rows] = (inside == inside.max(axis=0)).astype(int) - (inside == inside.min(axis=0))
    return normals


def draw_material(rng: np.random.Generator, poisson: bool) -> Material:
    """Soft to stiff, light to heavy; sometimes without friction, damping or expansion."""
    some = lambda low, high, share=0.8: float(rng.uniform(low, high)) if rng.random() < share else 0.0  # noqa: E731
    static = some(0.1, 1.2)
    return Material(
        youngs_modulus=float(10 ** rng.uniform(4, 6)),
        density=float(rng.uniform(500, 5000)),
        poissons_ratio=some(0.05, 0.4) if poisson else 0.0,
        static_friction=static,
        kinetic_friction=static * float(rng.uniform(0.3, 1.1)),
        internal_damping=some(0.2, 1.0),
        global_damping=some(0.0, 0.02, 0.5),
        collision_damping=some(0.2, 1.0),
        scale=tuple(rng.uniform(0.97, 1.03, 3).tolist()) if rng.random() < 0.3 else (1.0, 1.0, 1.0),
        thermal_expansion=some(0.0, 2e-3, 0.5),
        temperature=some(-5.0, 5.0, 0.3),
    )


def varied(rng: np.random.Generator, materials: Sequence[Material]) -> tuple[Material, ...]:
    """Like materials of another robot of the batch."""
    by = lambda: float(rng.uniform(0.7, 1.3))  # noqa: E731
    return tuple(
        replace(
            m,
            youngs_modulus=m.youngs_modulus * by(),
            density=m.density * by(),
            static_friction=m.static_friction * by(),
            internal_damping=m.internal_damping * by(),
        )
        for m in materials
    )


def closeness(body: LatticeBody) -> np.ndarray:
    """How many voxel edges parts one over the other must sink until just one is between their centres, shape (V,)."""
    x, _, z = body.voxels.T
    layers = np.isin(np.arange(z.max() + 1), z)
    if layers.all():  # a folded sheet, whose tips meet
        return np.where(z == 2, x / max(x.max(), 1), 0.0)
    gaps: np.ndarray = np.cumsum(~layers)[z]
    return gaps
