"""What sand finds of the surface of a solid: its law for points, by plain formulas, and the surface itself, by sums."""

import numpy as np
from scipy.integrate import quad

from taichi_sim.rigid import Box, Capsule, Sphere


def buried_share(start, rise):
    """Share of an edge in the ground that begins at a depth and rises by so much."""
    return start / max(start, rise) if start > 0 else 0.0


def of_point(solid, number, rotation, depth, way):
    """Integral of depth by cos^2 from a way, a unit vector, over the surface of a point of a solid [m^3].

    The way is straight down, or level.
    """
    if depth <= 0:
        return 0.0
    down = way[2] < -0.5
    if isinstance(solid, Box):
        corner = solid.points()[number][0]
        edges = [-2 * x * column for x, column in zip(corner, rotation.T, strict=True)]
        found = 0.0
        for k in range(3):
            facing = max(0.0, -way @ edges[k] / np.linalg.norm(edges[k])) ** 2
            others = [edges[i] for i in range(3) if i != k]
            found += facing * np.prod([np.linalg.norm(e) * buried_share(depth, e[2]) for e in others])
        return depth * found / 4
    r, g = solid.radius, None
    if isinstance(solid, Capsule):
        axis = (2 * number - 1) * rotation @ np.asarray(solid.axis) / np.linalg.norm(solid.axis)
        g = -axis[2]

    def ring(u):
        """Depth times cos^2, of the ball's ring at cosine u from straight down, over its width."""
        facing = u * u if down else (1 - u * u) / 4
        return 2 * np.pi * r**2 * max(0.0, depth - r * (1 - u)) * facing

    edge = float(np.clip(1 - depth / r, -1, 1))
    lower = quad(ring, max(edge, 0), 1)[0]
    upper = 0.0 if down else quad(ring, min(edge, 0), 0)[0]
    if g is None:
        return lower + upper
    found = (1 + g) / 2 * lower + (1 - g) / 2 * upper
    sine = np.sqrt(1 - g * g + 1e-4 * g * g)
    deep = depth - r + r * sine

    def line(a):
        """The same of the cylinder's line at an angle from its lowest one, over its width."""
        facing = 2 * np.cos(a) ** 2 * sine**2 if down else np.sin(a) ** 2 * (1 - (axis @ way) ** 2)
        return r * max(0.0, deep - r * sine * (1 - np.cos(a))) * facing

    widest = np.arccos(np.clip(1 - deep / (r * sine), 0 if down else -1, 1)) if deep > 0 else 0.0
    return found + solid.length / 2 * buried_share(deep, solid.length * g) * quad(line, 0, widest)[0]


def whole(solid, rotation, depth, way, fine=200):
    """The same over the whole surface of a solid whose lowest place is so deep, summed over pieces of it."""
    middles = (np.arange(fine) + 0.5) / fine - 0.5
    first, second = (each.ravel() for each in np.meshgrid(middles, middles))
    parts = []  # places, normals, area of each piece
    if isinstance(solid, Box):
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            for side in (-1, 1):
                places, normals = np.zeros((2, fine**2, 3))
                places[:, i], places[:, j], places[:, k] = first, second, side / 2
                normals[:, k] = side
                parts.append((places * solid.size, normals, solid.size[i] * solid.size[j]))
    else:
        u, turn = 2 * first, 2 * np.pi * second
        ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)
        ball = ring * np.sqrt(1 - u**2)[:, None] + np.outer(u, [0, 0, 1])
        apart = np.outer(np.sign(u), [0, 0, solid.length / 2]) if isinstance(solid, Capsule) else 0.0
        parts.append((solid.radius * ball + apart, ball, 4 * np.pi * solid.radius**2))
        if isinstance(solid, Capsule):
            along = solid.radius * ring + np.outer(first, [0, 0, solid.length])
            parts.append((along, ring, 2 * np.pi * solid.radius * solid.length))
    heights = [places @ rotation[2] for places, *_ in parts]
    level = min((rotation @ centre)[2] - radius for centre, radius in solid.points()) + depth
    return sum(
        (np.maximum(0, level - height) * np.maximum(0, normals @ rotation.T @ way) ** 2).mean() * area
        for height, (_, normals, area) in zip(heights, parts, strict=True)
    )


def of_solid(solid, rotation, depth, way):
    """The sum over its points of what belongs to them, at the same depth."""
    points = solid.points()
    lowest = [(rotation @ centre)[2] - radius for centre, radius in points]
    depths = depth + min(lowest) - np.array(lowest)
    return sum(of_point(solid, n, rotation, each, way) for n, each in enumerate(depths))


SOLIDS = {"ball": Sphere(0.1), "box": Box((0.4, 0.2, 0.1)), "capsule": Capsule(0.05, 0.3)}
