"""Whether what a page shows of a terminal is what a command says."""

import difflib
import math
import re

NUMBER = re.compile(r"(?<![\w.-])[-+]?\d+(?:\.\d+)?(?:e[-+]\d+)?(?![\w]|\.\d)")
LEFT_OUT = "..."
"""Stands in a shown line for anything."""
TOLERANCE = 0.02
"""Relative. Another processor rounds otherwise, which moves where a search ends: a fit by less than a fifth of a
standard error. What is shown here are errors, indices and costs, which such an end moves by less than two percent; a
figure of another version of the package or of another study is off by more, or stands in another line."""


def differences(shown: str, said: str) -> list[str]:
    """A sentence for each line of a block that is not, in this order, among the lines that were said."""
    lines, place, found = said.splitlines(), 0, []
    for line in filter(str.strip, shown.splitlines()):
        here = next((i for i in range(place, len(lines)) if agrees(line, lines[i])), None)
        if here is None:
            found.append(f"shown: {line.strip()}\n   said: {_nearest(line, lines)}")
        else:
            place = here + 1
    return found


def agrees(shown: str, said: str) -> bool:
    """Whether a line is another one, but for blanks, what is left out, and its figures within their tolerance."""
    figures = NUMBER.findall(shown)
    words = [re.escape(word) for word in NUMBER.sub("\0", shown).split()]
    pattern = r"\s+".join(words).replace(re.escape("\0"), f"({NUMBER.pattern})")
    pattern = pattern.replace(re.escape(LEFT_OUT), ".*")
    match = re.fullmatch(rf"\s*{pattern}\s*", said)
    return match is not None and all(map(close, figures, match.groups()))


def close(shown: str, said: str) -> bool:
    """Whether two figures agree to what is shown, or to `TOLERANCE`."""
    return math.isclose(float(shown), float(said), rel_tol=TOLERANCE, abs_tol=_last_digit(shown))


def _last_digit(figure: str) -> float:
    """One unit of it; whole numbers count something, and have none."""
    mantissa, _, exponent = figure.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals or exponent else 0.0


def _nearest(line: str, lines: list[str]) -> str:
    return next(iter(difflib.get_close_matches(line, lines, 1, cutoff=0.0)), "nothing").strip()
