# SPDX-License-Identifier: Apache-2.0
"""The page: pictures, conversation and buttons, made with Gradio."""

import asyncio
import os
from collections.abc import AsyncIterator
from html import escape
from pathlib import Path
from typing import Any

os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"  # Gradio reads it when it is imported

import gradio as gr
from starlette.middleware import Middleware

from lerobot_owlxt5.commands.prompts import MAX_CHARACTERS
from nico_tabletop.simulation import CONTROL_HZ

from . import show
from .own_host import OwnHostOnly
from .texts import ENGLISH, GERMAN, TEXTS, Texts, language_of
from .visitors import Visitors
from .world import HEIGHT, WIDTH, Table, View

_FOLDER = Path(__file__).parent
_PICTURE = (
    'const picture = element.querySelector("img");'
    'watch("value", () => { if (props.value) picture.src = props.value; });'
)
_SPEECH = """
<button type="button" id="listen" hidden aria-pressed="false"><span lang="en">Listen</span><span
lang="de">Zuhören</span></button>
<button type="button" id="speak" hidden aria-pressed="false"><span lang="en">Read aloud</span><span
lang="de">Vorlesen</span></button>
<small><span lang="en">Your browser does it; some send what they hear to their maker.</span><span
lang="de">Das tut Ihr Browser; manche schicken, was sie hören, an ihren Hersteller.</span></small>
"""
_QUIETLY: dict[str, Any] = {"show_progress": "hidden", "api_visibility": "private"}


def build_page(visitors: Visitors, table: Table, sends_words: bool = False) -> gr.Blocks:
    """The page for all visitors.

    Args:
        visitors: Who has a world.
        table: What a visitor finds on the table.
        sends_words: Whether a planner sends what they say to a server: then the page says so.
    """
    english = TEXTS[ENGLISH]
    with gr.Blocks(title="NICO", analytics_enabled=False, fill_width=True) as page:
        with gr.Row(elem_id="top"):
            intro = gr.Markdown(_heading(english, sends_words))
            language = gr.Radio(
                [("English", ENGLISH), ("Deutsch", GERMAN)],
                value=ENGLISH,
                label="Language / Sprache",
                container=False,
                elem_id="language",
            )
        with gr.Row(equal_height=False):
            with gr.Column(scale=3, min_width=300):
                with gr.Column(elem_id="seen"):
                    eyes = _picture("eyes", "What NICO sees / Was NICO sieht")
                    things = gr.HTML(elem_id="things", js_on_load=None)
                place = gr.Textbox(elem_id="place", visible="hidden")
                status = gr.HTML(show.said_politely(english.preparing), elem_id="status", js_on_load=None)
            with gr.Column(scale=2, min_width=300):
                chat = gr.Chatbot(
                    label=english.chat,
                    height=300,
                    render_markdown=False,
                    buttons=[],
                    feedback_options=None,
                    elem_id="chat",
                )
                words = gr.Textbox(
                    label=english.words,
                    placeholder=english.placeholder,
                    max_length=MAX_CHARACTERS,
                    lines=1,
                    max_lines=1,
                    elem_id="words",
                )
                with gr.Row():
                    say = gr.Button(english.say, variant="primary", min_width=80, elem_id="say")
                    stop = gr.Button(english.stop, variant="stop", min_width=80, elem_id="stop")
                    home = gr.Button(english.home, min_width=80, elem_id="home")
                    show_it = gr.Button(english.show, min_width=80, elem_id="show")
                gr.HTML(_SPEECH, elem_id="speech", js_on_load="window.owlxt5Speech(element);")
                spoken = gr.HTML(
                    elem_id="spoken",
                    html_template="<span></span>",
                    visible="hidden",
                    js_on_load='watch("value", () => window.owlxt5Say(props.value));',
                )
        with gr.Row(equal_height=False):
            with gr.Column(scale=2, min_width=300):
                bystander = _picture("bystander", "NICO at its table / NICO an seinem Tisch")
            with gr.Column(scale=3, min_width=300):
                objects = gr.Radio(
                    _choices(english.object_sets),
                    value=table.objects,
                    label=english.objects,
                    elem_id="objects",
                )
                placement = gr.Radio(
                    _choices(english.placements),
                    value=table.placement,
                    label=english.placement,
                    elem_id="placement",
                )
                new_scene = gr.Button(english.new_scene, elem_id="new_scene")

        worded = [intro, chat, words, say, stop, home, show_it, objects, placement, new_scene]

        def in_language(chosen: str, request: gr.Request) -> list[Any]:
            texts = TEXTS.get(chosen, english)
            if visitor := visitors.find(request.session_hash):
                visitor.language = chosen if chosen in TEXTS else ENGLISH
            return _worded(texts, sends_words)

        def first_language(request: gr.Request) -> list[Any]:
            chosen = language_of(request.headers.get("accept-language", ""))
            return [chosen, *_worded(TEXTS[chosen], sends_words)]

        async def watch(request: gr.Request) -> AsyncIterator[list[Any]]:
            async for shown in _watch(visitors, request):
                yield shown

        def hear(said: str, request: gr.Request) -> Any:
            visitor = visitors.find(request.session_hash)
            if visitor is None:
                return gr.skip()
            visitor.say(str(said))
            return ""

        def lay(chosen: str, placed: str, request: gr.Request) -> None:
            if visitor := visitors.find(request.session_hash):
                visitor.lay(Table(chosen, placed))

        def hold(request: gr.Request) -> None:
            if visitor := visitors.find(request.session_hash):
                visitor.stop()

        def go_home(request: gr.Request) -> None:
            if visitor := visitors.find(request.session_hash):
                visitor.home()

        def point(where: str, request: gr.Request) -> None:
            if visitor := visitors.find(request.session_hash):
                visitor.point(str(where))

        def be_shown(request: gr.Request) -> None:
            if visitor := visitors.find(request.session_hash):
                visitor.show()

        def leave(request: gr.Request) -> None:
            visitors.leave(request.session_hash)

        set_lang = "(chosen) => { document.documentElement.lang = chosen; return chosen; }"
        language.change(in_language, language, worded, js=set_lang, **_QUIETLY)
        page.load(first_language, None, [language, *worded], **_QUIETLY)
        page.load(
            watch, None, [eyes, bystander, things, status, chat, spoken], concurrency_limit=None, **_QUIETLY
        )
        gr.on([say.click, words.submit], hear, words, words, **_QUIETLY)
        gr.on([new_scene.click, objects.input, placement.input], lay, [objects, placement], None, **_QUIETLY)
        place.change(point, place, None, **_QUIETLY)
        stop.click(hold, None, None, queue=False, **_QUIETLY)
        home.click(go_home, None, None, **_QUIETLY)
        show_it.click(be_shown, None, None, **_QUIETLY)
        page.unload(leave)
    return page


