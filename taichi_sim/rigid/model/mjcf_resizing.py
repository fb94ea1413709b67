"""Resize bodies within an MJCF file: places, sizes, masses and inertias are written anew, all else is left.

Source: MuJoCo documentation, "XML reference" (which attributes are lengths). Angles, drives and densities stay.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.model.mjcf import BodyRead, MjcfReader, is_free, unlike
from taichi_sim.rigid.model.xml_values import numbers, with_numbers

_POWERS = {  # of the size, by which what an attribute says grows
    "inertial": {"pos": 1, "mass": 3, "diaginertia": 5, "fullinertia": 5},
    "joint": {"pos": 1},
    "geom": {"pos": 1, "size": 1, "fromto": 1, "mass": 3},
    "site": {"pos": 1, "size": 1, "fromto": 1},
    "camera": {"pos": 1},
    "light": {"pos": 1},
}
_OF_MASSES = ("boundmass", "boundinertia", "balanceinertia", "inertiagrouprange", "inertiafromgeom")
_WITH_DEFAULTS = ("joint", "geom", "site")  # cameras and lights have theirs, too, but are not checked
_SITE_SIZE = "0.005 0.005 0.005"  # m, of sites that have none


@dataclass(eq=False)
class MjcfResizing:
    """Resizes the bodies of an MJCF file.

    Attributes:
        reader: that has read the file.
        written: the element to write for each element that was read.
        sizes: factors by the names of the tree's bodies; others join their carriers, and have the size of these.
        rise: what is added to the place of the base, (3,) [m].
        weighed: whether to write the mass of every body as an inertial, as bounds of the compiler would not grow with
            sizes; these are left out.
    """

    reader: MjcfReader
    written: Mapping[Element, Element]
    sizes: Mapping[str, float]
    rise: Floats
    weighed: bool = False
    meshes: dict[tuple[str, float], str] = field(default_factory=dict)

    def resize(self) -> None:
        """Write the bodies anew."""
        if self.weighed:
            compilers = [self.written[each] for each in self.reader.root.iterfind("compiler")]
            for compiler in compilers:
                for name in _OF_MASSES:
                    compiler.attrib.pop(name, None)
            compilers[0].set("inertiafromgeom", "false")
        base = self.reader.base
        if self.rise.any():
            place = numbers(base, "pos", "0 0 0", 3) + self.rise
            self.written[base].set("pos", with_numbers(place))
        self._resize_body(base, 1.0, is_base=True)

    def _resize_body(self, body: Element, carrier: float, is_base: bool = False) -> None:
        """Resize a body, and those on it; ``carrier`` is the size of what carries it."""
        reader = self.reader
        found = reader.bodies_read[body]
        size, within = self.sizes.get(found.name, carrier), found.childclass
        joints = [reader.defaults.resolved(each, within) for each in body if each.tag in ("joint", "freejoint")]
        if joints and not is_free(joints[0]):
            arm = reader.compiler.turn(body) @ numbers(joints[0], "pos", "0 0 0", 3)
            self._place(body, carrier * (numbers(body, "pos", "0 0 0", 3) + arm) - size * arm)
        elif not is_base:
            self._place(body, carrier * numbers(body, "pos", "0 0 0", 3))
        for child in body:
            if child.tag == "inertial" and self.weighed:
                self.written[body].remove(self.written[child])
            elif child.tag in _POWERS and size != 1:
                self._resize_part(child, size, within)
            elif child.tag == "body":
                self._resize_body(child, size)
        if self.weighed and found.lump.mass > 0:
            self.written[body].insert(0, _inertial(found, size))

    def _place(self, body: Element, place: Floats) -> None:
        if (place != numbers(body, "pos", "0 0 0", 3)).any():
            self.written[body].set("pos", with_numbers(place))

    def _resize_part(self, element: Element, size: float, within: str) -> None:
        """Resize what belongs to a body: its inertial, joint, solids and sites."""
        given = self._with_defaults(element, within)
        for name, power in _POWERS[element.tag].items():
            if name in given.attrib:
                self.written[element].set(name, with_numbers(size**power * numbers(given, name)))
        if element.tag == "geom" and (mesh := given.get("mesh")) and (resized := self._resized_mesh(mesh, size)):
            self.written[element].set("mesh", resized)

    def _with_defaults(self, element: Element, within: str) -> Element:
        """An element with what it leaves out, as its class has it, and the size that a site has anyway."""
        defaults = self.reader.defaults
        if element.tag in _WITH_DEFAULTS:
            given = defaults.resolved(element, within)
        else:
            inherited = defaults.classes.get(element.get("class", within), {}).get(element.tag, {})
            given = Element(element.tag, {**inherited, **element.attrib})
        if element.tag == "site":
            size = given.get("size", "").split()
            given.set("size", " ".join([*size, *_SITE_SIZE.split()[len(size) :]]))
        return given

    def _resized_mesh(self, name: str, size: float) -> str:
        """Name of a mesh, a picture, in a size; it is added to the file once; empty if the file has no such mesh."""
        if (name, size) not in self.meshes:
            found = [each for each in self.reader.root.iterfind("asset/mesh") if _name_of(each) == name]
            if not found:
                return ""
            taken = {_name_of(each) for each in self.reader.root.iterfind("asset/mesh")} | set(self.meshes.values())
            copy = Element("mesh", {**found[0].attrib, "name": unlike(f"{name}_x{size:g}", taken)})
            inherited = self.reader.defaults.classes.get(copy.get("class", "main"), {}).get("mesh", {})
            copy.set("scale", inherited.get("scale", "1 1 1") if copy.get("scale") is None else copy.get("scale", ""))
            copy.set("scale", with_numbers(size * numbers(copy, "scale", None, 3)))
            copy.tail = self.written[found[0]].tail
            copy.extend(self.written[found[0]])
            parents = {child: parent for parent in self.reader.root.iterfind("asset") for child in parent}
            self.written[parents[found[0]]].append(copy)
            self.meshes[name, size] = copy.get("name", "")
        return self.meshes[name, size]


def _inertial(body: BodyRead, size: float) -> Element:
    """An inertial that tells the mass of a body in a size."""
    to_body = body.place.rotation.T
    centre = size * (to_body @ (body.lump.centre - body.place.position))
    inertia = size**5 * (to_body @ body.lump.inertia @ to_body.T)
    entries = [inertia[n, m] for n, m in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    texts = {"pos": with_numbers(centre), "mass": with_numbers([size**3 * body.lump.mass])}
    return Element("inertial", {**texts, "fullinertia": with_numbers(entries)})


def _name_of(mesh: Element) -> str:
    """Name of a mesh, which is that of its file without a name of its own."""
    return mesh.get("name") or mesh.get("file", "").replace("\\", "/").rpartition("/")[2].rpartition(".")[0]
