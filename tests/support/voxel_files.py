"""Texts of voxel robots, written as VoxCAD, evosoro, voxcraft and Voxelyze write them."""

import base64
import json
import zlib

import numpy as np


def layers(array, compression="ASCII_READABLE"):
    """The ``<Data>`` of an array of (X, Y, Z)."""
    written = []
    for z in range(array.shape[2]):
        values = bytes(array[:, :, z].T.ravel().astype(np.uint8))  # x fastest
        if compression == "ASCII_READABLE":
            written.append("".join(chr(v + 48) for v in values))
        else:
            packed = values if compression == "BASE64" else zlib.compress(values)
            packed = len(values).to_bytes(4, "big") + packed if compression == "QT_ZLIB" else packed
            written.append(base64.b64encode(packed).decode())
    return "<Data>" + "".join(f"<Layer><![CDATA[{text}]]></Layer>\n" for text in written) + "</Data>"


def numbers(array, name="PhaseOffset"):
    """A layer of numbers with commas after each, as evosoro writes them."""
    told = ["".join(f"{v}, " for v in array[:, :, z].T.ravel().tolist()) for z in range(array.shape[2])]
    return f"<{name}>" + "".join(f"<Layer><![CDATA[{text}]]></Layer>" for text in told) + f"</{name}>"


def material(name="muscle", modulus="1e+006", density="1e+006", cte="0.01", phase="0", more=""):
    return f"""<Material ID="1"><MatType>0</MatType><Name>{name}</Name>
<Display><Red>1</Red><Green>0.5</Green><Blue>0</Blue><Alpha>1</Alpha></Display>
<Mechanical><MatModel>0</MatModel><Elastic_Mod>{modulus}</Elastic_Mod><Plastic_Mod>0</Plastic_Mod>
<Density>{density}</Density><Poissons_Ratio>0.35</Poissons_Ratio><CTE>{cte}</CTE>
<MaterialTempPhase>{phase}</MaterialTempPhase><uStatic>1</uStatic><uDynamic>0.5</uDynamic>{more}</Mechanical></Material>
"""


def structure(array, compression="ASCII_READABLE", data=None, more="", sizes=None):
    x, y, z = sizes or array.shape
    return f"""<Structure Compression="{compression}"><X_Voxels>{x}</X_Voxels><Y_Voxels>{y}</Y_Voxels>
<Z_Voxels>{z}</Z_Voxels>{layers(array, compression) if data is None else data}{more}</Structure>"""


def vxa(array, palette=None, heat="<TempAmp>39</TempAmp><TempPeriod>0.25</TempPeriod>", body=None, head="", **more):
    return f"""<?xml version="1.0" encoding="ISO-8859-1"?>{head}
<VXA Version="1.0">
<Simulator><Integration><Integrator>0</Integrator><DtFrac>0.9</DtFrac></Integration>
<Damping><BondDampingZ>0.8</BondDampingZ><ColDampingZ>0.7</ColDampingZ><SlowDampingZ>0.01</SlowDampingZ></Damping>
<Collisions><SelfColEnabled>1</SelfColEnabled></Collisions>
<Features><VolumeEffectsEnabled>1</VolumeEffectsEnabled></Features></Simulator>
<Environment><Fixed_Regions><NumFixed>0</NumFixed></Fixed_Regions>
<Gravity><GravEnabled>1</GravEnabled><GravAcc>-9.81</GravAcc><FloorEnabled>1</FloorEnabled></Gravity>
<Thermal><TempEnabled>1</TempEnabled><TempBase>25</TempBase><VaryTempEnabled>1</VaryTempEnabled>{heat}</Thermal>
</Environment>
<VXC Version="0.93"><Lattice><Lattice_Dim>0.05</Lattice_Dim></Lattice>
<Palette>{"".join(palette or [material(), material("bone", "5e+006", cte="-0.01")])}</Palette>
{body or structure(array, **more)}</VXC></VXA>"""


def vxl(voxels, materials=None, externals=None, **more):
    """Voxelyze's JSON of rows x, y, z, material."""
    usual = {
        "name": "soft",
        "youngsModulus": 1e6,
        "density": 1e3,
        "poissonsRatio": 0.0,
        "CTE": 0.0,
        "staticFriction": 0.5,
        "kineticFriction": 0.25,
        "internalDamping": 1.0,
        "globalDamping": 0.0,
        "collisionDamping": 1.0,
        "externalScaleFactor": [1, 1, 1],
        "red": 255,
        "green": 0,
        "blue": 10,
        "alpha": 255,
    }
    document = {
        "voxelSize": 0.005,
        "materials": [usual] if materials is None else materials,
        "voxels": [int(v) for row in voxels for v in row],
        **more,
    }
    return json.dumps(document if externals is None else {**document, "externals": externals})
