"""Sends a digest: to people by apprise (mail, chats), to a program as its JSON contract by an HTTP POST."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.results.standing import FleetDigest
from mavhums.show.standing import digest_blocks, digest_headline
from mavhums.show.terminal import plain

if TYPE_CHECKING:
    from apprise import NotifyBase

_EXAMPLE: Final = (
    "write mailtos://USER:PASSWORD@HOST?from=A&to=B, https://HOST/PATH, or @FILE with such lines"
)
_PATIENCE_S: Final = 15.0
_CAUSE: Final = re.compile(r"\[Errno -?\d+\] ([\w ]+)")
_REPORTED: Final = ("WARNING ", "ERROR ")


@dataclass(frozen=True, slots=True)
class Recipient:
    """Where a digest goes.

    Attributes
    ----------
    name
        Scheme and host, without what may be a secret: what messages call it.
    webhook
        Address to which the JSON is posted; empty if a service sends text instead.
    service
        Apprise's service.
    """

    name: str
    webhook: str = ""
    service: NotifyBase | None = None


def recipients_of(urls: Iterable[str]) -> list[Recipient]:
    """Return the recipients that URLs name.

    Parameters
    ----------
    urls
        URLs of apprise, such as ``mailtos://…`` or that of a chat's incoming webhook; any other ``https://``
        or ``http://`` address; or ``@FILE``, a file with one URL a line and comments after ``#``.

    Raises
    ------
    MavhumsError
        If a URL names nothing, or a file cannot be read.
    MissingExtraError
        If apprise is not installed.
    """
    try:
        import apprise
    except ImportError as error:
        raise MissingExtraError("sending a digest", "fleet") from error
    found: list[Recipient] = []
    for url in _given(urls):
        with apprise.LogCapture(level=logging.CRITICAL):
            service: Any = apprise.Apprise.instantiate(url, suppress_exceptions=True)
        parts = urlsplit(url)
        if service is not None:
            service.redirects = False  # a redirected POST arrives as a GET, without the digest
            shown = urlsplit(service.url(privacy=True))
            found.append(Recipient(f"{shown.scheme}://{shown.netloc.rpartition('@')[2]}", service=service))
        elif parts.scheme in ("http", "https") and parts.hostname:
            found.append(Recipient(f"{parts.scheme}://{parts.hostname}", webhook=url))
        else:
            problem = f"--notify {parts.scheme or url[:20]}: is no address to which a digest can be sent"
            raise MavhumsError(problem, _EXAMPLE)
    return found


def send(digest: FleetDigest, recipients: Iterable[Recipient]) -> list[MavhumsError]:
    """Send a digest to each recipient, and return why it did not reach some."""
    title, text = digest_headline(digest), plain(digest_blocks(digest))
    errors: list[MavhumsError] = []
    for one in recipients:
        reason = _posted(one.webhook, digest) if one.webhook else _sent(one.service, title, text)
        if reason:
            remedy = "check address, credentials and network, then run it again with the same --since"
            errors.append(MavhumsError(f"{one.name}: the digest was not sent: {reason}", remedy))
    return errors


def _given(urls: Iterable[str]) -> Iterator[str]:
    for url in urls:
        if not url.startswith("@"):
            yield url
            continue
        try:
            lines = Path(url[1:]).read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise MavhumsError(f"--notify {url}: cannot be read", "name a text file of URLs") from error
        yield from (line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#"))


def _sent(service: Any, title: str, text: str) -> str:
    """Send text by a service of apprise, and return why that failed, or nothing."""
    import apprise

    sender = apprise.Apprise()
    sender.add(service)
    with apprise.LogCapture(level=logging.DEBUG, fmt="%(levelname)s %(message)s") as log:
        if sender.notify(title=title, body=text, body_format=apprise.NotifyFormat.TEXT):
            return ""
        said = log.getvalue()
    # The other lines may hold a password or a token.
    reasons = [line.partition(" ")[2] for line in said.splitlines() if line.startswith(_REPORTED)]
    return ", ".join(dict.fromkeys([*reasons, *_CAUSE.findall(said)])) or "no reason was given"


def _posted(address: str, digest: FleetDigest) -> str:
    """Post a digest as JSON, and return why that failed, or nothing."""
    import requests

    try:
        answer = requests.post(
            address,
            data=digest.to_json(indent=None).encode(),
            headers={"Content-Type": "application/json"},
            timeout=_PATIENCE_S,
            allow_redirects=False,
        )
    except requests.RequestException as error:  # its text may hold a token of the address
        return ", ".join(_CAUSE.findall(str(error))) or type(error).__name__
    return "" if answer.status_code < 300 else f"HTTP {answer.status_code} {answer.reason}"
