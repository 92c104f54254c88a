# SPDX-License-Identifier: Apache-2.0
"""Few words with one meaning in a conversation, in English and German (our lists).

A list holds whole sentences: what has one word more is left to the understanding. So "yes, but not now" is no
yes, and "stop pushing the ball when I say so" no stop.
"""

import re

from ..commands.answer import said_words

_POLITE = {"please", "bitte", "now", "jetzt", "nico", "robot", "roboter", "mal", "oh", "ok", "okay", "hey"}
_POLITE |= {"and", "und", "then", "dann", "hmm", "hm", "well", "na"}

STOP = {"stop", "stopp", "halt", "stop it", "stop that", "stop moving", "stop at once", "halt an", "anhalten"}
STOP |= {"hör auf", "freeze", "hold still", "halt still", "stay still", "wait", "warte", "sofort anhalten"}
HOME = {"home", "go home", "arms home", "go back home", "move home", "move your arms home", "nach hause"}
HOME |= {"geh nach hause", "fahr nach hause", "arme nach hause", "move your arms back"}
AGAIN = {"again", "once more", "do it again", "do that again", "try again", "try it again", "one more time"}
AGAIN |= {"nochmal", "noch mal", "noch einmal", "mach es nochmal", "mach das nochmal", "mach es noch einmal"}
AGAIN |= {"repeat", "repeat it", "repeat that", "wiederhole das", "versuch es nochmal", "versuche es nochmal"}
CARRY_ON = {"carry on", "go on", "continue", "keep going", "go ahead", "resume", "proceed", "you can go on"}
CARRY_ON |= {"you may go on", "you can continue", "weiter", "mach weiter", "weitermachen", "fahr fort"}
WATCH = {"watch me", "watch what i do", "describe what i do", "look what i do", "watch this", "watch"}
WATCH |= {"schau mir zu", "sieh mir zu", "schau zu", "sieh zu", "beschreibe was ich tue", "pass auf"}
WATCH |= {"beschreib was ich tue", "schau was ich mache", "schau her"}
DONE = {"done", "i am done", "i'm done", "that was it", "that is it", "finished", "i am finished", "ready"}
DONE |= {"what did i do", "fertig", "ich bin fertig", "das war es", "das war's", "was habe ich gemacht"}
IMITATE = {"do it again as i did", "do as i did", "do it as i did", "do it like me", "do what i did"}
IMITATE |= {"repeat what i did", "imitate me", "now you", "your turn", "mach es nach", "mach das nach"}
IMITATE |= {"mach es wie ich", "jetzt du", "mach mir das nach", "wiederhole was ich gemacht habe"}
YES = {"yes", "yeah", "yep", "yup", "sure", "of course", "right", "correct", "exactly", "do it", "yes do it"}
YES |= {
    "ja",
    "jawohl",
    "genau",
    "richtig",
    "mach es",
    "ja mach das",
    "ja genau",
    "yes i do",
    "yes i did",
    "go on",
}
YES |= {"ok", "okay", "alright", "all right", "ok yes", "okay yes", "klar", "ja klar", "ja bitte"}
NO = {"no", "nope", "nein", "no thanks", "no thank you", "nein danke", "never mind", "do not", "don't"}
NO |= {"neither", "none", "lass es", "egal", "nothing", "nichts", "not that"}
OTHER_WAY = {"the other way", "the other direction", "other way", "other direction", "the other way round"}
OTHER_WAY |= {"the other way around", "in the other direction", "the opposite direction"}
OTHER_WAY |= {"andersrum", "andersherum", "anders herum", "anders rum", "die andere richtung"}
OTHER_WAY |= {"in die andere richtung", "undo that", "undo it", "undo", "rückgängig", "mach das rückgängig"}

# "No, the mug" and "no the mug" correct, "no mug" does not.
_AFTER_NO = "the|die|der|das|den|i|ich|to|nach|wait|warte"
_NO = rf"(?:(?:no|nope|nein|sorry|ach|oh|hmm?|well|na|wait|warte)(?:\s*[,.!;:]\s*|\s+(?=(?:{_AFTER_NO})\b)))"
_MEANT = r"(?:(?:i|ich)\s+(?:meant?|meine?|meinte)\b[\s,:]*)"
# "Not the can, the mug" too.
_NOT = r"(?:(?:not|nicht)\s+[^,]+?\s*(?:,?\s*\b(?:but|sondern)\s|,)\s*)"
_CORRECTION = re.compile(rf"(?:{_NO}*{_NOT}|{_NO}+{_MEANT}?|{_MEANT})(?P<rest>.+)", re.IGNORECASE | re.DOTALL)

# "And the mug too" and "the same with the mug" say to do with it what was done last. "And the mug" alone may
# go on with a question.
_ARTICLE = r"(?:the|die|der|das|den|my|meine?n?)"
_ADDED = (
    rf"(?:(?:and|now|then|next|und|jetzt|dann)\s+)?(?P<rest>{_ARTICLE}\s.+?)\s+(?:too|also|as well|auch)",
    rf"(?:(?:and|und)\s+)?(?:also|auch)\s+(?P<rest>{_ARTICLE}\s.+)",
    r"(?:(?:please\s+)?(?:do|mach|tu)\s+)?(?:the|das)\s+(?:same|gleiche|selbe)\s+(?:thing\s+)?"
    r"(?:with|to|for|mit)\s+(?P<rest>.+)",
)


def says(words: str, phrases: set[str]) -> bool:
    """Whether words are one of some phrases, and polite words besides."""
    said = [*said_words(words)]
    return bool(said) and (
        " ".join(said) in phrases or " ".join(word for word in said if word not in _POLITE) in phrases
    )


def corrected(words: str) -> str:
    """What somebody says in place of what was said: "the mug" of "no, I meant the mug"; else ""."""
    found = _CORRECTION.fullmatch(words.strip())
    return found["rest"].strip() if found else ""


def added(words: str) -> str:
    """What is to be treated as the last thing was: "the can" of "and the can too"; else ""."""
    text = words.strip().rstrip(".! ")
    if text.endswith("?"):
        return ""
    found = (re.fullmatch(pattern, text, re.IGNORECASE | re.DOTALL) for pattern in _ADDED)
    return next((match["rest"].strip() for match in found if match), "")
