"""The player's page: what it holds, and what a browser would make of it."""

import base64
import json
import re
import zlib
from html.parser import HTMLParser

import numpy as np
import pytest
from made_motion import made

from robots.view.film import save_strip
from robots.view.motion import CUBE, Channel, Motion, Node
from robots.view.player import page, save_player, show
from robots.view.player.packing import NUMBERS, TOLERANCE, Packed, pack
from robots.view.player.page import MOST_VALUES, _channel
from robots.view.still import save_still
from taichi_sim.lattice.faces import rotate
from taichi_sim.rigid import Capsule

SIGNS = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])


def unpack(packed):
    """Decompress poses: translation (F, N, 3), rotation (F, N, 4) and scale (F, N, 3), as a player shows them."""
    split = np.frombuffer(zlib.decompress(packed.data), np.uint8).reshape(packed.planes, -1)
    unsigned = sum((plane.astype(np.int64) << (8 * k) for k, plane in enumerate(split)), np.zeros(1, np.int64))
    changes = ((unsigned >> 1) ^ -(unsigned & 1)).reshape(packed.frames, NUMBERS, packed.nodes)
    whole = np.moveaxis(np.cumsum(changes, axis=0), 1, 2)
    parts = zip(np.split(whole, [3, 7], axis=2), packed.steps, strict=True)
    translation, rotation, scale = (part.astype(np.float64) * step for part, step in parts)
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)
    return translation, rotation, scale


