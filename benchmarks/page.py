"""The page: start-up time, memory, time from drop to verdict, and the pictures of its documentation.

    python benchmarks/page.py [--pictures FOLDER [--store STORE]] [LOG...]

A headless Chromium is the user; the time from drop to verdict ends when the browser shows the headline. The
first log is judged by a process that is ready, as it is some seconds after the start.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click
import psutil

from mavhums_sim import Flight, fly, write_tlog
from tests.serve.browser import BROWSER, Browser, Served, served

HEADLINE = "document.querySelector('.headline')?.innerText"
CHARTS = "document.querySelectorAll('.curves .chart svg')"
REPORT = "document.querySelector('.shown .downloads a').href.replace('?save=1', '')"
DROPS = 7
TWENTY = 20


def simulated(folder: Path) -> Path:
    """Fly 105 s, a log of about 4 MB; the elevator's friction grows through both limits."""
    path = folder / "growing.tlog"
    write_tlog(fly(Flight(seed=22, duration_s=105.0, friction_nm={"elevator": (0.225, 1.2)})), path)
    return path


def answers(page: Served) -> None:
    with urllib.request.urlopen(page.url, timeout=60) as answer:
        answer.read()


def memory(page: Served) -> tuple[float, list[float]]:
    """Return the memory of the page's process and of each judging one that it does not share, in MB."""
    both = (psutil.Process(page.process.pid), *judging(page))
    parts = [one.memory_full_info().uss / 1e6 for one in both]
    return parts[0], parts[1:]


def judging(page: Served) -> list[psutil.Process]:
    """Return the judging processes, which one that the page's process started has forked."""
    return [judge for one in psutil.Process(page.process.pid).children() for judge in one.children()]


def ready(page: Served) -> None:
    """Wait until the judging processes do nothing."""
    while True:
        several = judging(page)
        spent = [sum(one.cpu_times()[:2]) for one in several]
        time.sleep(1.0)
        if len(several) >= 2 and spent == [sum(one.cpu_times()[:2]) for one in several]:
            return


def dropped(browser: Browser, page: Served, log: Path) -> tuple[float, float]:
    """Return the seconds from the drop to the headline, and to the plots."""
    browser.call("Network.clearBrowserCookies")  # a new session, without the logs before
    browser.open(page.url)
    browser.wait("document.querySelector('#logs')")
    time.sleep(1.0)
    begin = time.monotonic()
    browser.drop([log])
    browser.wait(HEADLINE)
    verdict = time.monotonic() - begin
    browser.wait(f"{CHARTS}.length && {CHARTS}[0].querySelector('text')")
    return verdict, time.monotonic() - begin


def pictures(browser: Browser, page: Served, log: Path, folder: Path) -> None:
    """Draw a log's answer at two widths, and print its report."""
    dropped(browser, page, log)
    for name, width, height, scheme in (("desktop", 1000, 1500, "light"), ("phone", 390, 1250, "dark")):
        browser.size(width, scheme=scheme)
        time.sleep(0.5)
        (folder / f"{log.stem}-{name}.png").write_bytes(browser.whole(height))
    browser.size(1000)
    browser.open(browser.js(REPORT))
    (folder / f"{log.stem}.pdf").write_bytes(browser.paper())


def many(browser: Browser, page: Served, folder: Path) -> float:
    """Drop twenty logs of 0.8 MB at once; return the seconds until all are judged."""
    logs = [folder / f"{number:02}.tlog" for number in range(TWENTY)]
    for number, log in enumerate(logs):
        write_tlog(fly(Flight(seed=number, duration_s=20.0)), log)
    browser.call("Network.clearBrowserCookies")
    browser.open(page.url)
    browser.wait("document.querySelector('#logs')")
    time.sleep(1.0)
    begin = time.monotonic()
    browser.choose(logs)
    browser.wait(f"document.querySelectorAll('.headline').length == {TWENTY}")
    return time.monotonic() - begin


