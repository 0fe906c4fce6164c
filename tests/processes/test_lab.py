"""The lab in a real browser: a run is started, touched by mouse, ended, exported and proved; a log is wound back."""

import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from tests.log.made import made_log
from tests.waiting import until
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.lab.bench import reach
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.outside.operator import Operator
from zenoh_cbef.plain import read_toml
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.simulator import simulate

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
if BROWSER is None:
    pytest.skip("no Chromium on this host; install the package chromium", allow_module_level=True)
playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
pytest.importorskip("uvicorn", reason="the extra 'lab' is not installed")

STANDS = """(() => { const [was, now] = [globalThis.stood, { step: lab.state.newest, at: performance.now() }];
if (was?.step !== now.step) globalThis.stood = now; return was?.step === now.step && now.at - was.at > 2000; })()"""
"""Whether the run has taken no step for two seconds."""


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-dev-shm-usage"])
        yield browser
        browser.close()


class Opened:
    """A page of the lab, what it complained of, and what it loaded."""

    def __init__(self, world, browser, *words: str) -> None:
        self.lab = world.start("lab", *words, "--no-browser")
        self.url = self._url()
        self.page = browser.new_page(viewport={"width": 1280, "height": 800})
        self.page.set_default_timeout(120_000)
        self.complaints: list[str] = []
        self.loaded: list[str] = []
        self.page.on("console", lambda one: self.complaints.append(one.text))
        self.page.on("pageerror", lambda one: self.complaints.append(str(one)))
        self.page.on("request", lambda one: self.loaded.append(one.url))
        self.page.goto(self.url)
        self.until("lab.state.frame !== null")

    def _url(self) -> str:
        assert self.lab.stderr is not None
        for line in self.lab.stderr:
            if found := re.search(r"http://\S+", line):
                return found[0]
        raise AssertionError(f"the lab did not start: {self.lab.communicate(timeout=100)}")

    def until(self, what: str, seconds: float = 120.0) -> None:
        # The page's own policy forbids what Playwright's waiting does.
        until = time.monotonic() + seconds
        while not self.page.evaluate(what):
            assert time.monotonic() < until, (what, self.page.inner_text("#verdict"), self.complaints)
            self.page.wait_for_timeout(50)

    def middle(self, first: int, second: int) -> tuple[float, float]:
        """The place of the middle of a link in the window."""
        x, y = self.page.evaluate(
            f"""(() => {{ const box = lab.map.canvas.getBoundingClientRect();
            const [a, b] = [{first}, {second}].map((one) => lab.map.pixel(lab.map.arrays.place, 3 * one));
            return [box.left + (a[0] + b[0]) / 2, box.top + (a[1] + b[1]) / 2]; }})()"""
        )
        return x, y

    def menu_of_link(self, first: int, second: int) -> None:
        """Click at a link until its menu is there: the map may be drawn anew between a look at it and the click."""
        until = time.monotonic() + 120.0
        while True:
            self.page.mouse.click(*self.middle(first, second))
            self.page.wait_for_timeout(500)
            if self.page.get_by_role("menuitem", name="cut", exact=True).count():
                return
            assert time.monotonic() < until, self.page.inner_text("#verdict")
            self.page.keyboard.press("Escape")

    def target(self) -> tuple[float, float]:
        """The place of the target in the window."""
        x, y = self.page.evaluate(
            """(() => { const box = lab.map.canvas.getBoundingClientRect();
            const [x, y] = lab.map.pixel(lab.map.arrays.truth); return [box.left + x, box.top + y]; })()"""
        )
        return x, y

    def link(self, source: int, destination: int) -> str:
        """An expression for what came and was lost on a link in the step that is shown."""
        row = f"lab.state.scene.links.findIndex(([s, d]) => s === {source} && d === {destination})"
        return f"(([c, l]) => ({{came: c, lost: l}}))(lab.state.frame.arrays.links.subarray(4 * {row}, 4 * {row} + 2))"

    def close(self) -> None:
        self.page.close()
        self.lab.terminate()
        self.lab.communicate(timeout=100)


