"""The player's page in a browser: its clock, and names that look like pages."""

import pytest
from made_motion import made

from robots.view.player import page

pytestmark = pytest.mark.browser

# Pictures wait until a test lets them come.
HOLD = """
const real = window.requestAnimationFrame.bind(window), held = [];
window.requestAnimationFrame = (act) => (window.free ? real(act) : held.push(act));
window.release = () => { window.free = true; held.forEach(real); };
"""


def test_who_plays_before_the_first_picture_sees_the_motion(tab):
    tab.add_init_script(HOLD)
    tab.goto("about:blank")
    tab.set_content(page(made()))
    tab.wait_for_function("() => window.player")
    tab.evaluate("() => { window.player.play(true); window.release(); }")
    tab.wait_for_function("() => window.player.renders > 0 && (window.player.time > 0 || isNaN(window.player.time))")
    assert 0 < tab.evaluate("() => window.player.time") <= tab.evaluate("() => window.player.duration")


def test_a_name_that_begins_a_script_hides_nothing_of_the_page(tab):
    name = "<!--<script>"
    tab.goto("about:blank")
    tab.set_content(page([made(name=name), made(name="another")]))
    tab.wait_for_function("() => window.player && window.player.renders > 0")
    assert name in tab.inner_text("body")
