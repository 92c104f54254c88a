# SPDX-License-Identifier: Apache-2.0
"""A view of a world as pieces of a web page; all words in it are escaped."""

from base64 import b64encode
from html import escape

from .texts import Texts
from .world import Seen, View


def data_url(jpeg: bytes) -> str:
    """A picture for an `<img>`; empty if there is none yet."""
    return f"data:image/jpeg;base64,{b64encode(jpeg).decode()}" if jpeg else ""


def things(view: View) -> str:
    """Buttons over the eyes' picture, one on each thing that is seen; what is looked at has a frame."""
    target = view.looking_at
    rest = [thing for thing in view.things if target is None or not target.covers(thing)]
    buttons = [_button(thing, "thing") for thing in rest]
    return "".join([*buttons, *([_button(target, "thing target")] if target else [])])


def _button(thing: Seen, kind: str) -> str:
    left, upper, right, lower = (100 * min(max(edge, 0.0), 1.0) for edge in thing.box)
    place = f"left:{left:.1f}%;top:{upper:.1f}%;width:{right - left:.1f}%;height:{lower - upper:.1f}%"
    name = escape(thing.name, quote=True)
    return (
        f'<button type="button" class="{kind}" style="{place}" data-thing="{name}" aria-label="{name}">'
        f"<span>{name}</span></button>"
    )


def status(view: View, texts: Texts) -> str:
    """One sentence on what the robot does."""
    if view.failed:
        sentence = texts.failed
    elif not view.eyes:
        sentence = texts.preparing
    elif not view.busy:
        sentence = texts.listening
    elif view.looking_at is None:
        sentence = texts.moving
    else:
        sentence = texts.looking.format(view.looking_at.name)
    return said_politely(sentence)


def said_politely(sentence: str) -> str:
    """A sentence that a screen reader reads when it changes."""
    return f'<p role="status" aria-live="polite">{escape(sentence)}</p>'
