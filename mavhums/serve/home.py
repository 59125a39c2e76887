"""The first page: a place to drop logs, the list of them, and the answer or the 3-D view of one."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from typing import Final
from urllib.parse import urlencode

from markupsafe import escape
from nicegui import ui

from mavhums.core.conditions import URGENCY
from mavhums.core.errors import MavhumsError
from mavhums.core.packed import ARCHIVES, COMPRESSED
from mavhums.flights.aircraft import UnnamedAircraftError
from mavhums.serve.fleet_view import FEWEST_FLIGHTS
from mavhums.serve.options import Fleet
from mavhums.serve.sessions import Dropped, Sessions, UserSession
from mavhums.show.html import environment

_EVERY_S: Final = 0.2
_FEW: Final = 3  # logs with all their buttons, above an answer
_Keep = Callable[[Dropped, str], Awaitable[None]]


class Home:
    """One open page of a session.

    Parameters
    ----------
    sessions, user
        All sessions, and the id of that of this page.
    fleet
        The store in which logs can be kept; None without one.
    where
        What the page says about the place of the logs.
    """

    def __init__(self, sessions: Sessions, user: str, fleet: Fleet | None, where: str) -> None:
        self._sessions, self._user, self._fleet = sessions, user, fleet
        self._rows: dict[str, _LogItem] = {}
        self._chosen = False
        self._shown: tuple[str, str] | None = None
        limit = sessions.limits.log_bytes
        told = {"limit_bytes": limit, "limit_mb": f"{limit // 1_000_000:,}", "where": where}
        markup(render("drop.html", packed=(*COMPRESSED, *ARCHIVES), **told))
        self._tally = markup("")
        self._order: list[str] = []
        self._list = ui.element("ul").classes("logs").props('aria-label="Logs"')
        self._place = ui.element("section").classes("shown").props('aria-label="The answer"')
        ui.timer(_EVERY_S, self.update)

    def update(self) -> None:
        """Show what has changed."""
        self._session.touch()
        for id_ in [id_ for id_ in self._rows if id_ not in self._session.logs]:
            self._rows.pop(id_).item.delete()
            if self._shown and self._shown[0] == id_:
                self._show(None)
        for log in self._session.logs.values():
            if log.id not in self._rows:
                with self._list:
                    self._rows[log.id] = _LogItem(self, log)
            if self._rows[log.id].update(self._shown) and not self._chosen:
                self._show_worst()
        self._sort()
        if self._shown and self._shown[1] == "view":
            self._view_when_ready()

    def choose(self, log: Dropped, what: str) -> None:
        """Show a log's answer or its 3-D view, because the user wants it."""
        self._chosen = True
        if what == "view":
            self._sessions.record(self._session, log)
        self._show((log.id, what))

    def remove(self, log: Dropped) -> None:
        """Remove a log."""
        self._sessions.remove(self._session, log)

    async def keep(self, log: Dropped, aircraft: str | None = None) -> None:
        """Keep a log in the store; where the store cannot identify its aircraft, ask the user."""
        assert self._fleet
        log.kept, log.asked = "being kept in the store, after any scan that runs …", None
        try:
            log.kept = await asyncio.to_thread(self._fleet.keep, log.path, aircraft)
        except UnnamedAircraftError as error:
            log.kept, log.asked = error.problem, error.proposed
        except MavhumsError as error:
            log.kept = f"not kept: {error}"

    @property
    def _session(self) -> UserSession:
        return self._sessions.get(self._user)  # it begins with its first log

    @property
    def keeps(self) -> bool:
        """Whether there is a store."""
        return self._fleet is not None

    def _sort(self) -> None:
        """List the logs worst first, and say how many there are of each."""
        logs = [self._session.logs[id_] for id_ in self._rows]
        order = [log.id for log in sorted(logs, key=_rank)]
        if order != self._order:
            for place, id_ in enumerate(order):
                if place >= len(self._order) or self._order[place] != id_:
                    self._rows[id_].item.move(target_index=place)
            self._order = order
        self._list.classes(**{"add" if len(order) > _FEW else "remove": "many"})
        several = Counter(log.condition for log in logs if log.state == "done")
        tally = sorted(several.items(), key=lambda one: -URGENCY[one[0]])
        rest = len(logs) - several.total()
        told = {"tally": tally if len(logs) > 1 else (), "trends": several.total() >= FEWEST_FLIGHTS}
        self._tally.set_content(render("tally.html", rest=rest, **told))

    def _show_worst(self) -> None:
        done = [log for log in self._session.logs.values() if log.state == "done"]
        if done:
            worst = max(done, key=lambda log: URGENCY[log.condition])
            self._show((worst.id, "answer"))

    def _show(self, wanted: tuple[str, str] | None) -> None:
        if wanted == self._shown:
            return
        self._shown = wanted
        self._place.clear()
        log = self._session.logs.get(wanted[0]) if wanted else None
        if wanted is None or log is None:
            return
        with self._place:
            if wanted[1] == "answer":
                here = markup(f"The answer for {escape(log.name)}", "h2").props("tabindex=-1")
                markup(render("downloads.html", log=log))
                show_parts(json.loads(log.shown.read_bytes()), f"/logs/{log.id}/curves")
                if self._chosen:  # a long list of logs stands above it
                    here.run_method("scrollIntoView")
                    here.run_method("focus", {"preventScroll": True})
            else:
                markup(f"3-D view of {escape(log.name)}", "h2")
                self._waits = markup("Preparing the recording …", "p").props("role=status")

    def _view_when_ready(self) -> None:
        assert self._shown
        log = self._session.logs.get(self._shown[0])
        if log is None or log.recording == "making":
            return
        if log.recording != "ready":
            self._show((log.id, "answer"))
            return
        self._shown = (log.id, "viewing")
        self._waits.delete()
        base = str(ui.context.client.request.base_url).rstrip("/")
        query = urlencode({"url": f"{base}/logs/{log.id}/flight.rrd", "hide_welcome_screen": 1, "persist": 0})
        with self._place:
            frame = ui.element("iframe").classes("frame viewer")
            frame.props["src"] = f"/viewer/index.html?{query}"
            frame.props["title"] = f"3-D view of {log.name}"


