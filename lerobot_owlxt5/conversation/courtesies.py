# SPDX-License-Identifier: Apache-2.0
"""Courtesies in English and German, and what a robot says to them (our lists and our words).

As in `phrases`, a list holds whole sentences: what has one word more is left to the understanding.
"""

from collections.abc import Sequence

from ..commands.parser import with_article
from ..commands.replies import listed
from .phrases import says

_GREETINGS = {"hello", "hi", "hey", "hello there", "hi there", "hey there", "good morning", "good day"}
_GREETINGS |= {"good afternoon", "good evening", "greetings", "nice to meet you", "pleased to meet you"}
_GREETINGS |= {"hallo", "guten morgen", "guten tag", "guten abend", "moin", "servus", "grüß dich"}
_HOW_ARE_YOU = {"how are you", "how are you doing", "how are you today", "how is it going", "what's up"}
_HOW_ARE_YOU |= {"how's it going", "are you okay", "wie geht es dir", "wie geht's", "wie geht's dir"}
_THANKS = {"thanks", "thank you", "thank you very much", "thank you so much", "thanks a lot", "cheers"}
_THANKS |= {"many thanks", "great thanks", "perfect thanks", "thanks that was great", "danke", "danke schön"}
_THANKS |= {"dankeschön", "vielen dank", "danke dir", "danke sehr", "danke das war toll"}
_PRAISE = {"well done", "good job", "great job", "nice job", "nice work", "good work", "great", "very good"}
_PRAISE |= {"good", "nice", "perfect", "excellent", "wonderful", "bravo", "super", "amazing", "awesome"}
_PRAISE |= {"that was great", "that was good", "that was perfect", "you are great", "you are good"}
_PRAISE |= {"good robot", "prima", "toll", "gut gemacht", "sehr gut", "das war toll", "das war gut", "klasse"}
_ASSENT = {"ok", "okay", "alright", "all right", "fine", "i see", "aha", "got it", "understood", "ach so"}
_ASSENT |= {"in ordnung", "alles klar", "verstanden", "na gut", "okay then", "ok then"}
_FAREWELLS = {"bye", "goodbye", "good bye", "bye bye", "see you", "see you later", "good night", "farewell"}
_FAREWELLS |= {"tschüss", "tschüs", "auf wiedersehen", "ciao", "gute nacht", "bis bald", "bis später"}

READY = "I am ready: tell me what to push, pull or slide."


def courtesy(words: str, seen: Sequence[str]) -> str | None:
    """What to say to a courtesy; None if the words are none, or more than that.

    Args:
        words: What somebody says.
        seen: What the things are called that the robot sees.
    """
    sees = f" I see {listed([with_article(name) for name in seen], 'and')}." if seen else ""
    replies = (
        (_GREETINGS, f"Hello!{sees} Tell me what to push, pull or slide."),
        (_HOW_ARE_YOU, READY),
        (_THANKS, "You are welcome."),
        (_PRAISE, "Thank you."),
        (_ASSENT, "All right."),
        (_FAREWELLS, "Goodbye!"),
    )
    return next((reply for phrases, reply in replies if says(words, phrases)), None)