def users(page: Served, folder: Path) -> tuple[list[float], int]:
    """Let twenty users drop a log of 0.8 MB each at once; return the seconds of each, and what others saw.

    Each has its cookie; afterwards each asks for the answers of all.
    """
    logs = [folder / f"{number:02}.tlog" for number in range(TWENTY)]
    openers = [urllib.request.build_opener(urllib.request.HTTPCookieProcessor()) for _ in logs]

    def got(opener: urllib.request.OpenerDirector, id_: str) -> bool:
        try:
            with opener.open(f"{page.url}/logs/{id_}/assessment.json", timeout=60) as answer:
                return bool(json.load(answer)["verdicts"])
        except urllib.error.HTTPError as error:
            if error.code != 404:
                raise
            return False

    def one(number: int) -> tuple[float, str]:
        opener, log = openers[number], logs[number]
        with opener.open(page.url, timeout=60) as answer:
            answer.read()
        begin = time.monotonic()
        request = urllib.request.Request(
            f"{page.url}/logs?name={log.name}", log.read_bytes(), {"Origin": page.url}
        )
        with opener.open(request, timeout=60) as answer:
            id_ = json.load(answer)["id"]
        while not got(opener, id_):
            time.sleep(0.1)
        return time.monotonic() - begin, id_

    with ThreadPoolExecutor(TWENTY) as pool:
        took, ids = zip(*pool.map(one, range(TWENTY)), strict=True)
    foreign = sum(got(opener, id_) for k, opener in enumerate(openers) for j, id_ in enumerate(ids) if j != k)
    return list(took), foreign


def fleet_pictures(browser: Browser, store: Path, folder: Path) -> None:
    """Draw a fleet, and its worst aircraft that wears."""
    with served("--store", store) as page:
        for name, width, scheme in (("desktop", 1000, "light"), ("phone", 390, "dark")):
            browser.size(width, 420, scheme=scheme)
            browser.open(f"{page.url}/fleet")
            browser.wait("document.querySelector('tbody')")
            (folder / f"fleet-{name}.png").write_bytes(browser.whole(1000))
            browser.js("document.querySelectorAll('tbody a')[1].click()")
            browser.wait(f"{CHARTS}.length")
            time.sleep(1.0)
            (folder / f"aircraft-{name}.png").write_bytes(browser.whole(1500))


@click.command()
@click.argument("logs", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--pictures", "folder", type=click.Path(path_type=Path), help="Folder for pictures of each log."
)
@click.option("--store", type=click.Path(path_type=Path), help="Also draw this store.")
def main(logs: tuple[Path, ...], folder: Path | None, store: Path | None) -> None:
    """Measure the page; with --pictures, draw the answers of LOGS."""
    assert BROWSER, "needs Chromium"
    with tempfile.TemporaryDirectory() as temporary:
        growing = simulated(Path(temporary))
        begin = time.monotonic()
        with served() as page:
            printed = time.monotonic() - begin
            answers(page)
            first = time.monotonic() - begin
            ready(page)
            print(f"address printed after {printed:.1f} s, page answers after {first:.1f} s,")
            print(f"judging processes ready after at most {time.monotonic() - begin:.0f} s")
            own, workers = memory(page)
            print(f"memory, ready: page {own:.0f} MB, each judging process {max(workers):.0f} MB")
            with Browser(BROWSER) as browser:
                browser.size(1000)
                size = growing.stat().st_size / 1e6
                times = [dropped(browser, page, growing) for _ in range(DROPS)]
                verdicts, plots = zip(*times, strict=True)
                spread = f"{min(verdicts):.2f} to {max(verdicts):.2f}"
                print(
                    f"{size:.1f} MB, drop to verdict: median {statistics.median(verdicts):.2f} s ({spread}),"
                )
                print(f"drop to plots: median {statistics.median(plots):.2f} s, of {DROPS}")
                all_s = many(browser, page, Path(temporary))
                print(f"{TWENTY} logs of 0.8 MB: {all_s:.1f} s until all are judged")
                took, foreign = users(page, Path(temporary))
                print(
                    f"{TWENTY} users at once: median {statistics.median(took):.1f} s, last {max(took):.1f} s;"
                )
                print(f"answers of others that they could fetch: {foreign}")
                own, workers = memory(page)
                print(
                    f"memory, after {DROPS} logs: page {own:.0f} MB, judging processes {max(workers):.0f} MB"
                )
                if folder:
                    folder.mkdir(parents=True, exist_ok=True)
                    for log in logs or (growing,):
                        pictures(browser, page, log, folder)
                    if store:
                        fleet_pictures(browser, store, folder)
    load = subprocess.run(["uptime"], capture_output=True, text=True, check=False).stdout.split("load")[-1]
    print(f"load{load.strip()}")


if __name__ == "__main__":
    main()