def held_at(opened: Opened) -> tuple[int | None, int | None]:
    """Where the held run itself stands: the step that it began last, and the round after which it stands in it."""
    opened.until(STANDS)
    with Operator(*reach(opened.page.evaluate("lab.state.scene.run")), patience=100.0) as operator:
        told = operator.hold(on=True)
    return told["step"], told["round"]


def held_and_taken_on_by_steps(opened: Opened) -> None:
    """The run stands still, takes a single step and single rounds, and goes on."""
    page = opened.page
    page.click("#hold")
    opened.until("lab.state.held && document.querySelector('#hold').textContent === 'Let run go on'")
    opened.until("document.querySelector('#clock').ariaLive === 'polite'")
    stood, _ = held_at(opened)
    assert stood is not None
    opened.until(f"lab.state.newest === {stood}")
    page.keyboard.press("ArrowRight")
    opened.until(f"lab.state.newest === {stood + 1}")
    assert held_at(opened) == (stood + 1, None)
    clock = "document.querySelector('#clock').textContent"
    for round_ in (1, 2):
        page.keyboard.press("r")
        opened.until(f"{clock}.includes('step {stood + 2} of 100000, run held after round {round_} of 3')")
    assert held_at(opened) == (stood + 2, 2)
    page.keyboard.press("r")
    opened.until(f"lab.state.newest === {stood + 2} && !{clock}.includes('round')")
    page.keyboard.press("r")
    opened.until(f"{clock}.includes('step {stood + 3} of 100000, run held after round 1 of 3')")
    page.keyboard.press("ArrowRight")
    opened.until(f"lab.state.newest === {stood + 3}")
    page.keyboard.press("r")
    opened.until(f"{clock}.includes('step {stood + 4} of 100000, run held after round 1 of 3')")
    page.keyboard.press("h")
    opened.until(f"lab.state.newest > {stood + 4}")
    opened.until("document.querySelector('#clock').ariaLive === 'off'")


def touched_by_keyboard(opened: Opened) -> None:
    """A link loses messages, two agents are parted from the others, the target is sent down: all without a mouse."""
    page = opened.page
    # Orders by keyboard: the menu of an agent leads to those of its links.
    page.focus("#agents button")
    page.keyboard.press("Enter")
    page.get_by_role("menuitem", name=re.compile("^link to ")).first.press("Enter")
    page.locator("#menu input").first.fill("60")
    page.locator("#menu input").first.press("Enter")
    opened.until("document.querySelector('#faults').textContent.includes('loss 60 %')")
    # A partition by keyboard: one side is chosen at the agents' buttons.
    page.focus("#agents button:first-child")
    page.keyboard.press("Enter")
    page.get_by_role("menuitem", name="part it and others").press("Enter")
    page.keyboard.press("Tab")
    page.keyboard.press(" ")
    opened.until("document.querySelector('#side output').textContent === 'choose agents to cut off: 0, 1'")
    opened.until("document.querySelectorAll('#agents button[aria-pressed=true]').length === 2")
    page.keyboard.press("s")
    page.keyboard.press("p")
    opened.until("document.querySelector('#verdict').textContent.includes('2 parts')")
    opened.until("document.querySelector('#side').hidden")


def finished_log(folder: Path) -> Path:
    """The log of the only run: the page says that a run has ended before its recorder has written all."""
    [log] = until(lambda: list(folder.glob("lab-*/run.mcap")), "the recorder does not end")
    return log


