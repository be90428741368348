"""Questions to the user on the terminal; answers come from the standard input, also from a file."""

import sys

from drivers.errors import ConfigError


def ask(question: str, default: str = "") -> str:
    """Return the answer to a question; the default for an empty line.

    Raises:
        ConfigError: The input has ended.
    """
    shown = f" [{default}]" if default else ""
    sys.stderr.write(f"{question}{shown}: ")
    sys.stderr.flush()
    line = sys.stdin.readline()
    if not line:
        raise ConfigError(f"the question '{question}' got no answer: run the command in a terminal")
    if not sys.stdin.isatty():
        sys.stderr.write(f"{line.strip()}\n")
    return line.strip() or default


def ask_yes(question: str, *, default: bool) -> bool:
    """Return whether the user agrees; asks again at a terminal until the answer is yes or no."""
    while True:
        answer = ask(f"{question} (yes/no)", "yes" if default else "no").lower()
        if answer in ("y", "yes", "n", "no"):
            return answer.startswith("y")
        again(question, "answer yes or no")


def ask_number(question: str, lower: float, upper: float, default: float | None = None) -> float:
    """Return a number within the limits; asks again at a terminal until there is one."""
    while True:
        answer = ask(question, "" if default is None else f"{default:g}")
        try:
            value = float(answer)
        except ValueError:
            again(question, f"'{answer}' is not a number: use a point, like 0.04")
            continue
        if lower <= value <= upper:
            return value
        again(question, f"{value:g} is outside {lower:g} .. {upper:g}: correct it")


def ask_choice(question: str, choices: tuple[str, ...], default: str) -> str:
    """Return one of the choices, also named by its number alone; asks again at a terminal until it is one."""
    while True:
        answer = ask(f"{question}: {', '.join(choices)}?", default)
        for choice in choices:
            if answer == choice or (answer.isdigit() and answer in choice.split()):
                return choice
        again(question, f"'{answer}' is none of them")


def again(question: str, words: str) -> None:
    """Report what is wrong with an answer, before the question is asked again.

    Raises:
        ConfigError: Nobody sits at the terminal: the next line answers another question.
    """
    if not sys.stdin.isatty():
        raise ConfigError(f"the answer to '{question}' cannot be used: {words}")
    sys.stderr.write(f"  {words}\n")
