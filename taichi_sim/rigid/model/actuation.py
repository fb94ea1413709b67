"""Change the actuation of a robot: the stiffness of servos and springs of its hinges, and largest torques of drives."""

import math
from collections.abc import Sequence
from dataclasses import replace

from taichi_sim.rigid.model.tree import Hinge, Joint, Motor, Servo, Tree


def is_stiff(joint: Joint | None) -> bool:
    """Whether a joint is a hinge with a torque that grows with its angle: that of a position servo, or of a spring."""
    return isinstance(joint, Hinge) and (joint.passive.stiffness > 0 or holds_angle(joint))


def holds_angle(hinge: Hinge) -> bool:
    """Whether the drive of a hinge is a servo by angle."""
    return isinstance(hinge.motor, Servo) and hinge.motor.by_angle < 0


def stiffened_tree(tree: Tree, factors: Sequence[float]) -> Tree:
    """Multiply the stiffness of hinges' servos and springs by a factor each; the damping of servos grows by its root.

    So servos keep their damping ratio. Their largest torques stay, and so do dampers of hinges, and drives that hold no
    angle. Where all factors are 1 the tree is returned itself.

    Args:
        tree: the robot.
        factors: of the hinges that carry the bodies, in the order of ``tree.ordered``.
    """
    if all(factor == 1 for factor in factors):
        return tree
    of_body = {body.name: factor for (body, _), factor in zip(tree.ordered, factors, strict=True)}
    joints = [_stiffened(joint, of_body[joint.child]) if isinstance(joint, Hinge) else joint for joint in tree.joints]
    return Tree(tree.bodies, joints, tree.fixed)


def is_limited(joint: Joint | None) -> bool:
    """Whether a joint is a hinge with a drive that has a largest torque."""
    return isinstance(joint, Hinge) and joint.motor is not None and math.isfinite(largest_torque(joint.motor))


def largest_torque(drive: Motor | Servo) -> float:
    """Largest torque of a drive [N m]: its limit, or of a torque motor that of its commands; infinite without one."""
    limit = math.inf if drive.torque is None else drive.torque
    return min(limit, abs(drive.by_command) + abs(drive.offset)) if pushes(drive) else limit


def pushes(drive: Motor | Servo | None) -> bool:
    """Whether a drive is a torque motor, whose torque is that of its command, whatever the hinge does."""
    return isinstance(drive, Servo) and drive.by_angle == drive.by_rate == 0


def strengthened_tree(tree: Tree, factors: Sequence[float]) -> Tree:
    """Multiply the largest torques of drives by a factor each, and with them all torques of torque motors.

    The gains of servos stay, and so do drives without a largest torque. Where all factors are 1 the tree is returned
    itself.

    Args:
        tree: the robot.
        factors: of the drives of the hinges that carry the bodies, in the order of ``tree.ordered``.
    """
    if all(factor == 1 for factor in factors):
        return tree
    of_body = {body.name: factor for (body, _), factor in zip(tree.ordered, factors, strict=True)}
    joints = [
        replace(joint, motor=_strengthened(joint.motor, of_body[joint.child])) if isinstance(joint, Hinge) else joint
        for joint in tree.joints
    ]
    return Tree(tree.bodies, joints, tree.fixed)


def _strengthened(drive: Motor | Servo | None, factor: float) -> Motor | Servo | None:
    if drive is None:
        return None
    torque = None if drive.torque is None else factor * drive.torque
    if isinstance(drive, Motor):
        return replace(drive, torque=factor * drive.torque)
    if pushes(drive):
        return replace(drive, by_command=factor * drive.by_command, offset=factor * drive.offset, torque=torque)
    return replace(drive, torque=torque)


def _stiffened(hinge: Hinge, factor: float) -> Hinge:
    servo, passive = hinge.motor, replace(hinge.passive, stiffness=factor * hinge.passive.stiffness)
    if isinstance(servo, Servo) and holds_angle(hinge):
        servo = replace(
            servo,
            by_command=factor * servo.by_command,
            by_angle=factor * servo.by_angle,
            offset=factor * servo.offset,
            by_rate=math.sqrt(factor) * servo.by_rate,
        )
    return replace(hinge, motor=servo, passive=passive)
