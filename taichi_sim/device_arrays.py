"""Arrays on a device that survive restarts of Taichi; its own do not, and using them afterwards may crash.

An engine on a device may have a tape that is pulled back after another engine has run, on a CPU or in another
precision. Before a restart its arrays go into NumPy's memory; they come back when their device is started again.
"""

from typing import Any
from weakref import WeakValueDictionary

from taichi_sim.base.compute import Compute


class DeviceArrays:
    """All arrays of a process that lie on a device, or would if it ran."""

    def __init__(self) -> None:
        """Know of none."""
        self._all: WeakValueDictionary[int, Any] = WeakValueDictionary()

    def new(self, ti: Any, dtype: Any, shape: tuple[int, ...]) -> Any:
        """Make an array of zeros on the device that runs."""
        array = ti.ndarray(dtype, shape)
        self._all[id(array)] = array
        return array

    @property
    def any_on_device(self) -> bool:
        """Whether any lies on the device."""
        return any(array.arr is not None for array in list(self._all.values()))

    def leave(self, compute: Compute) -> None:
        """Take all arrays off the device that runs, before it ends."""
        for array in list(self._all.values()):
            if array.arr is not None:
                array.away = compute, array.dtype, array.to_numpy()
                array.arr = None  # else its end would free what lies at its address by then

    def lose(self) -> None:
        """Forget the arrays of a device that other code has ended: what they held is gone."""
        for key, array in list(self._all.items()):
            if array.arr is not None:
                array.arr = None  # as in ``leave``
                del self._all[key]

    def come_back(self, compute: Compute) -> None:
        """Put the arrays of a device that runs again onto it."""
        for array in list(self._all.values()):
            if array.arr is None and array.away[0] == compute:
                _, dtype, values = array.away
                type(array).__init__(array, dtype, values.shape)
                array.from_numpy(values)
                del array.away
