"""What can go wrong, and the exit status each kind ends in. Imports nothing of slopemap, so every room may use it."""

from __future__ import annotations

from enum import IntEnum


class ExitStatus(IntEnum):
    """What the command line ends in."""

    UNUSABLE = 1  # an input; of an error that nobody raised on purpose, too
    NO_ANSWER = 3  # the inputs were read, and the scene gives none
    SOME_WITHOUT_ANSWER = 4  # of a batch that finished
    INTERRUPTED = 130


def visible(text: str) -> str:
    """The text with what a terminal would obey, or nobody would see, as escapes: control characters, ends of lines,
    marks that turn the direction of reading, parts of damaged names. The joiners that scripts need stay."""
    return "".join(c if c.isprintable() or c in "\u200c\u200d" else c.encode("unicode_escape").decode() for c in text)


class SlopemapError(Exception):
    """Base of all errors slopemap raises on purpose. `str(error)` is the one line a user reads."""

    exit_code = ExitStatus.UNUSABLE


class InputError(SlopemapError):
    """An input is unusable. The message says which, what was found, what was needed and what to try."""


class WrongArgument(InputError, TypeError):
    """An argument of a Python function is of a wrong type, missing, or unknown. The message says what is wanted."""


def expect(name: str, value: object, kind: type, remedy: str) -> None:
    """Raise WrongArgument unless an argument is of its kind; `remedy` says how to get one."""
    if not isinstance(value, kind):
        raise WrongArgument(f"{name} is of type {type(value).__name__}, needed a {kind.__name__}, {remedy}")


class DiskFull(InputError):
    """There is no space left for what is to be written."""


class NoAnswer(SlopemapError):
    """The inputs were read, but the scene gives no answer (no overlap, no texture, no parallax, pure rotation).

    Parameters
    ----------
    code : of a row of `findings.codes.CODES` with the severity "refusal", for example "pure-rotation".
    reason : what was found, with its number.
    remedy : what to do about it.
    """

    exit_code = ExitStatus.NO_ANSWER

    def __init__(self, code: str, reason: str, remedy: str, value: float | None = None) -> None:
        super().__init__(f"{code}: {reason}; {remedy}")
        self.code = code
        self.reason = reason
        self.remedy = remedy
        self.value = value


class DegenerateConfiguration(SlopemapError):
    """A geometric problem has no unique solution: too few, collinear or coincident points, or no motion."""

    exit_code = ExitStatus.NO_ANSWER
