"""Write robots for VoxCAD (``.vxa``): a body of layers, a palette, and a temperature that drives it.

Numbers are written in full, so that ``read_vxa`` restores them to the bit.
"""

from dataclasses import replace
from xml.sax.saxutils import escape

import numpy as np

from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.lattice.files.arrays import array_of_body
from taichi_sim.lattice.files.voxel_file import Heat, VoxelFile
from taichi_sim.lattice.materials import Material

MOST_MATERIALS = 70  # layers have a character a voxel, from "0" on, and some later ones are no plain text
_DAMPING = ("internal_damping", "collision_damping", "global_damping")


def write_vxa(file: VoxelFile) -> str:
    """Write a robot as the text of a ``.vxa`` file.

    Raises:
        ValueError: for what the format cannot express; the message does not name the file.
    """
    body = file.body
    _check(file)
    held = np.asarray(np.asarray(body.fixed, bool).any(axis=1))
    palette, numbers = _palette(body.material_index, held)
    if len(palette) > MOST_MATERIALS:
        raise ValueError(f"materials: {len(palette)} are not allowed in a .vxa; the most is {MOST_MATERIALS}")
    kinds = array_of_body(body)
    places = tuple((body.voxels - body.voxels.min(axis=0)).T)
    kinds[places] = numbers + 1
    materials = "\n".join(
        _material(n, body.materials[index], file.colours[index], fixed) for n, (index, fixed) in enumerate(palette, 1)
    )
    phases = np.zeros(kinds.shape)
    if file.heat is not None:
        phases[places] = file.heat.phase
    damping = body.materials[palette[0][0]]
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<VXA Version="1.0">
<Simulator>
<Damping><BondDampingZ>{damping.internal_damping!r}</BondDampingZ><ColDampingZ>{damping.collision_damping!r}\
</ColDampingZ><SlowDampingZ>{damping.global_damping!r}</SlowDampingZ></Damping>
<Collisions><SelfColEnabled>1</SelfColEnabled></Collisions>
{_features(file)}</Simulator>
<Environment>
{_gravity(file)}{_thermal(file.heat)}</Environment>
<VXC Version="0.93">
<Lattice><Lattice_Dim>{body.voxel_size!r}</Lattice_Dim></Lattice>
<Palette>
{materials}
</Palette>
{_structure(kinds, phases, file.heat is not None)}
</VXC>
</VXA>
"""


def _check(file: VoxelFile) -> None:
    """Refuse what the format has no place for."""
    body = file.body
    used = [body.materials[n] for n in np.unique(body.material_index).tolist()]
    if len(body.cut_links):
        raise ValueError(f"cut_links: {len(body.cut_links)} are not allowed in a .vxa; leave them out")
    if body.is_balanced:
        raise ValueError("links: balanced is not allowed in a .vxa, whose readers know none; give a .vxl.json")
    if any(np.any(load) for load in (file.force, file.moment, file.displacement)):
        raise ValueError("loads: forces and displacements are not allowed in a .vxa; give a .vxl.json")
    held = np.asarray(body.fixed, bool)
    if (held.any(axis=1) != held.all(axis=1)).any():
        raise ValueError("fixed: some degrees of freedom of a voxel are not allowed in a .vxa; hold all six, or none")
    for material in used:
        if material.scale != (1.0, 1.0, 1.0) or material.temperature:
            name = material.name or "a material"
            raise ValueError(f"scale: {material.scale} of {name} is not allowed in a .vxa, nor a temperature; give 1")
    dampings = {tuple(getattr(material, name) for name in _DAMPING) for material in used}
    if len(dampings) > 1:
        raise ValueError("damping: materials of a .vxa have one in common; give all the same")
    if file.heat is not None and file.heat.mean and file.heat.amplitude:
        raise ValueError(f"mean: {file.heat.mean:g} K is not allowed in a .vxa; temperatures swing about 0")


def _palette(index: Ints, held: Bools) -> tuple[list[tuple[int, bool]], Ints]:
    """Materials by their number and whether their voxels are held, and which one each voxel has."""
    kinds, found = np.unique(np.column_stack([index, held]), axis=0, return_inverse=True)
    return [(int(number), bool(fixed)) for number, fixed in kinds], found.reshape(-1)


def _material(number: int, material: Material, colour: Ints, fixed: bool) -> str:
    red, green, blue, alpha = (float(part) / 255 for part in colour)
    return (
        f'<Material ID="{number}"><MatType>0</MatType><Name>{escape(material.name)}</Name><Display><Red>{red!r}</Red>'
        f"<Green>{green!r}</Green><Blue>{blue!r}</Blue><Alpha>{alpha!r}</Alpha></Display><Mechanical>"
        f"<MatModel>0</MatModel><Elastic_Mod>{float(material.youngs_modulus)!r}</Elastic_Mod>"
        f"<Density>{float(material.density)!r}</Density><Poissons_Ratio>{float(material.poissons_ratio)!r}"
        f"</Poissons_Ratio><CTE>{float(material.thermal_expansion)!r}</CTE>"
        f"<uStatic>{float(material.static_friction)!r}</uStatic><uDynamic>{float(material.kinetic_friction)!r}"
        f"</uDynamic>{'<Fixed>1</Fixed>' if fixed else ''}</Mechanical></Material>"
    )


def _features(file: VoxelFile) -> str:
    """What simulators leave out unless they are told: Poisson's effect, and swelling with heat in voxcraft."""
    squeezed = any(material.poissons_ratio for material in file.body.materials)
    effects = "<Features><VolumeEffectsEnabled>1</VolumeEffectsEnabled></Features>\n" if squeezed else ""
    return effects + ("<EnableExpansion>1</EnableExpansion>\n" if file.heat is not None else "")


