"""Fragments of the pages: every text in them is escaped."""

from __future__ import annotations

from mavhums.show.html_environment import environment

__all__ = ["render"]


def render(template: str, **values: object) -> str:
    """Return a template of this room with its values."""
    return environment("mavhums.serve").get_template(template).render(**values)
