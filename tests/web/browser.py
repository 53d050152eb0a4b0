# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium that a test drives with Playwright."""
import functools
import http.server
import json
import os
import select
import shutil
import subprocess
import sys
import threading
import time

from browser_page import BrowserPage

HERE = os.path.dirname(os.path.abspath(__file__))
DRIVER = os.path.join(HERE, "browser_driver.mjs")
PLAYWRIGHT = os.path.join(HERE, "..", "..", "build", "npm", "node_modules", "playwright-core")
CHROMIUM = "/usr/bin/chromium"
FLAGS = ["--disable-gpu-sandbox", "--use-angle=swiftshader"]
TIMEOUT = 60  # seconds of a command
STARTUP_TIMEOUT = 120  # seconds


def require(*programs):
    """Exits with code 77, which skips the test, if Chromium, its driver or a program is missing."""
    missing = [program for program in ("node", *programs) if shutil.which(program) is None]
    if not os.path.exists(CHROMIUM):
        missing.append("chromium")
    if not os.path.exists(PLAYWRIGHT):
        missing.append("npm's playwright-core (run tools/setup/npm.sh)")
    if missing:
        print("skipped: needs", " and ".join(missing))
        sys.exit(77)


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


class Server:
    """Serves a folder on the loopback interface."""

    def __init__(self, folder):
        handler = functools.partial(QuietHandler, directory=folder)
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()


class Browser(BrowserPage):
    """One page. `evaluate` raises RuntimeError if the script throws. `flags`: more options of Chromium."""

    def __init__(self, flags=()):
        self.problems = []  # exceptions and errors that the page logged
        self.buffer = b""
        self.last_id = 0
        self.process = subprocess.Popen(["node", DRIVER, CHROMIUM, *FLAGS, *flags], bufsize=0,
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        try:
            self.receive(STARTUP_TIMEOUT)
        except BaseException:
            self.close()
            raise

    def call(self, method, *arguments):
        """Calls a method of an object of Playwright (browser_driver.mjs) and returns its value."""
        self.last_id += 1
        message = {"id": self.last_id, "method": method, "arguments": arguments}
        try:
            self.process.stdin.write(json.dumps(message).encode() + b"\n")
        except BrokenPipeError:
            pass  # read() reports the end of the driver
        return self.receive(TIMEOUT)

    def receive(self, seconds):
        """Returns the value of the reply to the last call, or raises RuntimeError."""
        end = time.monotonic() + seconds
        reply = {}
        while reply.get("id") != self.last_id:
            while b"\n" not in self.buffer:
                self.read(end)
            line, self.buffer = self.buffer.split(b"\n", 1)
            reply = json.loads(line)
            self.problems += reply["problems"]
        if "error" in reply:
            raise RuntimeError(reply["error"])
        return reply.get("value")

    def read(self, end):
        wait = end - time.monotonic()
        if wait <= 0 or not select.select([self.process.stdout], [], [], wait)[0]:
            raise TimeoutError("Chromium did not answer")
        data = self.process.stdout.read(1 << 20)
        if not data:
            raise RuntimeError(f"the driver of Chromium ended with code {self.process.wait()}")
        self.buffer += data

    def send(self, method, **parameters):
        """Sends a DevTools command to the page. Playwright has no method for these."""
        return self.call("session.send", method, parameters)

    def open(self, url):
        self.call("page.goto", url)

    def evaluate(self, script):
        return self.call("page.evaluate", script)

    def resize(self, width, height, ratio=1, mobile=False):
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=ratio, mobile=mobile)

    def set_reduced_motion(self, reduced):
        self.call("page.emulateMedia", {"reducedMotion": "reduce" if reduced else "no-preference"})

    def move(self, x, y):
        self.call("mouse.move", x, y)

    def wheel(self, delta):
        self.call("mouse.wheel", 0, delta)

    def click(self, x, y):
        self.call("mouse.click", x, y)

    def drag(self, begin, end, steps=5):
        self.move(*begin)
        self.call("mouse.down")
        self.call("mouse.move", *end, {"steps": steps})
        self.call("mouse.up")

    def touch(self, kind, *points):
        self.send("Input.dispatchTouchEvent", type=kind,
                  touchPoints=[{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)])

    def press(self, key):
        """Presses and releases a key, or several as in Shift+ArrowRight."""
        self.call("keyboard.press", key)

    def screenshot_data(self):
        # Playwright's method ignores the ratio of resize().
        return self.send("Page.captureScreenshot", format="png")["data"]

    def close(self):
        """Ends the driver, which kills Chromium."""
        self.process.stdin.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            pass
        super().close()
        self.process.stdout.close()
