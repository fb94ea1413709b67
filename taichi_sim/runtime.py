"""The one place that imports and starts Taichi, or Quadrants, its maintained fork (see ``base.compiler``).

What is said of Taichi here goes for both; ``ti`` is whichever it is. It has one global runtime per process.
:func:`start` owns it: asking for what already runs costs nothing, anything else restarts the runtime (about 0.2 s;
compiled kernels come back from a cache on disk), also where other code of the process has restarted it by ``ti.init``.
Engines start it before every launch, so engines of different precision can live side by side as long as their memory
is NumPy's, or made by :func:`device_array`.

Threads: functions that launch kernels are :func:`exclusive`, so threads of Python may simulate at the same time; they
wait for each other. Kernels use several CPU threads by themselves.

Fork: Taichi's threads do not survive a fork. A child process that was forked after a start is refused in one line;
start such processes with the method ``"spawn"`` of multiprocessing.

Bit-for-bit reproducibility rests on two settings made here: ``fast_math`` is off, so that a sum means what it says in
every lane, and vectors are kept whole (``real_matrix_scalarize=False``), so that a lane of a vector goes through the
same operations as a scalar.
"""

import contextlib
import ctypes
import functools
import importlib
import io
import os
import sys
import textwrap
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from taichi_sim.base.compiler import compiler
from taichi_sim.base.compute import Compute
from taichi_sim.base.deferring import ctrl_c_afterwards
from taichi_sim.device_arrays import DeviceArrays
from taichi_sim.launching import forget_all

COMPILER = compiler()
_SET_BY_US = {f"{prefix}_ENABLE_{name}" for prefix in ("TI", "QD") for name in ("PYBUF", "TORCH")}
for _prefix, _name in (("TI", "TAICHI"), ("QD", "QUADRANTS")):
    os.environ.setdefault(f"ENABLE_{_name}_HEADER_PRINT", "False")  # keeps stdout free for --json
    os.environ.setdefault(f"{_prefix}_ENABLE_PYBUF", "0")  # nor are notebooks and pytest told to be "graphical shells"
    os.environ.setdefault(f"{_prefix}_ENABLE_TORCH", "0")  # it would import torch at its start
os.environ.setdefault("HOME", os.path.expanduser("~").replace("~", os.sep))  # without it Taichi ends the process


def _imported() -> Any:
    """The compiler, without torch, which Quadrants would import for seconds, and without warnings of its sources."""
    hides_torch = sys.modules.setdefault("torch", None) is None  # type: ignore[arg-type]  # it then seems missing
    try:
        with ctrl_c_afterwards(), warnings.catch_warnings():  # its extension cannot be imported a second time
            warnings.simplefilter("ignore", SyntaxWarning)
            warnings.simplefilter("ignore", DeprecationWarning)
            return importlib.import_module(COMPILER)
    finally:
        if hides_torch:
            del sys.modules["torch"]


if TYPE_CHECKING:
    import taichi as ti
else:
    ti = _imported()

# Taichi runs an outer loop of at most this many iterations on one CPU thread, so each block of a batch gets as many.
GRAIN = 512

# A cache lock this old was left behind by a process that died; it would disable the cache for good.
STALE_LOCK_SECONDS = 600.0

# Bytes of compiled kernels that the cache keeps. Taichi's own limit of 100 MB holds some hundred of the larger kernels:
# who uses several robots and precisions would compile the same ones again and again.
CACHE_SIZE = 2_000_000_000

# Devices that Taichi compiles for by way of SPIR-V, and what one must be able to loop without a note.
THROUGH_SPIRV = ("vulkan", "metal")
MANY_ITERATIONS = 1 << 17

P = ParamSpec("P")
R = TypeVar("R")

_lock = threading.RLock()  # held while a thread starts Taichi and launches kernels
_holder: int | None = None  # that thread's number, as long as it does
_needed: list[Compute | None] = []  # what each :func:`exclusive` function that runs has started, the outermost first
_running: Compute | None = None
_begun: Any = None  # Taichi's runtime that was made for it; other code of the process may have made another since
_arrays = DeviceArrays()
_forked = False  # whether this process is the child of one in which Taichi ran
_told: set[Path | str] = set()  # caches whose loss the user knows of, devices with limits, variables without effect


