"""Pictures now and then, from a camera that stays as long as the robot is in view."""

from dataclasses import replace

import numpy as np
import pytest

from robots.view.motion import CUBE, GroundPlane, Motion, Node
from robots.view.onlooker import HEIGHT, WIDTH, Onlooker

RED = (0.9, 0.1, 0.1)


def cube(x=0.0, y=0.0, size=1.0, **settings):
    """A cube on the ground at a place [m]."""
    place = np.array([[x, y, size / 2]])
    upright, scale = np.array([[[1.0, 0, 0, 0]]]), np.full((1, 1, 3), size)
    return Motion("cube", [0.5], (Node("cube", CUBE, RED),), place[None], upright, scale, place, **settings)


def where(picture):
    """Middle of what is red on a picture: down and to the right [pixels]."""
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    found = np.argwhere((red > 120) & (green < 80) & (blue < 80))
    return found.mean(axis=0) if len(found) else None


def test_the_camera_stays_while_the_robot_is_in_view():
    onlooker = Onlooker(cube())
    first, second = (onlooker.picture(cube(x)) for x in (0.0, 1.0))
    assert first.shape == second.shape == (HEIGHT, WIDTH, 3) and first.dtype == np.uint8
    (down, right), (lower, further) = where(first), where(second)
    assert further - right > 50 and lower == pytest.approx(down, abs=1)
    assert np.array_equal(onlooker.picture(cube()), first)  # whatever was seen before


@pytest.mark.parametrize("place", [(40.0, 0.0), (-40.0, 0.0), (0.0, 30.0), (0.0, -30.0), (1e3, -2e3)])
@pytest.mark.parametrize("slope", [0.0, 10.0])
def test_it_keeps_up_with_a_robot_that_leaves(place, slope):
    ground = GroundPlane(slope=slope)
    onlooker = Onlooker(cube(ground=ground))
    down, right = where(onlooker.picture(cube(*place, ground=ground)))
    assert 0.1 * HEIGHT < down < 0.95 * HEIGHT and 0.02 * WIDTH < right < 0.98 * WIDTH


def test_lights_near_enough_are_in_view_at_the_right():
    for place in ((5.0, 0.0), (0.0, 5.0), (-3.0, -4.0)):
        seen = cube(lights=[[*place, 0.5]], light_radius=0.3)
        picture = Onlooker(seen).picture(seen)
        red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
        light = np.argwhere((red > 200) & (blue < 130) & (green > 150)).mean(axis=0)
        assert light[1] > where(picture)[1] + 0.3 * WIDTH
    far = cube(lights=[[500.0, 0.0, 0.5]], light_radius=0.3)
    assert np.array_equal(Onlooker(far).picture(far), Onlooker(cube()).picture(far))


def test_a_robot_in_a_fluid_has_no_ground():
    dry, wet = (Onlooker(cube(ground=ground)) for ground in (GroundPlane(), GroundPlane(solid=False)))
    pictures = [dry.picture(cube()), wet.picture(replace(cube(), ground=GroundPlane(solid=False)))]
    bare = [(picture == 255).all(axis=-1).mean() for picture in pictures]
    assert bare[0] < bare[1]
