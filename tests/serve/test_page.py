"""The page in a true browser: drop, progress, verdict, plots, 3-D view, fleet, users, hostile texts."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums import fleet
from tests.fleet_logs import moved
from tests.logs import heartbeat, write_log
from tests.serve.browser import BROWSER, Browser, Served, served, violations

pytest.importorskip("plotly", reason="the page needs the extra 'serve'")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="no browser; Debian has one in the package chromium"),
]

HEADLINE = "document.querySelector('.headline')?.innerText"
ANSWER = "document.querySelector('.shown')"
CHARTS = "document.querySelectorAll('.curves .chart .svg-container')"
REPORT = "document.querySelector('.shown .downloads a')?.href.replace('?save=1', '')"
MARKUP = "<img src=x onerror=top.alarmed=true><script>top.alarmed=true</script>"


@pytest.fixture(scope="module")
def page() -> Iterator[Served]:
    with served("--max-mb", "300") as page:
        yield page


@pytest.fixture
def browser() -> Iterator[Browser]:
    assert BROWSER
    with Browser(BROWSER) as browser:
        browser.size(1200)
        yield browser


def test_a_dropped_log_becomes_the_answer_with_its_plots(
    page: Served, browser: Browser, growing_log: Path
) -> None:
    browser.open(page.url)
    assert violations(browser) == [], "the empty page"
    browser.drop([growing_log])
    assert "emergency elevator (servo 3)" in browser.wait(HEADLINE)
    browser.wait(f"{CHARTS}.length == 4")
    browser.wait(f"{CHARTS}[0].getBoundingClientRect().top < 900")  # before every table
    answer = browser.js(f"{ANSWER}.innerText")
    for part in ("What to do", "do not fly", "Suspected", "Losses", "SHA-256", "The aircraft from above"):
        assert part in answer
    assert browser.js("document.querySelector('.curves .chart').ariaLabel").startswith("elevator: Coulomb")
    browser.wait(f"{CHARTS}[0].textContent.includes('AUTO')")
    for word in ("since 28s", "emergency", "degraded"):
        browser.wait(f"{CHARTS}[0].textContent.includes('{word}')")
    buttons = "[...document.querySelectorAll('.modebar-btn')].map(one => one.ariaLabel)"
    assert set(browser.js(buttons)) == {"Reset axes"}, "others lead to other servers"
    _point_at(browser, f"{CHARTS}[0]")
    titles = ".hovertext tspan.line:first-child"
    titles_shown = f"[...document.querySelectorAll('{titles}')].map(one => one.textContent)"
    browser.wait(f"{titles_shown}.length == 4 && new Set({titles_shown}).size == 1")  # one cursor for all
    boxes = "[...document.querySelectorAll('.curves .chart')]"
    part = "{'xaxis.range[0]': 10, 'xaxis.range[1]': 20}"
    browser.js(f"void Plotly.relayout({boxes}[0], {part})")
    browser.wait(f"{boxes}.every(one => one.layout.xaxis.range.join() == '10,20')")  # and one zoom
    browser.js("document.querySelector('.curves summary').click()")
    browser.wait(f"{CHARTS}.length == 10")
    assert violations(browser) == [], "the page with an answer"
    for scheme in ("light", "dark"):
        browser.size(390, scheme=scheme)
        browser.wait("document.documentElement.scrollWidth <= 390")  # the curves follow the width in a moment
        assert violations(browser) == [], f"on a phone, {scheme}"
    fetched = browser.js("performance.getEntriesByType('resource').map(entry => entry.name)")
    assert all(name.startswith((page.url, "data:", "blob:")) for name in fetched)
    assert browser.errors == []


def _point_at(browser: Browser, what: str, *, press: bool = False) -> None:
    """Move the mouse to the middle of an element, and press there."""
    x, y = browser.js(
        f"(() => {{const one = {what}; one.scrollIntoView({{block: 'center'}});"
        " const r = one.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]})()"
    )
    for kind in ("mouseMoved", *(("mousePressed", "mouseReleased") if press else ())):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)


def test_the_report_itself_is_accessible(page: Served, browser: Browser, growing_log: Path) -> None:
    browser.open(page.url)
    browser.choose([growing_log])
    browser.wait(HEADLINE)
    browser.open(browser.wait(REPORT))
    browser.wait("document.querySelector('main h1')")
    assert browser.js("document.querySelectorAll('svg[data-plot] path.line').length") == 10
    for scheme in ("light", "dark"):
        browser.size(1200, scheme=scheme)
        assert violations(browser) == []


def test_the_3d_view_opens_in_the_same_page(page: Served, browser: Browser, growing_log: Path) -> None:
    pytest.importorskip("rerun", reason="the 3-D view needs the extra 'viewer'")
    import io

    from PIL import Image

    browser.open(page.url)
    browser.choose([growing_log])
    browser.wait(HEADLINE)
    browser.press("Open in the 3-D viewer")
    browser.wait("document.querySelector('iframe.viewer')")
    browser.js("document.querySelector('iframe.viewer').scrollIntoView()")
    end = time.monotonic() + 120
    colours = {"emergency": (213, 94, 0), "healthy": (0, 158, 115), "curves": (86, 180, 233)}
    while True:
        with Image.open(io.BytesIO(browser.picture())) as image:
            pixels = np.asarray(image.convert("RGB")).astype(np.int16)
        seen = {name: int((np.abs(pixels - rgb).sum(axis=-1) < 90).sum()) for name, rgb in colours.items()}
        if min(seen.values()) > 150:
            break
        assert time.monotonic() < end, seen
        time.sleep(1)
    browser.press("Show the answer")
    assert browser.wait(f"{CHARTS}.length") >= 1


def test_the_first_page_has_an_example(page: Served, browser: Browser) -> None:
    browser.open(page.url)
    browser.js("document.querySelector('[data-example]').click()")
    assert "emergency elevator (servo 3)" in browser.wait(HEADLINE)


def test_several_logs_progress_and_what_is_refused(
    page: Served, browser: Browser, growing_log: Path, healthy_log: Path, tmp_path: Path
) -> None:
    odd = tmp_path / "notes.tlog"
    odd.write_text("this is no log\n" * 50)
    (tmp_path / "empty.BIN").write_bytes(b"")
    huge = tmp_path / "huge.ulg"
    with huge.open("wb") as file:
        file.truncate(301_000_000)
    browser.open(page.url)
    browser.js(
        "window.words = new Set(); new MutationObserver(() => document.querySelectorAll('progress')"
        ".forEach(bar => words.add(bar.getAttribute('aria-label').split(' ')[0])))"
        ".observe(document.body, {subtree: true, childList: true, attributes: true}); 1"
    )
    browser.drop([growing_log, healthy_log, odd, tmp_path / "empty.BIN", huge])
    browser.wait("document.querySelectorAll('.headline').length == 2")
    browser.wait("document.querySelectorAll('.uploads .refused').length == 2")
    browser.wait("document.querySelector('.log.refused')")
    assert {"Uploading", "Judging"} >= set(browser.js("[...words]")) != set()
    refused = browser.js("document.querySelector('.uploads').innerText")
    assert "huge.ulg" in refused
    assert "larger than 300 MB" in refused
    assert "the file is empty" in refused
    assert "notes.tlog" in browser.js("document.querySelector('.log.refused').innerText")
    # the worst log's answer is shown, though nobody chose one
    browser.wait("document.querySelector('.shown h2').innerText.includes('growing.tlog')")
    assert violations(browser) == []
    browser.press("Dismiss")
    browser.press("Remove")
    browser.wait("document.querySelectorAll('.log').length == 2")


def test_two_answers_side_by_side_and_a_link_to_a_moment(
    page: Served, browser: Browser, growing_log: Path, healthy_log: Path
) -> None:
    browser.size(1920)
    browser.open(page.url)
    heading = "document.querySelector('[data-shown] h2')?.innerText"
    browser.choose([growing_log])
    browser.wait(f"{heading} == 'The answer for growing.tlog'")
    browser.choose([healthy_log])  # the log that came alone is shown next, though the other one is worse
    browser.wait(f"{heading} == 'The answer for healthy.tlog'")
    compare = "[...document.querySelectorAll('[data-do=beside]')].find(b => b.innerText.includes('growing'))"
    browser.wait(compare)
    browser.js(f"{compare}.click()")
    other = "document.querySelector('[data-beside] h2')"
    assert browser.wait(f"{other}?.innerText") == "The answer for growing.tlog"
    tops = "['shown', 'beside'].map(one => document.querySelector(`[data-${one}] h2`).offsetTop)"
    assert len(set(browser.js(tops))) == 1
    assert violations(browser) == []
    for width in (1200, 390):
        browser.size(width)
        browser.wait(f"document.documentElement.scrollWidth <= {width}")
    browser.js(f"{compare}.click()")
    browser.wait(f"!{other}")

    browser.press("Show the answer")
    address = browser.wait("location.hash.includes('log=') && location.href")
    browser.open("about:blank")
    browser.open(f"{address}&t=0m25s")
    browser.wait(f"{CHARTS}.length && {CHARTS}[0].textContent.includes('at 25s')")
    assert browser.wait(f"{heading}") in ("The answer for growing.tlog", "The answer for healthy.tlog")


def test_hostile_names_and_texts_stay_texts(page: Served, browser: Browser, tmp_path: Path) -> None:
    log = tmp_path / f"{MARKUP.replace('/', '∕')}.tlog"  # a name cannot have a slash
    text = v2.MAVLink_statustext_message(6, b"<img src=x onerror=top.alarmed=1>")
    write_log(log, [heartbeat(3), text] * 20)
    odd = tmp_path / f"..%2f<b onclick=alert(1)>{'w' * 120}.tlog"
    odd.write_text("no log")
    browser.open(page.url)
    browser.drop([log, odd])
    browser.wait(HEADLINE)
    browser.wait("document.querySelector('.log.refused')")
    assert "<img src=x" in browser.wait(f"{ANSWER}?.innerText")
    assert "<img src=x onerror=top.alarmed=true>" in browser.js("document.querySelector('.logs').innerText")
    assert browser.js("document.querySelectorAll('img, b, .logs script, main script').length") == 0
    assert browser.js("window.alarmed === undefined")
    browser.wait("document.documentElement.scrollWidth <= 1200")
    assert browser.errors == []


def test_two_users_see_only_their_own(
    page: Served, browser: Browser, growing_log: Path, healthy_log: Path
) -> None:
    assert BROWSER
    with Browser(BROWSER) as other:
        for one, log in ((browser, growing_log), (other, healthy_log)):
            one.open(page.url)
            one.drop([log])
        assert "emergency" in browser.wait(HEADLINE)
        assert "normal" in other.wait(HEADLINE)
        for one in (browser, other):
            assert one.js("document.querySelectorAll('.log').length") == 1
        addresses = browser.wait("[...document.querySelectorAll('.shown .downloads a')].map(one => one.href)")
        assert len(addresses) == 3
        for address in addresses:
            assert other.js(f"fetch('{address}').then(answer => answer.status)") == 404
            assert browser.js(f"fetch('{address}').then(answer => answer.status)") == 200
        table = browser.js(f"fetch('{addresses[2]}').then(answer => answer.text())").splitlines()
        assert table[0] == "curve,time_s,low,value,high,demanded,limits"
        assert table[1].split(",")[0].startswith('"elevator: Coulomb friction')
    browser.open(page.url)
    assert "emergency" in browser.wait(HEADLINE), "a reload keeps the session"


def test_everything_can_be_reached_with_the_keyboard(
    page: Served, browser: Browser, growing_log: Path
) -> None:
    browser.open(page.url)
    browser.choose([growing_log])
    browser.wait(f"{CHARTS}.length")
    reached = []
    for _ in range(6):
        for kind in ("keyDown", "keyUp"):
            browser.call("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
        reached.append(browser.js("document.activeElement.innerText || document.activeElement.id"))
    names = " ".join(str(name) for name in reached)
    for name in ("logs", "Show the answer", "Open in the 3-D viewer", "Save the report", "Remove"):
        assert name in names


def test_a_log_of_200_mb_is_judged_in_bounded_memory(
    page: Served, browser: Browser, growing_log: Path, tmp_path: Path
) -> None:
    from tests.fleet_logs import moved

    data, large, number = growing_log.read_bytes(), tmp_path / "large.tlog", 0
    with large.open("wb") as file:
        while file.tell() < 200e6:
            file.write(moved(data, 45.0 * number) if number < 3 else data)
            number += 1
    browser.open(page.url)
    family = [psutil.Process(page.process.pid)]
    family += family[0].children(recursive=True)
    browser.choose([large])
    most = 0
    end = time.monotonic() + 240
    while not browser.js("!!document.querySelector('.headline, .log.refused')"):
        assert time.monotonic() < end
        most = max([most, *(one.memory_info().rss for one in family if one.is_running())])
        time.sleep(0.5)
    assert browser.js(HEADLINE), browser.js("document.body.innerText")
    assert most < 1 << 30
    print(f"most of one process: {most / 1e6:.0f} MB")


def test_a_fleet_is_listed_worst_first_and_leads_to_its_flights(store: Path, browser: Browser) -> None:
    with served("--store", store) as page:
        browser.open(f"{page.url}/fleet")
        names = browser.wait("[...document.querySelectorAll('tbody th')].map(one => one.innerText)")
        assert names == ["D-FAILS", "D-GROWS", "D-KEEPS"]
        assert violations(browser) == []
        browser.js("document.querySelectorAll('tbody th a')[1].click()")
        browser.wait("document.querySelector('h1')?.innerText == 'D-GROWS'")
        browser.wait(f"{CHARTS}.length >= 4")
        browser.wait(f"{CHARTS}[0].textContent.includes('2026-01-0')")
        text = browser.js("document.body.innerText")
        assert "until emergency" in text
        assert "95 % interval" in text
        assert violations(browser) == []
        points = f"[...{CHARTS}[0].querySelectorAll('.points path')]"
        browser.wait(f"{points}.length == 9")  # flights
        _point_at(browser, f"{points}.at(-1)", press=True)
        assert "DEGRADED" in browser.wait("document.querySelector('section.answer h1')?.innerText")
        browser.wait(f"{CHARTS}.length == 4")  # from the log where it lies
        assert violations(browser) == []
        browser.js(
            "[...document.querySelectorAll('a')].find(one => one.innerText.includes('D-GROWS')).click()"
        )
        browser.wait("document.querySelector('h1')?.innerText == 'D-GROWS'")
        assert browser.errors == []


def test_a_running_session_shows_as_it_runs(tmp_path: Path, browser: Browser, growing_log: Path) -> None:
    import socket
    import subprocess
    import sys

    from tests.fleet_logs import records

    lines = tmp_path / "live.jsonl"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "mavhums", "live", f"udpin:{port}", "--json"]
    with (
        lines.open("wb") as output,
        subprocess.Popen(command, stdout=output, stderr=subprocess.DEVNULL) as live,
        served("--live", lines) as page,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        browser.open(f"{page.url}/live")
        browser.wait("document.body.innerText.includes('(running)')")
        for number, (_, frame) in enumerate(records(growing_log.read_bytes())):
            sender.sendto(frame, ("127.0.0.1", port))
            if number % 100 == 0:
                time.sleep(0.005)
        rows = browser.wait(
            "document.querySelectorAll('tbody tr').length >= 4 &&"
            " [...document.querySelectorAll('tbody tr')].map(row => row.innerText)"
        )
        assert any("elevator" in row for row in rows)
        assert violations(browser) == []
        live.terminate()
        browser.wait("document.body.innerText.includes('(ended)')")


def test_nothing_stays_when_it_ends(
    browser: Browser, healthy_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with served() as page:
        browser.open(page.url)
        browser.choose([healthy_log])
        browser.wait(HEADLINE)
        (own,) = tmp_path.glob("mavhums-page-*")
        assert own.stat().st_mode & 0o077 == 0, "only this user reads it"
        children = psutil.Process(page.process.pid).children(recursive=True)
    assert not own.exists()
    psutil.wait_procs(children, timeout=5)
    assert not [child for child in children if child.is_running() and child.status() != "zombie"]


def test_a_log_that_the_store_cannot_name_is_asked_for(store: Path, browser: Browser, tmp_path: Path) -> None:
    copied = shutil.copy(store, tmp_path / "store")
    log = tmp_path / "new.tlog"
    log.write_bytes(moved((store.parent / "logs" / "D-KEEPS" / "00.tlog").read_bytes(), 90 * 86_400.0))
    with served("--store", copied) as page:
        browser.open(page.url)
        browser.choose([log])
        browser.wait(HEADLINE)
        browser.press("Keep in the store")
        browser.wait("document.querySelector('.asked input')")
        said = browser.js("document.querySelector('.log').innerText")
        assert "new.tlog: which aircraft is it of?" in said
        assert str(tmp_path) not in said
        assert violations(browser) == []
        browser.press("Keep as this aircraft")
        browser.wait("document.querySelector('.log').innerText.includes('kept in the store as')")
    assert sorted({str(one.aircraft) for one in fleet.worst(copied)}) == ["D-FAILS", "D-GROWS", "D-KEEPS"]