class Page(HTMLParser):
    """Elements of a page with their attributes, and the texts of its scripts by their ids."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: dict[str | None, str] = {}
        self.styles = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self.inside = tag

    def handle_endtag(self, tag):
        self.inside = None

    inside = None

    def handle_data(self, data):
        if self.inside == "script":
            name = self.elements[-1][1].get("id")
            self.scripts[name] = self.scripts.get(name, "") + data
        if self.inside == "style":
            self.styles += data


def robot(frames=200, voxels=300, seed=0) -> Motion:
    """Cubes of 1 cm that wander, turn and grow, together and each for itself."""
    draw = np.random.default_rng(seed)
    wander = np.cumsum(draw.normal(0, 2e-4, (frames, voxels, 3)), axis=0) + np.linspace(0, 0.6, frames)[:, None, None]
    vectors = np.cumsum(draw.normal(0, 2e-3, (frames, voxels, 3)), axis=0) + np.linspace(0, 9, frames)[:, None, None]
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    turns = np.concatenate([np.cos(angle / 2), np.sin(angle / 2) * vectors / angle], -1)
    size = 0.01 * (1 + 0.3 * np.sin(np.linspace(0, 9, frames)))[:, None, None] * np.ones((voxels, 3))
    places = draw.uniform(-0.1, 0.1, (voxels, 3)) + wander
    nodes = tuple(Node(f"voxel {n}", CUBE, (0.5, 0.5, 0.5)) for n in range(voxels))
    times = np.linspace(0.0, 20.0, frames)
    return Motion("robot", times, nodes, places, turns, size, places.mean(axis=1))


def test_every_corner_is_within_a_tenth_of_a_millimetre():
    motion = robot()
    translation, rotation, scale = unpack(pack(motion))
    assert TOLERANCE == 1e-4
    assert np.linalg.norm(translation - motion.translation, axis=-1).max() <= 0.5 * TOLERANCE + 1e-12

    def corners(places, turns, sizes):
        return places[:, :, None] + rotate(turns[:, :, None], SIGNS * sizes[:, :, None])

    shown = corners(translation, rotation, scale)
    true = corners(motion.translation, motion.rotation, motion.scale)
    error = np.linalg.norm(shown - true, axis=-1).max()
    assert 0.2 * TOLERANCE < error <= TOLERANCE


def test_ends_of_long_solids_are_as_exact():
    limb = Capsule(0.05, 1.0)
    motion = made(frames=100, nodes=tuple(Node(f"limb {n}", limb, (0, 0, 0)) for n in range(3)))
    translation, rotation, scale = unpack(pack(motion))
    end = np.array([0.0, 0.0, 0.55])
    shown = translation + rotate(rotation, end * scale)
    true = motion.translation + rotate(motion.rotation, end * motion.scale)
    assert np.linalg.norm(shown - true, axis=-1).max() <= 1e-4


def test_a_still_motion_takes_no_room_and_a_far_one_is_refused():
    still = made(frames=1)
    held = Motion(
        "still",
        np.arange(500.0),
        still.nodes,
        *(np.repeat(a, 500, axis=0) for a in (still.translation, still.rotation, still.scale, still.path)),
    )
    assert len(pack(held).data) < 1000
    far = made(translation=np.full((4, 3, 3), 1e6))
    with pytest.raises(ValueError, match=r"^motion: 1e\+06 m is too far for steps of [\de.-]+; show less of it$"):
        pack(far)


def test_charts_of_many_values_keep_extremes_and_ends():
    """Every 16th of the values of a sine with 16 nodes a cycle would be the same."""
    times = np.arange(31841) / 64
    told = _channel(Channel("muscle", "", times, np.sin(2 * np.pi * np.arange(31841) / 16)), 0.0)
    assert told["range"] == pytest.approx([-1.0, 1.0]) and told["times"][-1] == times[-1]
    assert len(told["times"]) <= MOST_VALUES and (np.diff(told["times"]) > 0).all()
    few = _channel(Channel("muscle", "", times[:MOST_VALUES], np.arange(MOST_VALUES)), 0.0)
    assert few["values"] == list(range(MOST_VALUES))


def test_read_outs_are_what_channels_say_and_not_what_they_are_called():
    times, values = [0.0, 0.5, 1.0], [3.0, 5.0, 4.0]
    named = ("speed of a wave", False), ("depth", True), ("distance", False)
    channels = [Channel(name, "", times, values, read_out=read_out) for name, read_out in named]
    (about,) = json.loads(Page(page(made(channels=channels))).scripts["about"])
    assert about["readouts"] == [1]


def test_a_page_holds_its_motions():
    motions = [robot(20, 30), made(channels=[Channel("heat", "K", [0.0, 0.5, 1.0], [3.0, 5.0, 4.0])])]
    seen = Page(page(motions, "Two & <b>more</b>"))
    about = json.loads(seen.scripts["about"])
    assert [motion["name"] for motion in about] == ["robot", "made"]
    for n, (motion, told) in enumerate(zip(motions, about, strict=True)):
        packed = Packed(
            told["frames"],
            told["nodes"],
            tuple(told["steps"]),
            told["planes"],
            base64.b64decode(seen.scripts[f"motion-{n}"]),
        )
        translation, rotation, scale = unpack(packed)
        assert np.abs(translation - motion.translation).max() <= 1e-4
        assert (np.abs((rotation * motion.rotation).sum(axis=-1)) > 0.999).all()
        assert np.abs(scale - motion.scale).max() <= 1e-4
        assert told["times"] == pytest.approx(motion.times, abs=1e-6)
        solids = [motion.nodes[told["solid_of"].index(k)].solid for k in range(len(told["solids"]))]
        assert [solids[k] for k in told["solid_of"]] == [node.solid for node in motion.nodes]
        colours = np.array(told["colours"])[told["colour_of"]]
        assert colours == pytest.approx(np.array([node.colour for node in motion.nodes]), abs=1e-4)
    (heat,) = about[1]["channels"]
    assert heat["values"] == [3.0, 5.0, 4.0] and heat["times"] == [0.0, 0.5, 1.0] and heat["range"] == [3.0, 5.0]


def test_a_page_needs_nothing_else():
    text = page(robot(5, 5), "One </script><script src='https://example.org/x.js'>")
    seen = Page(text)
    policy = dict(seen.elements[[tag for tag, _ in seen.elements].index("meta", 3)][1])
    assert policy["http-equiv"] == "Content-Security-Policy" and policy["content"].startswith("default-src 'none'; ")
    assert "http" not in policy["content"]
    for tag, attributes in seen.elements:
        assert tag not in ("link", "img", "iframe", "object", "base") and not {"src", "href"} & set(attributes)
    assert "url(" not in seen.styles and "@import" not in seen.styles
    program = "".join(text for name, text in seen.scripts.items() if name is None)
    assert not re.search(r"\bimport\(|\bfetch\(|XMLHttpRequest\(|WebSocket\(", program.replace("THREE", ""))
    assert "Copyright © 2010" in text and "Permission is hereby granted" in text  # three.js' licence


@pytest.mark.parametrize("name", ["</script><b>", "<!--<script>", "<!-- <SCRIPT "])
def test_what_is_written_in_names_stays_text(name):
    channel = Channel(name, "m", np.array([0.0, 1.0]), np.array([0.0, 2.0]), (0, 0, 0))
    text = page(made(name=name, channels=(channel,)), "<i>&")
    seen = Page(text)
    (about,) = json.loads(seen.scripts["about"])
    assert about["name"] == about["channels"][0]["name"] == name
    # Python's parser knows no escapes of scripts, browsers do: "<!--<script" hides the end of the element.
    embedded = re.search('<script id="about"[^>]*>(.*?)</script>', text, re.S)[1]
    assert "<" not in embedded
    assert not {"b", "i"} & {tag for tag, _ in seen.elements}


def test_names_that_are_no_utf_8_are_shown_as_escapes(tmp_path):
    """As those of files and folders may be."""
    named = made(name="a\udcff")
    size = save_player(named, tmp_path / "a.html", title="a\udcff")
    assert size == (tmp_path / "a.html").stat().st_size and "<title>a\\udcff" in (tmp_path / "a.html").read_text()
    for save in (save_still, save_strip):
        assert save(named, tmp_path / f"{save.__name__}.png") > 1000


def test_a_browser_without_webgl_is_told():
    seen = Page(page(made()))
    assert "noscript" in {tag for tag, _ in seen.elements}
    assert "shows no 3D graphics (WebGL 2)" in seen.scripts[None]


def test_a_slow_wide_gait_fits_into_few_bytes(tmp_path):
    size = save_player(robot(400, 200), tmp_path / "page.html", title="A page")
    assert size == (tmp_path / "page.html").stat().st_size
    per_pose = (size - 650_000) / (400 * 200)
    assert per_pose < 12  # 4 for a gait of the robot, whose voxels go together; these are noise


def test_a_page_that_exists_is_kept_and_empty_pages_are_refused(tmp_path):
    path = tmp_path / "page.html"
    path.write_text("mine")
    with pytest.raises(ValueError, match=r"^path: .*page.html exists; name a new file$"):
        save_player(made(), path)
    assert path.read_text() == "mine"
    with pytest.raises(ValueError, match=r"^motions: 0 are not allowed; give one, or up to 4$"):
        save_player([], tmp_path / "other.html")
    assert not (tmp_path / "other.html").exists()


def test_a_notebook_shows_the_page_in_a_frame():
    player = show(made(), title="Ours", height=500)
    frame = Page(player._repr_html_())
    ((tag, attributes),) = frame.elements
    assert tag == "iframe" and attributes["srcdoc"] == player.page and "height:500px" in attributes["style"]
    assert zlib.crc32(player.page.encode()) == zlib.crc32(page(made(), "Ours").encode())  # the same bits again
    with pytest.raises(ValueError, match=r"^height: 20 is not allowed; give a whole number, at least 200$"):
        show(made(), height=20)
