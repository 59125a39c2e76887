"""What changed in a fleet, for who looks once a day: as text, and as a page to mail."""

from __future__ import annotations

from collections.abc import Iterator

from mavhums.results.standing import Standing
from mavhums.results.store import Change, FleetDigest
from mavhums.show.standing import growth_words, sentences, step_words
from mavhums.show.words import capital, printable

__all__ = ["digest_html", "digest_lines", "headline"]

_TITLES = {
    "new": "New findings",
    "worse": "Worse",
    "growing": "Growing",
    "step": "Changed in one step",
    "eased": "Eased",
    "gone": "Gone",
}


def headline(digest: FleetDigest) -> str:
    """Return the digest in one line.

    Examples
    --------
    >>> times = dict(since_utc="2026-03-01T06:00:00+00:00", until_utc="2026-03-02T06:00:00+00:00")
    >>> headline(FleetDigest(**times, aircraft=20, flights=31, standing=2))
    'Nothing new since 2026-03-01 06:00 UTC: 31 flights of 20 aircraft; 2 findings stand'
    """
    counts = {kind: sum(one.kind == kind for one in digest.changes) for kind in _TITLES}
    parts = [f"{counts[kind]} {word}" for kind, word in _WORDS.items() if counts[kind]]
    parts += [f"{len(digest.silent)} not heard of"] if digest.silent else []
    parts += [f"{len(digest.failed)} logs failed"] if digest.failed else []
    since = f"{digest.since_utc[:16].replace('T', ' ')} UTC"
    flown = f"{_count(digest.flights, 'flight')} of {digest.aircraft} aircraft"
    rest = [flown]
    if digest.standing:
        rest.append(f"{_count(digest.standing, 'finding')} stand{'s' if digest.standing == 1 else ''}")
    rest += [f"{digest.silent_longer} silent for longer"] if digest.silent_longer else []
    return f"{', '.join(parts) or 'Nothing new'} since {since}: {'; '.join(rest)}"


_WORDS = {
    "new": "new",
    "worse": "worse",
    "growing": "growing",
    "step": "changed in one step",
    "eased": "eased",
    "gone": "gone",
}


def digest_lines(digest: FleetDigest) -> Iterator[str]:
    """Yield the lines of the digest; where there is nothing to say, one."""
    yield headline(digest)
    for title, items in _sections(digest):
        yield ""
        yield f"{title}:"
        for name, said in items:
            yield printable(f"  {name}: {'. '.join(said)}")
    if not digest.is_empty:
        yield ""
        yield f"{capital(digest.notice)}."


def _sections(digest: FleetDigest) -> Iterator[tuple[str, list[tuple[str, list[str]]]]]:
    for kind, title in _TITLES.items():
        found = [one for one in digest.changes if one.kind == kind]
        if found:
            yield title, [(f"{one.aircraft} {_subject(one.now)}", _said(one)) for one in found]
    if digest.silent:
        yield (
            "Not heard of",
            [
                (one.aircraft, [f"last flight {one.last_utc[:10]}, {one.days:.0f} days ago"])
                for one in digest.silent
            ],
        )
    if digest.failed:
        yield "Logs that could not be judged", [(one.problem, [one.remedy]) for one in digest.failed]


def _said(change: Change) -> list[str]:
    now, before = change.now, change.before
    if change.kind == "step" and now.step is not None:
        return [step_words(now.step)]
    if change.kind == "growing" and now.growth is not None:
        return [growth_words(now.growth)]
    if change.kind in ("gone", "eased") and before is not None:
        was = before.condition if before.growth is None or before.condition != "normal" else "growing"
        state = "growing" if now.growth and now.condition == "normal" else now.condition
        why = f"it was {was}; now {state} in flight {now.flights} ({now.last_utc[:10]})"
        return [why, *sentences(now)[:1]] if change.kind == "eased" else [why]
    return [said for said in sentences(now) if now.step is None or said != step_words(now.step)]


def _subject(standing: Standing) -> str:
    return f"{standing.actuator} control" if standing.subject == "axis" else standing.actuator


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"


def digest_html(digest: FleetDigest) -> str:
    """Return the digest as one HTML page, without scripts, styles from elsewhere or pictures, to mail."""
    from jinja2 import Environment

    page = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(_PAGE)
    return page.render(
        headline=headline(digest), sections=[*_sections(digest)], notice=capital(digest.notice)
    )


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{{ headline }}</title>
<style>body { font: 16px/1.5 system-ui, sans-serif; max-width: 44rem; margin: 1.5rem auto; padding: 0 1rem }
h1 { font-size: 1.2rem } h2 { font-size: 1rem; margin: 1.2rem 0 0.3rem } li { margin: 0.3rem 0 }</style>
</head>
<body>
<h1>{{ headline }}</h1>
{% for title, items in sections %}
<h2>{{ title }}</h2>
<ul>
{% for name, said in items %}
<li><strong>{{ name }}</strong>: {{ said | join(". ") }}</li>
{% endfor %}
</ul>
{% endfor %}
<p><small>{{ notice }}.</small></p>
</body>
</html>
"""