def _position(self: Any, node: Any) -> str:
    """Where a line of a kernel's source stands, for the message of an error in it."""
    place = f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {self.func.func.__name__}'
    return f"{place}:\n{self.src[node.lineno - 1]}\n"


def _internal(module: str) -> Any:
    """A module within the compiler."""
    return importlib.import_module(f"{COMPILER}.{module}")


def _adapt_taichi() -> Any:
    """Change what Taichi does for every node of a kernel's syntax tree; return the module that reads sources."""
    _internal("lang.ast.ast_transformer_utils").ASTTransformerContext.get_pos_info = _position
    reader = _internal("lang.kernel_impl")
    for name in ("getsourcefile", "getsourcelines"):
        setattr(reader, name, functools.cache(getattr(reader, name)))
    return reader


def _adapt_quadrants() -> Any:
    """The same for Quadrants, and let calls in kernels have ``*arguments`` before others.

    It refuses those because it looks for parts of dataclasses among the arguments, which no kernel here has.
    """
    _internal("lang.ast.ast_transformer_utils").ASTTransformerFuncContext.memoized_get_pos_info = _position
    _internal("lang._pruning").Pruning.filter_call_args = lambda self, *given: given[-1]
    reader = _internal("lang._func_base")
    reader.get_source_info_and_src = functools.cache(reader.get_source_info_and_src)
    return reader


# Building a kernel, also one whose machine code is cached, Taichi wraps source lines to paper width for every node of
# its syntax tree and reads the source of a function at every call of it: two thirds of the time. These do it once.
_wrapping = {"fill": functools.cache(textwrap.fill), "dedent": functools.cache(textwrap.dedent)}
(_adapt_taichi if COMPILER == "taichi" else _adapt_quadrants)().textwrap = SimpleNamespace(**_wrapping)


def cache_folder() -> Path:
    """Folder of compiled kernels; ``MORPHOLAB_CACHE`` overrides ``~/.cache/morpholab``."""
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    root = Path(os.environ.get("MORPHOLAB_CACHE") or user / "morpholab")
    name = "kernels" if COMPILER == "taichi" else f"{COMPILER}-kernels"
    return root / f"{name}-{'.'.join(map(str, ti.__version__))}"


def exclusive(function: Callable[P, R]) -> Callable[P, R]:
    """Let only one thread at a time run a function that starts Taichi and launches kernels; others wait.

    After one that another such function has called in a callback, such as ``progress``, Taichi runs again as that one
    needs it. What it has called before it needed anything is a part of it.
    """

    @functools.wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> R:
        global _holder
        with _lock:
            _needed.append(None)
            _holder = threading.get_ident()
            try:
                return function(*args, **kwargs)
            finally:
                inner = _needed.pop()
                _holder = _holder if _needed else None
                if _needed and inner is not None:
                    if _needed[-1] is None:
                        _needed[-1] = inner
                    elif _needed[-1] != inner:
                        _start(_needed[-1])

    return alone


def start(compute: Compute | str = "cpu", precision: str = "f64", threads: int | None = None) -> Compute:
    """Make sure that Taichi runs on this device, in this precision, on that many threads; restart it if it does not.

    Args:
        compute: all three, or the device alone.
        precision: beside a device, ``"f32"`` or ``"f64"``.
        threads: beside a device, CPU threads; all available cores if None.

    Returns:
        What runs now, with the number of threads.

    Raises:
        ValueError: if a value is unknown, or this machine lacks the device.
        RuntimeError: if this process was forked from one in which Taichi ran.
    """
    global _holder
    wanted = compute if isinstance(compute, Compute) else Compute(compute, precision, threads)
    wanted = replace(wanted, threads=wanted.thread_count)
    with _lock:
        before, _holder = _holder, threading.get_ident()
        if _needed:
            _needed[-1] = wanted
        try:
            _start(wanted)
        finally:
            _holder = before
    return wanted


