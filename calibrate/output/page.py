"""What the HTML reports have in common: templates, plots inside the file, versions."""

import datetime
import itertools
from typing import Any

import jinja2
import markupsafe
import plotly.graph_objects as go
import plotly.offline

from .software import software


def render_page(template: str, **values: Any) -> str:
    """A template of this package as HTML, with the plot library inside and what tells when and where it was made."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("calibrate"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": _number, "sentence": _sentence, "figure": _Figures()}
    return environment.get_template(template).render(
        date=datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
        software=software(),
        plotly=plotly.offline.get_plotlyjs(),
        **values,
    )


class _Figures:
    """Figures as parts of a page that has the plot library already; numbered, so that a page can be made again."""

    def __init__(self) -> None:
        self._numbers = itertools.count(1)

    def __call__(self, figure: go.Figure) -> markupsafe.Markup:
        config = {"displaylogo": False, "responsive": True}
        name = f"figure-{next(self._numbers)}"
        return markupsafe.Markup(figure.to_html(full_html=False, include_plotlyjs=False, config=config, div_id=name))


def _number(value: float | None, digits: int = 5) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def _sentence(said: str) -> str:
    """With a capital and a full stop; a parameter's name in front stays as it is written."""
    first = said.partition(" ")[0]
    return f"{said if '.' in first else said[0].upper() + said[1:]}."
