"""What the HTML reports have in common: templates, plots inside the file, versions."""

import datetime
import functools
from typing import Any

import jinja2
import markupsafe
import plotly.graph_objects as go
import plotly.io
import plotly.offline
from plotly.io.json import to_json_plotly

from .software import software

TEMPLATE = "plotly_white"
"""Of all figures; a page has it once."""
HEIGHT = 450
"""px of a figure that states none, as plotly has it."""


@functools.cache
def _environment() -> jinja2.Environment:
    """Templates are compiled once for all pages that a process makes."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("calibrate"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": _number, "sentence": _sentence, "figure": _figure}
    return environment


def render_page(template: str, **values: Any) -> str:
    """A template of this package as HTML, with the plot library inside and what tells when and where it was made."""
    return (
        _environment()
        .get_template(template)
        .render(
            date=datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
            software=software(),
            plotly=plotly.offline.get_plotlyjs(),
            figure_template=markupsafe.Markup(to_json_plotly(plotly.io.templates[TEMPLATE].to_plotly_json())),
            **values,
        )
    )


def _figure(figure: go.Figure) -> markupsafe.Markup:
    """A figure as part of a page that has the plot library already."""
    content = figure.to_plotly_json()
    layout = {key: value for key, value in content["layout"].items() if key != "template"}
    drawn = to_json_plotly({"data": content["data"], "layout": layout})  # without a "<", which could end the script
    place = f'<div class="plotly-graph-div" style="height: {layout.get("height", HEIGHT)}px"></div>'
    return markupsafe.Markup(f"{place}<script>drawFigure({drawn})</script>")


def _number(value: float | None, digits: int = 5) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def _sentence(said: str) -> str:
    """With a capital and a full stop; a parameter's name in front stays as it is written."""
    first = said.partition(" ")[0]
    return f"{said if '.' in first else said[0].upper() + said[1:]}."
