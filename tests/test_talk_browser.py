# SPDX-License-Identifier: Apache-2.0
"""The page to talk to the robot in a browser: the real command, which reaches no other computer."""

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from threading import Event, Timer
from typing import Any

import psutil
import pytest

from commands import ENVIRONMENT, hear_interrupts

BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, BROWSERS)), None)
LONGEST = 300  # seconds for all that is done in the browser, which takes 15
NO_NETWORK = "MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
DEAD_PROXY = {
    f"{kind}_proxy": "http://127.0.0.1:9" for kind in ("http", "https", "all", "HTTP", "HTTPS", "ALL")
}
WORDS, STATUS = "#words textarea, #words input", "#status"


def shows(page: Any, selector: str, text: str) -> None:
    page.locator(selector, has_text=text).first.wait_for()


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The real command, of which nothing gets out of this computer."""
    pytest.importorskip("gradio", reason="needs the extra `talk`")
    command = [sys.executable, "-m", "owlxt5_talk.cli", f"--port={free_port()}", "--visitors=1"]
    ours = {"no_proxy": "127.0.0.1", "PYTHONUNBUFFERED": "1", "OWLXT5_PLANNER_URL": ""}
    environment = ENVIRONMENT | DEAD_PROXY | ours
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment,
        preexec_fn=hear_interrupts,
    ) as server:
        assert server.stdout is not None
        lines = []
        for line in server.stdout:
            lines.append(line)
            if line.startswith("Open "):
                break
        else:
            raise AssertionError("".join(lines)[-4000:])
        assert line.startswith("Open http://127.0.0.1:")
        yield line.split()[1]
        server.send_signal(signal.SIGINT)
        output = server.communicate(timeout=60)[0]
        assert "Traceback" not in output, output[-4000:]


def in_a_browser(talk: Callable[[Any], None]) -> bool:
    """Whether somebody could talk; False if Chromium hung, as it once did: then closing it would hang too."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs the extra `dev`")
    if CHROMIUM is None:
        pytest.skip("needs Chromium; on Debian or Ubuntu: apt-get install chromium")
    options = [f"--host-resolver-rules={NO_NETWORK}", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    hung = Event()

    def give_up() -> None:
        hung.set()
        for process in psutil.Process().children(recursive=True):
            if "chrom" in process.name():
                process.kill()

    with playwright.sync_playwright() as play:
        watch = Timer(LONGEST, give_up)
        watch.start()
        try:
            browser = play.chromium.launch(executable_path=CHROMIUM, args=options)
            talk(browser)
            browser.close()
        except playwright.Error:
            if not hung.is_set():
                raise
        finally:
            watch.cancel()
    return not hung.is_set()


@pytest.mark.slow
def test_somebody_talks_to_the_robot_in_a_browser(address: str) -> None:
    assert any(in_a_browser(partial(talk, address)) for _ in range(2)), "Chromium hung twice"


def talk(address: str, browser: Any) -> None:
    context = browser.new_context(locale="en-US", viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.set_default_timeout(120_000)
    foreign, errors = [], []
    page.on("request", lambda each: foreign.append(each.url) if each.url.startswith("http") else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    page.wait_for_selector("#eyes img[src^=data]")
    page.wait_for_selector("#bystander img[src^=data]")
    page.wait_for_selector("#things button")
    assert page.evaluate("document.body.scrollWidth <= innerWidth")

    waiting = browser.new_context(locale="de-DE").new_page()
    waiting.set_default_timeout(120_000)
    waiting.goto(address)
    shows(waiting, "#status", "besetzt")
    shows(waiting, "#stop", "Halt")
    assert waiting.query_selector("#eyes img[src^=data]") is None

    # By keyboard alone: a thing is chosen, and a verb comes before it.
    page.focus("#things button >> nth=0")
    page.keyboard.press("Enter")
    name = page.input_value(WORDS).removeprefix("the ")
    assert name and page.evaluate("document.activeElement.closest('#words') !== null")
    page.keyboard.press("Home")
    page.keyboard.type("push ")
    page.keyboard.press("Enter")
    shows(page, "#chat .bot", name)
    picture = page.get_attribute("#eyes img", "src")
    page.wait_for_function("old => document.querySelector('#eyes img').src !== old", arg=picture)
    page.click("#stop")
    shows(page, "#status", "listening")
    shows(page, "#chat", "I stop")

    page.locator("#eyes img").click(position={"x": 3, "y": 3})  # the wall
    shows(page, "#chat", "I see nothing there")

    page.fill(WORDS, "<img src=x onerror=alert(1)> what do you see?")
    page.keyboard.press("Enter")
    shows(page, "#chat", "<img src=x")
    assert page.query_selector("#chat img[src=x]") is None

    page.click("text=Deutsch")
    shows(page, "#status", "NICO hört zu")
    page.click("text=bunte Würfel")
    page.wait_for_function("!document.querySelector('#chat').innerText.includes('img')")  # a new scene

    context.close()  # then the place is free
    waiting.wait_for_selector("#eyes img[src^=data]")
    waiting.context.close()
    assert [url for url in foreign if not url.startswith(address)] == []
    assert errors == []
