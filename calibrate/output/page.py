"""What the HTML reports have in common: templates, plots inside the file, versions."""

import datetime
import importlib.metadata
import platform
from typing import Any

import jinja2
import markupsafe
import plotly.graph_objects as go
import plotly.offline

_PACKAGES = ("vgtjax", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy")


def render_page(template: str, **values: Any) -> str:
    """A template of this package as HTML, with the plot library inside and what tells when and where it was made."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("calibrate"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": _number, "figure": _figure}
    return environment.get_template(template).render(
        date=datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
        versions={name: importlib.metadata.version(name) for name in _PACKAGES},
        python=platform.python_version(),
        machine=platform.machine(),
        plotly=plotly.offline.get_plotlyjs(),
        **values,
    )


def _figure(figure: go.Figure) -> markupsafe.Markup:
    """A figure as a part of a page that has the plot library already."""
    config = {"displaylogo": False, "responsive": True}
    return markupsafe.Markup(figure.to_html(full_html=False, include_plotlyjs=False, config=config))


def _number(value: float | None, digits: int = 5) -> str:
    return "" if value is None else f"{value:.{digits}g}"