def test_a_run_is_started_cut_by_mouse_healed_steered_ended_exported_and_proved(world, browser):
    keys = ("steps=100000", "consensus.rounds=3", "target.motion=manual")
    opened = Opened(world, browser, "tracking", *(part for key in keys for part in ("--set", key)))
    page = opened.page
    first, second = page.evaluate("lab.state.scene.links[0]")
    opened.menu_of_link(first, second)
    page.get_by_role("menuitem", name="cut", exact=True).click()
    opened.until(f"{opened.link(first, second)}.came === 0 && {opened.link(first, second)}.lost === 3")
    opened.until("document.querySelector('#faults li')?.textContent.startsWith('partition of')")
    opened.until(f"lab.colour({first}, {second}) === lab.map.colours.lost")
    opened.until("lab.curves.values.lost.at(-1) > 0")
    page.click("#undo")
    opened.until(f"{opened.link(first, second)}.came === 3")
    opened.until("lab.curves.values.lost.at(-1) === 0")
    opened.until(f"lab.colour({first}, {second}) === lab.map.colours.good")
    page.mouse.move(*opened.target())
    page.mouse.down()
    x, y = opened.target()
    page.mouse.move(x + 60, y - 40, steps=5)
    page.mouse.up()
    opened.until("Math.hypot(...lab.state.frame.arrays.truth.subarray(0, 2)) > 0.5")
    held_and_taken_on_by_steps(opened)
    touched_by_keyboard(opened)
    page.click("#stop")
    opened.until("lab.state.state === 'ended'")
    opened.until("document.querySelector('#notice').textContent.startsWith('the run has ended')")
    with page.expect_download() as download:
        page.click("#export")
    session = parse(read_toml(download.value.path().read_text()), "the session")
    assert [one.kind for one in session.fault] == ["partition", "loss", "partition"]
    assert session.fault[2].model_dump()["links"]["between"] == ((0, 1), (2, 3, 4, 5))
    *_, dragged, nudged = [order.to for order in session.target.orders]
    assert dragged[0] > 0.5
    assert nudged[1] < dragged[1]
    log = finished_log(world.folder / "logs")
    world.verdict(log=log)
    trace = read_trace(log)
    steps = len(trace.time)
    again = simulate([session.changed(steps=steps)])[0]
    assert np.array_equal(again.estimates, trace.estimates, equal_nan=True)
    assert opened.complaints == []
    assert {url.split("/")[2] for url in opened.loaded if not url.startswith("data:")} == {opened.url.split("/")[2]}
    opened.close()


def test_a_log_is_wound_back_and_a_lost_server_is_said(world, browser):
    world.complete("steps=60", 'fault=[{kind="outage", agents=[2], from=3.0, until=4.0}]')
    opened = Opened(world, browser, str(world.log))
    page = opened.page
    opened.until("lab.state.frame.step === 60")
    page.keyboard.press("ArrowLeft")
    opened.until("lab.state.frame.step === 59")
    page.fill("#step", "35")
    opened.until("lab.state.frame.step === 35 && document.querySelector('#verdict').textContent.includes('2 parts')")
    # The page draws its side panels after the map, in a frame of their own.
    opened.until("document.querySelector('#faults li')?.dataset.on === 'true'")
    opened.until("document.querySelector('#clock').textContent.includes('step 35 of 60')")
    page.keyboard.press("r")
    opened.until("document.querySelector('#clock').textContent.includes('step 35 of 60, round 1 of ')")
    opened.until("/[x-]/.test(lab.state.frame.marks.join(''))")
    page.keyboard.press("Home")
    opened.until("lab.state.frame.step === 1")
    opened.until("document.documentElement.scrollHeight <= innerHeight")
    page.set_viewport_size({"width": 390, "height": 844})
    opened.until("document.documentElement.scrollWidth <= innerWidth")
    # Playing ends at the last step.
    page.select_option("#speed", "50")
    page.keyboard.press(" ")
    opened.until("lab.state.frame.step === 60 && !lab.state.plays")
    assert opened.complaints == []
    opened.lab.terminate()
    opened.lab.communicate(timeout=100)
    opened.until("document.querySelector('#notice').textContent.includes('server is gone')")
    # The next lab at this port has another token.
    port = opened.url.split(":")[2].split("/")[0]
    again = world.start("lab", str(world.log), "--no-browser", "--port", port)
    opened.until("document.querySelector('#notice').textContent.includes('started again')")
    again.terminate()
    again.communicate(timeout=100)
    opened.close()


