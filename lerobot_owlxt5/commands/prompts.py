# SPDX-License-Identifier: Apache-2.0
"""The modes (paper, section 3), and the prompt that asks the language model for each."""

from collections.abc import Sequence
from reprlib import repr as shortened

from .answer import heard
from .parser import spoken

# CrossT5 alone has the last one.
MODES = ("execute", "describe", "repeat_action", "translate", "repeat_language")
EXECUTE, DESCRIBE, REPEAT_ACTION, TRANSLATE, REPEAT_LANGUAGE = range(len(MODES))

MAX_CHARACTERS = 500
"""Longest text that goes into a prompt. A language model's memory grows with the square of its length."""


def execute_prompt(command: str) -> str:
    """Ask for a command's movement."""
    return f"execute: {spoken(_checked(command))}"


def describe_prompt(label: str = "") -> str:
    """Ask what happened; to the object with this label, if a detector saw it move."""
    return f"describe: {spoken(_checked(label))}".strip()


def repeat_action_prompt() -> str:
    """Ask for the joint sequence that went in."""
    return "repeat action:"


def repeat_language_prompt(command: str) -> str:
    """Ask for the words that went in."""
    return f"repeat language: {spoken(_checked(command))}"


def translate_prompt(sentence: str) -> str:
    """Ask for a translation, with the prefix that T5 was pretrained with."""
    return f"Translate English to German: {_checked(sentence)}"


def name_in_english_prompt(name: str) -> str:
    """Ask what a thing that was named in English or German is called in English."""
    return f"Translate German to English: {_checked(name)}"


def understand_prompt(sentence: str) -> str:
    """Ask what a sentence asks for: a formal answer (`answer.py`)."""
    return f"understand: {heard(_checked(sentence))}"


def _checked(text: str) -> str:
    check_texts([text], "A prompt")
    return text


def check_texts(texts: Sequence[str], what: str) -> None:
    """Check texts before anything reads them.

    Args:
        texts: What is to be read.
        what: What they are, to begin the message with.

    Raises:
        ValueError: If this is not a list of texts, or one is too long.
    """
    if isinstance(texts, str) or not all(isinstance(each, str) for each in texts):
        raise ValueError(f"{what} must be given as a list of texts, and is {shortened(texts)}.")
    if long := [each for each in texts if len(each) > MAX_CHARACTERS]:
        raise ValueError(
            f"{what} may have at most {MAX_CHARACTERS} characters, but {shortened(long[0])} has "
            f"{len(long[0])}: shorten it."
        )
