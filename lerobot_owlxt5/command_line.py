# SPDX-License-Identifier: Apache-2.0
"""What our commands share: options, read by draccus, and mistakes that end in one line."""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import wraps
from io import TextIOWrapper
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import draccus
import yaml
from draccus.utils import DecodingError, ParsingError

# draccus takes what begins so for the name of a file to read an option from.
_INCLUDE = "include"
_TEXT = {str, Path, type(None)}


class _Option(NamedTuple):
    """An option of a command: its name, such as `dataset.root`, its types, and what it was set to."""

    name: str
    types: frozenset[Any]
    value: Any


def command(name: str, *errors: type[Exception]) -> Callable[[Callable[[Any], None]], Callable[[], None]]:
    """Turn a function of a configuration into a command, as `draccus.wrap` does.

    Unlike there, texts stay as they were typed, and an option that cannot be read ends in one line.

    Args:
        name: What its messages begin with.
        *errors: What ends in one line and exit status 1, beside OSError and ValueError: what a user can mend.
    """
    mendable: tuple[type[Exception], ...] = (OSError, ValueError, *errors)

    def decorate(function: Callable[[Any], None]) -> Callable[[], None]:
        [config_class] = (kind for key, kind in get_type_hints(function).items() if key != "return")

        @wraps(function)
        def run() -> None:
            write_whatever_the_locale()
            try:
                config = draccus.parse(config_class, args=quote_texts(config_class, sys.argv[1:]))
                check_given(config)
            except (ParsingError, ValueError, OSError, yaml.YAMLError) as error:
                sys.exit(f"{name}: {explain(error)}")
            try:
                function(config)
            except mendable as error:
                sys.exit(f"{name}: {error}")

        return run

    return decorate


def run_with_policy(
    name: str, config_class: type, function: Callable[[], None], *errors: type[Exception]
) -> None:
    """Run a function that LeRobot's `parser.wrap()` decorates, which knows --policy.path.

    As with `command`, texts stay as they were typed, and an error that the user can mend ends in one line.

    Args:
        name: What its messages begin with.
        config_class: Of its options.
        function: Reads them from `sys.argv`.
        *errors: What else ends in one line, and exit status 1.
    """
    usual: tuple[type[Exception], ...] = (OSError, ValueError, ParsingError, yaml.YAMLError)
    write_whatever_the_locale()
    sys.argv[1:] = quote_texts(config_class, sys.argv[1:])
    try:
        function()
    except (*usual, *errors) as error:
        sys.exit(f"{name}: {explain(error)}")


def write_whatever_the_locale() -> None:
    """Print a question mark for what the terminal's encoding lacks: a command does not end because of it."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


def quote_texts(config_class: type, arguments: Sequence[str]) -> list[str]:
    """Keep YAML, as which draccus reads every option, from seeing a number in a folder's name.

    Args:
        config_class: Configuration of the command.
        arguments: What was typed, such as `--root=20261126`.

    Returns:
        The same, with the values of texts and paths in quotes: `--root="20261126"`.
    """
    texts = {f"--{option.name}" for option in _options(config_class) if option.types <= _TEXT}
    quoted, value_of_text = list[str](), False
    for argument in arguments:
        option, equals, value = argument.partition("=")
        if value_of_text and not argument.startswith("--"):
            quoted.append(_quote(argument))
        elif equals and option in texts:
            quoted.append(f"{option}={_quote(value)}")
        else:
            quoted.append(argument)
        value_of_text = argument in texts
    return quoted


def _quote(text: str) -> str:
    # Every JSON text is one of YAML.
    return json.dumps(f"./{text}" if text.startswith(_INCLUDE) else text, ensure_ascii=False)


def check_given(config: Any) -> None:
    """Check that every option that needs a value has one: draccus takes `null` for any of them.

    Raises:
        ValueError: Naming the option.
    """
    for option in _options(type(config), config):
        if option.value is None and type(None) not in option.types:
            raise ValueError(f"--{option.name} needs a value, not null")


def check_numbers(config: Any, *positive: str) -> None:
    """Check that options are above 0, as far as they have a value, and that the seed is not negative.

    Args:
        config: Configuration of the command, with a `seed`.
        *positive: Names of the options that must be above 0.

    Raises:
        ValueError: Naming the option.
    """
    for name in positive:
        value = getattr(config, name)
        if value is not None and not value > 0:
            raise ValueError(f"--{name} must be above 0; got {value}")
    if config.seed < 0:
        raise ValueError(f"--seed must not be negative; got {config.seed}")


def explain(error: Exception) -> str:
    """One line on why options could not be read."""
    if isinstance(error, DecodingError):
        # Of a choice of types the last line is on the last one; there is one beside None.
        reason = error.message.strip().splitlines()[-1].strip()
        return f"--{'.'.join(error.key_path)}: {reason}"
    while isinstance(error, ParsingError) and isinstance(error.__cause__, Exception):
        error = error.__cause__
    return " ".join(str(error).split())


def _options(config_class: type, config: Any = None, prefix: str = "") -> Iterator[_Option]:
    """The options of a configuration and of those in it, with their values if it is given."""
    hints = get_type_hints(config_class)
    for field in fields(config_class):
        kind, value = hints[field.name], getattr(config, field.name, None)
        if is_dataclass(kind) and isinstance(kind, type):
            yield from _options(kind, value, f"{prefix}{field.name}.")
        else:
            types = frozenset(get_args(kind) or (kind,))
            yield _Option(prefix + field.name, types, value)
