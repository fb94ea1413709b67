"""A browser without a screen, in which nothing may reach for the network."""

import os
import shutil
from pathlib import Path

import pytest

SIZES = {"desktop": (1280, 900), "phone": (390, 844)}


@pytest.fixture(scope="session")
def chromium():
    sync_api = pytest.importorskip("playwright.sync_api")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_api.sync_playwright() as started:
        # Software in place of a graphics card, so that all machines draw alike.
        browser = started.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        )
        yield browser
        browser.close()


def shot(page, name):
    """Keeps a picture of a page in the folder that ``MORPHOLAB_SCREENSHOTS`` names, if it names one."""
    if folder := os.environ.get("MORPHOLAB_SCREENSHOTS"):
        page.screenshot(path=Path(folder, f"{name}-{page.form}.png"))


@pytest.fixture(params=SIZES)
def tab(chromium, request):
    """A page, of a desktop and of a phone; the test fails for an error in it, or a request that leaves it."""
    width, height = SIZES[request.param]
    page = chromium.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(120_000)  # of a busy machine, which draws without a graphics card
    page.form = request.param
    page.shot = lambda name: shot(page, name)
    errors, left = [], []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
    page.on("request", lambda asked: left.append(asked.url) if asked.url.startswith(("http:", "https:")) else None)
    page.own, page.expected = None, ()  # the address that it may ask, and how errors begin that are no fault
    yield page
    page.shot(request.node.originalname.removeprefix("test_"))
    page.close()
    assert not [error for error in errors if not error.startswith(tuple(page.expected))]
    assert not [url for url in left if page.own is None or not url.startswith(page.own)]
