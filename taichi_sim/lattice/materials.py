"""Materials of a beam lattice and the beam constants of a pair of materials.

Source: Hiller & Lipson, "Dynamic Simulation of Soft Multimaterial 3D-Printed Objects", Soft Robotics 1(1), 2014.
"""

from dataclasses import dataclass

import numpy as np

from taichi_sim.autodiff.tracing import law, sqrt
from taichi_sim.base.checks import number, numbers, positive
from taichi_sim.lattice.program import QUANTITY_COUNT, Quantity
from taichi_sim.runtime import ti


@dataclass(frozen=True)
class Material:
    """An isotropic elastic material of a lattice body; a voxel of it is a point mass with rotational inertia.

    Attributes:
        youngs_modulus: E [Pa].
        density: rho [kg/m^3].
        poissons_ratio: nu, dimensionless, 0 to below 0.5.
        static_friction: Coulomb coefficient mu_s against the floor.
        kinetic_friction: Coulomb coefficient mu_k against the floor.
        internal_damping: zeta_i, damping zeta_i sqrt(m E_l h) of a link of stiffness E_l h. A voxel whose neighbour
            is held has zeta_i / 2 of critical damping, two free ones zeta_i / sqrt(2). More than 1 takes shorter time
            steps. Two materials have the mean zeta_i, and m = 2 m1 m2 / (m1 + m2); see ``LatticeBody.links``.
        global_damping: zeta_g, damping 2 zeta_g sqrt(m E h) against the world; critical at 1 on a spring E h.
        collision_damping: zeta_c, damping 2 zeta_c sqrt(m E h) of contact, whose stiffness is 2 E h: two free voxels
            have zeta_c of critical damping, one on the floor zeta_c / sqrt(2). Two materials have the mean damping.
        scale: rest size per axis (x, y, z) in voxel edges; the mass does not change with it.
        thermal_expansion: alpha [1/K].
        temperature: T relative to the stress-free state [K].
        name: name of the material for people.

    Raises:
        ValueError: for a value that is not allowed.
    """

    youngs_modulus: float
    density: float
    poissons_ratio: float = 0.0
    static_friction: float = 0.0
    kinetic_friction: float = 0.0
    internal_damping: float = 1.0
    global_damping: float = 0.0
    collision_damping: float = 1.0
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    thermal_expansion: float = 0.0
    temperature: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", tuple(numbers("scale", self.scale, 3).tolist()))
        for name in ("youngs_modulus", "density"):
            positive(name, getattr(self, name))
        for name in ("static_friction", "kinetic_friction", "internal_damping", "global_damping", "collision_damping"):
            number(name, getattr(self, name), 0.0)
        for name in ("poissons_ratio", "thermal_expansion", "temperature"):
            number(name, getattr(self, name))
        if not 0 <= self.poissons_ratio < 0.5:
            raise ValueError(
                f"poissons_ratio: {self.poissons_ratio!r} is not allowed; it must be at least 0 and below 0.5"
            )
        if min(self.scale) <= 0:
            raise ValueError(f"scale: {self.scale!r} is not allowed; give three positive numbers")
        if 1 + self.thermal_expansion * self.temperature <= 0:
            raise ValueError(f"temperature: {self.temperature!r} shrinks the material to nothing")


# What becomes of each field: the laws of the tables take those of the first two in the order of their arguments, and a
# channel of the last holds the field until an event sets it (``scale`` has one per axis).
VOXEL_FIELDS = ("youngs_modulus", "density", "collision_damping", "thermal_expansion", "poissons_ratio")
BEAM_FIELDS = ("youngs_modulus", "density", "poissons_ratio", "internal_damping")
CHANNEL_FIELDS = {
    "scale": Quantity.SCALE,
    "temperature": Quantity.TEMPERATURE,
    "static_friction": Quantity.STATIC_FRICTION,
    "kinetic_friction": Quantity.KINETIC_FRICTION,
    "global_damping": Quantity.GLOBAL_DAMPING,
}


def channel_values(material: Material) -> np.ndarray:
    """What each channel of a region of this material holds before any event, shape (25,)."""
    values = np.zeros(QUANTITY_COUNT)
    for name, quantity in CHANNEL_FIELDS.items():
        held = getattr(material, name)
        values[quantity : quantity + np.size(held)] = held
    return values


# Columns of the table of beam constants, one row per pair of materials.
AXIAL, TRANSVERSE, STIFF, DAMP_MINUS, DAMP_PLUS, TWIST, TWIST_ROOT, SHARE_MINUS, SHARE_PLUS, BEAM_COLUMNS = range(10)


