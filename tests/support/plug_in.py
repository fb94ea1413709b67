"""Packages that tests install on a path: metadata with entry points, and a module."""


def install(folder, name, group, points, module=""):
    """Put a package into a folder that is, or will be, on the path of modules.

    Args:
        folder: the path.
        name: of the package; its module has the same name with underscores.
        group: of its entry points.
        points: where things are, by name.
        module: source of the module.
    """
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = "\n".join(f"{key} = {value}" for key, value in points.items())
    (info / "entry_points.txt").write_text(f"[{group}]\n{lines}\n")
    if module:
        (folder / f"{name.replace('-', '_')}.py").write_text(module)