def open_page(page: gr.Blocks, host: str | None = None, port: int | None = None) -> str:
    """Serve the page, from this host alone and to nobody's statistics.

    Args:
        page: From `build_page`.
        host: Where it listens; Gradio's own choice if None, as in a Space.
        port: The same.

    Returns:
        Its address.

    Raises:
        OSError: If the port is taken.
    """
    _, address, _ = page.launch(
        server_name=host,
        server_port=port,
        prevent_thread_lock=True,
        quiet=True,
        share=False,
        footer_links=[],
        show_error=False,
        enable_monitoring=False,
        ssr_mode=False,
        run_history=False,  # browsers would keep what was said
        max_file_size=1,  # there is nothing to upload
        app_kwargs={"middleware": [Middleware(OwnHostOnly)], "openapi_url": None},
        theme=gr.themes.Soft(font=["system-ui", "sans-serif"], font_mono=["ui-monospace", "monospace"]),
        css=(_FOLDER / "page.css").read_text(encoding="utf-8"),
        head=f"<script>{(_FOLDER / 'page.js').read_text(encoding='utf-8')}</script>",
    )
    return address


async def _watch(visitors: Visitors, request: gr.Request) -> AsyncIterator[list[Any]]:
    """What is new for somebody, until they leave: pictures, things, status, conversation, what was said."""
    session = str(request.session_hash)
    language = language_of(request.headers.get("accept-language", ""))
    while (visitor := visitors.enter(session)) is None:
        yield [*[gr.skip()] * 3, show.said_politely(TEXTS[language].waiting), *[gr.skip()] * 2]
        await asyncio.sleep(1)
    visitor.language = language
    shown: list[Any] = [None] * 6
    try:
        while visitors.find(session) is visitor:
            new = _shown(visitor.view, TEXTS[visitor.language])
            if new != shown:
                yield [gr.skip() if one == before else one for one, before in zip(new, shown, strict=True)]
                shown = new
            await asyncio.sleep(0.5 / CONTROL_HZ)
    finally:
        visitors.leave(session)  # also where a browser is gone without a word
    yield [*[gr.skip()] * 3, show.said_politely(TEXTS[visitor.language].left), *[gr.skip()] * 2]


def _shown(view: View, texts: Texts) -> list[Any]:
    chat = [
        {"role": _ROLES.get(speaker, "assistant"), "content": escape(text)} for speaker, text in view.lines
    ]
    speaker, last = view.lines[-1] if view.lines else ("", "")
    return [
        show.data_url(view.eyes),
        show.data_url(view.bystander),
        show.things(view),
        show.status(view, texts),
        chat,
        "" if speaker in _ROLES else last,
    ]


_ROLES = {"person": "user"}


def _worded(texts: Texts, sends_words: bool) -> list[Any]:
    """The words of all that has some, in the order of `worded`."""
    return [
        _heading(texts, sends_words),
        gr.update(label=texts.chat),
        gr.update(label=texts.words, placeholder=texts.placeholder),
        texts.say,
        texts.stop,
        texts.home,
        texts.show,
        gr.update(label=texts.objects, choices=_choices(texts.object_sets)),
        gr.update(label=texts.placement, choices=_choices(texts.placements)),
        texts.new_scene,
    ]


def _heading(texts: Texts, sends_words: bool) -> str:
    return f"# NICO\n{texts.intro} {texts.sends_words if sends_words else ''}".strip()


def _choices(named: dict[str, str]) -> list[tuple[str, str]]:
    return [(label, name) for name, label in named.items()]


def _picture(name: str, alternative: str) -> gr.HTML:
    return gr.HTML(
        html_template=f'<img alt="{alternative}" width="{WIDTH}" height="{HEIGHT}">',
        js_on_load=_PICTURE,
        elem_id=name,
    )
