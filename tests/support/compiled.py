"""Notes which kernels are compiled, whichever compiler there is."""

from taichi_sim.runtime import ti


def noting_compilations(monkeypatch):
    """From now on, (name, whether it was compiled before) of every kernel that is asked for its machine code."""
    noted = []
    kernel = ti.lang.kernel_impl.Kernel
    original = kernel.materialize

    def noting(self, key=None, *arguments, **keywords):
        known = (self.func, 0, self.autodiff_mode) if key is None else key
        before = self.compiled_kernels if hasattr(self, "compiled_kernels") else self.materialized_kernels
        noted.append((self.func.__name__, known in before))
        return original(self, key, *arguments, **keywords)

    monkeypatch.setattr(kernel, "materialize", noting)
    return noted
