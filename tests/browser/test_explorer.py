"""The explorer's widget in a browser: drag a slider, and see numbers and robot change."""

import json
from pathlib import Path

import pytest

import morpholab as ml
from optim import explorer

pytestmark = [pytest.mark.kernels, pytest.mark.browser]

FRONT = Path(explorer.__file__).with_name("explorer.js")
STYLE = Path(explorer.__file__).with_name("explorer.css")
# In place of Jupyter's: what the front end sets goes to Python, and what Python sets comes back.
MODEL = """
const told = {}, state = STATE;
window.model = {
  get: (name) => state[name],
  set: (name, value) => { state[name] = value; },
  on: (event, act) => { (told[event] ||= []).push(act); },
  off: (event, act) => { told[event] = told[event].filter((one) => one !== act); },
  save_changes: () => window.to_python(JSON.stringify({ values: state.values })),
  send: (content) => window.to_python(JSON.stringify({ message: content })),
};
window.from_python = (name, value) => { state[name] = value; (told[`change:${name}`] || []).forEach((act) => act()); };
"""
NAMES = ("controls", "values", "measured", "page", "message", "busy", "height")


def opened(tab, widget):
    """Shows a widget in a tab, and joins both by their state."""
    asked = []

    def to_python(text):
        asked.append(json.loads(text))

    tab.expose_function("to_python", to_python)
    state = json.dumps({name: getattr(widget, name) for name in NAMES})
    front = json.dumps(FRONT.read_text())
    tab.set_content(f"<!DOCTYPE html><style>body {{ margin: 0 }}\n{STYLE.read_text()}</style><div id='here'></div>")
    tab.evaluate(MODEL.replace("STATE", state))
    tab.evaluate(
        f"""async () => {{
          const front = await import(URL.createObjectURL(new Blob([{front}], {{ type: "text/javascript" }})));
          window.leave = front.default.render({{ model: window.model, el: document.getElementById("here") }});
        }}"""
    )
    tab.sent = []
    widget.observe(lambda change: tab.sent.append((change["name"], change["new"])), names=list(NAMES))

    def answer():
        """Lets Python do what the front end asked for, and tells it what came of it."""
        tab.wait_for_timeout(50)
        for question in asked:
            if "values" in question:
                widget.values = question["values"]
            else:
                widget._handle_custom_msg(question["message"], [])
        asked.clear()
        for name, value in tab.sent:
            tab.evaluate("([name, value]) => window.from_python(name, value)", [name, value])
        tab.sent.clear()

    return answer


def player(tab):
    """The frame in which the player is, once it plays."""
    tab.wait_for_selector("iframe:not(.next)")
    return tab.query_selector("iframe:not(.next)").content_frame()


def test_a_slider_changes_the_robot_and_its_numbers(tab):
    widget = ml.explore("vehicle", w1=(-1.0, 1.0), environment=[1, 2], w2=1)
    answer = opened(tab, widget)
    first = player(tab)
    assert first.evaluate("() => window.player.playing")
    numbers = [cell.inner_text() for cell in tab.query_selector_all("td")]
    slider = tab.query_selector("input[type=range]")
    box = slider.bounding_box()
    tab.mouse.move(box["x"] + box["width"] - 8, box["y"] + box["height"] / 2)
    tab.mouse.down()
    tab.mouse.move(box["x"] + box["width"] / 4, box["y"] + box["height"] / 2, steps=5)
    moved = tab.query_selector("output").inner_text()
    assert widget.values["w1"] == 1 and float(moved) < 0  # nothing is tried before it is let go
    tab.mouse.up()
    answer()
    assert widget.values["w1"] == float(moved)
    assert [cell.inner_text() for cell in tab.query_selector_all("td")] != numbers
    tab.wait_for_function("() => document.querySelectorAll('iframe').length === 1")
    assert player(tab) != first and player(tab).evaluate("() => window.player.stages.length") == 1


def test_menus_keys_and_reset(tab):
    widget = ml.explore("vehicle", w1=(-1.0, 1.0), environment=[1, 2])
    answer = opened(tab, widget)
    tab.select_option("select", label="2")
    answer()
    assert widget.values == {"w1": 1.0, "environment": 2}
    tab.focus("input[type=range]")
    tab.keyboard.press("ArrowLeft")
    answer()
    assert widget.values == {"w1": 0.98, "environment": 2}
    tab.click("text=reset")
    answer()
    assert widget.values == {"w1": 1.0, "environment": 1}


def test_what_is_kept_is_shown_beside_the_next(tab):
    widget = ml.explore("vehicle", environment=[1, 2])
    answer = opened(tab, widget)
    tab.click("text='keep'")
    answer()
    tab.select_option("select", label="2")
    answer()
    assert [head.inner_text() for head in tab.query_selector_all("tr:first-child th")] == [
        "",
        "kept 1: environment 1",
        "now",
    ]
    tab.wait_for_function("() => document.querySelectorAll('iframe').length === 1")
    assert player(tab).evaluate("() => window.player.stages.length") == 2
    tab.click("text=forget kept")
    answer()
    tab.wait_for_function("() => document.querySelectorAll('iframe').length === 1")
    assert player(tab).evaluate("() => window.player.stages.length") == 1


def test_the_view_stays_where_it_was_turned_to(tab):
    widget = ml.explore("vehicle", environment=[1, 2])
    answer = opened(tab, widget)
    first = player(tab)
    first.evaluate(
        "() => { const s = window.player.stages[0]; s.touched = true; s.camera.position.x += 7; s.controls.update(); }"
    )
    place = first.evaluate("() => window.player.stages[0].camera.position.toArray()")
    tab.select_option("select", label="2")
    answer()
    tab.wait_for_function("() => document.querySelectorAll('iframe').length === 1")
    assert player(tab).evaluate("() => window.player.stages[0].camera.position.toArray()") == pytest.approx(place)


def test_moves_during_a_trial_wait_for_its_end(tab):
    widget = ml.explore("vehicle", w1=(-1.0, 1.0))
    answer = opened(tab, widget)
    tab.evaluate("() => window.from_python('busy', 0.5)")
    assert tab.is_visible("progress")
    tab.focus("input[type=range]")
    for _ in range(3):
        tab.keyboard.press("ArrowLeft")
    answer()
    assert widget.values == {"w1": 1.0}
    tab.evaluate("() => window.from_python('busy', null)")
    answer()
    assert widget.values == {"w1": 0.94} and not tab.is_visible("progress")


def test_a_robot_that_changes_its_shape(tab):
    widget = ml.explore(
        "rolling", geometry="small", repeats=1, slope=(-10, 10), bladder_friction=(0.1, 2.0), orientation=(0, 90)
    )
    answer = opened(tab, widget)
    tab.click("text='keep'")
    answer()
    tab.query_selector_all("input[type=range]")[2].focus()
    tab.keyboard.press("ArrowRight")
    answer()
    tab.wait_for_function("() => document.querySelectorAll('iframe').length === 1")
    assert widget.values["orientation"] == 0.9
    assert player(tab).evaluate("() => window.player.stages.length") == 2


def test_what_is_no_robot_is_told(tab):
    widget = ml.explore(lambda size: ml.robot("walker", frequency=size, encoding="pattern"), size=(2.0, 4.0))
    opened(tab, widget)
    assert tab.inner_text(".message") == "source: walker is no robot: the body is empty"
    assert not tab.query_selector("iframe")
