"""The page in a real browser: no error, no request, and every control does something."""

import json

import pytest

from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.pages.report import report_page
from tests.pages.browser import open_browser, until

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    driver = open_browser()
    folder = tmp_path_factory.mktemp("page")
    asked = [
        "run",
        "three_satellite",
        "--trials",
        "9",
        "--estimator",
        "iekf",
        "--estimator",
        "ukf",
        "--keep",
        "covariance",
    ]
    with pytest.raises(SystemExit) as ended:
        main([*asked, "--set", "duration_s=20", "--out", str(folder / "three")])
    assert ended.value.code == 0
    (folder / "three.html").write_text(report_page(folder / "three"))
    driver.get(f"file://{folder / 'three.html'}")
    until(lambda: driver.execute_script("return document.documentElement.dataset.ready"))
    yield driver
    driver.quit()


def element(browser, name):
    from selenium.webdriver.common.by import By

    found = browser.find_element(By.ID, name)
    browser.execute_script("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", found)
    return found


def drawn(browser, name):
    """What a plot shows, as text; the plot is drawn when it comes into the window."""
    element(browser, name)
    script = f"const p = document.getElementById('{name}'); return p.data ? JSON.stringify([p.data, p.layout]) : null"
    return until(lambda: browser.execute_script(script))


def test_it_opens_in_less_than_two_seconds(browser):
    """In processor time of the page, which other work on the machine does not lengthen: until the first plot is drawn.

    A browser of its own, so that nothing of the page is compiled yet.
    """
    fresh = open_browser()
    try:
        fresh.execute_cdp_cmd("Performance.enable", {})

        def spent():
            told = fresh.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
            return next(one["value"] for one in told if one["name"] == "ProcessTime")

        before = spent()
        fresh.get(browser.current_url)
        until(lambda: fresh.execute_script("return document.documentElement.dataset.drawn"))
        assert spent() - before < 2.0
    finally:
        fresh.quit()


def test_no_error_and_no_request(browser):
    assert browser.execute_script("return document.documentElement.dataset.ready") == "yes"
    for name in ("error-plot", "consistency-plot", "view-0", "view-1", "ends-plot", "trial-ground", "trial-error"):
        assert drawn(browser, name)
    assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []
    sent = [json.loads(line["message"])["message"] for line in browser.get_log("performance")]
    urls = [one["params"]["request"]["url"] for one in sent if one["method"] == "Network.requestWillBeSent"]
    assert [url for url in urls if not url.startswith(("file:", "data:", "blob:"))] == []


@pytest.mark.parametrize(
    ("control", "plot"),
    [
        ("error-log", "error-plot"),
        ("error-bounds", "error-plot"),
        ("error-median", "error-plot"),
        ("consistency-log", "consistency-plot"),
        ("trial-worst", "trial-ground"),
        ("trial-best", "trial-error"),
    ],
)
def test_a_click_changes_the_plot(browser, control, plot):
    before = drawn(browser, plot)
    element(browser, control).click()
    until(lambda: drawn(browser, plot) != before, 10)


@pytest.mark.parametrize(
    ("control", "plot"),
    [("quantity", "error-plot"), ("consistency-kind", "consistency-plot"), ("trial-estimator", "trial-error")],
)
def test_a_choice_changes_the_plot(browser, control, plot):
    from selenium.webdriver.support.select import Select

    before = drawn(browser, plot)
    Select(element(browser, control)).select_by_index(1)
    until(lambda: drawn(browser, plot) != before, 10)


def test_any_trial_by_its_number(browser):
    before = drawn(browser, "trial-error")
    box = element(browser, "trial-number")
    box.clear()
    box.send_keys("4")
    until(lambda: "trial 4" in element(browser, "trial-note").text, 10)
    assert drawn(browser, "trial-error") != before
    box.clear()
    box.send_keys("400")
    until(lambda: "not on this page" in element(browser, "trial-note").text, 10)


def test_diagram_and_scenario_are_searched(browser):
    element(browser, "diagram-find").send_keys("sensor")
    until(lambda: "found" in element(browser, "diagram-found").text, 10)
    assert browser.execute_script("return document.querySelectorAll('#diagram-svg text.hit').length") >= 1
    wide = "return document.getElementById('diagram-svg').getBoundingClientRect().width"
    before = browser.execute_script(wide)
    element(browser, "diagram-in").click()
    assert browser.execute_script(wide) > before
    element(browser, "diagram-fit").click()
    assert browser.execute_script(wide) == pytest.approx(before, abs=20)  # a scroll bar may come and go
    element(browser, "scenario-find").send_keys("sigma_tdoa_ns")
    shown = "return [...document.querySelectorAll('.line')].filter(l => l.offsetParent !== null).length"
    until(lambda: 1 <= browser.execute_script(shown) < 5, 10)


def test_on_a_phone_nothing_sticks_out(browser):
    metrics = {"width": 380, "height": 800, "deviceScaleFactor": 2, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        until(lambda: browser.execute_script("return document.documentElement.scrollWidth") <= 380, 10)
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_in_the_dark(browser):
    dark = {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", dark)
    try:
        color = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
        assert sum(map(int, color.removeprefix("rgb(").removesuffix(")").split(","))) < 150
        script = "return document.getElementById('error-plot').layout.paper_bgcolor"
        until(lambda: browser.execute_script(script) == "#14181d", 10)
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_tables_fit_on_a_desktop_and_on_paper(browser):
    widths = "return [...document.querySelectorAll('.wide:has(table)')].map((b) => [b.scrollWidth, b.clientWidth])"
    for width, media in ((1280, ""), (718, "print")):  # of an A4 sheet without its margins
        metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media})
        try:
            found = browser.execute_script(widths)
            assert found and all(needed <= there for needed, there in found), (media, found)
        finally:
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
            browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_ticks_of_a_logarithm_are_whole_numbers(browser):
    drawn(browser, "error-plot")
    if not element(browser, "error-log").is_selected():
        element(browser, "error-log").click()
    script = "return [...document.querySelectorAll('#error-plot .ytick text')].map((text) => Number(text.textContent))"
    ticks = browser.execute_script(script)
    low, high = browser.execute_script("return document.getElementById('error-plot')._fullLayout.yaxis.range")
    assert ticks and all(10**low <= tick <= 10**high for tick in ticks), (ticks, low, high)


def test_names_of_platforms_do_not_lie_on_each_other(browser):
    drawn(browser, "view-0")
    script = """return [...document.querySelectorAll('#view-0 .textpoint text')]
        .filter((text) => text.textContent)
        .map((text) => [text.textContent, text.getBoundingClientRect()])
        .map(([said, box]) => [said, box.left, box.right, box.top, box.bottom])"""
    found = browser.execute_script(script)
    assert {name for text, *_ in found for name in text.split(", ")} == {f"satellite_{i}" for i in range(3)}
    for i, (_, left, right, top, bottom) in enumerate(found):
        for _, its_left, its_right, its_top, its_bottom in found[:i]:
            assert right < its_left or its_right < left or bottom < its_top or its_bottom < top, found
