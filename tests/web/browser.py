# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium that a test drives through a pipe, with the DevTools protocol."""
import functools
import http.server
import json
import os
import select
import subprocess
import sys
import tempfile
import threading
import time

from browser_page import BrowserPage

CHROMIUM = "/usr/bin/chromium"
FLAGS = ["--headless=new", "--no-sandbox", "--disable-gpu-sandbox", "--use-angle=swiftshader",
         "--enable-unsafe-swiftshader", "--no-first-run", "--hide-scrollbars",
         "--remote-debugging-pipe"]
TIMEOUT = 60  # seconds of a command
STARTUP_TIMEOUT = 120  # seconds


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


# Starts Chromium, which reads commands from descriptor 3 and writes replies to 4.
START = """import fcntl, os, sys
copies = [fcntl.fcntl(int(descriptor), fcntl.F_DUPFD, 10) for descriptor in sys.argv[1:3]]
for copy, descriptor in zip(copies, (3, 4)):
    os.dup2(copy, descriptor)
os.execv(sys.argv[3], sys.argv[3:])"""


class Browser(BrowserPage):
    """One page. `evaluate` raises RuntimeError if the script throws. `flags`: more options of Chromium."""

    def __init__(self, flags=()):
        self.profile = tempfile.TemporaryDirectory(prefix="stgs-chromium-",
                                                   ignore_cleanup_errors=True)
        to_browser, self.output = os.pipe()
        self.input, from_browser = os.pipe()

        self.process = subprocess.Popen(
            [sys.executable, "-c", START, str(to_browser), str(from_browser), CHROMIUM, *FLAGS, *flags, f"--user-data-dir={self.profile.name}", "about:blank"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            pass_fds=(to_browser, from_browser), start_new_session=True)
        os.close(to_browser)
        os.close(from_browser)
        self.buffer = b""
        self.next_id = 1
        self.session = None
        self.problems = []  # exceptions and errors that the page logged
        self.attach()

    def attach(self):
        end = time.monotonic() + STARTUP_TIMEOUT
        pages = []
        while not pages and time.monotonic() < end:
            targets = self.send("Target.getTargets")["targetInfos"]
            pages = [target for target in targets if target["type"] == "page"]
        target = pages[0]["targetId"]
        reply = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self.session = reply["sessionId"]
        self.send("Page.enable")
        self.send("Runtime.enable")

    def send(self, method, **parameters):
        message = {"id": self.next_id, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        self.next_id += 1
        os.write(self.output, json.dumps(message).encode() + b"\0")
        while True:
            reply = self.receive()
            if reply.get("id") == message["id"]:
                if "error" in reply:
                    raise RuntimeError(f"{method}: {reply['error']['message']}")
                return reply["result"]
            self.note(reply)

    def receive(self):
        end = time.monotonic() + (TIMEOUT if self.session else STARTUP_TIMEOUT)
        while b"\0" not in self.buffer:
            wait = end - time.monotonic()
            if wait <= 0 or not select.select([self.input], [], [], wait)[0]:
                raise TimeoutError("Chromium did not answer")
            data = os.read(self.input, 1 << 20)
            if not data:
                raise RuntimeError("Chromium ended")
            self.buffer += data
        message, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(message)

    def note(self, event):
        parameters = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self.problems.append(details.get("exception", {}).get("description", details["text"]))
        elif event.get("method") == "Runtime.consoleAPICalled" and parameters["type"] == "error":
            self.problems.append(str([item.get("value") for item in parameters["args"]]))

    def open(self, url):
        self.send("Page.navigate", url=url)
        self.wait_for("document.readyState === 'complete' && location.href !== 'about:blank'")

    def evaluate(self, script):
        reply = self.send("Runtime.evaluate", expression=script, awaitPromise=True,
                          returnByValue=True, userGesture=True)
        if "exceptionDetails" in reply:
            details = reply["exceptionDetails"]
            raise RuntimeError(details.get("exception", {}).get("description", details["text"]))
        return reply["result"].get("value")

    def resize(self, width, height, ratio=1, mobile=False):
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=ratio, mobile=mobile)

    def set_reduced_motion(self, reduced):
        value = "reduce" if reduced else ""
        self.send("Emulation.setEmulatedMedia",
                  features=[{"name": "prefers-reduced-motion", "value": value}])

    def mouse(self, kind, x, y, buttons=0, delta=None):
        more = {"button": "left", "clickCount": 1} if kind != "mouseMoved" else {}
        if kind == "mouseWheel":
            more = {"deltaX": 0, "deltaY": delta}
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, buttons=buttons, **more)

    def click(self, x, y):
        self.mouse("mouseMoved", x, y)
        self.mouse("mousePressed", x, y, 1)
        self.mouse("mouseReleased", x, y)

    def drag(self, begin, end, steps=5):
        self.mouse("mouseMoved", *begin)
        self.mouse("mousePressed", *begin, 1)
        for step in range(1, steps + 1):
            x, y = (a + (b - a) * step / steps for a, b in zip(begin, end))
            self.mouse("mouseMoved", x, y, 1)
        self.mouse("mouseReleased", *end)

    def touch(self, kind, *points):
        self.send("Input.dispatchTouchEvent", type=kind,
                  touchPoints=[{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)])

    def press(self, key, code=None, modifiers=0):
        """Presses and releases a key; `modifiers`: 8 is shift."""
        text = {"text": key} if len(key) == 1 else {}
        if key == "Enter":
            text = {"text": "\r"}
        keys = {"key": key, "code": code or key, "modifiers": modifiers}
        self.send("Input.dispatchKeyEvent", type="keyDown", **keys, **text)
        self.send("Input.dispatchKeyEvent", type="keyUp", **keys)

    def screenshot_data(self):
        return self.send("Page.captureScreenshot", format="png")["data"]

    def close(self):
        super().close()
        os.close(self.output)
        os.close(self.input)
