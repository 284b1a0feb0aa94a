"""Chromium without a window, for the tests of a page's viewer."""

import os
import shutil
from contextlib import contextmanager

import pytest

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
)


@contextmanager
def chromium(profile):
    """A browser with a profile folder of its own; the test is skipped where there is none."""
    programs = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
    missing = [name for name, path in programs.items() if path is None]
    if missing:
        pytest.skip(f"{' and '.join(missing)} missing: Debian packages chromium and chromium-driver")
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = programs["chromium"]
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    # a path of its own: else selenium looks for drivers, in the network too
    service = Service(programs["chromedriver"], log_output=os.devnull)
    driver = webdriver.Chrome(options=options, service=service)
    try:
        yield Browser(driver)
    finally:
        driver.quit()


class Browser:
    """What tests do with a page."""

    def __init__(self, driver):
        self.driver = driver
        self.driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})

    def busy(self):
        """Processor's time of the page's main thread so far [s]."""
        metrics = self.driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
        return next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration")

    def open(self, file, width=1280, height=900):
        self.resize(width, height)
        self.driver.get(file.as_uri())
        # the viewer expands its data first
        self.wait("!document.getElementById('viewer-data') || performance.getEntriesByName('viewer-ready').length")
        self.settle()

    def resize(self, width, height):
        values = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", values)

    def media(self, media="", scheme="light"):
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media, "features": features})

    def run(self, script, *arguments):
        return self.driver.execute_script(script, *arguments)

    def settle(self):
        """Wait until two frames are drawn."""
        self.driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")

    def wait(self, script, seconds=5.0):
        """Wait until an expression is true."""
        code = (
            "const [test, limit, done] = arguments; const start = performance.now(); const check = () => {"
            "const value = eval(test); if (value || performance.now() - start > limit) done(Boolean(value));"
            "else requestAnimationFrame(check);}; check();"
        )
        assert self.driver.execute_async_script(code, script, 1e3 * seconds), script

    def mouse(self, kind, x, y, modifiers=0, **values):
        parameters = {"type": kind, "x": x, "y": y, "modifiers": modifiers, **values}
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", parameters)
        self.settle()

    def click(self, x, y, count=1):
        self.mouse("mouseMoved", x, y)
        for press in range(1, count + 1):
            for kind in ("mousePressed", "mouseReleased"):
                self.mouse(kind, x, y, button="left", clickCount=press)

    def drag(self, begin, end, modifiers=0):
        self.mouse("mouseMoved", *begin, modifiers)
        self.mouse("mousePressed", *begin, modifiers, button="left", clickCount=1)
        self.mouse("mouseMoved", *end, modifiers, button="left", buttons=1)
        self.mouse("mouseReleased", *end, modifiers, button="left", clickCount=1)

    def key(self, name, shift=False, presses=1):
        for kind in ("keyDown", "keyUp") * presses:
            values = {"type": kind, "key": name, "code": name, "modifiers": 8 if shift else 0}
            codes = {
                "ArrowLeft": 37,
                "ArrowUp": 38,
                "ArrowRight": 39,
                "ArrowDown": 40,
                "Home": 36,
                "End": 35,
                "Escape": 27,
            }
            values |= {"windowsVirtualKeyCode": codes[name]}
            self.driver.execute_cdp_cmd("Input.dispatchKeyEvent", values)
        self.settle()

    def box(self, selector):
        """Left, top, width and height in the window of an element, which is scrolled to."""
        found = "const e = document.querySelector(arguments[0]);"
        self.run(f"{found} e.scrollIntoView({{block: 'center', behavior: 'instant'}});", selector)
        rectangle = f"{found} const b = e.getBoundingClientRect(); return [b.left, b.top, b.width, b.height];"
        before = None
        # what the page does when it is scrolled may move the element
        while (place := self.run(rectangle, selector)) != before:
            before = place
            self.settle()
        return place

    def text(self, selector):
        return self.run("return document.querySelector(arguments[0]).textContent", selector)

    def messages(self):
        """Messages on the console since the last call."""
        messages = [entry["message"] for entry in self.driver.get_log("browser")]
        # without a graphics card the browser reads each picture back, and says that this is slow
        return [message for message in messages if "GPU stall due to ReadPixels" not in message]
