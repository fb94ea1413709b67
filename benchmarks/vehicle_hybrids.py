"""Hybrids of evolution and gradients beside their gradient-free halves on a vehicle, at equal CPU time.

The places of both sensors and both weights of a Braitenberg vehicle are free; the objective is minus the sum of its
smallest distances from the light in four environments. Unlike a gait's speed it is smooth almost everywhere. One
thread, five seeds.

    python benchmarks/vehicle_hybrids.py --out runs/vehicle-hybrids --budget 3 [--seeds 0,1] [--plot curves.png]
"""

from equal_cost import Entry, compare_at_equal_cpu_time

from optim.problems.braitenberg import VehicleProblem

POPULATION = 16


def vehicle() -> VehicleProblem:
    """What is designed."""
    return VehicleProblem(threads=1)


ENTRIES = {
    "CMA-ES": Entry(vehicle, "cma", {"population": POPULATION}),
    "CMA-ES led by gradients": Entry(vehicle, "cma-gradient", {"population": POPULATION}),
    "differential evolution": Entry(vehicle, "de", {"population": POPULATION}),
    "memetic search": Entry(vehicle, "memetic", {"population": POPULATION}),
}


if __name__ == "__main__":
    compare_at_equal_cpu_time(__doc__, ENTRIES)
