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


@pytest.fixture(params=SIZES)
def tab(chromium, request):
    """A page, of a desktop and of a phone; the test fails for an error in it, or a request that leaves it."""
    width, height = SIZES[request.param]
    page = chromium.new_page(viewport={"width": width, "height": height})
    page.form = request.param
    errors, left = [], []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
    page.on("request", lambda asked: left.append(asked.url) if asked.url.startswith(("http:", "https:")) else None)
    page.left = left
    yield page
    if folder := os.environ.get("MORPHOLAB_SCREENSHOTS"):
        page.screenshot(path=Path(folder, f"{request.node.originalname.removeprefix('test_')}-{page.form}.png"))
    page.close()
    assert not errors
    assert not [url for url in left if not url.startswith(getattr(page, "own", "no address"))]
