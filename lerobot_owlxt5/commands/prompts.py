# SPDX-License-Identifier: Apache-2.0
"""The modes (paper, section 3), and the prompt that asks the language model for each."""

from .answer import heard
from .parser import spoken

# CrossT5 alone has the last one.
MODES = ("execute", "describe", "repeat_action", "translate", "repeat_language")
EXECUTE, DESCRIBE, REPEAT_ACTION, TRANSLATE, REPEAT_LANGUAGE = range(len(MODES))


def execute_prompt(command: str) -> str:
    """Ask for a command's movement."""
    return f"execute: {spoken(command)}"


def describe_prompt(label: str = "") -> str:
    """Ask what happened; to the object with this label, if a detector saw it move."""
    return f"describe: {spoken(label)}".strip()


def repeat_action_prompt() -> str:
    """Ask for the joint sequence that went in."""
    return "repeat action:"


def repeat_language_prompt(command: str) -> str:
    """Ask for the words that went in."""
    return f"repeat language: {spoken(command)}"


def translate_prompt(sentence: str) -> str:
    """Ask for a translation, with the prefix that T5 was pretrained with."""
    return f"Translate English to German: {sentence}"


def understand_prompt(sentence: str) -> str:
    """Ask what a sentence asks for: a formal answer (`answer.py`)."""
    return f"understand: {heard(sentence)}"
