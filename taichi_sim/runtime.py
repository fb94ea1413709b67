"""The one place that imports and starts Taichi.

Taichi has a single global runtime per process. :func:`start` owns it: asking for the configuration that is
already running costs nothing, another one restarts the runtime (about 0.2 s; compiled kernels come back
from the offline cache). Engines call it before every launch, so several engines of different precision can
live side by side as long as their memory is NumPy's.

Bit-for-bit reproducibility rests on two settings made here: ``fast_math`` is off, so that a sum means what
it says in every lane, and vectors are kept whole (``real_matrix_scalarize=False``), so that a lane of a
vector goes through the same operations as a scalar.
"""

import contextlib
import functools
import io
import os
import sys
import textwrap
import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")  # keeps stdout free for --json
os.environ.setdefault("TI_ENABLE_PYBUF", "0")  # nor does it announce notebooks and pytest as "graphical shells"
os.environ.setdefault("TI_ENABLE_TORCH", "0")  # Taichi would import torch at its start

import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

DEVICES = ("cpu", "cuda", "vulkan", "metal")
PRECISIONS = ("f32", "f64")

# Taichi runs an outer loop of at most this many iterations on one CPU thread, so each block of a batch gets as many.
GRAIN = 512

# A cache lock this old was left behind by a process that died; it would disable the cache for good.
STALE_LOCK_SECONDS = 600.0


@dataclass(frozen=True)
class Configuration:
    """What the running Taichi was started with.

    Attributes:
        device: one of ``DEVICES``.
        precision: ``"f32"`` or ``"f64"``; the type of every real number in a kernel.
        threads: CPU threads that share the blocks of a batch.
    """

    device: str = "cpu"
    precision: str = "f64"
    threads: int = 1

    def __post_init__(self) -> None:
        if self.device not in DEVICES:
            raise ValueError(f"device: {self.device!r} is unknown; choose one of {', '.join(DEVICES)}")
        if self.precision not in PRECISIONS:
            raise ValueError(f"precision: {self.precision!r} is unknown; choose one of {', '.join(PRECISIONS)}")
        if not isinstance(self.threads, int) or not 1 <= self.threads <= 1024:
            raise ValueError(f"threads: {self.threads!r} is not allowed; give a whole number from 1 to 1024")


_running: Configuration | None = None


def _position(self: Any, node: Any) -> str:
    """Where a line of a kernel's source stands, for the message of an error in it."""
    place = f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {self.func.func.__name__}'
    return f"{place}:\n{self.src[node.lineno - 1]}\n"


# Building a kernel, also one whose machine code is cached, Taichi wraps source lines to paper width for every node of
# its syntax tree and reads the source of a function at every call of it: two thirds of the time. These do it once.
ASTTransformerContext.get_pos_info = _position
for _name in ("getsourcefile", "getsourcelines"):
    setattr(kernel_impl, _name, functools.cache(getattr(kernel_impl, _name)))
kernel_impl.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))


def available_threads() -> int:
    """Number of CPU cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cache_folder() -> Path:
    """Folder of compiled kernels; ``MORPHOLAB_CACHE`` overrides ``~/.cache/morpholab``."""
    root = (
        os.environ.get("MORPHOLAB_CACHE")
        or Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "morpholab"
    )
    return Path(root) / f"kernels-{'.'.join(map(str, ti.__version__))}"


def start(device: str = "cpu", precision: str = "f64", threads: int | None = None) -> Configuration:
    """Make sure Taichi runs with this configuration; restart it only if it differs.

    Args:
        device: ``"cpu"``, ``"cuda"``, ``"vulkan"`` or ``"metal"``.
        precision: ``"f32"`` or ``"f64"``.
        threads: CPU threads; all available cores if ``None``.

    Raises:
        ValueError: for an unknown device or precision, or a device that this machine lacks.
    """
    global _running
    wanted = Configuration(device, precision, available_threads() if threads is None else threads)
    if wanted == _running:
        return wanted
    architecture = getattr(ti, device)
    if device != "cpu" and not ti.lang.misc.is_arch_supported(architecture):
        raise ValueError(f"device: {device!r} is not available on this machine; use 'cpu'")
    _initialise(wanted, architecture)
    _running = wanted
    return wanted


def _initialise(wanted: Configuration, architecture: object) -> None:
    folder = cache_folder()
    cache = _prepare_cache(folder)
    # Taichi announces its start on stdout, which belongs to the user's data.
    with contextlib.redirect_stdout(io.StringIO()):
        ti.init(
            arch=architecture,
            default_fp=ti.f32 if wanted.precision == "f32" else ti.f64,
            fast_math=False,
            real_matrix_scalarize=wanted.device != "cpu",
            # Taichi's own optimiser is quadratic in the size of a kernel (15 s for the lattice); LLVM does as well.
            advanced_optimization=False,
            cpu_max_num_threads=wanted.threads,
            log_level=ti.ERROR,
            offline_cache=cache,
            offline_cache_file_path=str(folder),
        )
    if wanted.device != "cpu" and ti.lang.impl.current_cfg().arch != architecture:
        raise ValueError(f"device: {wanted.device!r} could not be started on this machine; use 'cpu'")


def _prepare_cache(folder: Path) -> bool:
    """Create the cache folder and remove locks of dead processes; False if it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for lock in folder.rglob("*.lock"):
            if time.time() - lock.stat().st_mtime > STALE_LOCK_SECONDS:
                lock.unlink()
    except OSError:
        print(f"note: kernels are not cached, {folder} cannot be written", file=sys.stderr)
        return False
    return True


def single_precision() -> bool:
    """Whether the kernels being traced are f32; for constants that depend on it."""
    return _running is not None and _running.precision == "f32"


def aligned(shape: tuple[int, ...], dtype: type, fill: float = 0) -> np.ndarray:
    """A NumPy array on a 64-byte boundary, as native vectors of 512 bits require."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.zeros(size + 64, np.uint8)
    offset = -raw.ctypes.data % 64
    array: np.ndarray = raw[offset : offset + size].view(dtype).reshape(shape)
    if fill:
        array[...] = fill
    return array


def inside_kernel() -> bool:
    """Whether a kernel is being compiled, so that arithmetic writes instructions instead of giving numbers."""
    return bool(ti.lang.impl.inside_kernel())


def emit(value: Any) -> Any:
    """A variable of the kernel being compiled that holds an expression; its later uses do not compute it again."""
    return ti.lang.impl.expr_init(value) if isinstance(value, ti.lang.expr.Expr) else value


def element(array: Any, *indices: Any) -> Any:
    """An element of a kernel's array, to be read or assigned, in the kernel being compiled."""
    return ti.lang.impl.subscript(None, array, *indices)