OUT_AND_BACK = (
    'target.motion="waypoints"',
    "target.waypoints=[[0, 0, 5], [0, 90, 5], [0, 0, 5]]",
    "target.speed=30.0",
    "steps=58",
)
IN_VIEW = """({map, way}) => way.length > 20 && way.every((one) => { const [x, y] = map.pixel(one);
return x > 20 && y > 20 && x < map.width - 20 && y < map.height - 20; })"""
"""Whether all places of a way are on the map, and not at its rim."""


def test_a_report_opens_with_all_of_the_targets_way_in_view(tmp_path, browser):
    log = made_log(tmp_path / "run.mcap", *OUT_AND_BACK)
    write_report(analyze([read_trace(log)])[0], tmp_path / "report.html")
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(f"file://{tmp_path / 'report.html'}")
    page.wait_for_function(f"globalThis.replay && ({IN_VIEW})({{map: replay.map, way: replay.way()}})")
    page.evaluate("replay.map.zoom(5, 0, 0); replay.draw()")
    page.click("#fit")
    page.wait_for_function(f"({IN_VIEW})({{map: replay.map, way: replay.way()}})")
    page.close()


def test_the_lab_opens_with_the_targets_last_way_in_view(world, browser):
    world.complete(*OUT_AND_BACK)
    opened = Opened(world, browser, str(world.log))
    opened.until("lab.state.frame.step === 58")
    opened.until(f"({IN_VIEW})({{map: lab.map, way: lab.trails.truth}})", seconds=20.0)
    assert opened.complaints == []
    opened.close()


def test_a_report_plays_its_run_on_a_map_with_a_verdict_and_shows_each_link_over_time(tmp_path, browser):
    fault = 'fault=[{kind="partition", links={between=[[0, 1], [2, 3]]}, from=2.0, until=3.0}]'
    log = made_log(tmp_path / "run.mcap", "steps=40", "agents.count=4", "network.graph=complete", fault)
    write_report(analyze([read_trace(log)])[0], tmp_path / "report.html")
    page = browser.new_page(viewport={"width": 390, "height": 844}, color_scheme="dark")
    page.set_default_timeout(120_000)
    complaints: list[str] = []
    page.on("pageerror", lambda one: complaints.append(str(one)))
    page.goto(f"file://{tmp_path / 'report.html'}")
    page.wait_for_function("globalThis.replay && document.querySelector('.js-plotly-plot')")
    assert page.evaluate("replay.count") == 40

    def shows(where: str, what: str) -> None:
        page.wait_for_function(f"document.querySelector('{where}').textContent.startsWith('{what}')")

    page.fill("#moment", "26")
    shows("#verdict", "the network is in 2 parts")
    shows("#clock", "2.7 s, step 27")
    page.wait_for_function("replay.map.shown.get('0 2') === replay.map.colours.lost")
    page.wait_for_function("replay.map.shown.get('0 1') === replay.map.colours.good")
    page.keyboard.press("Tab")
    page.locator("#map").press("ArrowLeft")
    shows("#clock", "2.6 s, step 26")
    box = page.locator("canvas[data-what=lost]").bounding_box()
    assert box is not None
    page.locator("canvas[data-what=lost]").click(position={"x": 0.1 * box["width"], "y": 2})
    shows("#clock", "0.5 s, step 5")
    page.wait_for_function("document.documentElement.scrollWidth <= innerWidth")
    page.set_viewport_size({"width": 1280, "height": 800})
    assert page.locator(".pair .scroll").evaluate_all("all => all.every(one => one.scrollWidth <= one.clientWidth)")
    # Windows that leave hardly any map, or none.
    for width in (100, 40):
        page.set_viewport_size({"width": width, "height": 300})
        page.evaluate("replay.draw()")
    assert complaints == []
    page.close()
