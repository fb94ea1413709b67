"""One step of single hinges of all kinds against the only rate at which all impulses balance, found by bisection."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_sim.rigid import Body, Hinge, Motor, Passive, Physics, RigidEngine, Servo, Tree

pytestmark = pytest.mark.kernels

BASE = Body("base", (0.0, 0.0, 0.0), 20.0, inertia=np.eye(3))
RETURN = 10.0  # 1/s, from beyond a stop
ONE = np.ones((1, 1, 1))


class Case:
    """A flywheel on a hinge: any drive, passive forces and stops of any size, an angle, a rate and a command."""

    def __init__(self, rng, drive):
        def sized(low, high, share=1.0):
            return float(10 ** rng.uniform(low, high)) if rng.random() < share else 0.0

        self.inertia = sized(-8, 2)
        self.passive = Passive(
            *(self.inertia * sized(*ends) for ends in ((-3, 4, 0.5), (-3, 6, 0.6), (-2, 8, 0.6))),
            spring_rest=float(rng.uniform(-1, 1)),
            friction=self.inertia * sized(-3, 6, 0.6),
        )
        strength, wanted = self.inertia * sized(-3, 6), float(rng.uniform(-5, 5))
        self.drive = None
        if drive == "motor":
            fastest = sized(-1, 1, 0.5) or None
            self.drive = Motor(strength, wanted, -sized(-1, 3, 0.5), float(rng.uniform(-1, 1)), fastest)
        if drive == "servo":
            by_angle, by_rate = -self.inertia * sized(-2, 8, 0.6), self.inertia * sized(-2, 6, 0.6)
            limit = strength * sized(-2, 1) if rng.random() < 0.6 else None
            self.drive = Servo(strength * wanted, by_angle, strength * float(rng.uniform(-1, 1)), by_rate, limit)
        self.stops = None if rng.random() < 0.4 else (-float(rng.uniform(0, 1)), float(rng.uniform(0.01, 1)))
        self.angle = float(rng.choice(self.stops)) if self.stops and rng.random() < 0.3 else float(rng.uniform(-1, 1))
        self.rate = float(rng.normal() * sized(-3, 1, 0.7))

    def tree(self):
        flywheel = Body("flywheel", (0.0, 0.0, 0.0), 1.0, inertia=self.inertia * np.eye(3))
        hinge = Hinge("base", "flywheel", (0, 0, 0), (0, 1, 0), self.drive, 0, self.stops, passive=self.passive)
        return Tree((BASE, flywheel), (hinge,), fixed=True)

    def beside_drive(self, rate, side, step):
        """Impulse of all that acts but the drive, less what the rate needs."""
        by, lacking = self.passive, self.angle - self.passive.spring_rest
        inertia = self.inertia + by.rotor_inertia + 0.25 * step * step * by.stiffness
        found = inertia * (self.rate - rate) - step * (by.damping * rate + by.stiffness * lacking)
        return found - step * by.friction * (np.sign(rate) or side)

    def pull(self, rate, side, step):
        """Impulse of all that acts, less what the rate needs; ``side`` says how it is where it jumps."""
        found = self.beside_drive(rate, side, step)
        if self.drive is None:
            return found
        asked = self.drive.by_command + self.drive.by_angle * self.angle + self.drive.offset
        if isinstance(self.drive, Motor):
            limit = np.inf if self.drive.fastest is None else self.drive.fastest
            return found - step * self.drive.torque * (np.sign(rate - np.clip(asked, -limit, limit)) or side)
        drag = step * self.drive.by_rate * rate + 0.25 * step * step * self.drive.by_angle * (self.rate - rate)
        limit = np.inf if self.drive.torque is None else step * self.drive.torque
        return found + np.clip(step * asked - drag, -limit, limit)

    def work(self, rate, step):
        """Work of the drive in a step that ends with a rate, as far as it pushes that way."""
        if self.drive is None:
            return 0.0
        asked = self.drive.by_command + self.drive.by_angle * self.angle + self.drive.offset
        if isinstance(self.drive, Motor):  # what the rate needs, as far as it goes
            push = np.clip(-self.beside_drive(rate, 0.0, step), -step * self.drive.torque, step * self.drive.torque)
            if rate == 0 and self.passive.friction and asked:  # held by friction
                push = step * self.drive.torque * np.sign(asked)
        else:
            gained = -0.25 * step * step * self.drive.by_angle
            limit = np.inf if self.drive.torque is None else step * self.drive.torque
            push = np.clip(step * (asked - self.drive.by_rate * rate) + gained * (self.rate - rate), -limit, limit)
        return max(0.0, push * (self.rate + rate) / 2)

    def exact(self, step, return_rate):
        """The rate after a step, within what stops allow; the impulse falls as the rate grows."""
        low, high = -1e12, 1e12
        if self.stops is not None:
            low, high = (
                (return_rate if beyond else 1 / step) * (stop - self.angle)
                for stop, beyond in zip(
                    self.stops, (self.angle <= self.stops[0], self.angle >= self.stops[1]), strict=True
                )
            )
        start, end = -1e12, 1e12
        for jump in self.jumps():
            if self.pull(jump, -1.0, step) >= 0 >= self.pull(jump, 1.0, step):
                return float(np.clip(jump, low, high))
        for _ in range(200):
            middle = 0.5 * (start + end)
            start, end = (middle, end) if self.pull(middle, 0.0, step) > 0 else (start, middle)
        return float(np.clip(middle, low, high))

    def jumps(self):
        """Rates at which the impulse jumps."""
        found = [0.0]
        if isinstance(self.drive, Motor):
            limit = np.inf if self.drive.fastest is None else self.drive.fastest
            asked = self.drive.by_command + self.drive.by_angle * self.angle + self.drive.offset
            found.append(float(np.clip(asked, -limit, limit)))
        return found


@pytest.mark.parametrize("step", [2e-4, 2e-3, 0.05])
@pytest.mark.parametrize("drive", [None, "motor", "servo"])
def test_the_rate_after_a_step_is_the_only_one_at_which_all_impulses_balance(drive, step):
    """Whatever the drive, its bounds, friction, springs and stops are, and however far from them it starts."""
    rng = np.random.default_rng(0)
    cases = [Case(rng, drive) for _ in range(500)]
    engine = RigidEngine([case.tree() for case in cases], Physics(step, gravity=0.0), threads=1)
    start = {name: np.array([[getattr(case, name[:-1])] for case in cases]) for name in ("angles", "rates")}
    run = engine.run(1, commands=None if drive is None else ONE, start=replace(engine.rest(), **start))
    assert run.residual.max() == 0
    found = run.velocities[:, 1, 1]
    expected = np.array([case.exact(step, min(0.2 / step, RETURN)) for case in cases])
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert np.mean(abs(found) < 1e-9) > 0.02 and len(np.unique(found.round(6))) > 250
    work = np.array([case.work(rate, step) for case, rate in zip(cases, found, strict=True)])
    sizes = np.array([c.inertia * (1 + c.rate**2 + rate * rate) for c, rate in zip(cases, found, strict=True)])
    # Where friction holds a hinge at its stop, nothing tells what of the impulse is the drive's.
    told = np.array([rate != 0 or c.angle not in (c.stops or ()) for c, rate in zip(cases, found, strict=True)])
    assert (run.work / sizes)[told] == pytest.approx((work / sizes)[told], rel=1e-5, abs=1e-6)
    assert drive is None or (run.work > 0).sum() > 125


def test_a_motor_does_no_work_on_a_stop_however_strong_it_is():
    """It turned towards its stop at 5 rad/s, and reaches it within a step."""
    flywheel = Body("flywheel", (0.0, 0.0, 0.0), 1.0, inertia=0.01 * np.eye(3))
    hinges = [Hinge("base", "flywheel", (0, 0, 0), (0, 1, 0), Motor(t, 5.0), 0, (-1, 0.305)) for t in (1e2, 1e3, 1e4)]
    trees = [Tree((BASE, flywheel), (hinge,), fixed=True) for hinge in hinges]
    run = RigidEngine(trees, Physics(2e-3, gravity=0.0), threads=1).run(60, commands=ONE)
    assert run.angles == pytest.approx(0.305) and run.work == pytest.approx(
        0.01 * 5**2 / 2
    )  # what it began to turn with


def test_the_studies_integration_counts_no_work():
    engine = RigidEngine(
        Case(np.random.default_rng(3), "motor").tree(), Physics(0.01, integration="velocity"), threads=1
    )
    tape = engine.record(3, commands=ONE)
    assert np.isnan(tape.result.work).all()
    with pytest.raises(ValueError, match="work: integration 'velocity' counts none; take 'momentum'"):
        tape.pull_back(work=np.ones(1))
