"""Layout of a robot's memory: one run of slots, in sections whose places an integer array, the plan, holds.

So nothing compiles again for another tree: what differs between trees is an argument of the kernel. ``tables.plan_of``
makes the plan.
"""

# Places in the plan: counts; first slots of sections of the memory; then where lists begin in the plan itself: the body
# of each point, the hinged bodies between the base and each body, the body of each light sensor and of each portion,
# the slots that a step starts from (KEPT of them), and those that are recorded (FRAME_WIDTH). Before these lists, after
# the places, lie the integers of bodies. A launch goes from step FIRST to step UNTIL of the STEPS of a run.
BODIES, POINTS, TOUCHES, LIGHTS, SENSORS, MOTORS, DEPTH, COMMANDS, PORTIONS = range(9)
HOLD, STEPS, EVERY, FRAMES, PHASES, KEPT, FRAME_WIDTH, FIRST, UNTIL = range(9, 18)
BODY, PARAMETER, POINT, POINT_PARAMETER, LIGHT_PARAMETER, WATER, PORTION, WET_BODY, SAND, PATCH, SANDY_POINT = range(
    18, 29
)
READING, NEURON, WEIGHT, COMMAND, MATRIX, FACTOR, SLOTS = range(29, 36)
POINT_BODIES, PATHS, EYES, PORTION_BODIES, STATE, FRAME, PLACES = range(36, 43)

# Places in the array of numbers that all robots of a run share: see ``Physics`` and ``Network``. PUSH_OUT is the error
# reduction in a second, LEAST_COMPLIANCE a part of a diagonal entry, FLOATING 0 where the base is fixed to the world;
# GRAVITY is the first of three.
TIME_STEP, PUSH_OUT, FRICTION, COMPLIANCE, LEAST_COMPLIANCE, MEMORY, GAIN, APART, TOUCHING, FLOATING = range(10)
TOLERANCE, GRAVITY = range(10, 12)

# The head of the memory: base position and orientation, the light, its smallest horizontal distance squared so far,
# steps before divergence (negative: none), the worst unsolved residual; then factor, right-hand side and velocity;
# strength of friction of points that hold, see ``Physics.slip_strength``; how far impulses may be from their bounds;
# how high above the ground a point may be that still touches it; the work of all drives so far.
POSITION, ORIENTATION, LIGHT, POSE_WIDTH = 0, 3, 7, 7
CLOSEST, DIVERGED, RESIDUAL = 10, 11, 12
ROOT, ROOT_RIGHT, SLIP_STRENGTH, IMPULSE_TOLERANCE, TOUCH_TOLERANCE, WORK, HEAD = 13, 34, 40, 41, 42, 43, 44

# Of a body. State: what it carries from step to step (angular, then linear), its own position, its hinge: angle, modes
# of its row and ways in which its friction lets it turn in each phase (1 or -1; 0 where it holds), rate.
CARRIED, OWN, ANGLE, MODES, WAYS, LAST_RATE = 0, 6, 9, 10, 12, 14
STATE_WIDTH = 15
# Work: rotation, place relative to the base, hinge as a spatial vector, drift off the tree, inertia about the base,
# momentum; the articulated inertia and momentum, the hinge's column, inverse, rate and contact impulse; its row, with
# the least and the largest rate that its stops allow, the impulse with which it resists each unit of its rate, that by
# which a servo gives less for each, -1 of a motor that holds its rate, and the largest impulse of its friction. TARGET
# is a servo's impulse at rest.
ROTATION, PLACE, SCREW, DRIFT, INERTIA, MOMENTUM = 15, 24, 27, 33, 36, 42
ARTICULATED, IMPULSE, COLUMN, INVERSE, FREE_RATE, CONTACT, RATE = 48, 69, 75, 81, 82, 83, 84
TARGET, PUSH, LOW, HIGH, VELOCITY = 85, 86, 87, 88, 89
MOVING = MOMENTUM  # after a step: its velocity, that of its centre
LEAST_RATE, MOST_RATE, RESISTANCE, SERVO, RUBBING = 95, 96, 97, 98, 99
BODY_WIDTH = 100

# Parameters of a body: mass, inertia at rest, from the anchor to the centre, from the parent's centre to the anchor,
# axis; of its motor: torque, desired rate (of a servo torque) = by command, by angle, offset; stops; the motor's
# largest rate; what acts on the hinge besides: inertia of the rotor, damping, stiffness of the spring and the angle
# where that rests; a servo's torque by the rate, -1 of a motor that holds its rate; torque of its friction.
MASS, REST_INERTIA, CENTRE, ANCHOR, AXIS = 0, 1, 7, 10, 13
TORQUE, BY_COMMAND, BY_ANGLE, OFFSET, LOWER, UPPER, FASTEST = 16, 17, 18, 19, 20, 21, 22
ROTOR, DAMPING, STIFFNESS, SPRING_REST, BY_RATE, DRY_FRICTION = 23, 24, 25, 26, 27, 28
PARAMETER_WIDTH = 29

# Of a point that may touch the ground: place relative to the base, depth, normal impulse of each phase, strength of
# its friction, row of the factored matrix; for the complementarity: right-hand side, member, scratch, excess; how fast
# it slides without friction; of uneven ground its normal and factor of friction; then its hinges' entries.
AT, DEEP, IMPULSES, RUBS, ROW, RIGHT, MEMBER, SCRATCH, EXCESS, SLIDES = 0, 3, 4, 6, 7, 13, 14, 15, 16, 17
NORMAL, ROUGHNESS, HINGES = 18, 21, 22
POINT_PARAMETER_WIDTH = 4  # offset from the body's centre, radius
LIGHT_PARAMETER_WIDTH = 3

# Only of robots in water. The water: level of its surface; weight, mass that is carried along and half the mass, per
# volume. A portion of a body: its centre from the body's, spread, volume, whether it is a ball (1 or 0), drag areas.
# Of a body: its motion before the step, and what water adds to its spatial inertia.
WATER_WIDTH, PORTION_WIDTH = 4, 17
MOTION_BEFORE, WATER_INERTIA, WET_BODY_WIDTH = 0, 6, 27

# Only of robots on sand. The sand: stress per depth at which it yields. Of a point: the surface that belongs to it, as
# ``shapes.Patch`` has it: shares of its ball, length and axis of a cylinder, edges of a box. Of a point in a step: the
# largest normal impulse that the sand bears, whether it has that one (1 or 0), and the impulse within bounds so far.
SAND_WIDTH, PATCH_WIDTH = 1, 9
LIMIT, SATURATED, WITHIN, SANDY_POINT_WIDTH = 0, 1, 2, 3

# Columns of the integers of bodies and points.
PARENT, HINGED, MOTOR, PATH_LENGTH, TOUCH, BODY_COLUMNS = range(6)

NO_STOP = 1e20  # an angle, an impulse or a rate that is out of reach
NO_LIMIT = 1e30  # N m, of a drive: whose impulse in a step is out of reach
# Of a hinge's row: its rate is as desired, or its impulse as a servo's law has it; else its impulse is at the upper (1)
# or lower (-1) bound, or its rate is the least (2) or the largest (-2) that its stops allow, with an impulse beyond the
# bounds of its motor.
MODE_DRIVEN = 0.0
