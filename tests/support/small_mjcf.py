"""Small MJCF texts: a ball over ground, and a leg on it."""


def ball(geom='size=".5" mass="2"', inside="", attributes="", joint="<freejoint/>", head="", tail=""):
    ground = '<geom name="ground" type="plane" size="1 1 1"/>'
    body = f'<body name="ball" pos="0 0 2" {attributes}>{joint}<geom name="skin" {geom}/>{inside}</body>'
    return f"<mujoco>{head}<worldbody>{ground}{body}</worldbody>{tail}</mujoco>"


def leg(joint="", actuator="", head="", more=""):
    inside = f'<body name="leg"><joint name="hip" {joint}/><geom size=".1" mass="1"/>{more}</body>'
    return ball(inside=inside, head=head, tail=f"<actuator>{actuator}</actuator>" if actuator else "")


def inertial(rest, where='pos="0 0 0"'):
    return ball(inside=f"<inertial {where} {rest}/>")


def default(content, geom='size=".5"', **more):
    return ball(geom, head=f"<default>{content}</default>", **more)


def classed(content, geom):
    """A ball whose solid alone is of a class."""
    return ball(f'{geom} class="a"', head=f'<default><default class="a">{content}</default></default>')
