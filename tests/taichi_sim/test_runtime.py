"""How Taichi is started, and what its kernels say about errors in them."""

import pytest

from taichi_sim import runtime
from taichi_sim.runtime import ti

NAME_ERROR = ti.TaichiNameError if runtime.COMPILER == "taichi" else ti.QuadrantsNameError

pytestmark = pytest.mark.kernels


def test_an_error_in_a_kernel_names_its_line():
    runtime.start("cpu", "f64", 1)

    @ti.kernel
    def wrong() -> ti.i32:
        return absent  # noqa: F821

    with pytest.raises(NAME_ERROR, match=r'(?s)test_runtime.py", line \d+, in wrong:.*absent'):
        wrong()
