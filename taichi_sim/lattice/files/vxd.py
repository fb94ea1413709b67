"""Read difference files of voxcraft: a ``.vxd`` file replaces parts of a ``base.vxa``.

Source: voxcraft-sim, ``ctool.h``: each child of the root names the part that it takes the place of by its attribute
``replace``, a path with dots.
"""

from copy import deepcopy
from xml.etree.ElementTree import Element

MOST_LEVELS = 10


def merged(base: Element, difference: Element) -> Element:
    """Copy the base, and replace or add the parts that the difference gives.

    Raises:
        ValueError: for a part without a path, or a path that is not of this file.
    """
    if difference.tag != "VXD":
        raise ValueError(f"<{difference.tag}> is no difference; give a file of <VXD>")
    root = deepcopy(base)
    for part in difference:
        path = part.get("replace", "").split(".")
        plain = all(tag.isidentifier() for tag in path)
        if not plain or path[0] != root.tag or not 2 <= len(path) <= MOST_LEVELS:
            raise ValueError(f"{part.tag}: replace {part.get('replace')!r} is not allowed; give {root.tag}.PART")
        above = root
        for tag in path[1:-1]:
            found = above.find(tag)
            if found is None:
                found = Element(tag)
                above.append(found)
            above = found
        new = deepcopy(part)
        new.tag = path[-1]
        new.attrib.pop("replace")
        if (old := above.find(path[-1])) is None:
            above.append(new)
        else:
            above[list(above).index(old)] = new
    return root