class _LogItem:
    """A log in the list: what is known of it, and what can be done with it."""

    def __init__(self, home: Home, log: Dropped) -> None:
        self._log = log
        self._state = ""
        self._classes = ""
        self.item = ui.element("li").classes("log")
        with self.item:
            self._text = markup("")
            self._actions = ui.element("div").classes("actions")
        with self._actions:
            self._answer = _button("Show the answer", log, lambda: home.choose(log, "answer"))
            self._view = _button("Open in the 3-D viewer", log, lambda: home.choose(log, "view"))
            save = f"/logs/{log.id}/report?save=1"
            self._save = markup("Save the report", "a").classes("button").props(f'href="{save}" download')
            self._keep = _button("Keep in the store", log, lambda: home.keep(log)) if home.keeps else None
            self._remove = _button("Remove", log, lambda: home.remove(log))
        self._asked = _OwnerQuestion(self.item, log, home.keep)

    def update(self, shown: tuple[str, str] | None) -> bool:
        """Show the present state; return whether it has just been judged."""
        log = self._log
        percent = min(100, log.read * 100 // max(log.size, 1))
        doing = "Judging" if log.state == "judging" else "Waiting to be judged"
        size = f"{log.size / 1e6:,.1f} MB"
        here = shown[1] if shown and shown[0] == log.id else ""
        state = {"percent": percent, "doing": doing, "size": size, "shown": here == "answer"}
        self._text.set_content(render("log.html", log=log, **state))
        self.item.classes(**{"add" if here else "remove": "here"})
        self._answer.props(f"aria-pressed={'true' if here == 'answer' else 'false'}")
        self._view.props(f"aria-pressed={'true' if here.startswith('view') else 'false'}")
        if self._keep:
            self._keep.set_visibility(log.state == "done" and not log.kept)
        self._asked.update()
        if log.state == self._state:
            return False
        self._state = log.state
        done = log.state == "done"
        for element in (self._answer, self._view, self._save):
            element.set_visibility(done)
        if done:
            self.item.classes(log.condition)
        elif log.state == "failed":
            self.item.classes("refused")
        return done


class _OwnerQuestion:
    """The question whose log it is, where the store cannot tell."""

    def __init__(self, item: ui.element, log: Dropped, keep: _Keep) -> None:
        self._log, self._keep = log, keep
        self._shown: tuple[str, ...] | None = None
        with item:
            self._place = ui.element("div").classes("asked")

    def update(self) -> None:
        """Show the question while it is open."""
        if self._log.asked == self._shown:
            return
        self._shown = self._log.asked
        self._place.clear()
        if self._shown is None:
            return
        with self._place:
            first = self._shown[0] if self._shown else ""
            self._name = ui.input("Its aircraft", value=first, autocomplete=list(self._shown))
            _button("Keep as this aircraft's", self._log, self._answer)

    async def _answer(self) -> None:
        name = str(self._name.value or "").strip()
        if name:
            await self._keep(self._log, name)


def _rank(log: Dropped) -> int:
    """Return what sorts the worst first: what was judged, what could not be, what is not yet."""
    return {"done": -URGENCY[log.condition], "failed": 100}.get(log.state, 101)


def _button(text: str, log: Dropped, clicked: Callable[[], object]) -> ui.html:
    label = f'{text}<span class="hidden-text">: {escape(log.name)}</span>'
    return markup(label, "button").props("type=button").on("click", clicked)


def show_parts(shown: Mapping[str, str], curves: str) -> None:
    """Show an answer: what was found, the curves that show it, and the rest.

    Parameters
    ----------
    shown
        From :func:`mavhums.show.html.parts`, which escapes every text.
    curves
        Address of its curves.
    """
    markup(shown["answer"])
    ui.element("div").classes("curves").props["data-from"] = curves
    markup(shown["rest"])


def markup(content: str, tag: str = "div") -> ui.html:
    """Add markup in which every text is escaped."""
    return ui.html(content, sanitize=False, tag=tag)


def render(template: str, **values: object) -> str:
    """Return a template of this room with its values; every text in it is escaped."""
    return environment("mavhums.serve").get_template(template).render(**values)
