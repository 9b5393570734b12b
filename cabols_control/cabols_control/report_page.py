# SPDX-License-Identifier: Apache-2.0
"""The page that every report is: one HTML file that needs no other file and no network."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any

from bokeh.embed import components
from bokeh.resources import Resources
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

PAGE = "cabols_control"
"""Package of page.html.j2, which the templates of reports extend."""


def render_page(
    package: str,
    template: str,
    *,
    title: str,
    subtitle: str,
    script: str = "",
    head: str = "",
    **content: Any,
) -> str:
    """Render a report.

    Args:
        package: whose folder `templates` has the template.
        template: its file name; it extends page.html.j2.
        title: of the page.
        subtitle: the line below it.
        script: of the plots, from embed(); empty: a page without plots.
        head: another element of the page's head, as HTML; empty: none.
        content: what else the template shows.

    Returns:
        The HTML text.
    """
    loaders = [PackageLoader(name, "templates") for name in dict.fromkeys((package, PAGE))]
    environment = Environment(
        loader=ChoiceLoader(loaders),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    library = Resources(mode="inline", components=["bokeh"]).render_js() if script else ""
    return environment.get_template(template).render(
        title=title,
        subtitle=subtitle,
        head=head,
        bokeh_js=library,
        bokeh_script=script,
        **content,
    )


def embed(plots: Sequence[Any]) -> tuple[str, Sequence[str]]:
    """Return the script of bokeh's plots, and the element of each for the page."""
    script, divs = components(list(plots), wrap_script=True)
    return str(script), divs


def embedded_picture(figure: Any, dpi: float) -> str:
    """Return a matplotlib figure as a PNG file in base64, for an img element.

    Args:
        figure: of matplotlib.
        dpi: its resolution [1/inch].
    """
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=dpi)
    return base64.b64encode(picture.getvalue()).decode("ascii")
