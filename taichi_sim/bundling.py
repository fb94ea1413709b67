"""Kernels that take arrays and numbers in named tuples, which Taichi's own kernels take one by one."""

import linecache
from typing import Any

from taichi_sim.launching import Relauncher
from taichi_sim.runtime import go_on, ti


def kernel_of(body: Any, *types: Any) -> Relauncher:
    """Make a kernel that takes arrays and numbers in bundles, which Taichi's own kernels take one by one.

    Args:
        body: what the kernel does, a ``ti.func`` whose parameters are all ``ti.template()``.
        types: of each parameter: a type of Taichi, or a named tuple of such types, of constants (whole
            numbers, truth values and tuples of them) and of None. Where it has a constant or None, so has the body,
            whatever the kernel is given.

    Returns:
        The kernel; it takes an argument for each parameter of the body, named tuples where ``types`` has some.
    """
    places = [
        (i, j)
        for i, kinds in enumerate(types)
        for j, kind in (enumerate(kinds) if isinstance(kinds, tuple) else [(None, kinds)])
        if kind is not None and not isinstance(kind, int | tuple)
    ]

    def bundled(*values: Any) -> list[Any]:
        """The arguments of the body, from those of the kernel."""
        filled = [list(kinds) if isinstance(kinds, tuple) else kinds for kinds in types]
        for (i, j), value in zip(places, values, strict=True):
            if j is None:
                filled[i] = value
            else:
                filled[i][j] = value
        return [type(types[i])(*part) if isinstance(part, list) else part for i, part in enumerate(filled)]

    names = [f"a{number}" for number in range(len(places))]
    given = ", ".join(f"{name}: kinds[{number}]" for number, name in enumerate(names))
    source = f"def {body.__name__}({given}):\n    inner(*ti.static(bundled({', '.join(names)})))\n"
    file = f"<kernel {body.__name__} of {len(names)} arguments>"
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file  # where Taichi reads it
    kinds = [types[i] if j is None else types[i][j] for i, j in places]
    scope = {"kinds": kinds, "bundled": bundled, "inner": body, "ti": ti}
    exec(compile(source, file, "exec"), scope)
    return Relauncher(ti, ti.kernel(scope[body.__name__]), places, go_on)