def _gravity(file: VoxelFile) -> str:
    if file.gravity is None and file.floor is None:
        return ""
    pull = "" if file.gravity is None else f"<GravEnabled>1</GravEnabled><GravAcc>{-float(file.gravity)!r}</GravAcc>"
    floor = "" if file.floor is None else f"<FloorEnabled>{int(file.floor)}</FloorEnabled>"
    return f"<Gravity>{pull}{floor}</Gravity>\n"


def _thermal(heat: Heat | None) -> str:
    if heat is None:
        return ""
    amplitude = float(heat.amplitude or heat.mean)
    return (
        f"<Thermal><TempEnabled>1</TempEnabled><TempAmplitude>{amplitude!r}</TempAmplitude>"
        f"<TempAmp>{amplitude!r}</TempAmp>"
        f"<TempBase>0</TempBase><VaryTempEnabled>{int(heat.amplitude != 0)}</VaryTempEnabled>"
        f"<TempPeriod>{float(heat.period)!r}</TempPeriod></Thermal>\n"
    )


def _structure(kinds: Ints, phases: Floats, driven: bool) -> str:
    data = ["".join(chr(ord("0") + n) for n in layer.T.ravel().tolist()) for layer in np.moveaxis(kinds, 2, 0)]
    sizes = "".join(f"<{axis}_Voxels>{n}</{axis}_Voxels>" for axis, n in zip("XYZ", kinds.shape, strict=True))
    texts = [layer.replace("]]>", "]]]]><![CDATA[>") for layer in data]  # these three end a CDATA
    layers = "".join(f"<Layer><![CDATA[{text}]]></Layer>\n" for text in texts)
    offsets = ""
    if driven:
        told = [",".join(map(repr, layer.T.ravel().tolist())) for layer in np.moveaxis(phases, 2, 0)]
        offsets = (
            "<PhaseOffset>\n" + "".join(f"<Layer><![CDATA[{row}]]></Layer>\n" for row in told) + "</PhaseOffset>\n"
        )
    return f'<Structure Compression="ASCII_READABLE">{sizes}\n<Data>\n{layers}</Data>\n{offsets}</Structure>'


def with_expansions(file: VoxelFile, expansions: Floats) -> VoxelFile:
    """The file with a thermal expansion for each voxel [1/K], shape (V,): materials are split by it.

    Args:
        file: with a body.
        expansions: of all voxels; those of its materials no longer count.
    """
    body = file.body
    table = np.column_stack([body.material_index, expansions])
    kinds, index = np.unique(table, axis=0, return_inverse=True)
    numbers = kinds[:, 0].astype(int)
    materials = tuple(
        replace(body.materials[n], thermal_expansion=expansion)
        for n, expansion in zip(numbers.tolist(), kinds[:, 1].tolist(), strict=True)
    )
    changed = replace(body, materials=materials, material_index=index.reshape(-1))
    return replace(file, body=changed, colours=file.colours[numbers])
