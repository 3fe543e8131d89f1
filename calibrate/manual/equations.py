"""The index of equations: a section for each row of CONTRIBUTING's table, which the site's search finds by number."""

import re

from .contributing import EquationRow, Erratum, equations, errata


def index() -> str:
    """Every equation that the code implements, by chapter."""
    parts, chapter = [], ""
    for row in equations():
        found = re.findall(r"[A-C]|\d", row.title)[0]
        if found != chapter:
            chapter = found
            parts.append(f"## {'Chapter' if found.isdigit() else 'Appendix'} {found}")
        parts.append(_section(row))
    return "\n\n".join(parts)


def other_errata() -> str:
    """Mistakes of the print that belong to none of the equations above."""
    shown = {erratum for row in equations() for erratum in row.errata}
    return "\n".join(_said(erratum) for erratum in errata() if erratum not in shown)


def heading(row: EquationRow) -> str:
    """What a section is called."""
    return f"{f'({row.title})' if row.numbers else row.title} {row.what}"


def _section(row: EquationRow) -> str:
    lines = [f"### {heading(row)}", ""]
    if len(row.numbers) > 1:
        lines += ["Equations " + ", ".join(f"({number})" for number in row.numbers) + ".", ""]
    lines += [f"- Code: {_paths(row.code, 'vgtjax')}", f"- Test: {row.test}", *map(_said, row.errata)]
    return "\n".join(lines)


def _said(erratum: Erratum) -> str:
    return f"- Erratum {erratum.mistake}. Here: {erratum.remedy}. Test: {erratum.test}"


def _paths(cell: str, folder: str) -> str:
    """The files of a cell with the folder that they are in."""
    return re.sub(r"`([\w/]+\.py)", rf"`{folder}/\1", cell)