def go_on() -> None:
    """Let Taichi run again for the function that launches kernels, if a callback of it has called ``ti.init``.

    Raises:
        RuntimeError: if what the function had on a device is lost.
    """
    if _needed and _needed[-1] is not None and ti.lang.impl.get_runtime() is not _begun:
        if _arrays.any_on_device:
            raise RuntimeError("a callback of the simulation restarted Taichi: its arrays are lost; leave out ti.init")
        _start(_needed[-1])


def _start(wanted: Compute) -> None:
    global _running, _begun
    if _forked:
        raise RuntimeError(
            "this process was forked from one that had already simulated, which cannot work; "
            "start processes by multiprocessing.get_context('spawn')"
        )
    is_ours = ti.lang.impl.get_runtime() is _begun
    if is_ours and wanted == _running:
        return
    architecture = getattr(ti, wanted.device)
    if wanted.device != "cpu" and not ti.lang.misc.is_arch_supported(architecture):
        raise ValueError(f"device: {wanted.device!r} is not available on this machine; use 'cpu'")
    if _running is not None and is_ours:
        _arrays.leave(_running)
    else:
        _arrays.lose()
    _running = None
    _initialise(wanted, architecture)
    _running, _begun = wanted, ti.lang.impl.get_runtime()
    _arrays.come_back(wanted)


def _initialise(wanted: Compute, architecture: object) -> None:
    folder = cache_folder()
    cache = _prepare_cache(folder)
    # Taichi announces its start on stdout, which belongs to the user's data.
    with contextlib.redirect_stdout(io.StringIO()), _environment(wanted.device):
        forget_all()
        ti.init(
            arch=architecture,
            default_fp=ti.f32 if wanted.precision == "f32" else ti.f64,
            fast_math=False,
            real_matrix_scalarize=wanted.device != "cpu",
            # Taichi's own optimiser is quadratic in the size of a kernel (15 s for the lattice); LLVM does as well.
            advanced_optimization=False,
            cpu_max_num_threads=wanted.threads,
            log_level=ti.CRITICAL,
            offline_cache=cache,
            # Taichi makes this folder when it ends, also without a cache, and crashes if it cannot.
            offline_cache_file_path=str(folder) if cache else os.sep,
            offline_cache_max_size_of_files=CACHE_SIZE,
        )
        # Else the first launch would do it, which may come from another thread: Taichi refuses that.
        ti.lang.impl.get_runtime().materialize()
    if wanted.device != "cpu" and ti.lang.impl.current_cfg().arch != architecture:
        raise ValueError(f"device: {wanted.device!r} could not be started on this machine; use 'cpu'")
    if wanted.device in THROUGH_SPIRV:
        _try_out(wanted)


@contextlib.contextmanager
def _environment(device: str) -> Iterator[None]:
    """Hide the variable that would choose another device; a ValueError names others that Taichi refuses."""
    hidden = {name: os.environ.pop(name) for name in ("TI_ARCH", "QD_ARCH") if name in os.environ}
    for name in hidden.keys() - _told:
        _told.add(name)
        print(f"note: {name}={hidden[name]} has no effect, computing on {device}; --device chooses", file=sys.stderr)
    try:
        yield
    except ValueError as error:  # of a value that it cannot read
        own = [
            f"{name}={os.environ[name]}"
            for name in sorted(os.environ.keys() - _SET_BY_US)
            if name[:3] in ("TI_", "QD_")
        ]
        if not own:
            raise
        message = f"environment: {COMPILER} does not start with {', '.join(own)} ({error}); unset what is wrong"
        raise ValueError(message) from error
    finally:
        os.environ.update(hidden)