def voxel_mass(material: Material, edge: float) -> float:
    """m = rho h^3 [kg]."""
    return material.density * edge**3


def link_modulus(minus: Material, plus: Material) -> float:
    """Springs in series: E_l = 2 E- E+ / (E- + E+) [Pa]."""
    return 2 * minus.youngs_modulus * plus.youngs_modulus / (minus.youngs_modulus + plus.youngs_modulus)


def axial_stiffness_modulus(minus: Material, plus: Material) -> float:
    """E_l / ((1 - 2 nu)(1 + nu)) [Pa]; E_l itself for nu = 0."""
    nu = (minus.poissons_ratio + plus.poissons_ratio) / 2
    return link_modulus(minus, plus) / ((1 - 2 * nu) * (1 + nu))


@law
def beam_row(e1, rho1, nu1, zeta1, e2, rho2, nu2, zeta2, edge, time_step, own: ti.template()):
    """Constants of the Euler-Bernoulli beam between two voxels of edge h, of the materials 1 ("-" end) and 2.

    Returns:
        A row of the columns above (Hiller & Lipson, eq. 6-13, for a square beam as long as it is wide):
        forces E^ (1 - nu) h^2 and E^ nu h^2 per strain; b1 = E_l h; g sqrt(E_l h) with g = 2 sqrt(m) zeta / dt for
        both ends; the twisting stiffness a2 and sqrt(a2 h^2 / 6) / sqrt(E_l h); the ends' shares of the link strain.
        E_l = 2 E1 E2 / (E1 + E2) are springs in series, E^ = E_l / ((1 - 2 nu)(1 + nu)). Zeta is the mean zeta_i and
        m = 2 m1 m2 / (m1 + m2), with which two free voxels have the damping zeta / sqrt(2) whatever their masses. As
        published (``own``) m and zeta are those of each end, and a link of unlike ends pushes its body along.
    """
    volume = edge * edge * edge
    total = e1 + e2
    e = 2.0 * e1 * e2 / total
    nu = 0.5 * (nu1 + nu2)
    pressed = e / ((1.0 - 2.0 * nu) * (1.0 + nu)) * edge * edge
    stiff = e * edge
    root = sqrt(stiff)
    a2 = e * volume / (12.0 * (1.0 + nu))
    shared = sqrt(rho1 * (2.0 * rho2 / (rho1 + rho2)) * volume) * (0.5 * (zeta1 + zeta2))
    minus = shared
    plus = shared
    if ti.static(own):
        minus = sqrt(rho1 * volume) * zeta1
        plus = sqrt(rho2 * volume) * zeta2
    return (
        pressed * (1.0 - nu),
        pressed * nu,
        stiff,
        2.0 * minus / time_step * root,
        2.0 * plus / time_step * root,
        a2,
        sqrt(a2 * edge * edge / 6.0) / root,
        2.0 * e2 / total,
        2.0 * e1 / total,
    )


def beam_constants(minus: Material, plus: Material, edge: float, time_step: float, own: bool = False) -> np.ndarray:
    """:func:`beam_row` of two materials, edge h [m], time step dt [s]."""
    ends = [getattr(material, name) for material in (minus, plus) for name in BEAM_FIELDS]
    return np.array(beam_row(*ends, edge, time_step, own))


# Columns of the table of voxel constants, one row per group of voxels.
INVERSE_MASS, INVERSE_INERTIA, MASS, CRITICAL_TRANSLATION, CRITICAL_ROTATION = range(5)
STIFFNESS, CONTACT_DAMPING, EXPANSION, NU, CONSTANT_COLUMNS = range(5, 10)


@law
def voxel_row(e, rho, zeta_c, alpha, nu, edge):
    """Constants of one voxel: masses, critical damping coefficients 2 sqrt(m E h) and 2 sqrt(I E h^3), contact."""
    volume = edge * edge * edge
    mass = rho * volume
    inertia = mass * edge * edge / 6.0
    critical = 2.0 * sqrt(mass * e * edge)
    return (
        1.0 / mass,
        1.0 / inertia,
        mass,
        critical,
        2.0 * sqrt(inertia * e * volume),
        2.0 * e * edge,
        zeta_c * critical,
        alpha,
        nu,
    )


def voxel_constants(material: Material, edge: float) -> np.ndarray:
    """:func:`voxel_row` of a material, edge h [m]."""
    return np.array(voxel_row(*(getattr(material, name) for name in VOXEL_FIELDS), edge))