def _try_out(wanted: Compute) -> None:
    """Find out whether a device has the precision, and tell if it cannot loop for long; SPIR-V promises neither."""
    real = ti.f32 if wanted.precision == "f32" else ti.f64

    @ti.kernel
    def count(times: ti.i32, numbers: ti.types.ndarray(dtype=real, ndim=1)):
        for i in range(1):
            found = 0.0 * numbers[i]
            for _ in range(times):
                found += numbers[0]
            ti.atomic_add(numbers[1], found)

    numbers = np.array([1, 0], wanted.precision.replace("f", "float"))
    try:
        count(MANY_ITERATIONS, numbers)
    except Exception as error:
        message = f"precision: device {wanted.device!r} of this machine cannot compute in {wanted.precision!r}"
        raise ValueError(
            f"{message}; use {'f32' if wanted.precision == 'f64' else 'f64'!r}, or device 'cpu'"
        ) from error
    if numbers[1] != MANY_ITERATIONS and wanted.device not in _told:
        _told.add(wanted.device)
        print(
            f"note: device {wanted.device!r} ends a kernel's loops after {numbers[1]:.0f} iterations; on it only short "
            "runs of rigid robots and vehicles are right",
            file=sys.stderr,
        )


def _prepare_cache(folder: Path) -> bool:
    """Make the cache folder and remove locks of dead processes; False if it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for lock in folder.rglob("*.lock"):
            if time.time() - lock.stat().st_mtime > STALE_LOCK_SECONDS:
                lock.unlink()
    except OSError:
        if folder not in _told:
            _told.add(folder)
            print(f"note: kernels are not cached, {folder} cannot be written", file=sys.stderr)
        return False
    return True


def _after_fork() -> None:
    """Forget in a child process what the parent had started, which would hang when it is used or freed."""
    global _lock, _forked, _holder
    _lock, _holder = threading.RLock(), None
    _needed.clear()
    if _running is not None:
        _forked = True
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(ti.lang.impl.get_runtime().prog))  # so it is never freed


os.register_at_fork(after_in_child=_after_fork)


def one_thread() -> bool:
    """Whether kernels on the CPU run on one thread."""
    return _running is not None and _running.threads == 1


def single_precision() -> bool:
    """Whether the kernels being traced are f32; for constants that depend on it."""
    return _running is not None and _running.precision == "f32"


def rearranges_sums() -> bool:
    """Whether the compiler of the running device reorders sums and products as if they were exact.

    Taichi's optimiser of SPIR-V does, without ``fast_math`` too: it makes x of (x + c) - c.
    """
    return _running is not None and _running.device in THROUGH_SPIRV


def device_array(dtype: Any, shape: tuple[int, ...]) -> Any:
    """An array of zeros on the device that runs; it outlives restarts, see ``device_arrays``."""
    return _arrays.new(ti, dtype, shape)


def inside_kernel() -> bool:
    """Whether this thread compiles a kernel, so that arithmetic writes instructions instead of giving numbers.

    Other threads may compute with the same laws meanwhile, in NumPy.
    """
    return bool(ti.lang.impl.inside_kernel()) and _holder in (None, threading.get_ident())


class _Prints:
    """What a compiler asks of a function that kernels call."""

    has_print = False


def callable_in_kernels(function: Callable[..., Any]) -> Any:
    """Mark a plain Python function that kernels call while they are compiled; else there is a warning of each call."""
    marks = {f"_is_{COMPILER}_function": True, "func" if COMPILER == "taichi" else "wrapper": _Prints}
    for name, value in marks.items():
        setattr(function, name, value)
    return function


def emit(value: Any) -> Any:
    """An expression of the kernel being compiled as a variable, which nobody assigns: uses do not compute it again.

    What has been emitted is not again: each variable costs the compiler time that grows with those around it.
    """
    if not isinstance(value, ti.lang.expr.Expr) or hasattr(value, "is_emitted"):
        return value
    variable = variable_of(value)
    variable.is_emitted = True
    return variable


def variable_of(value: Any) -> Any:
    """A new variable of the kernel being compiled, which may be assigned other values; a Python value stays one."""
    return ti.lang.impl.expr_init(value) if isinstance(value, ti.lang.expr.Expr) else value


def element(array: Any, *indices: Any) -> Any:
    """An element of a kernel's array, to be read or assigned, in the kernel being compiled."""
    return ti.lang.impl.subscript(None, array, *indices)
